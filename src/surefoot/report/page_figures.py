"""Page figures: the plots and pictures of the report, with their captions and the numbers that they show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from surefoot.errors import UserError
from surefoot.evaluation.protocol import PROTOCOL
from surefoot.evaluation.replay import differences
from surefoot.evaluation.scenarios import limited_name
from surefoot.evaluation.suites import SINGLE
from surefoot.evaluation.trials import Trial
from surefoot.learning.validation import NUM_PUSHES
from surefoot.rendering.strip import filmstrip
from surefoot.rendering.words import push_words
from surefoot.report import paper, result_pictures
from surefoot.report.bounds import capture_point_bound, worse_bounds
from surefoot.report.evaluations import LARGEST, SHANK, Evaluation, has_several_robots, of_first_robot
from surefoot.report.figure import Figure, drawn, webp
from surefoot.report.learning_plots import learning_curves
from surefoot.report.plot_style import Point, counted
from surefoot.report.strategy_plots import strategy_map
from surefoot.report.threshold_plots import BarRow, bars_beside_paper, polar_map, success_map
from surefoot.report.thresholds import by_scenario, root_pushes, root_words
from surefoot.report.traces import STRIDE, Trace, run_traces
from surefoot.report.trial_plots import footprints, motion, support_foot
from surefoot.task.agent import Agent

Curves = Mapping[str, Sequence[Sequence[Mapping[str, float]]]]
"""Learning curves: algorithm -> runs -> points, as `surefoot.curve.read_curves` gives them."""


def comparison_figures(evaluations: Sequence[Evaluation], curves: Curves) -> list[Figure]:
    """Figures of all policies together; with several robots all but the first are of the first evaluation's."""
    pushed = [e for e in evaluations if root_pushes(e.thresholds)]
    found = [_ring_map(pushed)] if has_several_robots(pushed) else []
    evaluations = of_first_robot(evaluations)
    main = [e for e in evaluations if e.has_main_directions]
    if main:
        found.append(_bars(main))
    if len(main) > 1:
        found.append(_polar_map(main))
    if any(run for runs in curves.values() for run in runs):
        found.append(_learning_curves(curves))
    return found


def policy_figures(evaluation: Evaluation, policy: Agent | None) -> tuple[list[Figure], list[str]]:
    """Figures of one policy, and notes on those that could not be made.

    Args:
        evaluation: of the policy.
        policy: to run the drawn trials again; without it, only what needs no trial.
    """
    found = [_success_map(evaluation), _strategy_map(evaluation)] if any(evaluation.cells.values()) else []
    if policy is None or not evaluation.cases:
        return found, []
    traces = run_traces(policy, {name: case.trial for name, case in evaluation.cases.items()})
    changed = [name for name, trace in traces.items() if differences(evaluation.cases[name].outcome, trace.outcome)]
    notes = [f"When run again, these trials ended differently than stored: {', '.join(changed)}."] if changed else []
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
    equation = paper.TABLE_1[paper.NO_STEP_BOUND]
    rows.append(BarRow(paper.NO_STEP_BOUND, *worse_bounds(evaluations[0].robot), *equation))
    data = [
        [row.name, round(row.sagittal, 1), row.paper_sagittal, round(row.lateral, 1), row.paper_lateral] for row in rows
    ]
    return Figure(
        "table-1",
        "Rejected impulse beside the paper",
        f"Table I: pushes at the {root_words(evaluations[0].robot)} for 0.12 s, the worse of the two directions of each"
        " plane.",
        [["policy", "sagittal [Ns]", "paper", "lateral [Ns]", "paper"], *data],
        wide=True,
        **drawn(lambda path: bars_beside_paper(rows, path)),
    )


def _polar_map(evaluations: Sequence[Evaluation]) -> Figure:
    points = {e.name: [(t.line.angle, t.size) for t in root_pushes(e.thresholds).values()] for e in evaluations}
    bound = _bound(evaluations[0], evaluations[0].robot.default_pose)
    data = [[name, round(float(np.degrees(a)), 2), ns] for name, several in points.items() for a, ns in several]
    return Figure(
        "directions",
        "Rejected impulse by direction",
        f"Pushes at the {root_words(evaluations[0].robot)}; forward is up. The dashed line is the no-step bound in the"
        f" pose {evaluations[0].robot.default_pose}: the impulse that a point mass over fixed feet can reject.",
        [["policy", "direction [deg]", "rejected impulse [Ns]"], *data],
        alone=True,
        **drawn(lambda path: polar_map(points, bound, path, title="")),
    )


def _ring_map(evaluations: Sequence[Evaluation]) -> Figure:
    per_mass = {
        f"{e.robot.title}, {e.name}": [
            (t.line.angle, t.size / e.robot.mass) for t in root_pushes(e.thresholds).values()
        ]
        for e in evaluations
    }
    data = [
        [name, round(float(np.degrees(a)), 2), round(ns, 3)] for name, points in per_mass.items() for a, ns in points
    ]
    return Figure(
        "ring",
        "Rejected impulse by mass of the robot",
        "Pushes at the floating body of every robot; forward is up.",
        [["robot, policy", "direction [deg]", "rejected impulse [Ns/kg]"], *data],
        alone=True,
        **drawn(lambda path: polar_map(per_mass, [], path, title="", unit="Ns/kg")),
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
        f"Share of {NUM_PUSHES} held-out pushes from which the policy recovers in the course of training. The line is"
        " the mean over the seeds, and the band reaches from the lowest to the highest.",
        [["algorithm", "run", "minutes", "policy steps", "recovered"], *data],
        wide=True,
        **drawn(lambda path: learning_curves(curves, path)),
    )


def _success_map(e: Evaluation) -> Figure:
    pushes = list(root_pushes(e.thresholds).values())
    pose = np.array(e.contract.nominal_pose)
    data = [[line.name, cell.impulse, cell.recovered, cell.trials] for line, cells in e.cells.items() for cell in cells]
    return Figure(
        "success",
        f"Which pushes at the {root_words(e.robot)} it survives",
        f"{len(pushes)} directions; forward is up. Each cell of {pushes[0].line.grid:g} Ns has"
        f" {PROTOCOL.num_screening} short trials, and {PROTOCOL.num_full_length} of full length near the threshold."
        " Blank cells were not searched. The dashed line is the no-step bound in the policy's nominal pose.",
        [["direction", "impulse [Ns]", "recovered", "trials"], *data],
        alone=True,
        **drawn(lambda path: success_map(e.cells, pushes, _bound(e, pose), path)),
    )


def _strategy_map(e: Evaluation) -> Figure:
    found = by_scenario(e.thresholds)
    pushes = list((found.get(limited_name("root_push")) or found["root_push"]).values())
    without_step = list(found.get("root_push_no_step", {}).values())
    cells = {line.angle: several for line, several in e.cells.items()}
    data = [[line.name, cell.impulse, cell.strategy] for line, cells in e.cells.items() for cell in cells]
    return Figure(
        "strategies",
        f"Strategies after a push at the {root_words(e.robot)}",
        "The strongest strategy in the recovered trials of each cell (their median); forward is up. In grey cells fewer"
        " than nine in ten trials recovered. The rejected impulse is the one within the joints' limits.",
        [["direction", "impulse [Ns]", "strategy"], *data],
        alone=True,
        **drawn(lambda path: strategy_map(cells, pushes, without_step, path)),
    )


def _motion(e: Evaluation, traces: Mapping[str, Trace]) -> Figure:
    words = {name: push_words(trace.trial.push) for name, trace in traces.items()}
    named = {words[name]: trace for name, trace in traces.items()}
    ends = "; ".join(f"{words[name]}: {_end(trace)}" for name, trace in traces.items())
    root = root_words(e.robot)
    header = ["push", "time [s]", "CoM x [m]", "CoM y [m]", f"{root} roll [deg]", f"{root} pitch [deg]"]
    rows = [
        [words[name], *np.round(row, 4).tolist()]
        for name, trace in traces.items()
        for row in np.column_stack([trace.time, trace.com_shift, *trace.root_attitude_deg])[:: 2 * STRIDE]
    ]
    return Figure(
        "motion",
        "Motion after the paper's four pushes",
        f"CoM relative to its place at the push, attitude of the {root}, and the feet that carry load; seed 0."
        f" {ends}."
        " The paper's figure 5, a and b.",
        [header, *rows],
        wide=True,
        **drawn(lambda path: motion(named, path)),
    )


def _footprints(e: Evaluation, trace: Trace) -> Figure:
    steps = [
        [i, step.foot, round(step.time, 3), *np.round(step.place, 3).tolist(), round(step.length, 3)]
        for i, step in enumerate(trace.strategies.steps, 1)
    ]
    return Figure(
        "footprints",
        "The largest sagittal push from above",
        f"{push_words(trace.trial.push)}: {_end(trace)}. Dashed soles show where the feet stood, and numbers"
        " give the order of the steps. Compare the paper's figure 5, c.",
        [["step", "foot", "landing [s]", "x [m]", "y [m]", "length [m]"], *steps],
        wide=True,
        **drawn(lambda path: footprints(trace, path)),
    )


def _support_foot(e: Evaluation, trace: Trace) -> Figure:
    (roll, pitch), loaded = trace.foot_attitude_deg, trace.foot_loaded
    columns = [trace.time, *trace.sole_height.T, *roll.T, *pitch.T, *loaded.T]
    header = ["time [s]"]
    header += [f"{foot} {what}" for what in ("height [m]", "roll [deg]", "pitch [deg]", "loaded") for foot in _FEET]
    return Figure(
        "support-foot",
        "Feet after a push at the shank",
        f"{push_words(trace.trial.push)}: {_end(trace)}. Height of the soles' centres and their tilt. Compare"
        " the paper's figure 6, b.",
        [header, *np.round(np.column_stack(columns)[:: 2 * STRIDE], 4).tolist()],
        wide=True,
        **drawn(lambda path: support_foot(trace, path)),
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
        "The same trials as pictures, in the style of the paper's figures 1 and 2.",
        [["case", "push", "seed", "outcome", "seconds", "steps"], *rows],
        image=webp(strip),
        wide=True,
    )


def _end(trace: Trace) -> str:
    """How a trial ended, in words: "recovered, 8 steps"."""
    return f"{trace.outcome.reason}, {counted(trace.outcome.steps, 'step')}"


def _bound(e: Evaluation, pose: str | np.ndarray) -> list[Point]:
    angles = np.linspace(0.0, 2.0 * np.pi, 180, endpoint=False).tolist()
    return list(zip(angles, capture_point_bound(e.robot, pose, angles), strict=True))
