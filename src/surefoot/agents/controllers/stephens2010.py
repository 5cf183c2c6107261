"""Stephens 2010: one quadratic program plans the pressure centre and the next foothold together."""

from __future__ import annotations

import numpy as np

from surefoot.agents.controllers.linear_mpc import Pendulum, QuadraticPrograms
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
from surefoot.robots import Robot

STEP_S, NUM_STEPS = 0.02, 30
"""The horizon: 0.6 s."""
DURATION_S = 0.26
"""From lift to landing [s]; the published timing is fixed, too."""
REPLAN_STEPS = 5
"""Control steps from plan to plan: 50 Hz."""
HEIGHT = 1.05
"""Of the CoM in the model [m]."""
VELOCITY, PRESSURE, FOOTHOLD, REST = 0.02, 0.05, 0.05, 10.0
"""Weights of the CoM's velocity [s^2], of pressure centres away from the foot's middle, of footholds away from beside
the other foot, and of a capture point that at the end is not over the new foot."""


class SteppingMPC(Stepping):
    """B. Stephens and C. Atkeson 2010, Push recovery by stepping for humanoid robots with force controlled joints.

    Model predictive control of the linear inverted pendulum. The unknowns are the pressure centres of the next 0.6 s
    and the foothold, on which the later ones stand; both axes apart. Pressure centres stay inside the foot that bears,
    footholds within reach of leg and swing. The time of landing is fixed. While the capture point is inside the soles
    the robot stands as `controllers/ankle`.
    """

    def __init__(self, robot: Robot, num_robots: int):
        super().__init__(robot, num_robots)
        self.pendulum = Pendulum(NUM_STEPS, STEP_S, HEIGHT, robot.gravity)
        self.residuals: dict[int, np.ndarray] = {}
        self.programs: dict[int, QuadraticPrograms] = {}
        self.landing = np.zeros((num_robots, 2))
        """From the foot that bears [m], like the pressure centre."""
        self.planned = np.zeros((num_robots, 2))
        self.missed = np.zeros(num_robots)

    def plan(self, situation: Situation) -> Plan:
        """Plan anew where it is due, and go on with the last plan elsewhere."""
        s, ids = situation, situation.ids
        due = np.rint(s.clock * self.rate_hz).astype(int) % REPLAN_STEPS == 0
        steps_left = np.maximum(np.rint((DURATION_S - s.clock) / STEP_S).astype(int), 1)
        for left in np.unique(steps_left[due]).tolist():
            rows = np.flatnonzero(due & (steps_left == left))
            for axis in (0, 1):
                self._solve(s, rows, left, axis)
        remaining = DURATION_S - s.clock
        away = self.landing[ids]
        away = away + BEYOND * away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 0.2)
        return Plan(s.stance + away, remaining, s.stance + self.planned[ids], self.missed[ids].copy())

    def _solve(self, s: Situation, rows: np.ndarray, left: int, axis: int) -> None:
        """One axis of robots that land in `left` intervals: writes landing and pressure centre."""
        if left not in self.programs:
            self._prepare(left)
        ids, half = s.ids[rows], self.robot.sole_half_size[axis] - INSET
        now = np.stack([s.com[rows, axis] - s.stance[rows, axis], s.com_velocity[rows, axis]], axis=1)
        beside = np.zeros(len(rows)) if axis == 0 else BESIDE * s.side[rows]
        known = self._known(now, beside)
        gradient = np.matmul(known[:, None], self.residuals[left])[:, 0]
        low, high = self._reach(s, rows, left, axis)
        bounds = np.full((len(rows), NUM_STEPS), half)
        found = self.programs[left].solve(gradient, np.column_stack([-bounds, low]), np.column_stack([bounds, high]))
        self.landing[ids, axis], self.planned[ids, axis] = np.clip(found[:, -1], low, high), found[:, 0]
        end = self.pendulum.capture_point(now, np.clip(found[:, :left], -half, half))
        missed = np.maximum(np.abs(end - self.landing[ids, axis]) - half, 0.0)
        self.missed[ids] = missed if axis == 0 else np.hypot(self.missed[ids], missed)

    def _prepare(self, left: int) -> None:
        """Residuals R u + r of the objective, u the pressure centres and the foothold; foothold bounds come last."""
        n, pendulum = NUM_STEPS, self.pendulum
        none = np.zeros((n, 1))
        later = (np.arange(n) >= left).astype(float)[:, None]
        inside = np.hstack([np.eye(n), -later])
        foothold = np.eye(n + 1)[-1:]
        rest = np.hstack([pendulum.capture_of_pressure[-1:], [[-1.0]]])
        residuals = np.vstack(
            [
                np.sqrt(VELOCITY) * np.hstack([pendulum.velocity_of_pressure, none]),
                np.sqrt(PRESSURE) * inside,
                np.sqrt(FOOTHOLD) * foothold,
                np.sqrt(REST) * rest,
            ]
        )
        self.residuals[left] = residuals
        self.programs[left] = QuadraticPrograms(residuals.T @ residuals, np.vstack([inside, foothold]))

    def _known(self, now: np.ndarray, beside: np.ndarray) -> np.ndarray:
        """The residuals' part r that does not depend on the unknowns: (n, number of residuals)."""
        pendulum = self.pendulum
        velocity = np.matmul(pendulum.velocity_of_state, now[..., None])[..., 0]
        capture = np.matmul(pendulum.capture_of_state[-1:], now[..., None])[..., 0]
        return np.hstack(
            [
                np.sqrt(VELOCITY) * velocity,
                np.zeros((len(now), NUM_STEPS)),
                -np.sqrt(FOOTHOLD) * beside[:, None],
                np.sqrt(REST) * capture,
            ]
        )

    def _reach(self, s: Situation, rows: np.ndarray, left: int, axis: int) -> tuple[np.ndarray, np.ndarray]:
        """Nearest and farthest foothold from the foot that bears (n,) [m]: what leg and swing reach."""
        side = s.side[rows]
        ends = np.array(FORWARD)[None] + 0.0 * side[:, None] if axis == 0 else side[:, None] * np.array(APART)
        low, high = ends.min(axis=1), ends.max(axis=1)
        place, travel = s.swing[rows, axis] - s.stance[rows, axis], SWING_SPEED * left * STEP_S
        return np.clip(place - travel, low, high), np.clip(place + travel, low, high)
