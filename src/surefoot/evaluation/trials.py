"""Trials: one policy or controller, one robot, one disturbance, one verdict; thousands of them as one batch.

The batch never waits for its slowest robot: a finished robot's place is taken by the next trial.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from surefoot.errors import UserError
from surefoot.evaluation.outcome import Outcome
from surefoot.evaluation.protocol import PROTOCOL
from surefoot.evaluation.trial_monitor import TrialMonitor
from surefoot.physics.engines import DEFAULT_ENGINE, engine_kind
from surefoot.physics.pushes import Drop, Push
from surefoot.physics.step_record import StepRecord
from surefoot.rates import CONTROL_DT, CONTROL_HZ, TICKS_PER_STEP
from surefoot.robots.domain import NOMINAL_DOMAIN, DomainParameters
from surefoot.task.agent import Agent
from surefoot.task.control_loop import ControlLoop
from surefoot.task.imperfections import PERFECT, Imperfections

SETTLE_S = PROTOCOL.settle_time
"""Time that the policy has to find its stance before the disturbance."""
JOINT_NOISE = PROTOCOL.start_angle_noise
"""Start angles differ by up to this [rad]."""
NUM_SLOTS = 192

NO_PUSH = Push()


@dataclass(frozen=True)
class Trial:
    """One disturbance of one robot.

    The start of a push is counted from the end of the settling time, or from the release of a dropped robot.

    Attributes:
        push: the push. A push of 0 Ns disturbs nothing; the disturbance then begins when the push would have begun.
        seed: seed of the start angles, the push's start within the policy step, noise and bias.
        full_length: run to the horizon. Otherwise the trial may end as recovered once the robot stands quietly.
        preceding: a push before the main push, or at the same time.
        drop: the robot begins in the air, without a settling time.
        imperfections: imperfections of sensors and actuators.
        domain: properties of the ground and the robot; the same for all trials of a batch.
        horizon: time from the beginning of the disturbance to the verdict [s].
        quiet_from: time after the beginning of the disturbance from which quiet standing is measured [s].
    """

    push: Push = NO_PUSH
    seed: int = 0
    full_length: bool = True
    preceding: Push | None = None
    drop: Drop | None = None
    imperfections: Imperfections = PERFECT
    domain: DomainParameters = NOMINAL_DOMAIN
    horizon: float = PROTOCOL.horizon
    quiet_from: float = PROTOCOL.quiet_from

    @property
    def pushes(self) -> tuple[Push, ...]:
        """All pushes, the preceding one first."""
        return (self.push,) if self.preceding is None else (self.preceding, self.push)


class TrialSource(ABC):
    """Where `run_trials` gets its work from; it may depend on what came out so far."""

    @abstractmethod
    def next(self) -> Trial | None:
        """The next trial, or None if there is none until another is reported."""

    @abstractmethod
    def report(self, trial: Trial, outcome: Outcome) -> None:
        """A trial has ended."""

    def wants(self, trial: Trial) -> bool:
        """Is a running trial's outcome still of interest?"""
        return True

    def drop(self, trial: Trial) -> None:  # noqa: B027 nothing to do is a fair answer
        """A trial that is not wanted any more was stopped; it will not be reported."""


class _List(TrialSource):
    def __init__(self, trials: Iterable[Trial]):
        self._todo = iter(trials)
        self.outcomes: dict[Trial, Outcome] = {}

    def next(self) -> Trial | None:
        """The next of the list."""
        return next(self._todo, None)

    def report(self, trial: Trial, outcome: Outcome) -> None:
        """Keep the outcome."""
        self.outcomes[trial] = outcome


def run_trial(policy: Agent, trial: Trial) -> Outcome:
    """Run a single trial.

    Args:
        policy: the agent that moves the robot.
        trial: the conditions: a push, a drop, noise, the ground.

    Returns:
        The outcome: `recovered` and `reason`, steps, strategies, and the used share of the joints' limits.
    """
    return run_list(policy, [trial], num_slots=1, domain=trial.domain)[trial]


def run_list(policy: Agent, trials: Iterable[Trial], **options: Any) -> dict[Trial, Outcome]:
    """Run different trials, in any order; options are those of `run_trials`."""
    source = _List(trials)
    run_trials(policy, source, **options)
    return source.outcomes


def run_trials(
    policy: Agent,
    source: TrialSource,
    num_slots: int = 0,
    num_threads: int = 0,
    on_step: Callable[[np.ndarray, StepRecord], None] | None = None,
    domain: DomainParameters = NOMINAL_DOMAIN,
    engine: str = DEFAULT_ENGINE,
) -> None:
    """Run trials until the source has no more.

    Args:
        policy: the agent that moves the robots.
        source: hands out the trials and is told their outcomes.
        num_slots: robots in the batch; 0 for as many as suit the engine.
        num_threads: of the physics; 0 for all cores.
        on_step: called with the running slots (n,) and their ticks after every policy step.
        domain: of all the trials.
        engine: name of the physics engine.

    Raises:
        UserError: a trial is with other domain parameters.
    """
    arena = _Arena(policy, num_slots or engine_kind(engine).num_slots or NUM_SLOTS, num_threads, domain, engine)
    while True:
        arena.fill(source)
        running = arena.running
        if not len(running):
            return
        ticks, ended = arena.step(running)
        if on_step:
            on_step(running, ticks)
        for slot, outcome in ended.items():
            source.report(arena.finish(slot), outcome)
        if ended:
            arena.drop_unwanted(source)


class _Arena:
    """The slots: which trial each robot is in."""

    def __init__(self, policy: Agent, num_slots: int, num_threads: int, domain: DomainParameters, engine: str):
        self.domain = domain
        self.robot = policy.robot
        nominal = np.array(policy.contract.nominal_pose)
        self.loop = ControlLoop(self.robot, num_slots, nominal, num_threads=num_threads, domain=domain, engine=engine)
        self.loop.prepare(policy)
        self.monitor = TrialMonitor(self.robot, num_slots, domain.motor_strength)
        self.trial: list[Trial | None] = [None] * num_slots
        self._arms: dict[tuple[str, float], float] = {}

    @property
    def running(self) -> np.ndarray:
        """Slots in which a trial runs."""
        return np.flatnonzero([trial is not None for trial in self.trial])

    def fill(self, source: TrialSource) -> None:
        """Begin trials of the source in the free slots."""
        slots = []
        for slot, trial in enumerate(self.trial):
            if trial is None:
                self.trial[slot] = source.next()
                if self.trial[slot] is None:
                    break
                slots.append(slot)
        if slots:
            self._begin(np.array(slots), [trial for slot in slots if (trial := self.trial[slot])])

    def finish(self, slot: int) -> Trial:
        """Free a slot; returns the trial that was in it."""
        trial, self.trial[slot] = self.trial[slot], None
        assert trial is not None
        return trial

    def drop_unwanted(self, source: TrialSource) -> None:
        """Stop the trials that the source does not want any more."""
        for slot, trial in enumerate(self.trial):
            if trial and not source.wants(trial):
                source.drop(self.finish(slot))

    def step(self, slots: np.ndarray) -> tuple[StepRecord, dict[int, Outcome]]:
        """Make a policy step in some slots; returns its ticks, and the outcomes of the trials that ended, by slot."""
        everyone = len(slots) == len(self.trial)  # then nothing is copied
        ticks = self.loop.drive(None if everyone else slots)
        diverged = self.loop.engine.diverged[slots]
        return ticks, self.monitor.update(slots, ticks, self.loop.tick[slots], diverged, self.loop.failed)

    def _begin(self, slots: np.ndarray, trials: list[Trial]) -> None:
        if any(trial.domain != self.domain for trial in trials):
            raise UserError(f"a trial has other domain parameters than this batch's, {self.domain}")
        noise, begins = zip(*(draws(trial, self.robot.num_joints) for trial in trials), strict=True)
        drops = [trial.drop or _ON_THE_FLOOR for trial in trials]
        start_ticks = self.loop.reset(
            slots,
            np.clip(self.loop.nominal + np.array(noise), self.robot.joint_lower, self.robot.joint_upper),
            height=np.array([drop.height for drop in drops]),
            roll=np.array([drop.roll for drop in drops]),
            pitch=np.array([drop.pitch for drop in drops]),
        )
        begin = np.array(begins)
        for slot, trial, tick in zip(slots.tolist(), trials, begin.tolist(), strict=True):
            self.loop.set_imperfections(slot, trial.imperfections, trial.seed)
            for place, push in enumerate(trial.pushes):
                self._schedule(slot, place, push, tick)
        self.monitor.reset(
            slots,
            start_ticks,
            start=begin + _ticks([min(push.start for push in trial.pushes) for trial in trials]),
            push_end=begin + _ticks([max(push.start + push.duration for push in trial.pushes) for trial in trials]),
            horizon=np.array([trial.horizon for trial in trials]),
            quiet_from=np.array([trial.quiet_from for trial in trials]),
            full_length=np.array([trial.full_length for trial in trials]),
        )

    def _schedule(self, slot: int, place: int, push: Push, begin: int) -> None:
        """Give the robot of an arena's slot a push at a place among its pushes."""
        impulse = push.impulse * np.array(push.direction)
        start = begin + round(push.start / CONTROL_DT)
        body = self.robot.body_id(push.body)
        self.loop.pushes.schedule(np.array([slot]), place, body, impulse, start, push.duration, self._arm(push))

    def _arm(self, push: Push) -> float:
        if push.lever is None:
            return 0.0
        key = (push.body, push.lever)
        if key not in self._arms:
            self._arms[key] = self.robot.lever_arm(self.loop.nominal, *key)
        return self._arms[key]


def draws(trial: Trial, num_joints: int) -> tuple[np.ndarray, int]:
    """Return the quantities that the seed of a trial draws.

    Returns:
        The deviations of the start angles (num_joints,) [rad], and the tick from which the starts of the pushes are
        counted.
    """
    rng = np.random.default_rng(trial.seed)
    noise = rng.uniform(-JOINT_NOISE, JOINT_NOISE, num_joints)
    offset = int(rng.integers(TICKS_PER_STEP))
    return noise, 0 if trial.drop else round(SETTLE_S * CONTROL_HZ) + offset


_ON_THE_FLOOR = Drop(0.0)


def _ticks(seconds: list[float]) -> np.ndarray:
    return np.rint(np.array(seconds) * CONTROL_HZ).astype(np.int64)
