"""Data sheet: the facts of a robot that a runtime elsewhere needs, as plain values for JSON."""

from __future__ import annotations

from typing import Any

import mujoco

from surefoot.robots.model import SOLES, STALL, TORSO
from surefoot.robots.robot import Robot


def data_sheet(robot: Robot) -> dict[str, Any]:
    """Return joints, bodies, points, masses and motors of a robot; docs/policy-file.md explains each key."""
    model = robot.model()
    return {
        "bodies": [_body(model, number) for number in range(1, model.nbody)],
        "joints": [_joint(robot, model, name) for name in robot.joint_names],
        "held_joints": dict(robot.held_joints),
        "root": robot.root,
        "torso": _site(model, TORSO),
        "soles": [_site(model, name) | {"half_size": robot.sole_half_size.tolist()} for name in SOLES],
        "mass": robot.mass,
        "gravity": robot.gravity,
        "motors": {"stall_torque_ratio": STALL},
    }


def _body(model: mujoco.MjModel, number: int) -> dict[str, Any]:
    """Where a body lies in its parent with all joints at zero, and what it weighs."""
    body = model.body(number)
    return {
        "name": body.name,
        "parent": model.body(int(body.parentid[0])).name,
        "place": body.pos.tolist(),
        "quaternion": body.quat.tolist(),
        "mass": float(body.mass[0]),
        "centre_of_mass": body.ipos.tolist(),
    }


def _joint(robot: Robot, model: mujoco.MjModel, name: str) -> dict[str, Any]:
    joint = model.joint(name)
    body, dof, index = int(joint.bodyid[0]), int(joint.dofadr[0]), robot.joint_names.index(name)
    return {
        "name": name,
        "body": model.body(body).name,
        "parent": model.body(int(model.body_parentid[body])).name,
        "axis": joint.axis.tolist(),
        "anchor": joint.pos.tolist(),
        "lower": float(robot.joint_lower[index]),
        "upper": float(robot.joint_upper[index]),
        "armature": float(model.dof_armature[dof]),
        "damping": float(model.dof_damping[dof]),
        "friction": float(model.dof_frictionloss[dof]),
    }


def _site(model: mujoco.MjModel, name: str) -> dict[str, Any]:
    """A point and its axes in the frame of its body."""
    site = model.site(name)
    return {"body": model.body(int(site.bodyid[0])).name, "place": site.pos.tolist(), "quaternion": site.quat.tolist()}
