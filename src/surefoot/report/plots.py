"""Plots: rejected impulse by direction, learning curves, and both beside the paper's numbers. They run nothing."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke
from matplotlib.projections.polar import PolarAxes
from matplotlib.ticker import EngFormatter, PercentFormatter

from surefoot.errors import UserError

SUFFIXES = (".png", ".svg", ".pdf")

Point = tuple[float, float]
"""Direction [rad], counter-clockwise from the robot's +x, and impulse [Ns]."""

INK, GREY, PALE = "#1c2430", "#6b7686", "#e3e7ec"
_COLORS = {"trpo": "#2b6cb0", "ddpg": "#dd6b20", "ppo": "#2f9e6e", "nominal": "#8a94a3", "equation": "#4a5463"}
_SPARE_COLORS = ("#8250c4", "#c2385a", "#0f8b9d", "#a07c14")
_MARKERS = ("o", "s", "^", "D", "v", "P")
_STYLE: Any = {
    "font.family": "DejaVu Sans",
    "font.size": 12.0,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": GREY,
    "axes.titlesize": 13.0,
    "axes.titleweight": "bold",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": PALE,
    "xtick.color": INK,
    "ytick.color": INK,
    "legend.frameon": False,
    "savefig.dpi": 150,
    "svg.hashsalt": "surefoot",
}


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
) -> None:
    """Draw the rejected impulse by direction of push, forward up and left at the left.

    Args:
        thresholds: a closed curve per policy.
        bound: the capture-point bound, equation (6) of the paper.
        path: of the picture, .png, .svg or .pdf.
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
        draw_bound(axes, bound)
        for name, points in thresholds.items():
            _draw_closed(axes, points, color_of(name, names), _MARKERS[names.index(name) % len(_MARKERS)], name)
        for name, points in paper.items():
            angles, impulses = np.array(points).T
            axes.plot(angles, impulses, **_hollow(color_of(name, names)))
        if paper:
            axes.plot([], [], **_hollow(GREY), label="the paper")
        highest = max(ns for points in [bound, *thresholds.values(), *paper.values()] for _, ns in points)
        style_polar(axes, highest)
        figure.suptitle(title, y=0.975, fontsize=15, fontweight="bold")
        figure.legend(loc="lower center", bbox_to_anchor=(0.5, 0.01), ncols=3)


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
        by_steps.xaxis.set_major_formatter(EngFormatter(sep=""))
        lines = [
            Line2D([], [], color=color_of(name, list(runs)), lw=3, label=f"{name} ({counted(len(several), 'seed')})")
            for name, several in runs.items()
        ]
        figure.legend(handles=lines, loc="outside upper center", ncols=len(lines))


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


def color_of(name: str, names: Sequence[str]) -> str:
    """The colour of an algorithm or policy, the same in every plot; `names` are all of one plot."""
    for key, color in _COLORS.items():
        if name.lower().startswith(key):
            return color
    strangers = [other for other in names if not other.lower().startswith(tuple(_COLORS))]
    return _SPARE_COLORS[strangers.index(name) % len(_SPARE_COLORS)]


@contextlib.contextmanager
def drawing(path: str | Path, width: float, height: float) -> Iterator[Figure]:
    """A figure of this size [inch] in the house style, written to `path` at the end."""
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise UserError(f"cannot write '{path}': unknown suffix '{path.suffix}'; valid: {', '.join(SUFFIXES)}")
    with matplotlib.rc_context(_STYLE):
        figure = Figure((width, height), layout="constrained")
        yield figure
        # Without a date, the same numbers give the same file.
        undated = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}.get(path.suffix.lower())
        try:
            figure.savefig(path, metadata=undated)
        except OSError as error:
            raise UserError(f"cannot write {path}: {error.strerror or error}") from error


def draw_bound(axes: PolarAxes, bound: Sequence[Point], fill: bool = True) -> None:
    """The capture-point bound, dashed."""
    angles, impulses = closed(bound)
    if fill:
        axes.fill(angles, impulses, color=PALE, alpha=0.8, lw=0)
    axes.plot(angles, impulses, color=INK, lw=1.6, ls=(0, (5, 3)), label="equation (6), no step")


def _draw_closed(axes: PolarAxes, points: Sequence[Point], color: str, marker: str, label: str) -> None:
    angles, impulses = closed(points)
    axes.plot(angles, impulses, color=color, lw=2.2, marker=marker, ms=7, label=label, clip_on=False, zorder=3)
    axes.fill(angles, impulses, color=color, alpha=0.08, lw=0)


def closed(points: Sequence[Point]) -> tuple[np.ndarray, np.ndarray]:
    """Angles and impulses of a closed curve, in order."""
    ordered = sorted((angle % (2.0 * np.pi), impulse) for angle, impulse in points)
    angles, impulses = np.array([*ordered, ordered[0]]).T
    angles[-1] += 2.0 * np.pi
    return angles, impulses


def _hollow(color: str) -> dict:
    return {"ls": "", "marker": "o", "ms": 11, "mfc": "none", "mec": color, "mew": 2.2, "clip_on": False, "zorder": 4}


def style_polar(axes: PolarAxes, highest: float) -> None:
    """Forward up, rings with their numbers, words for the main directions."""
    axes.set_theta_zero_location("N")
    ring = 50.0 * np.ceil(max(highest, 1.0) / 300.0)
    rings = np.arange(ring, highest + 0.95 * ring, ring)
    axes.set_rlim(0.0, rings[-1])
    axes.set_rgrids(rings, [""] * len(rings))
    for impulse in rings:
        # Backward right is where the curves leave most room for numbers.
        label = axes.text(np.radians(202.5), impulse, f"{impulse:g} Ns", color=GREY, size=10, ha="center", va="center")
        label.set(zorder=5, path_effects=[withStroke(linewidth=3, foreground="white")])
    words = ["forward", "", "left", "", "backward", "", "right", ""]
    axes.set_thetagrids(range(0, 360, 45), words, fontsize=13, fontweight="bold")
    axes.tick_params(axis="x", pad=10)
    axes.spines["polar"].set_visible(False)


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
    axes.plot(common, seeds.mean(axis=0), color=color, lw=2.8, solid_capstyle="round")


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
        f"{value:.0f}", (end, place), (7, 0), textcoords="offset points", va="center", weight=weight, color=ink
    )


def counted(number: int, noun: str) -> str:
    """A number of things: "1 seed", "7 seeds"."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
