"""Traces: single trials run again, with every tick kept, for curves over time and footprints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.ndimage import binary_closing

from surefoot.agents.agent import Policy
from surefoot.agents.controllers.controller import ControllerAgent
from surefoot.evaluation.outcome import Outcome
from surefoot.evaluation.strategies import DEBOUNCE_S, LOADED_FORCE, Strategies, StrategyWatch
from surefoot.evaluation.trials import Trial, TrialSource, draws, run_trials
from surefoot.physics.rotations import roll_pitch
from surefoot.physics.step_record import StepRecord
from surefoot.rates import CONTROL_DT, CONTROL_HZ, TICKS_PER_STEP
from surefoot.rendering.moment import Moment
from surefoot.rendering.recording import Recording
from surefoot.robots import Robot, load_robot
from surefoot.robots.model import FLOOR

STRIDE = 10
"""Curves show every tenth tick: 50 Hz."""


@dataclass(frozen=True, eq=False)
class Trace:
    """One trial, tick by tick.

    Attributes:
        ticks: of one robot, (1, num_ticks, ...), from its reset to its verdict.
        begin: tick at which the disturbance began.
    """

    trial: Trial
    outcome: Outcome
    ticks: StepRecord
    begin: int

    @cached_property
    def time(self) -> np.ndarray:
        """Since the disturbance began (num_ticks,) [s]."""
        return (np.arange(len(self.ticks)) - self.begin) * CONTROL_DT

    @cached_property
    def com_shift(self) -> np.ndarray:
        """Horizontal CoM position, counted from where it was at the disturbance: (num_ticks, 2) [m], world frame."""
        place = self.ticks.com_position[0, :, :2]
        return place - place[self.begin]

    @property
    def root_attitude_deg(self) -> np.ndarray:
        """Roll and pitch: (2, num_ticks) [deg]."""
        return np.degrees(self.ticks.root_attitude[:, 0])

    @cached_property
    def foot_loaded(self) -> np.ndarray:
        """Does the foot carry load, but for chatter? bool (num_ticks, 2): left, right."""
        loaded = self.ticks.foot_force[0] > LOADED_FORCE
        gap = np.ones((round(DEBOUNCE_S / CONTROL_DT) + 1, 1))
        return loaded | binary_closing(loaded, gap)

    @property
    def sole_height(self) -> np.ndarray:
        """Height of the soles' centres above a flat floor: (num_ticks, 2) [m]."""
        return self.ticks.sole_position[0, ..., 2] - self.ticks.robot.model().geom(FLOOR).pos[2]

    @property
    def foot_attitude_deg(self) -> np.ndarray:
        """Roll and pitch of the feet: (2, num_ticks, 2) [deg]."""
        return np.degrees(roll_pitch(self.ticks.foot_orientation[0]))

    @cached_property
    def strategies(self) -> Strategies:
        """What the robot did, with the places of its steps, told from the ticks as in the trial itself."""
        watch, ids = StrategyWatch(self.ticks.robot, 1), np.array([0])
        watch.reset(ids, self.ticks.ticks(slice(0, 1)))
        for first in range(0, len(self.ticks), TICKS_PER_STEP):
            active = self.time[None, first : first + TICKS_PER_STEP] > -0.5 * CONTROL_DT
            watch.update(ids, self.ticks.ticks(slice(first, first + TICKS_PER_STEP)), active)
        return watch.strategies(0)

    def recording(self, policy_name: str) -> Recording:
        """As `surefoot.video` draws it."""
        ticks = range(self.begin % STRIDE, len(self.time), STRIDE)
        moments = (Moment.of(self.ticks, tick=tick, time=float(self.time[tick])) for tick in ticks)
        fps = CONTROL_HZ // STRIDE
        return Recording(policy_name, self.ticks.robot, self.trial, self.outcome, fps, tuple(moments))


def run_traces(policy: Policy | ControllerAgent, trials: Mapping[str, Trial]) -> dict[str, Trace]:
    """Run some whole trials of one policy again, those in the same world as one batch."""
    traces: dict[Trial, Trace] = {}
    for domain in dict.fromkeys(trial.domain for trial in trials.values()):
        recorder = _Recorder(list(dict.fromkeys(trial for trial in trials.values() if trial.domain == domain)))
        run_trials(policy, recorder, len(recorder.trials), on_step=recorder.watch, domain=domain)
        traces |= recorder.traces(load_robot(policy.contract.robot))
    return {name: traces[trial] for name, trial in trials.items()}


class _Recorder(TrialSource):
    """As many trials as there are slots, each in the slot of its place, and all their ticks."""

    def __init__(self, trials: list[Trial]):
        self.trials = trials
        self._todo = iter(trials)
        self._outcomes: dict[Trial, Outcome] = {}
        self._records: list[list[StepRecord]] = [[] for _ in trials]

    def next(self) -> Trial | None:
        return next(self._todo, None)

    def report(self, trial: Trial, outcome: Outcome) -> None:
        self._outcomes[trial] = outcome

    def watch(self, slots: np.ndarray, ticks: StepRecord) -> None:
        for row, slot in enumerate(slots.tolist()):
            self._records[slot].append(ticks[row : row + 1].copy())

    def traces(self, robot: Robot) -> dict[Trial, Trace]:
        found = {}
        for trial, records in zip(self.trials, self._records, strict=True):
            _, begin = draws(trial, robot.num_joints)
            begin += round(min(push.start for push in trial.pushes) * CONTROL_HZ)
            found[trial] = Trace(trial, self._outcomes[trial], StepRecord.join(records), begin)
        return found
