"""Observation: what the policy sees, as an ordered table of named, heading-invariant quantities.

The vector of Yang et al. 2018, section IV-C, in R^47: positions are relative to the pelvis, and every vector is
turned into the heading frame (the world turned by the pelvis yaw). Units: rad, m, m/s, rad/s; joint velocities as a
share of their limit, foot forces in units of 800 N. The functions give SI units, the table the unit to divide by:
the policy needs one filtered vector per step, so that the division waits until after the filter.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from surefoot.robot import Robot
from surefoot.simulation import Ticks

FOOT_FORCE_UNIT = 800.0


def joint_position(ticks: Ticks) -> np.ndarray:
    return ticks.joint_position


def joint_velocity(ticks: Ticks) -> np.ndarray:
    return ticks.joint_velocity


def pelvis_velocity(ticks: Ticks) -> np.ndarray:
    return ticks.in_heading("pelvis_velocity")


def pelvis_angular_velocity(ticks: Ticks) -> np.ndarray:
    return ticks.in_heading("pelvis_angular_velocity")


def pelvis_attitude(ticks: Ticks) -> np.ndarray:
    return np.moveaxis(ticks.pelvis_attitude, 0, -1)


def com_velocity(ticks: Ticks) -> np.ndarray:
    return ticks.in_heading("com_velocity")


def com_position(ticks: Ticks) -> np.ndarray:
    return ticks.in_heading("com_position")


def foot_force(ticks: Ticks) -> np.ndarray:
    return ticks.foot_force


def torso_position(ticks: Ticks) -> np.ndarray:
    return ticks.in_heading("torso_position")


def left_foot_position(ticks: Ticks) -> np.ndarray:
    return ticks.in_heading("left_sole_position")


def right_foot_position(ticks: Ticks) -> np.ndarray:
    return ticks.in_heading("right_sole_position")


_XYZ = ("x", "y", "z")


class Quantity(NamedTuple):
    """A named part of the observation vector.

    Attributes:
        function: from ticks to (num_robots, num_ticks, size).
        components: their names; None for one per joint.
        scale: how far the quantity typically moves, in its unit, which normalises a network's input.
        axial: a vector of rotation, which a mirror turns the other way round.
        unit: of a component, in SI units.
    """

    function: Callable[[Ticks], np.ndarray]
    components: tuple[str, ...] | None
    scale: float
    axial: bool = False
    unit: Callable[[Robot], np.ndarray | float] = lambda robot: 1.0


TABLE: dict[str, Quantity] = {
    "joint_position": Quantity(joint_position, None, scale=0.3),
    "joint_velocity": Quantity(joint_velocity, None, scale=0.2, unit=lambda robot: robot.velocity_limit),
    "pelvis_velocity": Quantity(pelvis_velocity, _XYZ, scale=0.5),
    "pelvis_angular_velocity": Quantity(pelvis_angular_velocity, _XYZ, scale=1.0, axial=True),
    "pelvis_attitude": Quantity(pelvis_attitude, ("roll", "pitch"), scale=0.2),
    "com_velocity": Quantity(com_velocity, _XYZ, scale=0.5),
    "com_position": Quantity(com_position, _XYZ, scale=0.1),
    "foot_force": Quantity(foot_force, ("left", "right"), scale=0.5, unit=lambda robot: FOOT_FORCE_UNIT),
    "torso_position": Quantity(torso_position, _XYZ, scale=0.1),
    "left_foot_position": Quantity(left_foot_position, _XYZ, scale=0.2),
    "right_foot_position": Quantity(right_foot_position, _XYZ, scale=0.2),
}


def component_names(robot: Robot) -> tuple[str, ...]:
    """Names of the vector's components in order: ``joint_position.torso_pitch``, ..., ``right_foot_position.z``."""
    return tuple(
        f"{name}.{component}"
        for name, quantity in TABLE.items()
        for component in (quantity.components or robot.joint_names)
    )


def scales(robot: Robot) -> np.ndarray:
    """Typical deviation of every component, (47,)."""
    return np.array([TABLE[name.split(".")[0]].scale for name in component_names(robot)])


def units(robot: Robot) -> np.ndarray:
    """Unit of every component in SI units, (47,)."""
    sizes = (len(quantity.components or robot.joint_names) for quantity in TABLE.values())
    pairs = zip(TABLE.values(), sizes, strict=True)
    return np.concatenate([np.broadcast_to(quantity.unit(robot), size) for quantity, size in pairs])


def mirror(robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """Left and right exchanged: the mirrored vector is ``sign * vector[source]``; both arrays are (47,)."""
    names = component_names(robot)
    source = [names.index(_other_side(name)) for name in names]
    return np.array(source), np.array([_mirror_sign(name) for name in names])


def mirror_joints(robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """The same for a vector over the joints, such as an action: (num_joints,) each."""
    names = robot.joint_names
    source = [names.index(_other_side(name)) for name in names]
    return np.array(source), np.array([-1.0 if name.endswith("roll") else 1.0 for name in names])


def _other_side(name: str) -> str:
    return name.replace("left", "?").replace("right", "left").replace("?", "right")


def _mirror_sign(name: str) -> float:
    quantity, component = name.split(".")
    if quantity in TABLE and TABLE[quantity].axial:
        return 1.0 if component == "y" else -1.0
    return -1.0 if component == "y" or component.endswith("roll") else 1.0


def quantities(ticks: Ticks) -> list[np.ndarray]:
    """The parts of the vector in its order, in SI units, unfiltered: (num_robots, num_ticks, size) each."""
    return [quantity.function(ticks) for quantity in TABLE.values()]


def observe(ticks: Ticks) -> np.ndarray:
    """The observation vector of every tick, unfiltered: (num_robots, num_ticks, 47) float64."""
    return np.concatenate(quantities(ticks), axis=-1) / units(ticks.robot)
