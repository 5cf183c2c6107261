"""Linear MPC: the cart-table model of the CoM over a horizon, and its quadratic programs, solved by DAQP."""

from __future__ import annotations

import numpy as np

from surefoot.errors import UserError


class CartTable:
    """CoM position, velocity and acceleration under piecewise constant jerk, one axis (Wieber 2006).

    Over the next `num_steps` intervals the position is `position_of_state @ state + position_of_jerk @ jerk`, likewise
    velocity and pressure centre, which is x - (h / g) x''.

    Args:
        num_steps, step: the horizon's intervals, and the length of one [s].
        height: of the CoM [m].
    """

    def __init__(self, num_steps: int, step: float, height: float, gravity: float):
        self.num_steps, self.step, self.lag = num_steps, step, height / gravity
        of_state = np.stack([_powers(step * (i + 1)) for i in range(num_steps)])
        of_jerk = np.zeros((num_steps, 3, num_steps))
        for i in range(num_steps):
            for j in range(i + 1):
                of_jerk[i, :, j] = _powers(step * (i - j)) @ _of_jerk(step)
        self.position_of_state, self.position_of_jerk = of_state[:, 0], of_jerk[:, 0]
        self.velocity_of_state, self.velocity_of_jerk = of_state[:, 1], of_jerk[:, 1]
        self.pressure_of_state = of_state[:, 0] - self.lag * of_state[:, 2]
        self.pressure_of_jerk = of_jerk[:, 0] - self.lag * of_jerk[:, 2]

    def pressure_after(self, state: np.ndarray, jerk: np.ndarray, time: np.ndarray) -> np.ndarray:
        """Pressure centre (...) [m] a while after a state (..., 3), under one jerk (...)."""
        x, v, a = np.moveaxis(state, -1, 0)
        x = x + v * time + 0.5 * a * time**2 + jerk * time**3 / 6.0
        return x - self.lag * (a + jerk * time)


class Pendulum:
    """CoM position and velocity over a piecewise constant pressure centre, one axis: the linear inverted pendulum.

    Over the next `num_steps` intervals the velocity is `velocity_of_state @ state + velocity_of_pressure @ pressure`,
    likewise the capture point.

    Args:
        num_steps, step: the horizon's intervals, and the length of one [s].
        height: of the CoM [m].
    """

    def __init__(self, num_steps: int, step: float, height: float, gravity: float):
        self.frequency = w = float(np.sqrt(gravity / height))
        self.growth = float(np.exp(w * step))
        cosh, sinh = np.cosh(w * step), np.sinh(w * step)
        free, forced = np.array([[cosh, sinh / w], [w * sinh, cosh]]), np.array([1.0 - cosh, -w * sinh])
        of_state, of_pressure = np.zeros((num_steps, 2, 2)), np.zeros((num_steps, 2, num_steps))
        state, pressure = np.eye(2), np.zeros((2, num_steps))
        for i in range(num_steps):
            state, pressure = free @ state, free @ pressure
            pressure[:, i] = forced
            of_state[i], of_pressure[i] = state, pressure
        self.velocity_of_state, self.velocity_of_pressure = of_state[:, 1], of_pressure[:, 1]
        self.capture_of_state = of_state[:, 0] + of_state[:, 1] / w
        self.capture_of_pressure = of_pressure[:, 0] + of_pressure[:, 1] / w

    def capture_point(self, state: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        """Where the capture point of states (n, 2) is after pressure centres (n, k): (n,) [m]."""
        point = state[:, 0] + state[:, 1] / self.frequency
        for i in range(pressure.shape[1]):
            point = pressure[:, i] + (point - pressure[:, i]) * self.growth
        return point


class QuadraticPrograms:
    """min 1/2 u'Hu + g'u with l <= C u <= u, solved by DAQP (D. Arnstrom et al. 2022); H and C are always the same.

    Constraints that cannot all be kept are broken as little as possible. The same numbers give the same bits, whatever
    was solved before.

    Args:
        hessian: H (k, k).
        constraints: C (m, k).
    """

    def __init__(self, hessian: np.ndarray, constraints: np.ndarray):
        try:
            import daqp
        except ImportError as error:
            raise UserError("this controller needs daqp: pip install 'surefoot[controllers]'") from error
        self._solve = daqp.solve
        self._hessian, self._constraints = np.ascontiguousarray(hessian), np.ascontiguousarray(constraints)
        self._inverse = np.linalg.inv(hessian)
        self._soft = np.full(len(constraints), 8, np.int32)

    def solve(self, gradient: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
        """Solutions (n, k) for gradients (n, k) and bounds (n, m)."""
        found = -np.matmul(gradient[:, None], self._inverse)[:, 0]  # without constraints, which is often all
        kept = np.matmul(found[:, None], self._constraints.T)[:, 0]
        for i in np.flatnonzero(((kept < lower) | (kept > upper)).any(axis=1)):
            bounds = upper[i], lower[i], self._soft
            found[i] = self._solve(self._hessian, gradient[i], self._constraints, *bounds)[0]
        return found


def _powers(time: float) -> np.ndarray:
    """Position, velocity and acceleration after a while without jerk, (3, 3)."""
    return np.array([[1.0, time, 0.5 * time**2], [0.0, 1.0, time], [0.0, 0.0, 1.0]])


def _of_jerk(time: float) -> np.ndarray:
    return np.array([time**3 / 6.0, 0.5 * time**2, time])
