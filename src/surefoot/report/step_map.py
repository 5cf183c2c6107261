"""Step map: how many steps an agent takes in answer to a push, by direction and impulse."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.patches import Patch
from matplotlib.projections.polar import PolarAxes

from surefoot.evaluation.scenarios import Line
from surefoot.evaluation.threshold_search import Threshold
from surefoot.report.evaluations import Cell
from surefoot.report.plot_style import INK, closed, drawing, style_polar

STEP_COLORS = {"no step": "#2f9e6e", "1 step": "#a9cf5a", "2 steps": "#f2c14e", "3 steps and more": "#e0762f"}
FALLS = "#d9dde3"
"""Of cells in which fewer than nine in ten trials recover."""
_MOST_FALL = 0.9


def step_map(
    cells: Mapping[Line, Sequence[Cell]], thresholds: Sequence[Threshold], without_step: Sequence[Threshold], path: Path
) -> None:
    """Draw the median number of steps of every cell, forward up and left at the left.

    Args:
        cells: of every direction, from the smallest impulse up.
        thresholds: the rejected impulses, within limits if they were measured.
        without_step: those without a step; none if they were not measured.
        path: of the picture, .png, .svg or .pdf.
    """
    width = 2.0 * np.pi / max(len(cells), 16)
    highest = max(cell.impulse for several in cells.values() for cell in several)
    with drawing(path, 7.6, 8.2) as figure:
        # By hand: the constrained layout is at a loss with the words around a polar plot.
        figure.set_layout_engine("none")
        axes = figure.add_axes((0.11, 0.17, 0.78, 0.74), projection="polar")
        assert isinstance(axes, PolarAxes)
        for line, several in cells.items():
            below = 0.0
            for cell in several:
                axes.bar(line.angle, cell.impulse - below, width, below, color=color_of(cell), lw=0, zorder=1)
                below = cell.impulse
        for found, dashes, words in ((thresholds, "-", "rejected impulse"), (without_step, "--", "without a step")):
            if found:
                angles, sizes = closed([(t.line.angle, t.size) for t in found])
                axes.plot(angles, sizes, color=INK, lw=2.0, ls=dashes, label=words, zorder=4)
        style_polar(axes, highest)
        patches = [Patch(color=color, label=words) for words, color in STEP_COLORS.items()]
        patches.append(Patch(color=FALLS, label="gives way"))
        handles, _ = axes.get_legend_handles_labels()
        figure.legend(handles=[*patches, *handles], loc="lower center", bbox_to_anchor=(0.5, 0.0), ncols=3)


def color_of(cell: Cell) -> str:
    """The colour of a cell: by the median number of steps, unless too few of its trials recover."""
    if cell.recovered < _MOST_FALL * cell.trials:
        return FALLS
    return list(STEP_COLORS.values())[min(int(np.ceil(cell.steps)), len(STEP_COLORS) - 1)]
