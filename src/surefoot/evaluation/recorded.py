"""Recorded trials: trials run again with every tick kept, for films, curves over time and footprints."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from surefoot.evaluation.outcome import Outcome
from surefoot.evaluation.trials import Trial, TrialSource, draws, run_trials
from surefoot.physics.engines import DEFAULT_ENGINE
from surefoot.physics.step_record import StepRecord
from surefoot.rates import CONTROL_HZ
from surefoot.task.agent import Agent


@dataclass(frozen=True, eq=False)
class RecordedTrial:
    """One trial, tick by tick.

    Attributes:
        trial: what was run.
        outcome: its verdict.
        ticks: of one robot, (1, num_ticks, ...), from its reset to its verdict.
        begin: tick at which the disturbance began.
    """

    trial: Trial
    outcome: Outcome
    ticks: StepRecord
    begin: int


def record_trials(
    agent: Agent, trials: Iterable[Trial], num_threads: int = 0, engine: str = DEFAULT_ENGINE
) -> dict[Trial, RecordedTrial]:
    """Run trials of one agent, those in the same domain as one batch, and keep all their ticks."""
    different = list(dict.fromkeys(trials))
    recorded: dict[Trial, RecordedTrial] = {}
    for domain in dict.fromkeys(trial.domain for trial in different):
        recorder = _Recorder([trial for trial in different if trial.domain == domain])
        run_trials(agent, recorder, len(recorder.trials), num_threads, recorder.watch, domain, engine)
        recorded |= recorder.recorded(len(agent.contract.joints))
    return {trial: recorded[trial] for trial in different}


class _Recorder(TrialSource):
    """As many trials as there are slots, each in the slot of its place, and all their ticks."""

    def __init__(self, trials: list[Trial]):
        self.trials = trials
        self._todo = iter(trials)
        self._outcomes: dict[Trial, Outcome] = {}
        self._records: list[list[StepRecord]] = [[] for _ in trials]

    def next(self) -> Trial | None:
        """The next of the trials."""
        return next(self._todo, None)

    def report(self, trial: Trial, outcome: Outcome) -> None:
        """Keep the outcome."""
        self._outcomes[trial] = outcome

    def watch(self, slots: np.ndarray, ticks: StepRecord) -> None:
        """Keep a policy step of the robots in some slots; to be given to `run_trials` as `on_step`."""
        for row, slot in enumerate(slots.tolist()):
            self._records[slot].append(ticks[row : row + 1].copy())

    def recorded(self, num_joints: int) -> dict[Trial, RecordedTrial]:
        """The record of each trial."""
        found = {}
        for trial, records in zip(self.trials, self._records, strict=True):
            _, origin = draws(trial, num_joints)
            begin = origin + round(min(push.start for push in trial.pushes) * CONTROL_HZ)
            found[trial] = RecordedTrial(trial, self._outcomes[trial], StepRecord.join(records), begin)
        return found
