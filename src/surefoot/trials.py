"""Trials: one policy, one robot, one push, one verdict; thousands of them as one batch.

The batch never waits for its slowest robot: a finished robot's place is taken by the next trial.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from surefoot.control import ControlLoop
from surefoot.disturbance import Push
from surefoot.policy import Policy
from surefoot.robot import Robot, load_robot
from surefoot.simulation import CONTROL_HZ, POLICY_HZ, TICKS_PER_STEP, Ticks

SETTLE_S = 1.0
"""Time that the policy has to find its stance before the disturbance."""
HORIZON_S = 10.0
"""Time after the beginning of the disturbance at which a trial is judged."""
JUDGED_S = 1.0
"""The last part of it, in which the robot must stand."""
MAX_COM_SPEED = 0.15
"""Largest mean CoM speed in that part [m/s]."""
MAX_TILT_DEG = 20.0
"""Largest angle of pelvis and torso from upright in that part."""
QUIET_S = 2.0
"""A trial that is not `whole` has recovered once it has been upright and slow, as at the end of one, for so long."""
JOINT_NOISE = 0.02
"""Start angles differ by up to this [rad]."""
STEP_LENGTH = 0.03
"""A foot that moves by more than this has left its place [m]."""
NUM_SLOTS = 192


@dataclass(frozen=True)
class Trial:
    """One push of one robot.

    Attributes:
        push: its `start` is counted from the end of the settling time.
        seed: draws the start angles and the push's start within the policy step.
        whole: judged at the horizon; otherwise it may end as recovered once it is quiet.
    """

    push: Push
    seed: int
    whole: bool = True


@dataclass(frozen=True)
class Outcome:
    """What became of a trial.

    Attributes:
        recovered: by the one definition of success (`docs/method.md`).
        reason: "recovered", "fell", "restless" (CoM too fast at the end), "tilted" or "diverged".
        seconds: from the beginning of the disturbance to the end of the trial; negative if that came before.
        foot_shift: farthest that a foot came from its place at the push [m].
        com_speed: mean over the judged time [m/s]; NaN if the trial ended before.
        torque_ratio, speed_ratio: largest share of a joint's torque and speed limit that was used.
    """

    recovered: bool
    reason: str
    seconds: float
    foot_shift: float
    com_speed: float
    torque_ratio: float
    speed_ratio: float

    @property
    def without_step(self) -> bool:
        return self.recovered and self.foot_shift <= STEP_LENGTH


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
        return next(self._todo, None)

    def report(self, trial: Trial, outcome: Outcome) -> None:
        self.outcomes[trial] = outcome


def run_list(policy: Policy, trials: Iterable[Trial], **options) -> dict[Trial, Outcome]:
    """Run different trials, in any order; options are those of `run_trials`."""
    source = _List(trials)
    run_trials(policy, source, **options)
    return source.outcomes


def run_trials(
    policy: Policy,
    source: TrialSource,
    num_slots: int = NUM_SLOTS,
    num_threads: int = 0,
    on_step: Callable[[np.ndarray, Ticks], None] | None = None,
) -> None:
    """Run trials until the source has no more.

    Args:
        num_slots: robots in the batch.
        on_step: called with the running slots (n,) and their ticks after every policy step.
    """
    arena = _Arena(policy, num_slots, num_threads)
    while True:
        arena.fill(source)
        running = arena.running
        if not len(running):
            return
        ticks = arena.step(running)
        if on_step:
            on_step(running, ticks)
        ended = arena.judge(running, ticks)
        for slot, outcome in ended:
            source.report(arena.finish(slot), outcome)
        if ended:
            arena.drop_unwanted(source)


class _Arena:
    """The slots: which trial each robot is in, and what has been seen of it."""

    def __init__(self, policy: Policy, num_slots: int, num_threads: int):
        contract = policy.contract
        self.policy = policy
        self.robot: Robot = load_robot(contract.robot)
        nominal = np.array(contract.nominal_pose)
        self.loop = ControlLoop(self.robot, num_slots, nominal, contract.action_scale, num_threads)
        self.trial: list[Trial | None] = [None] * num_slots
        self.start = np.zeros(num_slots, np.int64)
        self.end = np.zeros(num_slots, np.int64)
        self.whole = np.zeros(num_slots, bool)
        self.speed_sum = np.zeros(num_slots)
        self.tilted = np.zeros(num_slots, bool)
        self.recent_speed = np.zeros((num_slots, round(QUIET_S * POLICY_HZ)))
        self.upright_steps = np.zeros(num_slots, np.int64)
        self.foot_place = np.zeros((num_slots, 2, 2))
        self.foot_shift = np.zeros(num_slots)
        self.torque_ratio = np.zeros(num_slots)
        self.speed_ratio = np.zeros(num_slots)

    @property
    def running(self) -> np.ndarray:
        return np.flatnonzero([trial is not None for trial in self.trial])

    def fill(self, source: TrialSource) -> None:
        slots = []
        for slot, trial in enumerate(self.trial):
            if trial is None:
                self.trial[slot] = source.next()
                if self.trial[slot] is None:
                    break
                slots.append(slot)
        if slots:
            self._begin(np.array(slots))

    def finish(self, slot: int) -> Trial:
        trial, self.trial[slot] = self.trial[slot], None
        assert trial is not None
        return trial

    def drop_unwanted(self, source: TrialSource) -> None:
        for slot, trial in enumerate(self.trial):
            if trial and not source.wants(trial):
                source.drop(self.finish(slot))

    def _begin(self, slots: np.ndarray) -> None:
        trials = [trial for slot in slots if (trial := self.trial[slot])]
        rngs = [np.random.default_rng(trial.seed) for trial in trials]
        noise = np.array([rng.uniform(-JOINT_NOISE, JOINT_NOISE, self.robot.num_joints) for rng in rngs])
        offset = np.array([rng.integers(TICKS_PER_STEP) for rng in rngs])
        joints = np.clip(self.loop.nominal + noise, self.robot.joint_lower, self.robot.joint_upper)
        self.loop.reset(slots, joints)
        self.policy.reset(slots)
        pushes = [trial.push for trial in trials]
        begin = np.rint([(SETTLE_S + push.start) * CONTROL_HZ for push in pushes]).astype(np.int64) + offset
        for slot, push, start in zip(slots, pushes, begin, strict=True):
            impulse = push.impulse * np.array(push.direction)
            self.loop.pushes.schedule(
                np.array([slot]), np.array([self.robot.body_id(push.body)]), impulse, start, push.duration
            )
        self.start[slots] = begin
        self.end[slots] = begin + round(HORIZON_S * CONTROL_HZ)
        self.whole[slots] = [trial.whole for trial in trials]
        for seen in (
            self.speed_sum,
            self.tilted,
            self.upright_steps,
            self.foot_shift,
            self.torque_ratio,
            self.speed_ratio,
        ):
            seen[slots] = 0

    def step(self, slots: np.ndarray) -> Ticks:
        return self.loop.step(self.policy(self.loop.observation[slots], slots), slots)

    def judge(self, slots: np.ndarray, ticks: Ticks) -> list[tuple[int, Outcome]]:
        """Outcomes of the trials that have just ended, by slot."""
        tick = self.loop.tick[slots, None] - TICKS_PER_STEP + np.arange(TICKS_PER_STEP)
        self._watch(slots, ticks, tick)
        fell = np.asarray((ticks.non_foot_contact & (tick < self.end[slots, None])).any(axis=1))
        diverged = self.loop.simulation.diverged[slots]
        quiet: np.ndarray = ~self.whole[slots] & self._is_quiet(slots)
        over = np.asarray(tick[:, -1] + 1 >= self.end[slots])
        ended = np.flatnonzero(fell | diverged | quiet | over)
        return [(int(slots[i]), self._verdict(slots[i], fell[i], diverged[i], over[i], tick[i, -1])) for i in ended]

    def _watch(self, slots: np.ndarray, ticks: Ticks, tick: np.ndarray) -> None:
        speed = np.linalg.norm(ticks.com_velocity, axis=-1)
        upright = (ticks.pelvis_uprightness > _COS_TILT) & (ticks.torso_uprightness > _COS_TILT)
        judged = (tick >= self.end[slots, None] - round(JUDGED_S * CONTROL_HZ)) & (tick < self.end[slots, None])
        self.speed_sum[slots] += (speed * judged).sum(axis=1)
        self.tilted[slots] |= (~upright & judged).any(axis=1)
        over = tick[:, 0] >= self.loop.pushes.end[slots]
        self.upright_steps[slots] = np.where(over & upright.all(axis=1), self.upright_steps[slots] + 1, 0)
        step = self.loop.tick[slots] // TICKS_PER_STEP
        self.recent_speed[slots, step % self.recent_speed.shape[1]] = speed.mean(axis=1)
        before = tick[:, -1] < self.start[slots]
        soles = ticks.sole_position[..., :2]
        self.foot_place[slots] = np.where(before[:, None, None], soles[:, -1], self.foot_place[slots])
        shift = np.linalg.norm(soles - self.foot_place[slots, None], axis=-1).max(axis=(1, 2))
        self.foot_shift[slots] = np.where(before, 0.0, np.maximum(self.foot_shift[slots], shift))
        torque = (np.abs(ticks.joint_torque) / self.robot.torque_limit).max(axis=(1, 2))
        velocity = (np.abs(ticks.joint_velocity) / self.robot.velocity_limit).max(axis=(1, 2))
        self.torque_ratio[slots] = np.maximum(self.torque_ratio[slots], torque)
        self.speed_ratio[slots] = np.maximum(self.speed_ratio[slots], velocity)

    def _is_quiet(self, slots: np.ndarray) -> np.ndarray:
        """Since the push's end, upright for `QUIET_S`, and over that time as slow on average as a recovered robot."""
        speed = self.recent_speed[slots]
        return (self.upright_steps[slots] >= speed.shape[1]) & (speed.mean(axis=1) < MAX_COM_SPEED)

    def _verdict(self, slot: int, fell: bool, diverged: bool, over: bool, tick: int) -> Outcome:
        com_speed = self.speed_sum[slot] / (JUDGED_S * CONTROL_HZ) if over else np.nan
        if diverged:
            reason = "diverged"
        elif fell:
            reason = "fell"
        elif over and self.tilted[slot]:
            reason = "tilted"
        elif over and com_speed >= MAX_COM_SPEED:
            reason = "restless"
        else:
            reason = "recovered"
        return Outcome(
            recovered=reason == "recovered",
            reason=reason,
            seconds=float(min(tick + 1, self.end[slot]) - self.start[slot]) / CONTROL_HZ,
            foot_shift=float(self.foot_shift[slot]),
            com_speed=float(com_speed),
            torque_ratio=float(self.torque_ratio[slot]),
            speed_ratio=float(self.speed_ratio[slot]),
        )


_COS_TILT = np.cos(np.radians(MAX_TILT_DEG))
