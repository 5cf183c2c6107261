"""Observation: the policy's input, as an ordered table of named, heading-invariant quantities.

The vector of Yang et al. 2018, section IV-C, in R^47 for the paper's robot: positions are relative to the root, and
every vector is turned into the heading frame (the world turned by the root's yaw). Units are rad, m, m/s and rad/s;
joint velocities are shares of their limit, and foot forces are in units of the robot's reference load. The policy needs
one filtered vector per step, so the filter gets SI units in whole blocks of ticks, and the vector gets its order and
its units afterwards.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from surefoot.physics.step_record import HEADING_BLOCK, StepRecord
from surefoot.robots import Robot

_XYZ = ("x", "y", "z")


class Quantity(NamedTuple):
    """A named part of the observation vector.

    Attributes:
        components: their names; None for one per joint.
        scale: how far the quantity typically moves in the paper's robot, in its unit; see `scales`.
        axial: a vector of rotation, which a mirror turns the other way round.
        unit: of a component, in SI units.
        grows: the scale over that of the paper's robot.
    """

    components: tuple[str, ...] | None
    scale: float
    axial: bool = False
    unit: Callable[[Robot], np.ndarray | float] = lambda robot: 1.0
    grows: Callable[[Robot], np.ndarray | float] = lambda robot: 1.0


def _length(robot: Robot) -> float:
    return robot.length_scale


def _speed(robot: Robot) -> float:
    return robot.speed_scale


def _turn(robot: Robot) -> float:
    return 1.0 / robot.time_scale


def _joint_speed(robot: Robot) -> np.ndarray:
    """A joint that could turn faster than the fastest of the paper's robot, in its own time, seldom does so."""
    return np.minimum(_FASTEST / robot.time_scale / robot.velocity_limit, 1.0)


_FASTEST = 11.0
"""Largest speed limit of a joint of the paper's robot [rad/s]."""

TABLE: dict[str, Quantity] = {
    "joint_position": Quantity(None, scale=0.3),
    "joint_velocity": Quantity(None, scale=0.2, unit=lambda robot: robot.velocity_limit, grows=_joint_speed),
    "root_velocity": Quantity(_XYZ, scale=0.5, grows=_speed),
    "root_angular_velocity": Quantity(_XYZ, scale=1.0, axial=True, grows=_turn),
    "root_attitude": Quantity(("roll", "pitch"), scale=0.2),
    "com_velocity": Quantity(_XYZ, scale=0.5, grows=_speed),
    "com_position": Quantity(_XYZ, scale=0.1, grows=_length),
    "foot_force": Quantity(("left", "right"), scale=0.5, unit=lambda robot: robot.load_unit),
    "torso_position": Quantity(_XYZ, scale=0.1, grows=_length),
    "left_foot_position": Quantity(_XYZ, scale=0.2, grows=_length),
    "right_foot_position": Quantity(_XYZ, scale=0.2, grows=_length),
}


def component_names(robot: Robot) -> tuple[str, ...]:
    """Names of the vector's components in order: ``joint_position.JOINT``, ..., ``right_foot_position.z``.

    The root has the robot's own word for it, as in ``base_velocity.x`` of a robot whose root is "base".
    """
    named = ((name.replace("root", robot.root, 1) if name.startswith("root_") else name, c) for name, c in parts(robot))
    return tuple(f"{name}.{component}" for name, component in named)


@functools.cache
def parts(robot: Robot) -> tuple[tuple[str, str], ...]:
    """Quantity of `TABLE` and component of every entry of the vector, in order."""
    return tuple(
        (name, component)
        for name, quantity in TABLE.items()
        for component in (quantity.components or robot.joint_names)
    )


def scales(robot: Robot) -> np.ndarray:
    """Typical deviation of every component, (47,): normalises a network's input, and is the unit of a sensor's bias."""
    return _of_components(robot, lambda quantity: quantity.scale * quantity.grows(robot))


@functools.cache
def units(robot: Robot) -> np.ndarray:
    """Unit of every component in SI units, (47,)."""
    return _of_components(robot, lambda quantity: quantity.unit(robot))


def _of_components(robot: Robot, value: Callable[[Quantity], np.ndarray | float]) -> np.ndarray:
    """A number of each quantity, or one for each of its components, laid out as the vector: (47,)."""
    sizes = (len(quantity.components or robot.joint_names) for quantity in TABLE.values())
    pairs = zip(TABLE.values(), sizes, strict=True)
    return np.concatenate([np.broadcast_to(value(quantity), size) for quantity, size in pairs])


def mirror(robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """Left and right exchanged: the mirrored vector is ``sign * vector[source]``; both arrays are (47,)."""
    index = {part: i for i, part in enumerate(parts(robot))}
    pairs = [_mirrored(name, component, robot) for name, component in index]
    return np.array([index[part] for part, _ in pairs]), np.array([sign for _, sign in pairs])


def _mirrored(name: str, component: str, robot: Robot) -> tuple[tuple[str, str], float]:
    """Which entry an entry comes from in the mirror, and with which sign."""
    quantity = TABLE[name]
    if quantity.components is None:
        joint = robot.joint_names.index(component)
        return (name, robot.joint_names[robot.mirror_source[joint]]), float(robot.mirror_sign[joint])
    if component in _OTHER_SIDE:
        return (name, _OTHER_SIDE[component]), 1.0
    side = next((side for side in _OTHER_SIDE if name.startswith(f"{side}_")), "")
    other = name.replace(side, _OTHER_SIDE[side], 1) if side else name
    flips = component in (("x", "z") if quantity.axial else ("y", "roll"))
    return (other, component), -1.0 if flips else 1.0


_OTHER_SIDE = {"left": "right", "right": "left"}


def blocks(ticks: StepRecord) -> list[np.ndarray]:
    """The parts of the vector that lie side by side in the ticks, in SI units, unfiltered.

    Returns:
        Arrays (num_robots, num_ticks, size), 47 columns in all, to be put in order by `from_blocks`.
    """
    attitude = np.moveaxis(ticks.root_attitude, 0, -1)
    return [ticks.joint_state, ticks.in_heading, attitude, ticks.foot_force]


_BLOCKS = ("joint_position", "joint_velocity", *HEADING_BLOCK, "root_attitude", "foot_force")
"""Quantities in the order of `blocks`."""


@functools.cache
def _order(robot: Robot) -> np.ndarray:
    every = parts(robot)
    in_blocks = [part for quantity in _BLOCKS for part in every if part[0] == quantity]
    return np.array([in_blocks.index(part) for part in every])


def from_blocks(values: np.ndarray, robot: Robot) -> np.ndarray:
    """The vector (..., 47) in its order and units, from the joined columns of `blocks` (..., 47)."""
    return values[..., _order(robot)] / units(robot)


def observe(ticks: StepRecord) -> np.ndarray:
    """The observation vector of every tick, unfiltered: (num_robots, num_ticks, 47) float64."""
    return from_blocks(np.concatenate(blocks(ticks), axis=-1), ticks.robot)
