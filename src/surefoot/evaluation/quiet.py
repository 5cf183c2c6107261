"""QuietRule: the test for a robot that stands upright and still, which ends trials before their horizon."""

from __future__ import annotations

import numpy as np

from surefoot.evaluation.protocol import PROTOCOL
from surefoot.physics.step_record import StepRecord
from surefoot.rates import POLICY_HZ, TICKS_PER_STEP

NUM_STEPS = round(PROTOCOL.quiet_time * POLICY_HZ)
"""Policy steps for which a robot must stand quietly."""
_COS_TILT = np.cos(np.radians(PROTOCOL.max_tilt_deg))


def is_upright(ticks: StepRecord) -> np.ndarray:
    """Whether root and torso are within the largest tilt of upright: bool (n, num_ticks)."""
    return (ticks.root_uprightness > _COS_TILT) & (ticks.torso_uprightness > _COS_TILT)


def com_speed(ticks: StepRecord) -> np.ndarray:
    """Speed of the CoM (n, num_ticks) [m/s]."""
    return np.linalg.norm(ticks.com_velocity, axis=-1)


class QuietRule:
    """Tells which of N robots have stood upright for the quiet time, as slow on average as a recovered robot."""

    def __init__(self, num_robots: int):
        self._upright_steps = np.zeros(num_robots, np.int64)
        self._speed = np.zeros((num_robots, NUM_STEPS))

    def reset(self, ids: np.ndarray) -> None:
        """Robots `ids` (n,) begin anew."""
        self._upright_steps[ids] = 0

    def update(
        self, ids: np.ndarray, upright: np.ndarray, speed: np.ndarray, first_tick: np.ndarray, counts: np.ndarray
    ) -> None:
        """Take in a policy step of robots `ids` (n,).

        Args:
            ids: the robots (n,).
            upright: as of `is_upright` (n, TICKS_PER_STEP).
            speed: of the CoM (n, TICKS_PER_STEP) [m/s].
            first_tick: of the step, since each robot's reset (n,).
            counts: bool (n,), whether the step counts; one during a disturbance does not.
        """
        self._upright_steps[ids] = np.where(counts & upright.all(axis=1), self._upright_steps[ids] + 1, 0)
        self._speed[ids, first_tick // TICKS_PER_STEP % NUM_STEPS] = speed.mean(axis=1)

    def holds(self, ids: np.ndarray) -> np.ndarray:
        """Which of robots `ids` (n,) stand quietly, bool (n,)."""
        return (self._upright_steps[ids] >= NUM_STEPS) & (self._speed[ids].mean(axis=1) < PROTOCOL.max_com_speed)
