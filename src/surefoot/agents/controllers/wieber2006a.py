"""Wieber 2006a: the CoM is planned ahead under bounds on the pressure centre, without any reference to track."""

from __future__ import annotations

import numpy as np

from surefoot.agents.controllers.ankle import EDGE, Ankle
from surefoot.agents.controllers.controller import State
from surefoot.agents.controllers.linear_mpc import CartTable, QuadraticPrograms
from surefoot.robots import Robot

NUM_STEPS, STEP_S = 24, 0.05
"""The horizon: 1.2 s."""
REPLAN_STEPS = 5
"""Control steps from plan to plan: 50 Hz."""
HEIGHT = 1.08
"""Of the CoM in the model [m]."""
JERK, VELOCITY, POSITION = 1e-7, 1e-1, 1e-1
"""Weights of the objective [s^6/m^2, s^2/m^2, 1/m^2]; the published one has the jerk alone, which does not come to rest
in the middle."""


class TrajectoryFreeMPC(Ankle):
    """Model predictive control of the CoM without a reference.

    P.-B. Wieber 2006, Trajectory free linear model predictive control for stable walking in the presence of strong
    perturbations (Humanoids).

    min over the jerk of the CoM, sum of jerk^2, with the pressure centre inside the support over the whole horizon; one
    quadratic program per axis. Its first jerk gives the pressure centre until the next plan.
    """

    def __init__(self, robot: Robot, num_robots: int):
        super().__init__(robot, num_robots)
        self.table = table = CartTable(NUM_STEPS, STEP_S, HEIGHT, robot.gravity)
        hessian = JERK * np.eye(NUM_STEPS)
        hessian += VELOCITY * table.velocity_of_jerk.T @ table.velocity_of_jerk
        hessian += POSITION * table.position_of_jerk.T @ table.position_of_jerk
        self.programs = QuadraticPrograms(hessian, table.pressure_of_jerk)
        self.state = np.zeros((num_robots, 2, 3))
        """CoM position from the middle of the feet, velocity and acceleration at the last plan, by axis."""
        self.jerk = np.zeros((num_robots, 2))
        self.planned = np.zeros(num_robots)
        self.acceleration = np.zeros((num_robots, 2))

    def reset(self, ids: np.ndarray) -> None:
        """Forget robots `ids` (n,): the next plan begins without an acceleration."""
        super().reset(ids)
        self.acceleration[ids] = 0.0

    def pressure(self, state: State, ids: np.ndarray) -> np.ndarray:
        """Pressure centre (n, 2) [m] of the last plan at this time, inside the support."""
        due = np.rint(state.time * self.rate_hz).astype(int) % REPLAN_STEPS == 0
        if due.any():
            self._plan(state[due], ids[due])
        since = (state.time - self.planned[ids])[:, None]
        center = state.sole_position[..., :2].mean(axis=1)
        half = self._half(state)
        offset = self.table.pressure_after(self.state[ids], self.jerk[ids], since)
        pressure = center + np.clip(offset, -half, half)
        self.acceleration[ids] = (state.com_position[:, :2] - pressure) / self.table.lag
        return pressure

    def _plan(self, state: State, ids: np.ndarray) -> None:
        table = self.table
        center = state.sole_position[..., :2].mean(axis=1)
        com = state.com_position[:, :2] - center
        self.state[ids] = np.stack([com, state.com_velocity[:, :2], self.acceleration[ids]], axis=-1)
        self.planned[ids] = state.time
        now, half = self.state[ids].reshape(-1, 3)[:, :, None], self._half(state).reshape(-1, 1)
        gradient = VELOCITY * table.velocity_of_jerk.T @ (table.velocity_of_state @ now)
        gradient += POSITION * table.position_of_jerk.T @ (table.position_of_state @ now)
        rest = (table.pressure_of_state @ now)[..., 0]
        self.jerk[ids] = self.programs.solve(gradient[..., 0], -half - rest, half - rest)[:, 0].reshape(-1, 2)

    def _half(self, state: State) -> np.ndarray:
        """Half length and half width of the support (n, 2) [m], of feet side by side."""
        apart = np.abs(state.sole_position[:, 0, :2] - state.sole_position[:, 1, :2])
        half = self.robot.sole_half_size - EDGE + np.array([-0.5, 0.5]) * apart
        return np.maximum(half, 0.01)
