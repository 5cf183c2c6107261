"""Early ends: the events beside a fall that end an episode, so that a policy learns to avoid them.

A forbidden thing that ends an episode costs all that could still have been earned. A penalty would have to be weighed
against the reward instead, and be large enough to matter without making a recovery worth less than a fall
(constraints as terminations: Chane-Sane et al., 2024).
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from surefoot.physics.rotations import horizontal
from surefoot.physics.step_record import StepRecord
from surefoot.rates import CONTROL_HZ
from surefoot.robots import Robot

SPEED_TIME = 0.01
"""A joint's speed counts as its mean over this time [s], which forgives the single ticks of an impact."""


class EarlyEnds:
    """Tells which of N robots have stepped, or have moved a joint too fast.

    Args:
        robot: which robot they all are.
        num_robots: N.
        foot_shift_limit: largest distance of a sole's centre from its place [m]; None if steps are free.
        joint_speed_limit: largest share of a joint's speed limit; None if it may move as fast as it can.
    """

    def __init__(self, robot: Robot, num_robots: int, foot_shift_limit: float | None, joint_speed_limit: float | None):
        self._foot_shift_limit = foot_shift_limit
        self._joint_speed_limit = joint_speed_limit
        self._velocity_limit = robot.velocity_limit
        self._place = np.zeros((num_robots, 2), complex)
        self._has_place = np.zeros(num_robots, bool)
        self._last_velocity = np.zeros((num_robots, round(SPEED_TIME * CONTROL_HZ) - 1, robot.num_joints))

    def reset(self, ids: np.ndarray) -> None:
        """Robots `ids` (n,) begin an episode."""
        self._has_place[ids] = False
        self._last_velocity[ids] = 0.0

    def stepped(self, record: StepRecord, survived: np.ndarray) -> np.ndarray:
        """Tell who has left its place in a policy step: (N,).

        Args:
            record: of the step.
            survived: robots that have survived a push; wherever their feet are is their place from now on.
        """
        if self._foot_shift_limit is None:
            return np.zeros(len(self._place), bool)
        soles = horizontal(record.sole_position)
        self._has_place[survived] = False
        new = ~self._has_place
        self._place[new] = soles[new, 0]
        self._has_place[:] = True
        return (np.abs(soles - self._place[:, None]) > self._foot_shift_limit).any(axis=(1, 2))

    def too_fast(self, record: StepRecord) -> np.ndarray:
        """Tell who has moved a joint faster than is allowed in a policy step: (N,)."""
        if self._joint_speed_limit is None:
            return np.zeros(len(self._place), bool)
        velocity = np.concatenate([self._last_velocity, record.joint_velocity], axis=1)
        window = self._last_velocity.shape[1] + 1
        self._last_velocity = velocity[:, -window + 1 :].copy()
        speed = np.abs(sliding_window_view(velocity, window, axis=1).mean(axis=-1))
        return (speed > self._joint_speed_limit * self._velocity_limit).any(axis=(1, 2))
