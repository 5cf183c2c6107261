"""Terms: the assumptions of a policy's contract on its robot and the loop, spelled out for other runtimes.

A policy file carries them beside its contract. Surefoot itself has a description of the robot and reads nothing from
them; a stranger needs no other source than the file and docs/policy-file.md.
"""

from __future__ import annotations

from typing import Any

from surefoot.rates import CONTROL_HZ
from surefoot.robots import Robot
from surefoot.robots.data_sheet import data_sheet
from surefoot.task.contract import Contract

VERSION = 1
"""Of the terms; a term is only ever added, unless this number is raised."""


def terms(robot: Robot, contract: Contract) -> dict[str, Any]:
    """Return the terms of a policy for a robot as plain values for JSON; docs/policy-file.md explains each."""
    of_loop = {"version": VERSION, "network": _network(contract), "loop": _loop(contract), "units": _units(robot)}
    return of_loop | data_sheet(robot)


def _network(contract: Contract) -> dict[str, Any]:
    """Names, types and sizes of what goes in and comes out."""
    return {
        "input": {"name": "observation", "type": "float32", "shape": ["robots", contract.num_inputs]},
        "output": {"name": "action", "type": "float32", "shape": ["robots", len(contract.joints)]},
    }


def _loop(contract: Contract) -> dict[str, Any]:
    """The timing that the rates of the contract leave open."""
    return {
        "observation_age_ticks": 1,
        "filter_start": "steady state of the first observation",
        "first_target": "angles that the motors hold before the first policy step",
        "target_ticks": contract.control_hz // contract.policy_hz,
        "explicit_joint_law_hz": 2 * CONTROL_HZ,
        "attitude": "roll and pitch of the root's Z-Y-X Euler angles: Rz(yaw) Ry(pitch) Rx(roll)",
        "foot_force": "component of the floor's force on a foot along the world's z axis",
    }


def _units(robot: Robot) -> dict[str, Any]:
    """Units of the observation's parts that are not SI units."""
    return {"joint_velocity": robot.velocity_limit.tolist(), "foot_force": robot.load_unit}
