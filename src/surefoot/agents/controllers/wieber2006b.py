"""Wieber 2006b: the reference trajectory is chosen anew, on line, so that it can be followed from where the CoM is."""

from __future__ import annotations

import numpy as np

from surefoot.agents.controllers.ankle import EDGE, Ankle
from surefoot.agents.controllers.controller import State
from surefoot.agents.controllers.inverse_dynamics import clip_to_support

TIMES = np.linspace(0.2, 1.6, 15)
"""How long the return to rest may take [s]."""
SHARES = np.linspace(-1.0, 1.0, 17)
"""Where it may end, as a share of the way from the middle of the support to its border."""
SAMPLES = np.linspace(0.0, 1.0, 5)
"""Where along the way the pressure centre is looked at."""
COSTS = 0.05, 0.01
"""Of an end away from the middle [m/m], and of a long way [m/s], against metres outside the support."""


class ReferenceAdaptation(Ankle):
    """After P.-B. Wieber and C. Chevallereau 2006, Online adaptation of reference trajectories for walking systems.

    A reference is not tracked at any price: out of a continuous set of trajectories from the present state, here cubics
    to rest with two parameters (where and when), the one is followed whose pressure centre stays inside the support, or
    leaves it least. The choice is repeated at every control step, in closed form, both axes apart.
    """

    def pressure(self, state: State, ids: np.ndarray) -> np.ndarray:
        """Pressure centre (n, 2) [m] with which the best way to rest begins, inside the support."""
        soles = state.sole_position[..., :2]
        center = soles.mean(axis=1)
        com, speed = state.com_position[:, :2] - center, state.com_velocity[:, :2]
        apart = np.abs(soles[:, 0] - soles[:, 1])
        half = self.robot.sole_half_size - EDGE
        border = np.maximum(half + np.array([-0.5, 0.5]) * apart, 0.01)
        lag = (np.maximum(state.com_height, 0.1) / self.robot.gravity)[:, None]
        pressure = center + self._first_pressure(com, speed, border, lag)
        return clip_to_support(pressure, soles, np.ones((len(state), 2), bool), half)

    def _first_pressure(self, com: np.ndarray, speed: np.ndarray, border: np.ndarray, lag: np.ndarray) -> np.ndarray:
        """Pressure centre with which the best trajectory begins; all arguments and the result by axis (n, 2)."""
        x, v, d, lag = (part[..., None, None] for part in (com, speed, border, np.broadcast_to(lag, com.shape)))
        end = SHARES[:, None] * d
        first = 6.0 * (end - x) / TIMES**2 - 4.0 * v / TIMES
        last = -6.0 * (end - x) / TIMES**2 + 2.0 * v / TIMES
        outside = np.zeros_like(first)
        for u in SAMPLES:
            place = x + v * TIMES * u + TIMES**2 * (first * u**2 / 2.0 + (last - first) * u**3 / 6.0)
            pressure = place - lag * (first + (last - first) * u)
            outside = np.maximum(outside, np.abs(pressure) - d)
        cost = np.maximum(outside, 0.0) + COSTS[0] * np.abs(end) + COSTS[1] * TIMES
        best = cost.reshape(*cost.shape[:2], -1).argmin(axis=-1)[..., None]
        begin = np.take_along_axis(first.reshape(*first.shape[:2], -1), best, axis=-1)[..., 0]
        return com - lag[..., 0, 0] * begin
