"""Pushes as data, and their wrenches at tick resolution."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surefoot.rates import CONTROL_DT, TICKS_PER_STEP
from surefoot.robots import Robot

PUSH_DURATION = 0.12
"""The paper's push: a constant force for 0.12 s."""


@dataclass(frozen=True)
class Push:
    """A constant force at a body.

    Attributes:
        body: a pushable body of the robot.
        direction: unit vector in the world frame; robots start facing +x.
        impulse: force x duration [Ns].
        start: seconds after the trial's beginning.
        duration: [s].
        lever: where the force acts: so far above (or, negative, below) the robot's CoM [m] as both are in the nominal
            pose; without it, at the body's own CoM. The line of action keeps its height relative to the body.
    """

    body: str = "root"
    direction: tuple[float, float, float] = (1.0, 0.0, 0.0)
    impulse: float = 0.0
    start: float = 0.0
    duration: float = PUSH_DURATION
    lever: float | None = None


def horizontal_push(body: str, angle_deg: float, impulse: float, duration: float = PUSH_DURATION) -> Push:
    """A horizontal push at once; `angle_deg` counts counter-clockwise from forward (+x) [deg], `impulse` is in Ns."""
    angle = np.radians(angle_deg)
    return Push(body, (float(np.cos(angle)), float(np.sin(angle)), 0.0), impulse, 0.0, duration)


@dataclass(frozen=True)
class Drop:
    """A fall from a height in the nominal pose.

    Attributes:
        height: of the lowest corner of the soles above the floor [m].
        roll, pitch: of the whole robot at its release [rad].
    """

    height: float
    roll: float = 0.0
    pitch: float = 0.0


class Pushes:
    """The current push of each of N robots, written as wrenches at tick resolution.

    Attributes:
        start, end: first tick of the push and first tick after it, counted from the robot's reset, (N,).
        body: MuJoCo body ids (N,).
        force: world frame (N, 3) [N].
        arm: height of the force's line of action above the body's CoM (N,) [m].
    """

    def __init__(self, robot: Robot, num_robots: int):
        self.robot = robot
        self.start = np.full(num_robots, np.iinfo(np.int64).max, np.int64)
        self.end = self.start.copy()
        self.body = np.zeros(num_robots, np.int64)
        self.force = np.zeros((num_robots, 3))
        self.arm = np.zeros(num_robots)
        self._written = self._written_body = np.zeros(0, np.int64)
        self._ever_used = False

    def schedule(
        self,
        ids: np.ndarray,
        body: np.ndarray,
        impulse: np.ndarray,
        start: np.ndarray,
        duration: float,
        arm: np.ndarray | float = 0.0,
    ) -> None:
        """Give robots `ids` (n,) a push: body ids (n,), impulse vectors (n, 3) [Ns], start ticks (n,), [s], arm [m]."""
        self._ever_used = True
        num_ticks = max(1, round(duration / CONTROL_DT))
        self.start[ids], self.end[ids] = start, start + num_ticks
        self.body[ids] = body
        self.force[ids] = impulse / (num_ticks * CONTROL_DT)
        self.arm[ids] = arm

    def cancel(self, ids: np.ndarray) -> None:
        """No push for robots `ids`."""
        self.start[ids] = self.end[ids] = np.iinfo(np.int64).max

    def clear(self, wrench: np.ndarray) -> None:
        """Take back what the last `add` wrote into the wrenches."""
        if len(self._written):
            wrench[self._written, :, self._written_body] = 0.0

    def add(self, wrench: np.ndarray, tick: np.ndarray) -> None:
        """Add the forces of the next policy step.

        Args:
            wrench: (N, TICKS_PER_STEP, num_bodies, 6).
            tick: ticks since each robot's reset (N,).
        """
        if not self._ever_used:
            return
        active = np.flatnonzero((self.start < tick + TICKS_PER_STEP) & (self.end > tick))
        self._written, self._written_body = active, self.body[active]
        if not len(active):
            return
        now = tick[active, None] + np.arange(TICKS_PER_STEP)
        pushed = (now >= self.start[active, None]) & (now < self.end[active, None])
        x, y, _ = self.force[active].T
        torque = self.arm[active, None] * np.stack([-y, x, np.zeros_like(x)], axis=1)
        both = np.concatenate([self.force[active], torque], axis=1)
        wrench[active, :, self.body[active]] += pushed[..., None] * both[:, None]
