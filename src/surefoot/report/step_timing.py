"""Timing: what is kept and shown of a controller's time per control step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from surefoot.agents.controllers.controller import ControllerAgent
from surefoot.agents.controllers.step_times import Timing
from surefoot.evaluation.trials import Trial, run_list
from surefoot.physics.pushes import Push
from surefoot.report.tables import Table

ALONE = Trial(Push(impulse=60.0), seed=0)
"""The trial in which a controller is timed with a single robot, as on the real one."""


def measure(contestant: ControllerAgent) -> Timing:
    """The times of all trials so far, and of one more with a single robot."""
    batch = contestant.times
    failures = ", ".join(f"{count} x {words}" for words, count in contestant.failures.most_common())
    single = ControllerAgent(contestant.name, contestant.make, contestant.digest)
    run_list(single, [ALONE], num_slots=1, num_threads=1)
    alone = single.times
    return Timing(
        contestant.rate_hz, batch.num_steps, batch.num_missed, batch.quantile(0.5), batch.quantile(0.99),
        alone.num_steps, alone.num_missed, alone.quantile(0.5), alone.quantile(0.99), failures,
    )  # fmt: skip


def timing_figures(timing: Timing) -> dict[str, float]:
    """For `surefoot evaluate --json`."""
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
    """A row per controller."""
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
        "Time per control step and robot: in the evaluation's batch a call's time over its robots; alone, a trial of a"
        " single robot. Missed: steps that took longer than a period at the controller's rate. Failures: trials that"
        " the controller failed by itself."
    )
    return Table("Controllers: time per control step", columns, rows, note)


def _row(name: str, timing: Timing) -> Sequence[str]:
    times = [f"{1e6 * t:.0f}" for t in (timing.median, timing.p99, timing.alone_median, timing.alone_p99)]
    return [
        name, f"{timing.rate_hz}", *times[:2], f"{timing.missed} of {timing.steps}", *times[2:],
        f"{timing.alone_missed} of {timing.alone_steps}", timing.failures or "none",
    ]  # fmt: skip
