"""Plot style: the colours, fonts, file formats and polar axes that all plots share."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.projections.polar import PolarAxes

from surefoot.errors import UserError

SUFFIXES = (".png", ".svg", ".pdf")

Point = tuple[float, float]
"""Direction [rad], counter-clockwise from the robot's +x, and impulse [Ns]."""

INK, GREY, PALE = "#1c2430", "#6b7686", "#e3e7ec"
_COLORS = {"trpo": "#2b6cb0", "ddpg": "#dd6b20", "ppo": "#2f9e6e", "nominal": "#8a94a3", "equation": "#4a5463"}
_SPARE_COLORS = ("#8250c4", "#c2385a", "#0f8b9d", "#a07c14")
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
    axes.plot(angles, impulses, color=INK, lw=1.6, ls=(0, (5, 3)), label="no-step bound")


def closed(points: Sequence[Point]) -> tuple[np.ndarray, np.ndarray]:
    """Angles and impulses of a closed curve, in order."""
    ordered = sorted((angle % (2.0 * np.pi), impulse) for angle, impulse in points)
    angles, impulses = np.array([*ordered, ordered[0]]).T
    angles[-1] += 2.0 * np.pi
    return angles, impulses


def style_polar(axes: PolarAxes, highest: float, unit: str = "Ns") -> None:
    """Forward up, rings with their numbers, words for the main directions."""
    axes.set_theta_zero_location("N")
    ring = _ring_step(max(highest, 1e-3))
    rings = np.arange(ring, highest + 0.95 * ring, ring)
    axes.set_rlim(0.0, rings[-1])
    axes.set_rgrids(rings, [""] * len(rings))
    for impulse in rings:
        # Backward right is where the curves leave most room for numbers.
        label = axes.text(
            np.radians(202.5), impulse, f"{impulse:g} {unit}", color=GREY, size=10, ha="center", va="center"
        )
        label.set(zorder=5, path_effects=[withStroke(linewidth=3, foreground="white")])
    words = ["forward", "", "left", "", "backward", "", "right", ""]
    axes.set_thetagrids(range(0, 360, 45), words, fontsize=13, fontweight="bold")
    axes.tick_params(axis="x", pad=10)
    axes.spines["polar"].set_visible(False)


def counted(number: int, noun: str) -> str:
    """A number of things: "1 seed", "7 seeds"."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def _ring_step(highest: float) -> float:
    """From one ring to the next: 1, 2 or 5 times a power of ten, so that six rings at most hold the highest number."""
    decade = 10.0 ** np.floor(np.log10(highest / 6.0))
    return float(next(step for step in decade * np.array([1.0, 2.0, 5.0, 10.0]) if highest <= 6.0 * step * (1 + 1e-9)))
