"""Trial plots: motion over time, footprints and support foot of single trials, and success by direction."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon

from surefoot.evaluation.strategies import Step
from surefoot.rendering.words import push_words
from surefoot.report.plot_style import GREY, INK, drawing
from surefoot.report.thresholds import root_words
from surefoot.report.traces import STRIDE, Trace

FIRST, SECOND = "#2b6cb0", "#d1600f"
"""x and pitch; y and roll."""
LEFT, RIGHT = "#0f8b9d", "#b5327a"
"""Feet."""
_PUSH = "#e8b32a"
_BEFORE, _AFTER = -0.5, 6.0
"""Shown part of a trial, relative to the beginning of its disturbance [s]."""
_LEAST = 5.0
"""No scale is finer than this either way [cm, deg], or a robot at rest would seem to dance."""


def motion(traces: Mapping[str, Trace], path: str | Path) -> None:
    """Draw CoM, attitude of the root and loaded feet over time, a column per trial (the paper's figure 5 a and b)."""
    root = root_words(next(iter(traces.values())).ticks.robot)
    with drawing(path, 3.3 * max(len(traces), 2), 7.0) as figure:
        panels = figure.subplots(3, len(traces), sharex=True, squeeze=False, height_ratios=(3, 3, 1))
        for column, (title, trace) in zip(panels.T, traces.items(), strict=True):
            shown = _shown(trace)
            time = trace.time[shown]
            com, (roll, pitch) = 100.0 * trace.com_shift[shown], trace.root_attitude_deg[:, shown]
            column[0].set_title(title, loc="left")
            _lines(column[0], trace, time, (com[:, 0], com[:, 1]))
            _lines(column[1], trace, time, (pitch, roll))
            _gait(column[2], trace, legend=False)
            column[2].set_xlabel("time [s]")
        panels[0, 0].set_ylabel("CoM [cm]")
        panels[1, 0].set_ylabel(f"{root} [deg]")
        panels[0, 0].set_xlim(_BEFORE, _AFTER)
        for axes in panels[2, 1:]:
            axes.set_yticklabels([])
        words = (f"CoM forward (x), {root} pitch", f"CoM left (y), {root} roll")
        handles: list[Any] = [Line2D([], [], color=c, lw=2.4, label=w) for c, w in zip((FIRST, SECOND), words)]  # noqa: B905
        handles += [Patch(color=_PUSH, alpha=0.5, label="push"), Patch(color=GREY, label="foot loaded")]
        figure.legend(handles=handles, loc="outside lower center", ncols=4)


def footprints(trace: Trace, path: str | Path) -> None:
    """The soles' places and the CoM's path from above, with the steps numbered (the paper's figure 5 c)."""
    steps = trace.strategies.steps
    spread = np.ptp(trace.ticks.sole_position[0, trace.begin :, :, :2], axis=(0, 1))
    height = 10.0 * (spread[1] + 0.35) / max(spread[0] + 0.8, 1.0) + 1.4
    with drawing(path, 10.0, float(np.clip(height, 4.2, 7.5))) as figure:
        axes = figure.subplots()
        for foot, color in enumerate((LEFT, RIGHT)):
            _sole(axes, trace, trace.begin, foot, edgecolor=color, facecolor="none", lw=2.0, ls=(0, (3, 2)))
        for number, step in enumerate(steps, 1):
            _footprint(axes, trace, number, step)
        seen = slice(trace.begin, len(trace.time), STRIDE)
        for foot, color in enumerate((LEFT, RIGHT)):
            sole = trace.ticks.sole_position[0, seen, foot]
            axes.plot(sole[:, 0], sole[:, 1], color=color, lw=1.0, alpha=0.6, zorder=2)
        com = trace.ticks.com_position[0, seen]
        axes.plot(com[:, 0], com[:, 1], color=INK, lw=2.2, zorder=4)
        axes.plot(*com[0, :2], "o", color=INK, ms=8, zorder=5)
        axes.plot(*com[-1, :2], "s", color=INK, ms=8, zorder=5)
        _push_arrow(axes, trace, com[0, :2])
        axes.set(xlabel="forward (x) [m]", ylabel="left (y) [m]", aspect="equal")
        axes.margins(0.06)
        axes.autoscale_view()
        handles: list[Any] = [
            Line2D([], [], color=INK, lw=2.2, marker="o", label="CoM, from the disturbance"),
            Line2D([], [], color=INK, lw=0, marker="s", label="at the end"),
            Patch(facecolor=LEFT, alpha=0.4, label="left foot"),
            Patch(facecolor=RIGHT, alpha=0.4, label="right foot"),
        ]
        figure.legend(handles=handles, loc="outside lower center", ncols=4)


def support_foot(trace: Trace, path: str | Path) -> None:
    """Height and tilt of each foot over time, strong while it carries load (the paper's figure 6 b)."""
    with drawing(path, 10.0, 6.6) as figure:
        panels = figure.subplots(4, 1, sharex=True, height_ratios=(3, 3, 3, 1))
        shown = _shown(trace)
        time, loaded = trace.time[shown], trace.foot_loaded[shown]
        roll, pitch = trace.foot_attitude_deg[:, shown]
        curves = (("sole height [cm]", 100.0 * trace.sole_height[shown]), ("pitch [deg]", pitch), ("roll [deg]", roll))
        for axes, (label, values) in zip(panels, curves, strict=False):
            _mark_push(axes, trace)
            for foot, color in enumerate((LEFT, RIGHT)):
                axes.plot(time, values[:, foot], color=color, lw=1.0, alpha=0.45)
                axes.plot(time, np.where(loaded[:, foot], values[:, foot], np.nan), color=color, lw=2.6)
            axes.set_ylabel(label)
        figure.align_ylabels(panels[:3])
        _gait(panels[3], trace, legend=True)
        panels[3].set(xlabel="time [s]", xlim=(_BEFORE, _AFTER))
        handles: list[Any] = [
            Line2D([], [], color=LEFT, lw=2.6, label="left foot, loaded"),
            Line2D([], [], color=RIGHT, lw=2.6, label="right foot, loaded"),
            Line2D([], [], color=GREY, lw=1.0, label="unloaded"),
            Patch(color=_PUSH, alpha=0.5, label="push"),
        ]
        figure.legend(handles=handles, loc="outside lower center", ncols=4)


def _shown(trace: Trace) -> np.ndarray:
    """StepRecord to draw."""
    ticks = np.arange(trace.begin % STRIDE, len(trace.time), STRIDE)
    return ticks[(trace.time[ticks] >= _BEFORE - 1e-9) & (trace.time[ticks] <= _AFTER + 1e-9)]


def _lines(axes: Axes, trace: Trace, time: np.ndarray, pair: tuple[np.ndarray, np.ndarray]) -> None:
    _mark_push(axes, trace)
    fell = not trace.outcome.recovered and time[-1] < _AFTER - 0.1
    for values, color in zip(pair, (FIRST, SECOND), strict=True):
        axes.plot(time, values, color=color, lw=2.0)
        if fell:
            axes.plot(time[-1], values[-1], "X", color=color, ms=9, clip_on=False)
    if fell:
        reason = (trace.outcome.reason, (time[-1], max(values[-1] for values in pair)), (9, 0))
        axes.annotate(*reason, textcoords="offset points", va="center", color=GREY)
    low, high = axes.get_ylim()
    axes.set_ylim(min(low, -_LEAST), max(high, _LEAST))


def _mark_push(axes: Axes, trace: Trace) -> None:
    first = min(push.start for push in trace.trial.pushes)
    for push in trace.trial.pushes:
        if push.impulse:
            axes.axvspan(push.start - first, push.start - first + push.duration, color=_PUSH, alpha=0.5, lw=0)


def _gait(axes: Axes, trace: Trace, legend: bool) -> None:
    """A bar per foot while it carries load."""
    for row, (foot, color) in enumerate(((1, RIGHT), (0, LEFT))):
        for start, length in _spans(trace.foot_loaded[:, foot]):
            begin, end = trace.time[start], trace.time[start + length - 1]
            if end > _BEFORE and begin < _AFTER:
                axes.barh(row, end - max(begin, _BEFORE), 0.62, max(begin, _BEFORE), color=color if legend else GREY)
    axes.set_yticks([0, 1], ["right", "left"])
    axes.set_ylim(-0.5, 1.5)
    axes.grid(axis="y", visible=False)
    axes.tick_params(left=False)
    axes.spines["left"].set_visible(False)


def _spans(holds: np.ndarray) -> list[tuple[int, int]]:
    """First index and length of every run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], holds.astype(np.int8), [0]])))
    return [(int(a), int(b - a)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _footprint(axes: Axes, trace: Trace, number: int, step: Step) -> None:
    foot, color = (0, LEFT) if step.foot == "left" else (1, RIGHT)
    # A little after the landing, when the sole lies flat.
    tick = min(int(np.searchsorted(trace.time, step.time)) + 2 * STRIDE, len(trace.time) - 1)
    _sole(axes, trace, tick, foot, edgecolor=color, facecolor=color, alpha=0.35, lw=1.2)
    place = trace.ticks.sole_position[0, tick, foot, :2]
    axes.text(place[0], place[1], str(number), color=INK, ha="center", va="center", weight="bold", zorder=6)


def _sole(axes: Axes, trace: Trace, tick: int, foot: int, **style: Any) -> None:
    """Outline of a sole at a tick."""
    length, width = trace.ticks.robot.sole_half_size
    w, x, y, z = trace.ticks.foot_orientation[0, tick, foot]
    yaw = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    corners = np.array([[length, width], [-length, width], [-length, -width], [length, -width]]) @ turn.T
    axes.add_patch(Polygon(corners + trace.ticks.sole_position[0, tick, foot, :2], closed=True, zorder=3, **style))
    axes.update_datalim(corners + trace.ticks.sole_position[0, tick, foot, :2])


def _push_arrow(axes: Axes, trace: Trace, place: np.ndarray) -> None:
    push = trace.trial.push
    along = np.array(push.direction[:2])
    axes.annotate(
        "",
        xy=tuple(place - 0.06 * along),
        xytext=tuple(place - 0.34 * along),
        arrowprops={"arrowstyle": "-|>,head_width=0.5,head_length=0.9", "color": "#c98f00", "lw": 5},
        zorder=7,
    )
    axes.annotate(
        push_words(push), tuple(place - 0.36 * along), (0, 14), textcoords="offset points", color=INK, ha="center"
    )
    axes.update_datalim([place - 0.45 * along])
