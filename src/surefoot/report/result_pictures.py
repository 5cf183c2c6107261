"""Result pictures: the pictures of the demo and the README, from thresholds, curves and single trials run again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain
from pathlib import Path

import numpy as np

from surefoot.evaluation.strategy_map import StrategyCell
from surefoot.evaluation.threshold_search import Threshold
from surefoot.physics.engines import DEFAULT_ENGINE
from surefoot.rendering.image_files import save_picture
from surefoot.rendering.recording import Recording, record
from surefoot.rendering.strip import filmstrip
from surefoot.report import paper
from surefoot.report.bounds import capture_point_bound, worse_bounds
from surefoot.report.strategy_plots import side_by_side
from surefoot.report.threshold_plots import BarRow, bars_beside_paper, polar_map
from surefoot.report.thresholds import LATERAL, SAGITTAL, root_pushes, root_words, worse_of
from surefoot.robots import Robot
from surefoot.task.agent import Agent

BEYOND = 1.5
"""The push of a film strip that the policy does not reject, as a multiple of its largest threshold."""


def draw_thresholds(policies: Mapping[str, Sequence[Threshold]], robot: Robot, folder: Path) -> list[Path]:
    """Table I as bars, and the rejected impulse by direction as a polar map.

    Args:
        robot: whose they are.
        folder: for the pictures.
        policies: thresholds at the root by the policy's name; the four main directions must be among them.
    """
    rows = [bar_row(name, thresholds) for name, thresholds in policies.items()]
    equation = paper.TABLE_1[paper.NO_STEP_BOUND]
    sagittal, lateral = worse_bounds(robot)
    rows.append(BarRow(paper.NO_STEP_BOUND, sagittal, lateral, equation.sagittal, equation.lateral))
    bars, polar = folder / "bars.png", folder / "polar.png"
    bars_beside_paper(rows, bars)
    angles = np.linspace(0.0, 2.0 * np.pi, 360, endpoint=False).tolist()
    bound = list(zip(angles, capture_point_bound(robot, robot.default_pose, angles), strict=True))
    points = {
        name: [(t.line.angle, t.size) for t in root_pushes(thresholds).values()]
        for name, thresholds in policies.items()
    }
    polar_map(points, bound, polar, title=f"Rejected impulse at the {root_words(robot)}")
    return [bars, polar]


def draw_strategies(cells: Sequence[StrategyCell], policy: Agent, folder: Path) -> list[Path]:
    """The strategies of all policies of a robot in the default engine, and those of other robots and engines.

    Args:
        cells: of all of them.
        policy: whose robot's policies are set side by side. Other robots are set beside this policy alone, and other
            engines beside the policies that they had.
        folder: for the pictures.
    """
    robot = policy.robot
    own = [cell for cell in cells if cell.robot == robot.name and cell.engine.startswith(DEFAULT_ENGINE)]
    drawn = []
    if own:
        drawn.append(folder / "strategies.png")
        side_by_side(own, drawn[-1])
    names = {cell.name for cell in cells if cell not in own}
    if names:
        names.add(policy.name)
        drawn.append(folder / "strategies-robots.png")
        side_by_side([cell for cell in cells if cell.name in names], drawn[-1])
    return drawn


def draw_strip(policy: Agent, thresholds: Sequence[Threshold], path: Path) -> Path:
    """A film strip of the policy's largest rejected pushes forward and to the left, and of one that it does not reject.

    Raises:
        UserError: there is no OpenGL to draw with.
    """
    pushes = root_pushes(thresholds)
    forward, left = pushes["forward"], pushes["left"]
    too_much = max(pushes.values(), key=lambda t: t.size)
    recordings = [recovered_recording(policy, threshold) for threshold in (forward, left)]
    cell = round(BEYOND * too_much.size / too_much.line.grid) + 5
    recordings.append(record(policy, too_much.line.trial(cell, 0, full_length=True)))
    save_picture(path, filmstrip(recordings))
    return path


def recovered_recording(policy: Agent, threshold: Threshold) -> Recording:
    """The first recovered trial at a threshold, where one of 20 may fail; the first trial if none recovers.

    At a threshold of 0 it is a trial without a push.
    """
    trials = threshold.full_length_trials() or [threshold.line.trial(0, 0, full_length=True)]
    first = record(policy, trials[0])
    others = (record(policy, trial) for trial in trials[1:])
    return next((each for each in chain([first], others) if each.outcome.recovered), first)


def bar_row(name: str, thresholds: Sequence[Threshold]) -> BarRow:
    """One policy's bars, the worse direction of each plane."""
    pushes = root_pushes(thresholds)
    sagittal = worse_of(pushes, SAGITTAL).size
    lateral = worse_of(pushes, LATERAL).size
    return BarRow(name, sagittal, lateral, *(paper.algorithm_row(name) or (None, None)))
