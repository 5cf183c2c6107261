"""Step times: how long control steps take, and whether that is in time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


class StepTimes:
    """How long the control steps took, per robot: a call's time over the number of its robots [s]."""

    def __init__(self, rate_hz: int):
        self.rate_hz = rate_hz
        self._seconds: list[float] = []
        self._robots: list[int] = []

    def add(self, seconds: float, num_robots: int) -> None:
        """A call for so many robots took so long altogether."""
        self._seconds.append(seconds / num_robots)
        self._robots.append(num_robots)

    def extend(self, others: StepTimes) -> None:
        """Take in the calls that were timed elsewhere."""
        self._seconds += others._seconds
        self._robots += others._robots

    @property
    def num_steps(self) -> int:
        """Control steps of single robots."""
        return sum(self._robots)

    @property
    def num_missed(self) -> int:
        """Control steps that took longer than there is time for at the controller's rate."""
        return int((np.array(self._robots)[np.array(self._seconds) > 1.0 / self.rate_hz]).sum())

    def quantile(self, share: float) -> float:
        """Time within which this share of the control steps was done [s]; NaN without any."""
        if not self._seconds:
            return float("nan")
        seconds, robots = np.array(self._seconds), np.array(self._robots)
        order = np.argsort(seconds)
        reached = np.cumsum(robots[order]) >= share * robots.sum()
        return float(seconds[order][int(reached.argmax())])


@dataclass(frozen=True)
class Timing:
    """Times per control step [s]: in the evaluation's batch, per robot, and with one robot alone.

    Attributes:
        rate_hz: of the control steps.
        steps, missed: control steps of single robots, and how many took longer than a period.
        median, p99: of a step's time per robot.
        alone_steps, alone_missed, alone_median, alone_p99: the same with one robot alone.
        failures: how often the controller failed a trial, by reason, in words.
    """

    rate_hz: int
    steps: int
    missed: int
    median: float
    p99: float
    alone_steps: int
    alone_missed: int
    alone_median: float
    alone_p99: float
    failures: str
