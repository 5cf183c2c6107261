"""Observation: what the policy sees, as an ordered table of named, heading-invariant quantities.

The vector of Yang et al. 2018, section IV-C, in R^47: positions are relative to the pelvis, and every vector is
turned into the heading frame (the world turned by the pelvis yaw). Units: rad, m, m/s, rad/s; joint velocities as a
share of their limit, foot forces in units of 800 N. The policy needs one filtered vector per step, so that the filter
gets SI units in whole blocks of ticks, and the vector its order and its units afterwards.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from surefoot.robot import Robot
from surefoot.ticks import HEADING_BLOCK, Ticks

FOOT_FORCE_UNIT = 800.0


_XYZ = ("x", "y", "z")


class Quantity(NamedTuple):
    """A named part of the observation vector.

    Attributes:
        components: their names; None for one per joint.
        scale: how far the quantity typically moves, in its unit, which normalises a network's input.
        axial: a vector of rotation, which a mirror turns the other way round.
        unit: of a component, in SI units.
    """

    components: tuple[str, ...] | None
    scale: float
    axial: bool = False
    unit: Callable[[Robot], np.ndarray | float] = lambda robot: 1.0


TABLE: dict[str, Quantity] = {
    "joint_position": Quantity(None, scale=0.3),
    "joint_velocity": Quantity(None, scale=0.2, unit=lambda robot: robot.velocity_limit),
    "pelvis_velocity": Quantity(_XYZ, scale=0.5),
    "pelvis_angular_velocity": Quantity(_XYZ, scale=1.0, axial=True),
    "pelvis_attitude": Quantity(("roll", "pitch"), scale=0.2),
    "com_velocity": Quantity(_XYZ, scale=0.5),
    "com_position": Quantity(_XYZ, scale=0.1),
    "foot_force": Quantity(("left", "right"), scale=0.5, unit=lambda robot: FOOT_FORCE_UNIT),
    "torso_position": Quantity(_XYZ, scale=0.1),
    "left_foot_position": Quantity(_XYZ, scale=0.2),
    "right_foot_position": Quantity(_XYZ, scale=0.2),
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


@functools.cache
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


def blocks(ticks: Ticks) -> list[np.ndarray]:
    """What the vector is made of as it lies side by side in the ticks, in SI units, unfiltered.

    Returns:
        Arrays (num_robots, num_ticks, size), 47 columns in all, to be put in order by `from_blocks`.
    """
    attitude = np.moveaxis(ticks.pelvis_attitude, 0, -1)
    return [ticks.joint_state, ticks.in_heading, attitude, ticks.foot_force]


_BLOCKS = ("joint_position", "joint_velocity", *HEADING_BLOCK, "pelvis_attitude", "foot_force")
"""Quantities in the order of `blocks`."""


@functools.cache
def _order(robot: Robot) -> np.ndarray:
    names = component_names(robot)
    in_blocks = [name for quantity in _BLOCKS for name in names if name.startswith(f"{quantity}.")]
    return np.array([in_blocks.index(name) for name in names])


def from_blocks(values: np.ndarray, robot: Robot) -> np.ndarray:
    """The vector (..., 47) in its order and units, from the joined columns of `blocks` (..., 47)."""
    return values[..., _order(robot)] / units(robot)


def observe(ticks: Ticks) -> np.ndarray:
    """The observation vector of every tick, unfiltered: (num_robots, num_ticks, 47) float64."""
    return from_blocks(np.concatenate(blocks(ticks), axis=-1), ticks.robot)
