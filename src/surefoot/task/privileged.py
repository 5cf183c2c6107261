"""Privileged observation: the input of the critic alone in training (asymmetric actor and critic, Pinto et al. 2017).

A push that a critic does not expect is noise in its estimates of all states shortly before it. The same holds for a
push that is harder than it looks because it comes at the torso.
"""

from __future__ import annotations

import functools

import numpy as np

from surefoot.physics.pushes import Pushes
from surefoot.rates import CONTROL_HZ
from surefoot.robots import Robot
from surefoot.task.random_pushes import LIFT, PUSH

IMPULSE_UNIT = 200.0
"""[Ns], for a robot of the mass of the paper's."""
LEVER_UNIT = 0.5
"""[m], for a robot with legs as long as those of the paper's."""
SIGNS = {
    "near": 1.0,
    "impulse": 1.0,
    "impulse_x": 1.0,
    "impulse_y": -1.0,
    "lever": 1.0,
    "lever_x": 1.0,
    "lever_y": -1.0,
    "side": -1.0,
    "lift": 1.0,
    "step_penalty_share": 1.0,
    "posture_penalised": 1.0,
    "noise": 1.0,
}
"""The components in order, with their signs in the mirror; the first nine are those of `next_push`."""


class PrivilegedObservation:
    """Describes the next pushes of a batch of robots.

    Args:
        robot: the machine.
        nominal: pose in which the bodies' heights are taken, (num_joints,) [rad].
    """

    def __init__(self, robot: Robot, nominal: np.ndarray):
        self._impulse_unit = IMPULSE_UNIT * robot.mass_scale
        self._height = np.zeros(len(robot.body_names))
        self._side = np.zeros_like(self._height)
        for name, height in zip(robot.pushable, _heights(robot, tuple(nominal)), strict=True):
            self._height[robot.body_id(name)] = height / (LEVER_UNIT * robot.length_scale)
            self._side[robot.body_id(name)] = robot.side(name)

    def next_push(self, pushes: Pushes, tick: np.ndarray, heading: np.ndarray) -> np.ndarray:
        """Return the pushes to come or under way.

        Args:
            pushes: of the N robots, horizontal ones in slot `PUSH`, upward ones in slot `LIFT`.
            tick: since each robot's reset (N,).
            heading: of each robot, as a complex number of length 1, (N,).

        Returns:
            (N, 9): how near the push is, from 0 (a second away, or over) to 1 (under way); times how much of its
            impulse is left, in units of `IMPULSE_UNIT`: its size, along x and y of the heading frame; these three
            times the height of the pushed body above the robot's CoM, in units of `LEVER_UNIT`; the size again,
            positive at a left leg, negative at a right one and 0 at a body in the middle; and the same of the push
            upwards. Both units are scaled to the robot.
        """
        near, share, seconds = _weight(pushes, PUSH, tick)
        force = pushes.force[:, PUSH]
        impulse = seconds / self._impulse_unit * share * (force[:, 0] + 1j * force[:, 1]) * heading.conj()
        along = np.stack([np.abs(impulse), impulse.real, impulse.imag], axis=1)
        lever = self._height[pushes.body[:, PUSH], None] * along
        _, share, seconds = _weight(pushes, LIFT, tick)
        lift = seconds / self._impulse_unit * share * pushes.force[:, LIFT, 2]
        side = self._side[pushes.body[:, PUSH]] * along[:, 0]
        return np.column_stack([near, along, lever, side, lift])


@functools.cache
def _heights(robot: Robot, pose: tuple[float, ...]) -> list[float]:
    """Return the heights of the pushable bodies' CoMs above the robot's [m]."""
    return [-robot.lever_arm(np.array(pose), name, 0.0) for name in robot.pushable]


def _weight(pushes: Pushes, slot: int, tick: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return how near each push of a slot is, that times the share that is left, and its duration [s]: (N,) each."""
    start, end = pushes.start[:, slot], pushes.end[:, slot]
    ticks = np.maximum(end - start, 1)
    left = np.clip((end - np.maximum(tick, start)) / ticks, 0.0, 1.0)
    near = np.clip(1.0 - (start - tick) / CONTROL_HZ, 0.0, 1.0) * (left > 0.0)
    return near, near * left, ticks / CONTROL_HZ
