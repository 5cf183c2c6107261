"""Urata 2011: place and time of the next foothold in closed form, decided anew at every control step."""

from __future__ import annotations

import numpy as np

from surefoot.agents.controllers.stepping import (
    APART,
    BESIDE,
    BEYOND,
    FORWARD,
    INSET,
    SWING_SPEED,
    Plan,
    Situation,
    Stepping,
)

TIMES = np.arange(0.04, 0.60, 0.02)
"""Candidates for the time until the foot lands [s]."""
SHORTEST_STEP = 0.20
"""From lift to landing, at least [s]."""


class FootPlacement(Stepping):
    """J. Urata et al. 2011: singular LQ preview regulation, whose solution stays bounded only if the foothold is right.

    With the pressure centre p under the foot that bears, the capture point c of the linear inverted pendulum moves as
    c(T) = p + (c - p) exp(w T). What stays bounded after the landing at T needs c(T) over the new foot. Candidate times
    are tried in closed form; the best one needs least of what the robot cannot do: reach, swing speed. Later steps are
    decided later, and the preview beyond the next foothold is "at rest there".
    """

    def plan(self, situation: Situation) -> Plan:
        """Choose the best of the candidate times, and the foothold that belongs to it."""
        s = situation
        half = self.robot.sole_half_size - INSET
        times = np.where(np.isnan(s.committed[:, None]), TIMES, s.committed[:, None])
        growth = np.exp(s.frequency[:, None] * np.maximum(times, 0.02))[..., None]
        stance, point = s.stance[:, None], s.capture_point[:, None]
        aim = stance + s.side[:, None, None] * np.array([0.0, BESIDE])
        pressure = stance + np.clip((point * growth - aim) / (growth - 1.0) - stance, -half, half)
        reached = pressure + (point - pressure) * growth
        away = reached - stance
        away += BEYOND * away / np.maximum(np.linalg.norm(away, axis=-1, keepdims=True), 0.2)
        side = s.side[:, None]
        step = np.stack([np.clip(away[..., 0], *FORWARD), side * np.clip(side * away[..., 1], *APART)], axis=-1)
        landing = stance + step
        missed = np.linalg.norm(np.maximum(np.abs(reached - landing) - half, 0.0), axis=-1)
        distance = np.linalg.norm(landing - s.swing[:, None], axis=-1)
        late = np.maximum(distance / SWING_SPEED + 0.04 - times, 0.0)
        late += np.maximum(SHORTEST_STEP - s.clock[:, None] - times, 0.0)
        cost = missed + 5.0 * late + 0.2 * times
        best = cost.argmin(axis=1)
        rows = np.arange(len(best))
        return Plan(landing[rows, best], times[rows, best], pressure[rows, best], cost[rows, best])
