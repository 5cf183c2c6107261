"""Pushes: pushes as data, and their wrenches at tick resolution."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surefoot.rates import CONTROL_DT, TICKS_PER_STEP
from surefoot.robots import Robot

PUSH_DURATION = 0.12
"""The paper's push: a constant force for 0.12 s."""
NEVER = np.iinfo(np.int64).max
"""The start and the end of a push that is not there [ticks]."""


@dataclass(frozen=True)
class Push:
    """A constant force at a body.

    Attributes:
        body: a pushable body of the robot.
        direction: unit vector in the world frame; robots start facing +x.
        impulse: force x duration [Ns].
        start: time after the beginning of the trial [s].
        duration: duration of the force [s].
        lever: height of the force above the robot's CoM in the nominal pose [m]; negative values are below it. The
            default is the body's own CoM. The line of action keeps its height relative to the body.
    """

    body: str = "root"
    direction: tuple[float, float, float] = (1.0, 0.0, 0.0)
    impulse: float = 0.0
    start: float = 0.0
    duration: float = PUSH_DURATION
    lever: float | None = None


def horizontal_push(body: str, angle_deg: float, impulse: float, duration: float = PUSH_DURATION) -> Push:
    """Return a horizontal push that begins at once.

    Args:
        body: "root", or another pushable body of the robot.
        angle_deg: angle of the direction, counter-clockwise from forward (+x): 90 pushes to the left [deg].
        impulse: force x duration [Ns].
        duration: duration of the constant force [s].
    """
    angle = np.radians(angle_deg)
    return Push(body, (float(np.cos(angle)), float(np.sin(angle)), 0.0), impulse, 0.0, duration)


@dataclass(frozen=True)
class Drop:
    """A fall from a height in the nominal pose.

    Attributes:
        height: height of the lowest corner of the soles above the floor [m].
        roll, pitch: roll and pitch of the whole robot at its release [rad].
    """

    height: float
    roll: float = 0.0
    pitch: float = 0.0


class Pushes:
    """Up to `num_slots` pushes of each of N robots, written as wrenches at tick resolution.

    A slot holds one push of each robot; where pushes overlap, their forces are added in the order of the slots.

    Attributes:
        start, end: first tick of each push and first tick after it, counted from the robot's reset, (N, num_slots).
        body: indices into the robot's `body_names` (N, num_slots).
        force: world frame (N, num_slots, 3) [N].
        arm: height of the force's line of action above the body's CoM (N, num_slots) [m].
    """

    def __init__(self, robot: Robot, num_robots: int, num_slots: int = 1):
        self.robot = robot
        self.num_slots = num_slots
        self.start = np.full((num_robots, num_slots), NEVER, np.int64)
        self.end = self.start.copy()
        self.body = np.zeros((num_robots, num_slots), np.int64)
        self.force = np.zeros((num_robots, num_slots, 3))
        self.arm = np.zeros((num_robots, num_slots))
        self._ever_used = False

    def schedule(
        self,
        ids: np.ndarray,
        slot: int,
        body: np.ndarray | int,
        impulse: np.ndarray,
        start: np.ndarray | int,
        duration: float,
        arm: np.ndarray | float = 0.0,
    ) -> None:
        """Give robots a push in place of the one that they have in this slot.

        Args:
            ids: the robots (n,).
            slot: 0 to `num_slots` - 1.
            body: indices into the robot's `body_names` (n,), or one for all.
            impulse: in the world frame (n, 3), or (3,) for all [Ns].
            start: ticks since each robot's reset (n,), or one for all.
            duration: of the push [s]; it is rounded to whole ticks, one at least.
            arm: height of the force's line of action above the body's CoM (n,), or one for all [m].
        """
        self._ever_used = True
        num_ticks = max(1, round(duration / CONTROL_DT))
        self.start[ids, slot] = start
        self.end[ids, slot] = self.start[ids, slot] + num_ticks
        self.body[ids, slot] = body
        self.force[ids, slot] = impulse / (num_ticks * CONTROL_DT)
        self.arm[ids, slot] = arm

    def of(self, ids: np.ndarray) -> Pushes:
        """A copy of the pushes of robots `ids` (n,)."""
        some = Pushes(self.robot, len(ids), self.num_slots)
        for name in ("start", "end", "body", "force", "arm"):
            getattr(some, name)[:] = getattr(self, name)[ids]
        return some

    def cancel(self, ids: np.ndarray, slots: int | slice = slice(None)) -> None:
        """Take away the pushes of robots `ids` (n,) in one slot or, without it, in all of them."""
        self.start[ids, slots] = self.end[ids, slots] = NEVER

    def write(self, wrench: np.ndarray, tick: np.ndarray) -> np.ndarray:
        """Add the forces of the next policy step to the wrenches.

        Args:
            wrench: (N, TICKS_PER_STEP, num_bodies, 6) [N, Nm].
            tick: ticks since each robot's reset (N,).

        Returns:
            The robots that are pushed in this step (n,), whose wrenches the caller has to clear after it; a robot
            that is pushed twice is named twice.
        """
        if not self._ever_used:
            return _NOBODY
        is_active = (self.start < tick[:, None] + TICKS_PER_STEP) & (self.end > tick[:, None])
        active = [np.flatnonzero(is_active[:, slot]) for slot in range(self.num_slots)]
        for slot, ids in enumerate(active):
            if len(ids):
                self._add(wrench, tick, ids, slot)
        return np.concatenate(active)

    def _add(self, wrench: np.ndarray, tick: np.ndarray, ids: np.ndarray, slot: int) -> None:
        now = tick[ids, None] + np.arange(TICKS_PER_STEP)
        is_pushed = (now >= self.start[ids, slot, None]) & (now < self.end[ids, slot, None])
        force = self.force[ids, slot]
        x, y, _ = force.T
        torque = self.arm[ids, slot, None] * np.stack([-y, x, np.zeros_like(x)], axis=1)
        both = np.concatenate([force, torque], axis=1)
        wrench[ids, :, self.body[ids, slot]] += is_pushed[..., None] * both[:, None]


_NOBODY = np.zeros(0, np.int64)
