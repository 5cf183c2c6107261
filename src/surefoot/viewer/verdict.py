"""Verdict: the state of a pushed robot (standing, recovering, recovered or fallen), and counts of these.

The words are those of a trial (`docs/method.md`), but without the wait of ten seconds: a robot has recovered once it
has been upright and slow for 2 s, as in the trials that need not run to their horizon.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from surefoot.evaluation.protocol import PROTOCOL
from surefoot.evaluation.quiet import QuietRule, com_speed, is_upright
from surefoot.physics.step_record import StepRecord
from surefoot.rates import CONTROL_HZ, TICKS_PER_STEP


class State(IntEnum):
    """The state of a robot."""

    STANDING = 0
    RECOVERING = 1
    RECOVERED = 2
    FELL = 3
    RESTLESS = 4
    """Ten seconds after the disturbance it is up, but does not stand still."""


class Verdicts:
    """The states of N robots and the count of what became of them.

    Attributes:
        state: of each robot, `State` (N,).
        since: seconds that each robot has been in it (N,).
        recovered, fallen: disturbances that ended so.
    """

    def __init__(self, num_robots: int):
        self.state = np.full(num_robots, State.STANDING)
        self.since = np.zeros(num_robots)
        self.recovered = 0
        self.fallen = 0
        self._over = np.zeros(num_robots, np.int64)
        self._everyone = np.arange(num_robots)
        self._quiet_rule = QuietRule(num_robots)

    def reset(self, ids: np.ndarray) -> None:
        """Robots `ids` (n,) stand anew; what they were recovering from does not count."""
        self._set(ids, State.STANDING)
        self._quiet_rule.reset(ids)
        self._over[ids] = 0

    def disturb(self, ids: np.ndarray, over: np.ndarray) -> None:
        """Robots `ids` (n,) are disturbed until the ticks `over` (n,) since their reset; the fallen stay fallen."""
        up = self.state[ids] != State.FELL
        ids, over = ids[up], over[up]
        self._over[ids] = over
        self._set(ids[self.state[ids] != State.RECOVERING], State.RECOVERING)

    def clear_counts(self) -> None:
        """Begin to count anew."""
        self.recovered = self.fallen = 0

    def update(self, ticks: StepRecord, tick: np.ndarray, diverged: np.ndarray) -> None:
        """Take in the last policy step (N, TICKS_PER_STEP, ...) of all robots; `tick` (N,) is its end."""
        self.since += TICKS_PER_STEP / CONTROL_HZ
        first_tick, counts = tick - TICKS_PER_STEP, tick > self._over
        self._quiet_rule.update(self._everyone, is_upright(ticks), com_speed(ticks), first_tick, counts)
        quiet = self._quiet_rule.holds(self._everyone)
        recovering = self.state == State.RECOVERING
        fell = (ticks.non_foot_contact.any(axis=1) | diverged) & (self.state != State.FELL)
        self.fallen += int(fell.sum())
        self._set(np.flatnonzero(fell), State.FELL)
        recovered = ~fell & quiet & (recovering | (self.state == State.RESTLESS))
        self.recovered += int((recovered & recovering).sum())
        self._set(np.flatnonzero(recovered), State.RECOVERED)
        late = recovering & ~fell & ~recovered & (tick - self._over > PROTOCOL.horizon * CONTROL_HZ)
        self._set(np.flatnonzero(late), State.RESTLESS)

    def _set(self, ids: np.ndarray, state: State) -> None:
        self.state[ids] = state
        self.since[ids] = 0.0
