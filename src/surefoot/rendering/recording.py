"""Recording: trials that were run and kept moment by moment for drawing."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from surefoot.errors import UserError
from surefoot.evaluation.outcome import Outcome
from surefoot.evaluation.recorded import RecordedTrial, record_trials
from surefoot.evaluation.trials import Trial
from surefoot.physics.engines import DEFAULT_ENGINE
from surefoot.rates import CONTROL_DT, CONTROL_HZ
from surefoot.rendering.moment import Moment
from surefoot.robots import Robot
from surefoot.task.agent import Agent


@dataclass(frozen=True, eq=False)
class Recording:
    """A trial that was run, moment by moment at `fps`, from the start of its settling time to its verdict."""

    policy: str
    robot: Robot
    trial: Trial
    outcome: Outcome
    fps: int
    moments: tuple[Moment, ...]

    @classmethod
    def of(cls, policy: str, recorded: RecordedTrial, fps: int, first: int = 0) -> Recording:
        """The moments of a recorded trial, `fps` a second from the tick `first` on; `fps` divides 500."""
        ticks, begin = recorded.ticks, recorded.begin
        moments = (
            Moment.of(ticks, tick=tick, time=float((tick - begin) * CONTROL_DT))
            for tick in range(first, len(ticks), CONTROL_HZ // fps)
        )
        return cls(policy, ticks.robot, recorded.trial, recorded.outcome, fps, tuple(moments))

    @functools.cached_property
    def times(self) -> np.ndarray:
        """Since the beginning of the push (num_moments,) [s]."""
        return np.array([moment.time for moment in self.moments])

    def at(self, time: float) -> Moment:
        """The first moment that is not before `time`; else the last."""
        return self.moments[min(int(np.searchsorted(self.times, time - 1e-9)), len(self.moments) - 1)]


def record(policy: Agent, trial: Trial, fps: int = 50, engine: str = DEFAULT_ENGINE) -> Recording:
    """Run one trial and record it for pictures.

    Args:
        policy: the agent.
        trial: the trial to run.
        fps: number of recorded moments per second of simulated time.
        engine: name of the physics engine.

    Raises:
        UserError: `fps` does not divide the 500 ticks of a second.
    """
    valid = [rate for rate in range(1, CONTROL_HZ + 1) if CONTROL_HZ % rate == 0]
    if fps not in valid:
        raise UserError(f"cannot record {fps} frames per second; valid: {', '.join(map(str, valid))}")
    recorded = record_trials(policy, [trial], num_threads=1, engine=engine)[trial]
    return Recording.of(policy.name, recorded, fps)
