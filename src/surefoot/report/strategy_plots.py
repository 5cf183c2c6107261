"""Strategy plots: maps of how agents keep their balance, by the direction and the impulse of a push."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.projections.polar import PolarAxes

from surefoot.errors import UserError
from surefoot.evaluation.strategy_map import GIVES_WAY, STRATEGIES, StrategyCell
from surefoot.evaluation.threshold_search import Threshold
from surefoot.report.plot_style import INK, closed, drawing, style_polar

STRATEGY_COLORS = dict(
    zip(
        (*STRATEGIES, GIVES_WAY),
        ("#e4f0d9", "#a6d5a0", "#4fae7b", "#1f7a6d", "#f6d55c", "#f0953f", "#cf4b32", "#d3d8df"),
        strict=True,
    )
)
"""Green stays in place, the warmer the more steps; grey falls."""
_COLUMNS = 4
_PANEL, _LEGEND_ROW = 4.3, 0.3
"""Width and height of a panel, and height of a row of the legend below all of them [inch]."""


class DrawnCell(Protocol):
    """The drawn part of a cell."""

    @property
    def impulse(self) -> float:
        """Of the push [Ns], or [Ns/kg]."""

    @property
    def strategy(self) -> str:
        """One of `STRATEGIES`, or `GIVES_WAY`."""


Directions = Mapping[float, Sequence[DrawnCell]]
"""Direction, counter-clockwise from forward [rad] -> its cells."""


def strategy_map(
    cells: Directions, thresholds: Sequence[Threshold], without_step: Sequence[Threshold], path: Path
) -> None:
    """Draw the strategies of one agent, forward up and left at the left.

    Args:
        cells: of every direction.
        thresholds: the rejected impulses, within limits if they were measured.
        without_step: those without a step; none if they were not measured.
        path: of the picture, .png, .svg or .pdf.
    """
    with drawing(path, 7.6, 8.4) as figure:
        # By hand: the constrained layout is at a loss with the words around a polar plot.
        figure.set_layout_engine("none")
        axes = _polar(figure, (0.11, 0.18, 0.78, 0.74))
        highest = _draw_cells(axes, cells)
        for found, dashes, words in ((thresholds, "-", "rejected impulse"), (without_step, "--", "without a step")):
            if found:
                angles, sizes = closed([(t.line.angle, t.size) for t in found])
                axes.plot(angles, sizes, color=INK, lw=2.0, ls=dashes, label=words, zorder=4)
        style_polar(axes, highest)
        handles, _ = axes.get_legend_handles_labels()
        figure.legend(handles=[*_patches(), *handles], loc="lower center", bbox_to_anchor=(0.5, 0.0), ncols=4)


def side_by_side(cells: Sequence[StrategyCell], path: Path) -> None:
    """Draw the strategies of several agents, robots and engines on one scale.

    The impulses are those per mass of the robot if there are several robots.

    Args:
        cells: of all of them, in the order in which they are drawn.
        path: of the picture, .png, .svg or .pdf.

    Raises:
        UserError: there are no cells, the suffix is unknown, or the file cannot be written.
    """
    if not cells:
        raise UserError("no strategies to draw; run surefoot strategies first")
    per_mass = len({cell.robot for cell in cells}) > 1
    panels = _panels(cells, per_mass)
    columns = min(len(panels), _COLUMNS)
    rows = -(-len(panels) // columns)
    legend_columns = min(2**columns, len(STRATEGY_COLORS))
    foot = _LEGEND_ROW * (-(-len(STRATEGY_COLORS) // legend_columns)) + 0.1
    width, height = _PANEL * columns, _PANEL * rows + foot
    highest = max(cell.impulse for panel in panels.values() for several in panel.values() for cell in several)
    with drawing(path, width, height) as figure:
        figure.set_layout_engine("none")
        for number, (title, panel) in enumerate(panels.items()):
            row, column = divmod(number, columns)
            left, top = _PANEL * (column + 0.16), height - _PANEL * (row + 0.19)
            side = 0.68 * _PANEL
            axes = _polar(figure, (left / width, (top - side) / height, side / width, side / height))
            _draw_cells(axes, panel)
            style_polar(axes, highest, "Ns/kg" if per_mass else "Ns")
            axes.tick_params(axis="x", pad=7, labelsize=11)
            axes.set_title(title, pad=14, fontsize=14)
        figure.legend(handles=_patches(), loc="lower center", bbox_to_anchor=(0.5, 0.0), ncols=legend_columns)


class _PerMass:
    def __init__(self, cell: StrategyCell):
        self.impulse = cell.impulse / cell.mass
        self.strategy = cell.strategy


def _panels(cells: Sequence[StrategyCell], per_mass: bool) -> dict[str, Directions]:
    """Title -> direction -> cells."""
    several_robots = len({cell.robot for cell in cells}) > 1
    several_engines = len({cell.engine for cell in cells}) > 1
    panels: dict[str, dict[float, list[DrawnCell]]] = {}
    for cell in cells:
        title = cell.name.rpartition("/")[2]
        if several_robots:
            title += f" ({cell.robot})"
        if several_engines:
            title += f", {cell.engine.split(' ')[0]}"
        shown: DrawnCell = _PerMass(cell) if per_mass else cell
        panels.setdefault(title, {}).setdefault(float(np.radians(cell.angle_deg)), []).append(shown)
    return dict(panels)


def _polar(figure: Figure, place: tuple[float, float, float, float]) -> PolarAxes:
    axes = figure.add_axes(place, projection="polar")
    assert isinstance(axes, PolarAxes)
    return axes


def _draw_cells(axes: PolarAxes, directions: Directions) -> float:
    """Draw a sector for each cell, from the next smaller impulse to its own; returns the largest impulse."""
    width = 2.0 * np.pi / len(directions) if len(directions) >= 8 else 2.0 * np.pi / 16
    highest = 0.0
    for angle, several in directions.items():
        below = 0.0
        for cell in sorted(several, key=lambda cell: cell.impulse):
            color = STRATEGY_COLORS[cell.strategy]
            # The edge hides the seam to the next cell.
            axes.bar(angle, cell.impulse - below, width, below, color=color, ec=color, lw=0.4, zorder=1)
            below = cell.impulse
        highest = max(highest, below)
    return highest


def _patches() -> list[Patch]:
    words = {"none": "sways only", "3+ steps": "3 and more steps", GIVES_WAY: "falls"}
    return [Patch(color=color, label=words.get(strategy, strategy)) for strategy, color in STRATEGY_COLORS.items()]
