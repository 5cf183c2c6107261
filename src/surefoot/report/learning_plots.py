"""Learning plots: the share of recovered pushes over the course of training."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import EngFormatter, LogLocator, NullFormatter, PercentFormatter

from surefoot.errors import UserError
from surefoot.report.plot_style import color_of, counted, drawing


def learning_curves(curves: Mapping[str, Sequence[Sequence[Mapping[str, float]]]], path: str | Path) -> None:
    """Draw the share of held-out pushes recovered against wall-clock time and against policy steps.

    Args:
        curves: algorithm -> runs (one per seed) -> points with "minutes", "steps" and "recovered" (0 to 1), as
            `RunFolder.curve` gives them. Runs are thin lines; as far as all of them reach, their mean is thick and
            a band goes from the lowest to the highest.
        path: of the picture, .png, .svg or .pdf.

    Raises:
        UserError: there are no points, the suffix is unknown, or the file cannot be written.
    """
    runs = {name: [list(run) for run in several if len(run)] for name, several in curves.items()}
    if not any(runs.values()):
        raise UserError("no learning curves to draw; every curve is empty")
    with drawing(path, 10.0, 4.4) as figure:
        by_time, by_steps = figure.subplots(1, 2, sharey=True)
        for axes, key in ((by_time, "minutes"), (by_steps, "steps")):
            for name, several in runs.items():
                _draw_curves(axes, several, key, color_of(name, list(runs)))
        by_time.set(
            xlabel="wall-clock time [min]", ylabel="held-out pushes recovered", xlim=(0, None), ylim=(-0.02, 1.02)
        )
        by_time.yaxis.set_major_formatter(PercentFormatter(1.0))
        by_steps.set(xlabel="policy steps", xscale="log")
        by_steps.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        by_steps.xaxis.set_major_formatter(EngFormatter(sep=""))
        by_steps.xaxis.set_minor_formatter(NullFormatter())
        lines = [
            Line2D([], [], color=color_of(name, list(runs)), lw=3, label=f"{name} ({counted(len(several), 'seed')})")
            for name, several in runs.items()
        ]
        figure.legend(handles=lines, loc="outside upper center", ncols=len(lines))


def _draw_curves(axes: Axes, runs: Sequence[Sequence[Mapping[str, float]]], key: str, color: str) -> None:
    columns = [(np.array([p[key] for p in run]), np.array([p["recovered"] for p in run])) for run in runs]
    if len(columns) > 1:
        for x, share in columns:
            axes.plot(x, share, color=color, lw=0.8, alpha=0.3)
    everywhere = np.unique(np.concatenate([x for x, _ in columns]))
    first, last = max(x[0] for x, _ in columns), min(x[-1] for x, _ in columns)
    common = everywhere[(everywhere >= first) & (everywhere <= last)]
    seeds = np.array([np.interp(common, x, share) for x, share in columns])
    axes.fill_between(common, seeds.min(axis=0), seeds.max(axis=0), color=color, alpha=0.15, lw=0)
    single = "o" if len(common) == 1 else ""  # a line of one point is not seen
    axes.plot(common, seeds.mean(axis=0), color=color, lw=2.8, solid_capstyle="round", marker=single)
