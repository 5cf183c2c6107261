"""Observations: the inputs of foreign networks, under the names that mjlab, Isaac Lab and others use."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from surefoot.task.state import State


class Moment(NamedTuple):
    """The parts of an observation, for n robots at one control step. Joints are in the network's own order.

    Attributes:
        state: of the robots.
        joint_position: (n, num_joints) [rad].
        joint_velocity: (n, num_joints) [rad/s].
        default_pose: joint angles that an action of zero means (num_joints,) [rad].
        action: the network's last answer (n, num_joints); zero at first.
        command: forward, left and turning speed that it is asked for (n, 3) [m/s, m/s, rad/s].
        period: of the gait [s]; NaN where nobody has named one.
    """

    state: State
    joint_position: np.ndarray
    joint_velocity: np.ndarray
    default_pose: np.ndarray
    action: np.ndarray
    command: np.ndarray
    period: float


class Observation(NamedTuple):
    """How an observation is made.

    Attributes:
        size: how many numbers it has; None for one per joint of the network.
        observe: from the moment to these numbers (n, size).
    """

    size: int | None
    observe: Callable[[Moment], np.ndarray]


def _joint_position(now: Moment) -> np.ndarray:
    return now.joint_position - now.default_pose


def _root_velocity(now: Moment) -> np.ndarray:
    return now.state.in_root_frame(now.state.root_velocity)


def _gait_phase(now: Moment) -> np.ndarray:
    angle = 2.0 * np.pi * now.state.time / now.period
    return np.stack([np.sin(angle), np.cos(angle)], axis=1)


_JOINT_POSITION = Observation(None, _joint_position)
_JOINT_VELOCITY = Observation(None, lambda now: now.joint_velocity)
_ACTION = Observation(None, lambda now: now.action)
_COMMAND = Observation(3, lambda now: now.command)
OBSERVATIONS: dict[str, Observation] = {
    "base_lin_vel": Observation(3, _root_velocity),
    "base_ang_vel": Observation(3, lambda now: now.state.gyroscope),
    "projected_gravity": Observation(3, lambda now: now.state.gravity_direction),
    "joint_pos": _JOINT_POSITION,
    "joint_pos_rel": _JOINT_POSITION,
    "dof_pos": _JOINT_POSITION,
    "joint_vel": _JOINT_VELOCITY,
    "joint_vel_rel": _JOINT_VELOCITY,
    "dof_vel": _JOINT_VELOCITY,
    "actions": _ACTION,
    "last_action": _ACTION,
    "command": _COMMAND,
    "velocity_commands": _COMMAND,
    "command_lin_vel": Observation(2, lambda now: now.command[:, :2]),
    "command_ang_vel": Observation(1, lambda now: now.command[:, 2:]),
    "gait_phase": Observation(2, _gait_phase),
}
"""Name of an observation -> how it is made; several names stand for the same one.

Joint positions are counted from the default pose, as all these projects do.
"""
