"""Agent inputs: the inputs of any agent as named quantities."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from surefoot.robots import Robot
from surefoot.task import observation
from surefoot.task.state import State

SMALL_CHANGES = {
    "time": 0.25,
    "joint_position": 0.05,
    "joint_velocity": 0.5,
    "root_attitude": 0.05,
    "root_velocity": 0.2,
    "root_angular_velocity": 0.3,
    "gyroscope": 0.3,
    "gravity_direction": 0.05,
    "com_position": 0.02,
    "com_velocity": 0.2,
    "capture_point": 0.05,
    "com_height": 0.05,
    "sole_position": 0.02,
    "foot_attitude": 0.05,
    "foot_force": 50.0,
    "pressure_point": 0.02,
}
"""A small change of each quantity of a `State`, in SI units, by which reactions are compared."""


def quantities(inputs: Any, robot: Robot) -> dict[str, np.ndarray]:
    """Name -> values (n, ...) of what an agent is given: a `State` or observation vectors (n, num_observations)."""
    if isinstance(inputs, State):
        return {field.name: getattr(inputs, field.name) for field in dataclasses.fields(inputs)}
    return {name: inputs[:, columns] for name, columns in _columns(robot).items()}


def with_quantities(inputs: Any, robot: Robot, changed: dict[str, np.ndarray]) -> Any:
    """The same inputs with other values (n, ...) of the named quantities."""
    if isinstance(inputs, State):
        return dataclasses.replace(inputs, **changed)
    inputs, columns = np.array(inputs), _columns(robot)
    for name, values in changed.items():
        inputs[:, columns[name]] = values
    return inputs


def small_change(name: str, inputs: Any) -> float:
    """A small change of a quantity, in the unit in which the agent is given it."""
    if isinstance(inputs, State):
        return SMALL_CHANGES[name]
    return 0.2 * observation.TABLE[name].scale


def _columns(robot: Robot) -> dict[str, slice]:
    names = [name for name, _ in observation.parts(robot)]
    return {name: slice(names.index(name), names.index(name) + names.count(name)) for name in dict.fromkeys(names)}
