"""Timing table: the time of a controller's control steps, as a table and as metrics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from surefoot.agents.controllers.step_times import Timing
from surefoot.report.table import Table


def timing_metrics(timing: Timing) -> dict[str, float]:
    """The metrics of a controller's time per control step, for `surefoot evaluate --json`."""
    return {
        "control.rate_hz": timing.rate_hz,
        "control.steps": timing.steps,
        "control.step_us_median": round(1e6 * timing.median, 1),
        "control.step_us_p99": round(1e6 * timing.p99, 1),
        "control.missed_deadlines": timing.missed,
        "control.alone_steps": timing.alone_steps,
        "control.alone_us_median": round(1e6 * timing.alone_median, 1),
        "control.alone_us_p99": round(1e6 * timing.alone_p99, 1),
        "control.alone_missed_deadlines": timing.alone_missed,
    }


def timing_table(timings: Mapping[str, Timing]) -> Table:
    """How long controllers take per control step, a row per controller."""
    rows = [_row(name, timing) for name, timing in timings.items()]
    columns = [
        "controller",
        "[Hz]",
        "median [us]",
        "99 % [us]",
        "missed",
        "alone: median",
        "99 %",
        "missed",
        "failures",
    ]
    note = (
        "Time per control step and robot. In the evaluation's batch it is the time of a call divided by its number of"
        " robots; alone, it is measured in a trial of a single robot. Missed: steps that took longer than a period at"
        " the controller's rate. Failures: trials that the controller itself failed."
    )
    return Table("Controllers: time per control step", columns, rows, note)


def _row(name: str, timing: Timing) -> Sequence[str]:
    times = [f"{1e6 * t:.0f}" for t in (timing.median, timing.p99, timing.alone_median, timing.alone_p99)]
    return [
        name, f"{timing.rate_hz}", *times[:2], f"{timing.missed} of {timing.steps}", *times[2:],
        f"{timing.alone_missed} of {timing.alone_steps}", timing.failures or "none",
    ]  # fmt: skip
