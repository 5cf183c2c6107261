"""Threshold plots: rejected impulse by direction and beside the paper, and the share recovered in each cell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.patches import Patch
from matplotlib.projections.polar import PolarAxes
from matplotlib.ticker import PercentFormatter

from surefoot.errors import UserError
from surefoot.evaluation.scenarios import Line
from surefoot.evaluation.threshold_search import Threshold
from surefoot.report.evaluations import Cell
from surefoot.report.plot_style import GREY, INK, Point, closed, color_of, draw_bound, drawing, style_polar

_MARKERS = ("o", "s", "^", "D", "v", "P")
_SHARES = LinearSegmentedColormap.from_list("shares", ["#d0662f", "#f0c9a8", "#eef1f5", "#b4cdea", "#6aa1d8"])


@dataclass(frozen=True)
class BarRow:
    """Rejected impulses of one algorithm, the worse side of each plane, beside the paper's [Ns].

    Attributes:
        name: algorithm or policy.
        sagittal, lateral: ours.
        paper_sagittal, paper_lateral: the paper's, if it has them.
        sagittal_range, lateral_range: lowest and highest over seeds, if there are several.
    """

    name: str
    sagittal: float
    lateral: float
    paper_sagittal: float | None = None
    paper_lateral: float | None = None
    sagittal_range: tuple[float, float] | None = None
    lateral_range: tuple[float, float] | None = None


def polar_map(
    thresholds: Mapping[str, Sequence[Point]],
    bound: Sequence[Point],
    path: str | Path,
    title: str = "Rejected impulse by direction",
    paper: Mapping[str, Sequence[Point]] | None = None,
    unit: str = "Ns",
) -> None:
    """Draw the rejected impulse by direction of push, forward up and left at the left.

    Args:
        thresholds: a closed curve per policy.
        bound: the no-step bound, equation (6) of the paper; none if it is empty.
        path: of the picture, .png, .svg or .pdf.
        title: above the plot.
        unit: of the impulses.
        paper: the paper's numbers, as hollow marks in the colour of the policy whose name begins alike.

    Raises:
        UserError: there are no thresholds, the suffix is unknown, or the file cannot be written.
    """
    thresholds = {name: points for name, points in thresholds.items() if len(points)}
    if not thresholds:
        raise UserError("no thresholds to draw; run an evaluation first")
    paper = paper or {}
    names = list(dict.fromkeys([*thresholds, *paper]))
    with drawing(path, 7.0, 7.6) as figure:
        # By hand: the constrained layout is at a loss with the words around a polar plot.
        figure.set_layout_engine("none")
        axes = figure.add_axes((0.12, 0.16, 0.76, 0.7), projection="polar")
        assert isinstance(axes, PolarAxes)
        if bound:
            draw_bound(axes, bound)
        for name, points in thresholds.items():
            _draw_closed(axes, points, color_of(name, names), _MARKERS[names.index(name) % len(_MARKERS)], name)
        for name, points in paper.items():
            axes.plot(*np.array(points).T, **_hollow(color_of(name, names)))
        if paper:
            axes.plot([], [], **_hollow(GREY), label="the paper")
        highest = max(ns for points in [bound, *thresholds.values(), *paper.values()] for _, ns in points)
        style_polar(axes, highest, unit)
        figure.suptitle(title, y=0.975, fontsize=15, fontweight="bold")
        figure.legend(loc="lower center", bbox_to_anchor=(0.5, 0.01), ncols=3)


def bars_beside_paper(rows: Sequence[BarRow], path: str | Path, label: str = "ours") -> None:
    """Draw rejected impulses as horizontal bars, ours above the paper's: sagittal at the left, lateral at the right.

    Args:
        rows: from top to bottom.
        path: of the picture, .png, .svg or .pdf.
        label: what to call our bars.

    Raises:
        UserError: there are no rows, the suffix is unknown, or the file cannot be written.
    """
    if not rows:
        raise UserError("no rejected impulses to draw; run an evaluation first")
    names = [row.name for row in rows]
    with drawing(path, 10.0, 1.7 + 0.85 * len(rows)) as figure:
        panels = figure.subplots(1, 2, sharey=True, sharex=True)
        for axes, plane, sides in zip(
            panels, ("sagittal", "lateral"), ("forward, backward", "left, right"), strict=True
        ):
            for place, row in enumerate(rows):
                color, theirs = color_of(row.name, names), getattr(row, f"paper_{plane}")
                shift = 0.0 if theirs is None else 0.2
                _draw_bar(axes, place - shift, getattr(row, plane), getattr(row, f"{plane}_range"), color, filled=True)
                _draw_bar(axes, place + shift, theirs, None, color, filled=False)
            axes.set_title(f"{plane.capitalize()} (worse of {sides})", loc="left")
            axes.set_xlabel("rejected impulse [Ns]")
            axes.grid(axis="y", visible=False)
            axes.spines["left"].set_visible(False)
            axes.tick_params(left=False)
        panels[0].set_yticks(range(len(rows)), names, fontweight="bold")
        panels[0].invert_yaxis()
        panels[0].margins(x=0.16)
        panels[0].set_xlim(left=0)
        handles = [
            Patch(color=GREY, label=label),
            Patch(facecolor="white", edgecolor=GREY, label="the paper, Table I"),
        ]
        figure.legend(handles=handles, loc="outside upper right", ncols=2)


def success_map(
    cells: Mapping[Line, Sequence[Cell]], thresholds: Sequence[Threshold], bound: Sequence[Point], path: str | Path
) -> None:
    """Share of the trials that recovered by direction and impulse, the rejected impulse and the bound.

    Args:
        thresholds: the rejected impulses.
        path: of the picture, .png, .svg or .pdf.
        cells: of every direction; cells without trials stay blank.
        bound: the no-step bound, equation (6) of the paper.
    """
    highest = max([cell.impulse for several in cells.values() for cell in several] + [ns for _, ns in bound])
    width = 2.0 * np.pi / max(len(cells), 16)
    with drawing(path, 7.6, 8.2) as figure:
        # By hand: the constrained layout is at a loss with the words around a polar plot.
        figure.set_layout_engine("none")
        axes = figure.add_axes((0.11, 0.19, 0.78, 0.72), projection="polar")
        assert isinstance(axes, PolarAxes)
        for line, several in cells.items():
            for low, high, share in _runs(several):
                axes.bar(line.angle, high - low, width, low, color=_SHARES(share), lw=0, zorder=1)
        draw_bound(axes, bound, fill=False)
        angles, sizes = closed([(t.line.angle, t.size) for t in thresholds])
        axes.plot(angles, sizes, color=INK, lw=2.2, marker="o", ms=6, label="rejected impulse", zorder=4, clip_on=False)
        style_polar(axes, highest)
        bar = figure.add_axes((0.25, 0.105, 0.5, 0.018))
        scale = figure.colorbar(ScalarMappable(Normalize(0.0, 1.0), _SHARES), cax=bar, orientation="horizontal")
        scale.ax.xaxis.set_major_formatter(PercentFormatter(1.0))
        scale.set_label("recovered of the cell's trials", labelpad=2)
        scale.outline.set_visible(False)
        figure.legend(loc="lower center", bbox_to_anchor=(0.5, 0.0), ncols=2)


def _draw_closed(axes: PolarAxes, points: Sequence[Point], color: str, marker: str, label: str) -> None:
    angles, impulses = closed(points)
    axes.plot(angles, impulses, color=color, lw=2.2, marker=marker, ms=7, label=label, clip_on=False, zorder=3)
    axes.fill(angles, impulses, color=color, alpha=0.08, lw=0)


def _hollow(color: str) -> dict[str, Any]:
    return {"ls": "", "marker": "o", "ms": 11, "mfc": "none", "mec": color, "mew": 2.2, "clip_on": False, "zorder": 4}


def _draw_bar(
    axes: Axes, place: float, value: float | None, span: tuple[float, float] | None, color: str, filled: bool
) -> None:
    if value is None:
        return
    axes.barh(place, value, 0.34, facecolor=color if filled else "white", edgecolor=color, lw=1.8)
    end = value
    if span is not None:
        axes.plot(span, (place, place), color=INK, lw=1.6, marker="|", ms=9, mew=1.6)
        end = max(value, span[1])
    weight, ink = ("bold", INK) if filled else ("normal", GREY)
    axes.annotate(
        f"{value:.0f}" if value >= 10.0 else f"{value:.2g}",
        (end, place),
        (7, 0),
        textcoords="offset points",
        va="center",
        weight=weight,
        color=ink,
    )


def _runs(cells: Sequence[Cell]) -> list[tuple[float, float, float]]:
    """Lower and upper impulse [Ns] and share, neighbouring cells of the same share as one."""
    found: list[tuple[float, float, float]] = []
    if not cells:
        return found
    step = cells[0].impulse  # the smallest cell is one step of the grid
    for (share, _), group in groupby(
        enumerate(cells), lambda nc: (nc[1].recovered / nc[1].trials, round(nc[1].impulse / step) - nc[0])
    ):
        several = [cell.impulse for _, cell in group]
        low = several[0] - 0.5 * step if several[0] > step else 0.0
        found.append((low, several[-1] + 0.5 * step, share))
    return found
