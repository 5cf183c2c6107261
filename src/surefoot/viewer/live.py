"""Live: what stands beside the scene: verdict, strategies, CoM and capture point, root attitude, joint torques."""

from __future__ import annotations

from collections import deque
from html import escape

import numpy as np
import viser
from viser import uplot

from surefoot.physics.step_record import StepRecord
from surefoot.rates import POLICY_HZ
from surefoot.robots import Robot
from surefoot.viewer.browser_scene import CAPTURED, COM, ESCAPED, FORCE, PRESSURE, PUSH, STATE_COLORS, SUPPORT
from surefoot.viewer.session import Session
from surefoot.viewer.verdict import State

SECONDS = 6.0
"""How far the curves look back."""
_NUM_STEPS = round(SECONDS * POLICY_HZ)
_COM_INK, _CAPTURE_INK, _EDGE_INK, _ROLL_INK, _PITCH_INK = (
    *("#d99a00", "#1f9d55", "#9aa7b8"),
    *("#2d7dd2", "#8e44ad"),
)
_PLOT_HEIGHT = 84
_WORDS = {
    State.STANDING: ("Standing", "push it"),
    State.RECOVERING: ("Recovering", ""),
    State.RECOVERED: ("Recovered", "stands still for 2 s"),
    State.FELL: ("Fell", ""),
    State.RESTLESS: ("Up, but restless", "does not stand still"),
}


class History:
    """The last seconds of the watched robot, one row per policy step.

    Rows: CoM, capture point and the support's edges, forward and to the left of the middle between the soles [cm];
    roll and pitch of the root [deg].
    """

    COLUMNS = ("com_x", "cp_x", "front", "back", "com_y", "cp_y", "left", "right", "roll", "pitch")

    def __init__(self) -> None:
        self._rows: deque[list[float]] = deque(maxlen=_NUM_STEPS)
        self.peak_torque = np.zeros(0)

    def clear(self) -> None:
        self._rows.clear()
        self.peak_torque = np.zeros(0)

    def add(self, session: Session, robot: int) -> None:
        """Remember the last tick of the session's last step, and the torques of all of it."""
        ticks = session.ticks
        one = ticks[robot : robot + 1].ticks(slice(-1, None))
        center, forward = one.sole_position[0, 0, :, :2].mean(axis=0), one.heading[0, 0]

        def ahead(points: np.ndarray) -> np.ndarray:
            """Forward and to the left of the middle between the soles [cm]."""
            away = points - center
            turned = (away[..., 0] + 1j * away[..., 1]) * forward.conjugate()
            return 100.0 * np.stack([turned.real, turned.imag], axis=-1)

        polygon = one.support_polygon(0, 0)
        edge = ahead(polygon) if len(polygon) else np.full((1, 2), np.nan)
        (high_x, high_y), (low_x, low_y) = edge.max(axis=0), edge.min(axis=0)
        (com_x, com_y), (cp_x, cp_y) = ahead(one.com_position[0, 0, :2]), ahead(one.capture_point[0, 0])
        roll, pitch = np.degrees(one.root_attitude[:, 0, 0])
        self._rows.append([com_x, cp_x, high_x, low_x, com_y, cp_y, high_y, low_y, roll, pitch])
        torque = np.abs(ticks.joint_torque[robot]).max(axis=0) / ticks.robot.torque_limit
        fading = self.peak_torque * 0.985 if len(self.peak_torque) else torque
        self.peak_torque = np.maximum(torque, fading)

    def columns(self, *names: str) -> tuple[np.ndarray, ...]:
        """Time before now [s], and the columns of these names."""
        rows = np.array(self._rows or [[np.nan] * len(self.COLUMNS)])
        time = np.arange(1 - len(rows), 1) / POLICY_HZ
        return (time, *(rows[:, self.COLUMNS.index(name)] for name in names))


class LivePanel:
    """The panel's elements; `show` brings them up to date."""

    def __init__(self, server: viser.ViserServer):
        gui = server.gui
        self._status = gui.add_html("")
        self._plots = {}
        for title, limit, curves in _PLOTS:
            gui.add_html(_plot_title(title, curves))
            columns = tuple(column for column, _, _ in curves)
            self._plots[columns] = gui.add_uplot(
                History().columns(*columns),
                (uplot.Series(label="s"), *(_series(name, ink) for _, name, ink in curves)),
                scales={
                    "x": uplot.Scale(time=False, range=(-SECONDS, 0.0)),
                    "y": uplot.Scale(range=(-limit, limit)),
                },
                axes=(uplot.Axis(show=False), _axis()),
                legend=uplot.Legend(show=False),
                cursor=uplot.Cursor(show=False),
                height=_PLOT_HEIGHT,
                padding=(4, 8, 4, 0),
            )
        self._torques = gui.add_html("")
        gui.add_html(legend_html())

    def show(self, session: Session, history: History, watched: int, policy: str, rates: str) -> None:
        """Bring everything up to date; `policy` and `rates` are a line each."""
        self._status.content = status_html(session, watched, policy, rates)
        for columns, plot in self._plots.items():
            plot.data = history.columns(*columns)
        self._torques.content = torques_html(session.robot, session.ticks, watched, history.peak_torque)


_PLOTS = (
    (
        "Forward [cm]",
        40.0,
        (
            ("com_x", "CoM", _COM_INK),
            ("cp_x", "capture point", _CAPTURE_INK),
            ("front", "support", _EDGE_INK),
            ("back", "", _EDGE_INK),
        ),
    ),
    (
        "Left [cm]",
        40.0,
        (
            ("com_y", "CoM", _COM_INK),
            ("cp_y", "capture point", _CAPTURE_INK),
            ("left", "support", _EDGE_INK),
            ("right", "", _EDGE_INK),
        ),
    ),
    ("Root [deg]", 30.0, (("roll", "roll", _ROLL_INK), ("pitch", "pitch", _PITCH_INK))),
)
"""Title, range, and the curves: column of the history, word, colour."""


def _plot_title(title: str, curves: tuple[tuple[str, str, str], ...]) -> str:
    words = "".join(
        f'<span style="margin-left:10px;white-space:nowrap"><span style="color:{ink}">━</span> {name}</span>'
        for _, name, ink in curves
        if name
    )
    return (
        '<div style="font:12px/1.2 system-ui,sans-serif;padding:6px 12px 0;display:flex;justify-content:space-between">'
        f'<b style="white-space:nowrap">{title}</b><span style="opacity:.85">{words}</span></div>'
    )


def status_html(session: Session, watched: int, policy: str, rates: str) -> str:
    """The verdict on the watched robot, how it did it, and the count."""
    verdicts = session.verdicts
    state = State(verdicts.state[watched])
    word, detail = _WORDS[state]
    ended = verdicts.recovered + verdicts.fallen
    red, green, blue = STATE_COLORS[state]
    crowd = ""
    if session.num_robots > 1:
        counts = [(int((verdicts.state == s).sum()), _WORDS[s][0].lower(), STATE_COLORS[s]) for s in State]
        crowd = "".join(
            f'<span style="margin-right:9px;white-space:nowrap">{dot(color)} {n} {name}</span>'
            for n, name, color in counts
            if n
        )
        crowd = f'<div style="margin-top:6px;display:flex;flex-wrap:wrap">{crowd}</div>'
    return (
        '<div style="font:13px/1.45 system-ui,sans-serif;padding:2px 12px 6px">'
        f'<div data-surefoot="verdict" style="background:rgb({red},{green},{blue});color:white;border-radius:8px;'
        'padding:8px 12px">'
        f'<div style="font-size:21px;font-weight:700;line-height:1.2">{word}</div>'
        f'<div style="opacity:.92;min-height:1.4em">{escape(session.strategies(watched)) or detail}</div></div>'
        '<div style="display:flex;justify-content:space-between;margin-top:8px;font-size:15px">'
        f'<span data-surefoot="count"><b>{verdicts.recovered}</b> of <b>{ended}</b> recovered</span>'
        f'<span style="color:rgb(200,50,50)">{verdicts.fallen} fell</span></div>{crowd}'
        f'<div style="opacity:.75;margin-top:4px">{escape(policy)}</div>'
        f'<div data-surefoot="rates" style="opacity:.55;font-size:12px">{escape(rates)}</div></div>'
    )


def legend_html() -> str:
    """What the marks in the scene mean."""
    marks = (
        (PUSH, "push"),
        (FORCE, "foot force"),
        (COM, "CoM, also on the ground"),
        (PRESSURE, "centre of pressure"),
        (CAPTURED, "capture point, captured"),
        (SUPPORT, "support polygon"),
        (ESCAPED, "capture point, beyond"),
    )
    cells = "".join(f"<div>{dot(color)} {words}</div>" for color, words in marks)
    return (
        '<div style="font:12px/1.5 system-ui,sans-serif;padding:2px 12px 8px;display:grid;'
        f'grid-template-columns:1fr 1fr;white-space:nowrap">{cells}</div>'
    )


def dot(color: tuple[int, int, int]) -> str:
    """A coloured dot, as HTML."""
    return f'<span style="color:rgb{color}">●</span>'


def torques_html(robot: Robot, ticks: StepRecord, watched: int, peak: np.ndarray) -> str:
    """Bars of the joint torques as shares of their limits: now, and the fading peak as a tick."""
    share = ticks.joint_torque[watched, -1] / robot.torque_limit
    peak = peak if len(peak) else np.abs(share)
    rows = "".join(
        _torque_row(name, value, limit, high)
        for name, value, limit, high in zip(robot.joint_names, share, robot.torque_limit, peak, strict=True)
    )
    return (
        '<div style="font:12px/1.3 system-ui,sans-serif;padding:4px 12px 10px">'
        '<div style="font-weight:600;font-size:12px;margin-bottom:3px">Joint torque, share of its limit</div>'
        f"{rows}</div>"
    )


def _torque_row(name: str, share: float, limit: float, peak: float) -> str:
    width, color = min(abs(share), 1.0) * 100.0, "#d64545" if abs(share) > 0.95 else "#4a7fb5"
    return (
        '<div style="display:flex;align-items:center;height:14px">'
        f'<span style="width:106px;opacity:.8;white-space:nowrap">{name.replace("_", " ")}</span>'
        '<span style="flex:1;position:relative;height:8px;background:rgba(128,140,160,.22);border-radius:4px">'
        f'<span style="position:absolute;left:0;top:0;height:8px;width:{width:.1f}%;background:{color};'
        'border-radius:4px"></span>'
        f'<span style="position:absolute;left:{min(peak, 1.0) * 100.0:.1f}%;top:-1px;height:10px;width:2px;'
        'background:#d64545;opacity:.7"></span></span>'
        '<span style="width:86px;text-align:right;opacity:.65;white-space:nowrap">'
        f"{abs(share) * limit:.0f} / {limit:.0f} Nm</span></div>"
    )


def _series(label: str, ink: str) -> uplot.Series:
    is_edge = ink == _EDGE_INK
    return uplot.Series(
        label=label,
        stroke=ink,
        width=1.0 if is_edge else 2.0,
        dash=(4.0, 4.0) if is_edge else (),
        points={"show": False},
    )


def _axis() -> uplot.Axis:
    faint = "rgba(120,130,150,.16)"
    return uplot.Axis(
        stroke="#7b8796",
        size=34,
        space=18,
        font="10px system-ui",
        grid={"stroke": faint},
        ticks={"stroke": faint},
    )
