"""Gallery: the report's figures, each with its caption and the numbers behind it."""

from __future__ import annotations

import base64
import csv
import hashlib
import io
import re
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypedDict

import matplotlib
import numpy as np
from PIL import Image

from surefoot.agents.agent import Policy
from surefoot.agents.controllers.controller import ControllerAgent
from surefoot.errors import UserError
from surefoot.evaluation.replay import differences
from surefoot.evaluation.suites import SINGLE
from surefoot.evaluation.trials import Trial
from surefoot.rendering.strip import filmstrip
from surefoot.rendering.words import push_words
from surefoot.report import paper, plots, result_pictures, tables
from surefoot.report import trial_plots as drawings
from surefoot.report.evaluations import LARGEST, SHANK, Evaluation
from surefoot.report.traces import STRIDE, Trace, run_traces

Curves = Mapping[str, Sequence[Sequence[Mapping[str, float]]]]
"""Learning curves: algorithm -> runs -> points, as `surefoot.curve.read_curves` gives them."""

_FONT = "ui-sans-serif, system-ui, sans-serif"
_THEMED = {plots.INK: "var(--ink)", plots.GREY: "var(--muted)", plots.PALE: "var(--line)", "#ffffff": "var(--card)"}
"""Colours of the plots that the page's light and dark styles replace."""


@dataclass(frozen=True)
class Figure:
    """A figure of the page.

    Attributes:
        slug: for anchors and file names.
        svg: as markup; empty if it is an image.
        image: as a data URI; empty if it is SVG.
        rows: the numbers behind it, the first row naming the columns.
        wide: to be scrolled rather than shrunk on a narrow screen.
        alone: in a row of its own, though it is not wide.
    """

    slug: str
    title: str
    caption: str
    rows: Sequence[Sequence[object]]
    svg: str = ""
    image: str = ""
    wide: bool = False
    alone: bool = False

    @property
    def csv_uri(self) -> str:
        """The numbers as a file to save."""
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows(self.rows)
        return "data:text/csv;base64," + base64.b64encode(text.getvalue().encode()).decode()


def comparison_figures(evaluations: Sequence[Evaluation], curves: Curves) -> list[Figure]:
    """Figures of all policies together."""
    found = []
    main = [e for e in evaluations if e.has_main_directions]
    if main:
        found.append(_bars(main))
    if len(main) > 1:
        found.append(_polar_map(main))
    if any(run for runs in curves.values() for run in runs):
        found.append(_learning_curves(curves))
    return found


def policy_figures(evaluation: Evaluation, policy: Policy | ControllerAgent | None) -> tuple[list[Figure], list[str]]:
    """Figures of one policy, and notes on those that could not be made.

    Args:
        policy: to run the drawn trials again; without it, only what needs no trial.
    """
    found = [_success_map(evaluation)] if any(evaluation.cells.values()) else []
    if policy is None or not evaluation.cases:
        return found, []
    traces = run_traces(policy, {name: case.trial for name, case in evaluation.cases.items()})
    changed = [name for name, trace in traces.items() if differences(evaluation.cases[name].outcome, trace.outcome)]
    notes = [f"Run again, these trials came out otherwise than stored: {', '.join(changed)}."] if changed else []
    singles = {name: trace for name, trace in traces.items() if name in SINGLE}
    if LARGEST in traces:
        found.append(_footprints(evaluation, traces[LARGEST]))
    if singles:
        found.append(_motion(evaluation, singles))
    if SHANK in traces:
        found.append(_support_foot(evaluation, traces[SHANK]))
    try:
        found.append(_film_strip(evaluation, traces))
    except UserError as error:
        notes.append(f"No film strip: {error}.")
    return found, notes


def _bars(evaluations: Sequence[Evaluation]) -> Figure:
    rows = [result_pictures.bar_row(e.name, e.thresholds) for e in evaluations]
    equation = paper.TABLE_1["equation (6)"]
    rows.append(plots.BarRow("equation (6)", *tables.worse_bounds(evaluations[0].robot), *equation))
    data = [
        [row.name, round(row.sagittal, 1), row.paper_sagittal, round(row.lateral, 1), row.paper_lateral] for row in rows
    ]
    return Figure(
        "table-1",
        "Rejected impulse beside the paper",
        "Table I: pushes at the root for 0.12 s, the worse of the two directions of each plane.",
        [["policy", "sagittal [Ns]", "paper", "lateral [Ns]", "paper"], *data],
        wide=True,
        **_drawn(lambda path: plots.bars_beside_paper(rows, path)),
    )


def _polar_map(evaluations: Sequence[Evaluation]) -> Figure:
    points = {e.name: [(t.line.angle, t.size) for t in tables.root_pushes(e.thresholds).values()] for e in evaluations}
    bound = _bound(evaluations[0], "straight")
    data = [[name, round(float(np.degrees(a)), 2), ns] for name, several in points.items() for a, ns in several]
    return Figure(
        "directions",
        "Rejected impulse by direction",
        "Pushes at the root, forward up. Dashed: equation (6) of the paper, what a point mass over fixed feet can"
        " reject, in the straight pose.",
        [["policy", "direction [deg]", "rejected impulse [Ns]"], *data],
        alone=True,
        **_drawn(lambda path: plots.polar_map(points, bound, path, title="")),
    )


def _learning_curves(curves: Curves) -> Figure:
    data = [
        [algorithm, seed, round(p["minutes"], 3), int(p["steps"]), round(p["recovered"], 4)]
        for algorithm, runs in curves.items()
        for seed, run in enumerate(runs)
        for p in run
    ]
    return Figure(
        "learning",
        "Learning curves",
        "Share of 96 held-out pushes recovered while learning: mean over the seeds, and a band from the lowest to the"
        " highest.",
        [["algorithm", "run", "minutes", "policy steps", "recovered"], *data],
        wide=True,
        **_drawn(lambda path: plots.learning_curves(curves, path)),
    )


def _success_map(e: Evaluation) -> Figure:
    pushes = list(tables.root_pushes(e.thresholds).values())
    pose = np.array(e.contract.nominal_pose)
    data = [[line.name, cell.impulse, cell.recovered, cell.trials] for line, cells in e.cells.items() for cell in cells]
    return Figure(
        "success",
        "Which pushes at the root it survives",
        f"{len(pushes)} directions, forward up; 8 sampled trials in each cell of 6 Ns, 40 whole ones where it was"
        " close. Blank: not searched. Dashed: equation (6) in the policy's nominal pose.",
        [["direction", "impulse [Ns]", "recovered", "trials"], *data],
        alone=True,
        **_drawn(lambda path: drawings.success_map(e.cells, pushes, _bound(e, pose), path)),
    )


def _motion(e: Evaluation, traces: Mapping[str, Trace]) -> Figure:
    words = {name: push_words(trace.trial.push) for name, trace in traces.items()}
    named = {words[name]: trace for name, trace in traces.items()}
    ends = "; ".join(f"{words[name]}: {_end(trace)}" for name, trace in traces.items())
    header = ["push", "time [s]", "CoM x [m]", "CoM y [m]", "root roll [deg]", "root pitch [deg]"]
    rows = [
        [words[name], *np.round(row, 4).tolist()]
        for name, trace in traces.items()
        for row in np.column_stack([trace.time, trace.com_shift, *trace.root_attitude_deg])[:: 2 * STRIDE]
    ]
    return Figure(
        "motion",
        "Motion after the paper's four pushes",
        f"CoM counted from where it was at the push, root attitude, and which foot carries load; seed 0. {ends}."
        " The paper's figure 5, a and b.",
        [header, *rows],
        wide=True,
        **_drawn(lambda path: drawings.motion(named, path)),
    )


def _footprints(e: Evaluation, trace: Trace) -> Figure:
    steps = [
        [i, step.foot, round(step.time, 3), *np.round(step.place, 3).tolist(), round(step.length, 3)]
        for i, step in enumerate(trace.strategies.steps, 1)
    ]
    return Figure(
        "footprints",
        "The largest sagittal push from above",
        f"{push_words(trace.trial.push)}: {_end(trace)}. Dashed soles: where the feet stood; numbers: the steps"
        " in their order. The paper's figure 5, c.",
        [["step", "foot", "landing [s]", "x [m]", "y [m]", "length [m]"], *steps],
        wide=True,
        **_drawn(lambda path: drawings.footprints(trace, path)),
    )


def _support_foot(e: Evaluation, trace: Trace) -> Figure:
    (roll, pitch), loaded = trace.foot_attitude_deg, trace.foot_loaded
    columns = [trace.time, *trace.sole_height.T, *roll.T, *pitch.T, *loaded.T]
    header = ["time [s]"]
    header += [f"{foot} {what}" for what in ("height [m]", "roll [deg]", "pitch [deg]", "loaded") for foot in _FEET]
    return Figure(
        "support-foot",
        "Feet after a push at the shank",
        f"{push_words(trace.trial.push)}: {_end(trace)}. Height of the soles' centres and their tilt. The paper's"
        " figure 6, b.",
        [header, *np.round(np.column_stack(columns)[:: 2 * STRIDE], 4).tolist()],
        wide=True,
        **_drawn(lambda path: drawings.support_foot(trace, path)),
    )


_FEET = ("left", "right")


def _film_strip(e: Evaluation, traces: Mapping[str, Trace]) -> Figure:
    shown: dict[Trial, str] = {}
    for name in (*SINGLE, LARGEST, SHANK):
        if name in traces:  # the largest sagittal push may be one of the paper's
            shown.setdefault(traces[name].trial, name)
    strip = filmstrip([traces[name].recording(e.name) for name in shown.values()])
    rows = [
        [name, push_words(c.trial.push), c.trial.seed, c.outcome.reason, c.outcome.seconds, c.outcome.steps]
        for name, c in ((name, e.cases[name]) for name in shown.values())
    ]
    return Figure(
        "film",
        "Film strips",
        "The same trials as pictures, in the manner of the paper's figures 1 and 2.",
        [["case", "push", "seed", "outcome", "seconds", "steps"], *rows],
        image=_webp(strip),
        wide=True,
    )


def _end(trace: Trace) -> str:
    """How a trial ended, in words: "recovered, 8 steps"."""
    return f"{trace.outcome.reason}, {plots.counted(trace.outcome.steps, 'step')}"


def _bound(e: Evaluation, pose: str | np.ndarray) -> list[plots.Point]:
    angles = np.linspace(0.0, 2.0 * np.pi, 180, endpoint=False).tolist()
    return list(zip(angles, tables.capture_point_bound(e.robot, pose, angles), strict=True))


class _Markup(TypedDict):
    svg: str
    image: str


def _drawn(draw: Callable[[Path], None]) -> _Markup:
    """A plot as SVG markup or as a PNG's data URI, whatever is smaller: keyword arguments of `Figure`."""
    with tempfile.TemporaryDirectory() as folder, matplotlib.rc_context({"svg.fonttype": "none"}):
        vector, pixels = Path(folder) / "plot.svg", Path(folder) / "plot.png"
        draw(vector)
        svg = _inline(vector.read_text())
        if len(svg) < _WORTH_A_TRY:
            return {"svg": svg, "image": ""}
        draw(pixels)
        image = "data:image/png;base64," + base64.b64encode(pixels.read_bytes()).decode()
    return {"svg": svg, "image": ""} if len(svg) <= len(image) else {"svg": "", "image": image}


_WORTH_A_TRY = 100_000
"""No PNG of a plot is smaller than so many bytes."""


def _inline(text: str) -> str:
    """Matplotlib's SVG file as markup within a page: no header, the page's colours and font, ids of its own."""
    own = hashlib.sha256(text.encode()).hexdigest()[:8]
    text = re.sub(r"<metadata>.*?</metadata>", "", text[text.index("<svg") :], flags=re.DOTALL)
    text = re.sub(r'(<svg[^>]*?) width="[^"]*"', r"\1", text)
    text = re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", text)
    text = re.sub(r'(id="|href="#|url\(#)', rf"\1f{own}-", text)
    text = re.sub(r"(-?\d+\.\d\d)\d+", r"\1", text)  # a hundredth of a point is enough
    text = text.replace("'DejaVu Sans'", _FONT)
    for color, variable in _THEMED.items():
        text = text.replace(color, variable)
    return text


def _webp(image: np.ndarray) -> str:
    data = io.BytesIO()
    Image.fromarray(image).save(data, "webp", quality=80, method=6)
    return "data:image/webp;base64," + base64.b64encode(data.getvalue()).decode()
