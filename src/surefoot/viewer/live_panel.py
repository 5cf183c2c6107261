"""Live panel: the panel beside the scene, with verdict, strategies, CoM and capture point, attitude, joint torques."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import viser
from viser import uplot

from surefoot.physics.step_record import StepRecord
from surefoot.rendering.framing import scale_of
from surefoot.robots import Robot
from surefoot.viewer.history import SECONDS, History
from surefoot.viewer.marks import CAPTURED, COM, ESCAPED, FORCE, PRESSURE, PUSH, STATE_COLORS, SUPPORT
from surefoot.viewer.markup import render
from surefoot.viewer.playback import Shown
from surefoot.viewer.verdict import State

_COM_INK, _CAPTURE_INK, _EDGE_INK = "#d99a00", "#1f9d55", "#9aa7b8"
_ROLL_INK, _PITCH_INK = "#2d7dd2", "#8e44ad"
_PLOT_HEIGHT = 84
_REACH = 40.0
"""Range of the curves of the CoM [cm], for a robot of `framing.REFERENCE_HEIGHT`."""
_WORDS = {
    State.STANDING: ("Standing", "push it"),
    State.RECOVERING: ("Recovering", ""),
    State.RECOVERED: ("Recovered", "stands still for 2 s"),
    State.FELL: ("Fell", ""),
    State.RESTLESS: ("Up, but restless", "does not stand still"),
}
"""Of a state: its name, and what is said of a robot that shows no strategy."""


@dataclass(frozen=True)
class Curve:
    """A curve of a plot: column of the history, word for the reader (none repeats the one before), and colour."""

    column: str
    word: str
    ink: str


@dataclass(frozen=True)
class Plot:
    """A plot of the panel; its usual range reaches from `-limit` to `limit`."""

    title: str
    limit: float
    curves: tuple[Curve, ...]


def plots_of(robot: Robot) -> tuple[Plot, ...]:
    """The data that the panel draws for a robot."""
    reach = _REACH * scale_of(robot)
    ahead = (Curve("com_x", "CoM", _COM_INK), Curve("cp_x", "capture point", _CAPTURE_INK))
    aside = (Curve("com_y", "CoM", _COM_INK), Curve("cp_y", "capture point", _CAPTURE_INK))
    attitude = (Curve("roll", "roll", _ROLL_INK), Curve("pitch", "pitch", _PITCH_INK))
    return (
        Plot("Forward [cm]", reach, (*ahead, Curve("front", "support", _EDGE_INK), Curve("back", "", _EDGE_INK))),
        Plot("Left [cm]", reach, (*aside, Curve("left", "support", _EDGE_INK), Curve("right", "", _EDGE_INK))),
        Plot(f"{robot.root.replace('_', ' ').capitalize()} [deg]", 30.0, attitude),
    )


class LivePanel:
    """The panel's elements; `show` brings them up to date.

    Args:
        server: server of the panel.
        robot: which is shown.
        phone: where the verdict and the last pushes stand on a phone, which does not show this panel.
    """

    def __init__(self, server: viser.ViserServer, robot: Robot, phone: Sequence[viser.GuiHtmlHandle]):
        gui = server.gui
        self._phone, self._phone_deeds = phone
        self._status = gui.add_html("")
        self._deeds = gui.add_html("")
        self._plots: dict[tuple[str, ...], viser.GuiUplotHandle] = {}
        self._usual: dict[tuple[str, ...], float] = {}
        self._limits: dict[tuple[str, ...], float] = {}
        for plot in plots_of(robot):
            named = [(curve.word, curve.ink) for curve in plot.curves if curve.word]
            gui.add_html(render("plot_title", title=plot.title, curves=named))
            columns = tuple(curve.column for curve in plot.curves)
            self._plots[columns] = _add_plot(gui, plot)
            self._usual[columns] = self._limits[columns] = plot.limit
        self._torques = gui.add_html("")

    def show(self, shown: Shown, history: History, watched: int, policy: str, rates: str) -> None:
        """Bring everything up to date; `policy` and `rates` are a line each."""
        verdict = verdict_values(shown, watched)
        self._status.content = render("status", **verdict, policy=policy, rates=rates)
        self._phone.content = render("phone", **verdict)
        self._deeds.content = deeds = render("deeds", deeds=list(shown.deeds))
        self._phone_deeds.content = f'<div data-surefoot="phone">{deeds}</div>'
        for columns, plot in self._plots.items():
            plot.data = history.columns(*columns)
            self._fit(columns, plot)
        self._torques.content = torques_html(shown.robot, shown.ticks, watched, history.peak_torque)

    def _fit(self, columns: tuple[str, ...], plot: viser.GuiUplotHandle) -> None:
        """Double the range of a plot until its curves fit into it, and halve it again when they have passed."""
        limit = fitting_limit(self._usual[columns], plot.data)
        if limit != self._limits[columns]:
            self._limits[columns] = limit
            plot.scales = _scales(limit)


def fitting_limit(usual: float, data: Sequence[np.ndarray]) -> float:
    """Return the range of a plot: its usual one, doubled until the curves fit.

    Args:
        usual: of the plot.
        data: times, and the values of each curve; NaN where there is none.
    """
    values = np.abs(np.concatenate(data[1:]))
    largest = float(np.max(values, initial=0.0, where=np.isfinite(values)))
    return usual * 2.0 ** max(0, math.ceil(math.log2(max(largest / usual, 1.0))))


def verdict_values(shown: Shown, watched: int) -> dict[str, object]:
    """The verdict on the watched robot, how it keeps its balance, and the count, for a template."""
    verdicts = shown.verdicts
    state = State(verdicts.state[watched])
    word, detail = _WORDS[state]
    counts = [(int((verdicts.state == s).sum()), _WORDS[s][0].lower(), STATE_COLORS[s]) for s in State]
    return {
        "color": STATE_COLORS[state],
        "word": word,
        "detail": _hand_words(shown, watched) or shown.strategies(watched) or detail,
        "recovered": verdicts.recovered,
        "fallen": verdicts.fallen,
        "crowd": [count for count in counts if count[0]] if shown.num_robots > 1 else [],
    }


def _hand_words(shown: Shown, watched: int) -> str:
    """How strongly a hand pulls at the watched robot."""
    force = shown.hand_force(watched)
    return f"held by hand with {force:.0f} N" if force else ""


def legend_html() -> str:
    """The legend of the marks in the scene, as HTML."""
    marks = (
        (PUSH, "push"),
        (FORCE, "foot force"),
        (COM, "CoM"),
        (PRESSURE, "centre of pressure"),
        (CAPTURED, "capture point, inside"),
        (SUPPORT, "support polygon"),
        (ESCAPED, "capture point, outside"),
    )
    return render("legend", marks=marks)


def torques_html(robot: Robot, ticks: StepRecord, watched: int, peak: np.ndarray) -> str:
    """Bars of the joint torques as shares of their limits: now, and the fading peak as a tick; as HTML."""
    share = np.abs(ticks.joint_torque[watched, -1]) / robot.torque_limit
    peak = peak if len(peak) else share
    return render("torques", bars=list(map(_bar, robot.joint_names, share, robot.torque_limit, peak)))


def _bar(name: str, share: float, limit: float, peak: float) -> dict[str, object]:
    return {
        "name": name.removesuffix("_joint").replace("_", " "),
        "width": 100.0 * min(share, 1.0),
        "color": "#d64545" if share > 0.95 else "#4a7fb5",
        "peak": 100.0 * min(peak, 1.0),
        "torque": f"{share * limit:.0f}",
        "limit": f"{limit:.0f}",
    }


def _add_plot(gui: viser.GuiApi, plot: Plot) -> viser.GuiUplotHandle:
    columns = [curve.column for curve in plot.curves]
    return gui.add_uplot(
        History().columns(*columns),
        (uplot.Series(label="s"), *_series(plot.curves)),
        scales=_scales(plot.limit),
        axes=(uplot.Axis(show=False), _axis()),
        legend=uplot.Legend(show=False),
        cursor=uplot.Cursor(show=False),
        height=_PLOT_HEIGHT,
        padding=(4, 8, 4, 0),
    )


def _scales(limit: float) -> dict[str, uplot.Scale]:
    return {"x": uplot.Scale(time=False, range=(-SECONDS, 0.0)), "y": uplot.Scale(range=(-limit, limit))}


def _series(curves: Sequence[Curve]) -> list[uplot.Series]:
    found = []
    for curve in curves:
        is_edge = curve.ink == _EDGE_INK
        dash = (4.0, 4.0) if is_edge else ()
        width = 1.0 if is_edge else 2.0
        found.append(uplot.Series(label=curve.word, stroke=curve.ink, width=width, dash=dash, points={"show": False}))
    return found


def _axis() -> uplot.Axis:
    faint = "rgba(120,130,150,.16)"
    return uplot.Axis(
        stroke="#7b8796",
        size=40,
        space=18,
        font="10px system-ui",
        grid={"stroke": faint},
        ticks={"stroke": faint},
    )
