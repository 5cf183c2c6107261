"""Traces: single trials run again, with every tick kept, for curves over time and footprints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.ndimage import binary_closing

from surefoot.evaluation.protocol import protocol_for
from surefoot.evaluation.recorded import RecordedTrial, record_trials
from surefoot.evaluation.strategies import DEBOUNCE_S, Strategies, StrategyWatch
from surefoot.evaluation.trials import Trial
from surefoot.physics.rotations import roll_pitch
from surefoot.rates import CONTROL_DT, CONTROL_HZ, TICKS_PER_STEP
from surefoot.rendering.recording import Recording
from surefoot.robots.model import FLOOR
from surefoot.task.agent import Agent

STRIDE = 10
"""Curves show every tenth tick: 50 Hz."""


@dataclass(frozen=True, eq=False)
class Trace(RecordedTrial):
    """A recorded trial, and what is drawn of it."""

    @cached_property
    def time(self) -> np.ndarray:
        """Since the disturbance began (num_ticks,) [s]."""
        return np.asarray((np.arange(len(self.ticks)) - self.begin) * CONTROL_DT)

    @cached_property
    def com_shift(self) -> np.ndarray:
        """Horizontal CoM position, counted from where it was at the disturbance: (num_ticks, 2) [m], world frame."""
        place = self.ticks.com_position[0, :, :2]
        return np.asarray(place - place[self.begin])

    @property
    def root_attitude_deg(self) -> np.ndarray:
        """Roll and pitch: (2, num_ticks) [deg]."""
        return np.asarray(np.degrees(self.ticks.root_attitude[:, 0]))

    @cached_property
    def foot_loaded(self) -> np.ndarray:
        """Does the foot carry load, but for chatter? bool (num_ticks, 2): left, right."""
        loaded = self.ticks.foot_force[0] > protocol_for(self.ticks.robot).loaded_force
        gap = np.ones((round(DEBOUNCE_S / CONTROL_DT) + 1, 1))
        return np.asarray(loaded | binary_closing(loaded, gap))

    @property
    def sole_height(self) -> np.ndarray:
        """Height of the soles' centres above a flat floor: (num_ticks, 2) [m]."""
        return np.asarray(self.ticks.sole_position[0, ..., 2] - self.ticks.robot.model().geom(FLOOR).pos[2])

    @property
    def foot_attitude_deg(self) -> np.ndarray:
        """Roll and pitch of the feet: (2, num_ticks, 2) [deg]."""
        return np.asarray(np.degrees(roll_pitch(self.ticks.foot_orientation[0])))

    @cached_property
    def strategies(self) -> Strategies:
        """The robot's strategies with the places of its steps, recognised from the ticks as in the trial itself."""
        watch, ids = StrategyWatch(self.ticks.robot, 1), np.array([0])
        watch.reset(ids, self.ticks.ticks(slice(0, 1)))
        for first in range(0, len(self.ticks), TICKS_PER_STEP):
            active = self.time[None, first : first + TICKS_PER_STEP] > -0.5 * CONTROL_DT
            watch.update(ids, self.ticks.ticks(slice(first, first + TICKS_PER_STEP)), active)
        return watch.strategies(0)

    def recording(self, policy_name: str) -> Recording:
        """The recording for films and strips."""
        return Recording.of(policy_name, self, CONTROL_HZ // STRIDE, first=self.begin % STRIDE)


def run_traces(policy: Agent, trials: Mapping[str, Trial]) -> dict[str, Trace]:
    """Run some full-length trials of one policy again, those in the same domain as one batch."""
    recorded = record_trials(policy, trials.values())
    traces = {trial: Trace(trial, each.outcome, each.ticks, each.begin) for trial, each in recorded.items()}
    return {name: traces[trial] for name, trial in trials.items()}
