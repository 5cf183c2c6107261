"""Playback: the motion of a robot, kept for every policy step and shown again on the live page."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from surefoot.evaluation.outcome import Outcome
from surefoot.evaluation.recorded import RecordedTrial
from surefoot.evaluation.strategies import StrategyWatch
from surefoot.evaluation.trials import draws
from surefoot.physics.pushes import Pushes
from surefoot.physics.step_record import StepRecord
from surefoot.rates import CONTROL_DT, CONTROL_HZ, POLICY_HZ, TICKS_PER_STEP
from surefoot.task.control_loop import NUM_PUSHES
from surefoot.viewer.deeds import SHOWN, Deed
from surefoot.viewer.session import Session, strategy_words
from surefoot.viewer.verdict import State, Verdicts

BEFORE_S, AFTER_S, LONGEST_S = 0.4, 1.0, 14.0
"""Recorded times of a deed: before its beginning, after its verdict, and at most in all [s]."""


@dataclass(frozen=True, eq=False)
class Kept:
    """One robot in one policy step.

    Attributes:
        ticks: of the step (1, num_ticks, ...).
        end: tick at which it ends, since the robot's reset.
        pushes: what acted on the robot.
        state: its verdict at the end of the step.
        words: the strategies that it had used.
        hand_force: of the hand that held it [N]; 0 if none did.
    """

    ticks: StepRecord
    end: int
    pushes: Pushes
    state: State
    words: str
    hand_force: float = 0.0

    @classmethod
    def of(cls, session: Session, robot: int) -> Kept:
        """The motion of a session's robot in its last step."""
        ids = np.array([robot])
        state = State(session.verdicts.state[robot])
        force, words = session.hand_force(robot), session.strategies(robot)
        end = int(session.loop.tick[robot])
        return cls(session.ticks[ids].copy(), end, session.pushes.of(ids), state, words, force)


class Takes:
    """Keeps what the watched robot did at each of the last deeds."""

    def __init__(self) -> None:
        self._takes: deque[tuple[Deed, list[Kept]]] = deque(maxlen=SHOWN)
        self._before: deque[Kept] = deque(maxlen=round(BEFORE_S * POLICY_HZ))
        self._robot = 0
        self._is_open = False
        self._left = 0

    def of(self, deed: Deed) -> Sequence[Kept]:
        """The record of a deed; nothing if no robot was watched then."""
        return next((take for known, take in self._takes if known is deed), ())

    def keep(self, deed: Deed, take: list[Kept]) -> None:
        """Keep what is already known of a deed."""
        self._takes.appendleft((deed, take))
        self._is_open = False

    def add(self, session: Session, watched: int) -> None:
        """Remember the session's last step of the watched robot."""
        now = Kept.of(session, watched)
        if watched != self._robot:
            self._robot, self._is_open = watched, False
            self._before.clear()
        deed = session.deeds.newest
        if deed and not any(known is deed for known, _ in self._takes):
            self.keep(deed, [*self._before, now])
            self._is_open, self._left = True, round(AFTER_S * POLICY_HZ)
        elif self._is_open:
            self._extend(now)
        self._before.append(now)

    def _extend(self, now: Kept) -> None:
        _, take = self._takes[0]
        has_begun_anew = now.end <= take[-1].end
        if has_begun_anew or self._left <= 0 or len(take) >= LONGEST_S * POLICY_HZ:
            self._is_open = False
        else:
            take.append(now)
            self._left -= now.state not in (State.STANDING, State.RECOVERING)


def take_of(recorded: RecordedTrial) -> list[Kept]:
    """A trial of the evaluation as the page shows it; its last picture stays for a while."""
    robot, trial = recorded.ticks.robot, recorded.trial
    pushes = Pushes(robot, 1, NUM_PUSHES)
    _, origin = draws(trial, robot.num_joints)
    for place, push in enumerate(trial.pushes):
        impulse, start = push.impulse * np.array(push.direction), origin + round(push.start / CONTROL_DT)
        pushes.schedule(np.array([0]), place, robot.body_id(push.body), impulse, start, push.duration)
    watch, one, take = StrategyWatch(robot, 1), np.array([0]), []
    watch.reset(one, recorded.ticks.ticks(slice(0, 1)))
    for first in range(0, len(recorded.ticks), TICKS_PER_STEP):
        ticks = recorded.ticks.ticks(slice(first, first + TICKS_PER_STEP))
        numbers = first + np.arange(len(ticks))
        watch.update(one, ticks, numbers[None] >= recorded.begin)
        has_begun = numbers[-1] >= recorded.begin
        state = State.RECOVERING if has_begun else State.STANDING
        take.append(Kept(ticks, first + len(ticks), pushes, state, strategy_words(watch, 0)))
    verdict = state_of(recorded.outcome)
    last = Kept(take[-1].ticks, take[-1].end, pushes, verdict, take[-1].words or recorded.outcome.reason)
    return [*take[:-1], *[last] * round(AFTER_S * POLICY_HZ)]


def state_of(outcome: Outcome) -> State:
    """The page's verdict of an outcome."""
    if outcome.recovered:
        return State.RECOVERED
    return State.RESTLESS if outcome.reason in ("restless", "tilted") else State.FELL


class Playback:
    """A take that is shown in the place of the session, as if it were one of a single robot.

    Args:
        take: what is shown, one step at least.
        live: the session that waits meanwhile.
        words: what was done.

    Attributes:
        words: the same.
        verdicts: the state of the robot, and the counts of the session.
        deeds: those of the session.
        ticks: of the step that is shown.
    """

    num_robots = 1

    def __init__(self, take: Sequence[Kept], live: Session, words: str):
        self.robot = take[0].ticks.robot
        self.words = words
        self.deeds = live.deeds
        self.verdicts = Verdicts(1)
        self.verdicts.recovered, self.verdicts.fallen = live.verdicts.recovered, live.verdicts.fallen
        self._take = take
        self._next = 0
        self.step()

    @property
    def is_over(self) -> bool:
        """Has the last step been shown?"""
        return self._next >= len(self._take)

    def step(self) -> StepRecord:
        """Go on to the next step, or stay at the last."""
        self._now = self._take[min(self._next, len(self._take) - 1)]
        self._next += 1
        self.ticks = self._now.ticks
        self.verdicts.state[0] = self._now.state
        return self.ticks

    @property
    def pushes(self) -> Pushes:
        """The forces on the robot."""
        return self._now.pushes

    def since(self, tick: int) -> np.ndarray:
        """As of a session."""
        now = self._now.end - len(self.ticks) + tick % len(self.ticks)
        return np.where(now >= self.pushes.start, (now - self.pushes.end) / CONTROL_HZ, np.inf)

    @property
    def is_held(self) -> np.ndarray:
        """As of a session, bool (1,)."""
        return np.array([self._now.hand_force > 0.0])

    def hand_force(self, robot: int) -> float:
        """As of a session [N]."""
        return self._now.hand_force

    def strategies(self, robot: int) -> str:
        """As of a session."""
        return self._now.words


Shown = Session | Playback
"""The robots that the page shows: those of a live session, or a recorded one."""
