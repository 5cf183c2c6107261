"""Random pushes: the pushes of training episodes, drawn at random for each robot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surefoot.physics.pushes import PUSH_DURATION, Pushes
from surefoot.physics.rotations import horizontal
from surefoot.rates import CONTROL_DT, TICKS_PER_STEP
from surefoot.task.fall_rates import NUM_SECTORS, FallRates, to_sector

LIFT, PUSH = 0, 1
"""Slots of the pushes upwards and of those that follow."""


@dataclass(frozen=True)
class DisturbanceConfig:
    """Random horizontal pushes of a training episode; the defaults are the paper's (section IV-F).

    Attributes:
        bodies: the bodies that are pushed. One is drawn for each push.
        impulse: range of the impulses [Ns], uniform.
        body_scale: factor of every impulse, for each of the bodies. The default is 1.
        sagittal: preference for pushes forward and backward over pushes to the sides, from 0 to less than 0.5. The
            density over the angle is proportional to 1 / (1 - 2 sagittal cos(2 angle)).
        first: range of the first push's start [s], uniform.
        interval: range of the time from one push to the next [s], uniform.
        duration: duration of a push [s].
        survival_target: share of the hard pushes that robots are to survive. If given, each direction has a ceiling of
            its own. The ceiling begins at the range's upper end, rises while robots survive a larger share than this,
            and falls while they survive a smaller one.
        max_impulse: largest value of the ceilings [Ns].
        hard_share: share of the pushes with a hard impulse, which is close to the ceiling of the direction; see
            `RandomPushes.HARD`.
        lift: range of the push upwards at the root that precedes some pushes [Ns], uniform.
        lift_share: share of the pushes with such a lift. The push itself is then half as large as drawn.
        lift_gap: time from the lift to the push [s].
        small: range of the pushes that the robot should answer without a step [Ns], uniform.
        small_share: share of such small pushes.
        focus: share of the pushes at bodies, in directions and with impulses that sometimes make robots fall; see
            `FallRates`.
    """

    bodies: tuple[str, ...] = ("root",)
    impulse: tuple[float, float] = (26.5, 106.0)
    body_scale: tuple[float, ...] | None = None
    sagittal: float = 0.0
    first: tuple[float, float] = (1.0, 1.0)
    interval: tuple[float, float] = (5.0, 5.0)
    duration: float = PUSH_DURATION
    survival_target: float | None = None
    max_impulse: float = 600.0
    hard_share: float = 0.0
    lift: tuple[float, float] = (0.0, 0.0)
    lift_share: float = 0.0
    lift_gap: float = 0.24
    small: tuple[float, float] = (0.0, 0.0)
    small_share: float = 0.0
    focus: float = 0.0


class RandomPushes:
    """Draws every robot's next push once the last one has been survived.

    Args:
        config: ranges to draw from.
        pushes: the N robots' pushes to fill, in the slots `LIFT` and `PUSH`.
        rng: the environment batch's one generator.

    Attributes:
        ceiling: largest impulse drawn per sector of directions, (NUM_SECTORS,) [Ns], counter-clockwise from +x.
        falls: of late, by body, direction and impulse.
    """

    STEP = 4.0
    """How fast a ceiling moves [Ns per push], for a robot of the mass of the paper's."""
    HARD = 0.7
    """Pushes above this share of the ceiling move it."""
    SURVIVED_S = 2.0
    """A push is survived when the robot has not fallen for so long after its start."""

    def __init__(self, config: DisturbanceConfig, pushes: Pushes, rng: np.random.Generator):
        self.config = config
        self.pushes = pushes
        self.rng = rng
        self.ceiling = np.full(NUM_SECTORS, config.impulse[1])
        self._body_ids = np.array([pushes.robot.body_id(body) for body in config.bodies])
        self._step = self.STEP * pushes.robot.mass_scale
        self._body_scale = np.ones(len(pushes.robot.body_names))
        if config.body_scale:
            self._body_scale[self._body_ids] = config.body_scale
        num_robots = len(pushes.start)
        self._sector = np.zeros(num_robots, np.int64)
        self._impulse = np.zeros(num_robots)
        self._lifted = np.zeros(num_robots, bool)
        self._angle = np.zeros(num_robots)
        self.falls = FallRates(pushes.robot, config.bodies, config.impulse[1])
        self._latest_impulse = np.zeros(num_robots)
        self._latest_start = np.zeros(num_robots, np.int64)
        self._latest_at_root = np.ones(num_robots, bool)
        self._latest_angle = np.zeros(num_robots)
        self._root = pushes.robot.body_id("root")
        # The next push is drawn in good time before it may begin.
        survived = round(min(self.SURVIVED_S, config.interval[0]) / CONTROL_DT) - TICKS_PER_STEP
        self._survived_ticks = max(survived, round(config.duration / CONTROL_DT))

    @property
    def _start(self) -> np.ndarray:
        """First tick of each robot's push (N,)."""
        return self.pushes.start[:, PUSH]

    def reset(self, ids: np.ndarray) -> None:
        """Robots `ids` begin an episode."""
        self._latest_impulse[ids] = 0.0
        self._latest_at_root[ids] = True
        self._latest_start[ids] = 0
        self._draw(ids, np.zeros(len(ids), np.int64), self.config.first)

    def advance(self, tick: np.ndarray) -> np.ndarray:
        """Draw the next push of every robot that has survived its last one; `tick` (N,) since its reset.

        Returns:
            The robots that have (n,).
        """
        over = np.flatnonzero(self._start + self._survived_ticks <= tick)
        if len(over):
            self._move_ceiling(over, survived=True)
            self._count_falls(over, fell=False)
            self._draw(over, self._start[over], self.config.interval)
        return over

    def latest(self, tick: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The push that began last, before `tick` (N,) since each robot's reset.

        Returns:
            impulse: (N,) [Ns], infinite if it came with a push upwards, 0 if none began.
            since: (N,) ticks since its start, or since the reset.
        """
        begun = self._start < tick
        self._latest_impulse[begun] = np.where(self._lifted, np.inf, self._impulse)[begun]
        self._latest_start[begun] = self._start[begun]
        self._latest_at_root[begun] = (self.pushes.body[:, PUSH] == self._root)[begun]
        self._latest_angle[begun] = self._angle[begun]
        return self._latest_impulse, tick - self._latest_start

    def latest_place(self) -> tuple[np.ndarray, np.ndarray]:
        """Where the push of the last call of `latest` went.

        Returns:
            at_root: whether it was at the root (N,).
            angle: its direction in the world, counter-clockwise from +x (N,) [rad].
        """
        return self._latest_at_root, self._latest_angle

    def fell(self, ids: np.ndarray, tick: np.ndarray) -> None:
        """Robots `ids` (n,) have fallen at `tick` (n,) since their reset."""
        pushed = ids[self._start[ids] < tick]
        self._move_ceiling(pushed, survived=False)
        self._count_falls(pushed, fell=True)

    def _move_ceiling(self, ids: np.ndarray, survived: bool) -> None:
        if self.config.survival_target is None:
            return
        hard = ids[self._impulse[ids] > self.HARD * self.ceiling[self._sector[ids]]]
        np.add.at(self.ceiling, self._sector[hard], self._step * (survived - self.config.survival_target))
        np.clip(self.ceiling, self.config.impulse[1], self.config.max_impulse, out=self.ceiling)

    def _count_falls(self, ids: np.ndarray, fell: bool) -> None:
        if self.config.focus:
            ids = ids[~self._lifted[ids]]
            self.falls.count(self.pushes.body[ids, PUSH], self._angle[ids], self._impulse[ids], fell)

    def _draw(self, ids: np.ndarray, since: np.ndarray, wait: tuple[float, float]) -> None:
        n = len(ids)
        start = since + np.rint(self.rng.uniform(*wait, n) / CONTROL_DT).astype(np.int64)
        angle = self.rng.uniform(0.0, 2.0 * np.pi, n)
        angle = (angle - self.config.sagittal * np.sin(2.0 * angle)) % (2.0 * np.pi)
        self._sector[ids] = to_sector(angle)
        size = self.rng.uniform(self.config.impulse[0], self.ceiling[self._sector[ids]])
        if self.config.hard_share:
            hard = self.rng.random(n) < self.config.hard_share
            size[hard] = self.ceiling[self._sector[ids[hard]]] * self.rng.uniform(self.HARD, 1.0, hard.sum())
        body = self._body_ids[self.rng.integers(len(self._body_ids), size=n)]
        if self.config.small_share:
            small = self.rng.random(n) < self.config.small_share
            size[small] = self.rng.uniform(*self.config.small, small.sum())
        if self.config.focus:
            aimed = self.rng.random(n) < self.config.focus
            body[aimed], angle[aimed], drawn = self.falls.draw(aimed.sum(), self.rng)
            size[aimed] = np.clip(drawn, *self.config.impulse)
            self._sector[ids] = to_sector(angle)
        self._impulse[ids], self._angle[ids] = size, angle
        impulse = np.zeros((n, 3))
        horizontal(impulse)[:] = self._body_scale[body] * size * np.exp(1j * angle)
        if self.config.lift_share:
            lifted = self._lift(ids, start)
            start += lifted * round(self.config.lift_gap / CONTROL_DT)
            impulse[lifted] *= 0.5
            self._lifted[ids] = lifted
        self.pushes.schedule(ids, PUSH, body, impulse, start, self.config.duration)

    def _lift(self, ids: np.ndarray, start: np.ndarray) -> np.ndarray:
        """Push some of the robots upwards at `start`; which ones (n,)."""
        config = self.config
        lifted = self.rng.random(len(ids)) < config.lift_share
        up = self.rng.uniform(*config.lift, lifted.sum())[:, None] * np.array([0.0, 0.0, 1.0])
        self.pushes.cancel(ids, LIFT)
        self.pushes.schedule(ids[lifted], LIFT, self.pushes.robot.body_id("root"), up, start[lifted], config.duration)
        return lifted
