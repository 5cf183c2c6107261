"""Ablations: the table of the results of runs that each leave out one part of a preset."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from surefoot.report.table import Table

LATE_FROM = 0.6
"""Share of a run's steps after which its learning curve is averaged."""


def ablation_table(curves: Mapping[str, Sequence[Mapping[str, float]]]) -> Table:
    """Return what came out of the runs: at the end, and in the mean over the last part of each.

    Args:
        curves: learning curves, see `surefoot.learning.curve`, by what was left out.
    """
    rows = []
    for name, curve in curves.items():
        steps = [row["steps"] for row in curve]
        # Validations come by the clock, so that two runs have them at different steps: values between are interpolated.
        late = np.linspace(LATE_FROM, 1.0, 20) * steps[-1]
        recovered, quiet = (np.interp(late, steps, [row[name] for row in curve]) for name in ("recovered", "calm"))
        rows.append((name.replace("-", " "), f"{recovered.mean():.2f}", f"{recovered[-1]:.2f}", f"{quiet.mean():.2f}"))
    return Table(
        "Ablations",
        ("left out", "recovered", "at the end", "quiet afterwards"),
        rows,
        f"The means begin at {LATE_FROM:.0%} of the steps. Pushes of 36 to 540 Ns in 8 directions, one seed.",
    )
