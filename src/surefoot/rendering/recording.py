"""Recording: real trials that were run and kept, moment by moment, to be drawn."""

from __future__ import annotations

import dataclasses
import functools
from dataclasses import dataclass

import numpy as np

from surefoot.agents.agent import Policy
from surefoot.agents.controllers.controller import ControllerAgent
from surefoot.errors import UserError
from surefoot.evaluation.outcome import Outcome
from surefoot.evaluation.trials import Trial, TrialSource, draws, run_trials
from surefoot.physics.step_record import StepRecord
from surefoot.rates import CONTROL_DT, CONTROL_HZ
from surefoot.rendering.moment import Moment
from surefoot.robots import Robot, load_robot


@dataclass(frozen=True, eq=False)
class Recording:
    """A trial that was run, moment by moment at `fps`, from the start of its settling time to its verdict."""

    policy: str
    robot: Robot
    trial: Trial
    outcome: Outcome
    fps: int
    moments: tuple[Moment, ...]

    @functools.cached_property
    def times(self) -> np.ndarray:
        """Since the beginning of the push (num_moments,) [s]."""
        return np.array([moment.time for moment in self.moments])

    def at(self, time: float) -> Moment:
        """The first moment that is not before `time`; else the last."""
        return self.moments[min(int(np.searchsorted(self.times, time - 1e-9)), len(self.moments) - 1)]


def record(policy: Policy | ControllerAgent, trial: Trial, fps: int = 50) -> Recording:
    """Run one trial and keep what a picture shows of it.

    Args:
        fps: moments per second of simulated time.

    Raises:
        UserError: `fps` does not divide the 500 ticks of a second.
    """
    valid = [rate for rate in range(1, CONTROL_HZ + 1) if CONTROL_HZ % rate == 0]
    if fps not in valid:
        raise UserError(f"cannot record {fps} frames per second; valid: {', '.join(map(str, valid))}")
    recorder = _Recorder(trial, len(policy.contract.joints), CONTROL_HZ // fps)
    run_trials(policy, recorder, num_slots=1, num_threads=1, on_step=recorder.watch, domain=trial.domain)
    return Recording(
        policy.name, load_robot(policy.contract.robot), trial, recorder.outcome, fps, recorder.timed_moments()
    )


class _Recorder(TrialSource):
    """The source of a single trial, and the one who watches it."""

    outcome: Outcome

    def __init__(self, trial: Trial, num_joints: int, stride: int):
        self._trial = trial
        self._todo: list[Trial] = [trial]
        _, self._begin = draws(trial, num_joints)
        self._stride = stride
        self._num_ticks = 0
        self._seen: list[tuple[int, Moment]] = []

    def next(self) -> Trial | None:
        return self._todo.pop() if self._todo else None

    def report(self, trial: Trial, outcome: Outcome) -> None:
        self.outcome = outcome

    def watch(self, slots: np.ndarray, ticks: StepRecord) -> None:
        for tick in range(-self._num_ticks % self._stride, len(ticks), self._stride):
            self._seen.append((self._num_ticks + tick, Moment.of(ticks, tick=tick)))
        self._num_ticks += len(ticks)

    def timed_moments(self) -> tuple[Moment, ...]:
        begin = self._begin + round(min(push.start for push in self._trial.pushes) * CONTROL_HZ)
        return tuple(dataclasses.replace(moment, time=(tick - begin) * CONTROL_DT) for tick, moment in self._seen)
