"""Suite validation: held-out trials along every searched line of the suite `paper`, up to our target on each.

The quick validation covers pushes at the root only, but a training has further aims. The suite validation gives for
each scenario the share of the trials up to the target that succeed, so that one policy of many can be chosen.
"""

from __future__ import annotations

import itertools

from surefoot.evaluation.protocol import PROTOCOL, protocol_for
from surefoot.evaluation.scenario_file import suite
from surefoot.evaluation.scenarios import Line, Scenario
from surefoot.evaluation.suites import ROOT_16
from surefoot.evaluation.targets import MAIN_DIRECTIONS, TARGET_VALUES
from surefoot.evaluation.trials import Trial, run_list
from surefoot.learning.validation import FIRST_SEED
from surefoot.robots import Robot
from surefoot.task.agent import Agent
from surefoot.task.imperfections import PERFECT

NUM_SIZES = 6
"""Sizes that are tried along a line, evenly spaced up to the target."""
_UNDER_NOISE = 0.8 * MAIN_DIRECTIONS["trpo"][0]
_WITHOUT_STEP = ("root_push_no_step.sagittal", "root_push_no_step.lateral")
UP_TO = {
    "root_push": TARGET_VALUES["root_push.worst"],
    "root_push_no_step": sum(TARGET_VALUES[key] for key in _WITHOUT_STEP) / 2.0,
    "torso_push": TARGET_VALUES["torso_push.worst"],
    "thigh_push": TARGET_VALUES["thigh_push.worst"],
    "shank_push": TARGET_VALUES["shank_push.worst"],
    "landing_height": TARGET_VALUES["landing.height_m"],
    "landing_tilt": TARGET_VALUES["landing.angle_deg"],
    "combined": TARGET_VALUES["combined.horizontal_Ns"],
    "noise_observation": _UNDER_NOISE,
    "noise_action": _UNDER_NOISE,
    "noise_both": _UNDER_NOISE,
}
"""The largest size of each scenario that the paper's robot tries, in its unit.

With noise it is 0.8 of the sagittal target without it.
"""
_SEEDS = FIRST_SEED // 2


def scenarios(robot: Robot | None = None) -> list[Scenario]:
    """Return the scenarios of the suite validation; pushes at the root come in 16 directions.

    Args:
        robot: that is tested; the paper's robot without it.
    """
    paper = suite("paper", robot)
    return [ROOT_16 if scenario.name == ROOT_16.name else scenario for scenario in paper if scenario.name in UP_TO]


def validate_suite(policy: Agent, round: int = 0, num_threads: int = 0) -> dict[str, float]:
    """Return the share of the trials that succeeded, by scenario: one trial of each size in every direction.

    Args:
        policy: to be validated.
        num_threads: of the physics; 0 for one per core.
        round: which of many such sets of trials, that differ in their seeds.
    """
    robot = policy.robot
    tested = scenarios(robot)
    lines = [line for scenario in tested for line in scenario.lines(protocol_for(robot))]
    seeds = itertools.count(_SEEDS + round * len(lines) * NUM_SIZES)
    # With noise nothing is ever quiet: only whole trials tell.
    trials = {
        line: [line.trial(cell, next(seeds), line.scenario.imperfections != PERFECT) for cell in _cells(line, robot)]
        for line in lines
    }
    every: list[Trial] = [trial for asked in trials.values() for trial in asked]
    outcomes = run_list(policy, every, num_threads=num_threads)
    passed: dict[str, list[bool]] = {scenario.name: [] for scenario in tested}
    for line, asked in trials.items():
        passed[line.scenario.name] += [line.succeeded(outcomes[trial]) for trial in asked]
    return {name: sum(each) / len(each) for name, each in passed.items()}


def _cells(line: Line, robot: Robot) -> list[int]:
    """Sizes up to the target: the same cells of impulses and tilts for any robot, and heights by its legs."""
    search = line.scenario.search
    end = UP_TO[line.scenario.name] / PROTOCOL.grid(search)[0]
    end *= robot.length_scale if search == "height" else 1.0
    return [round(end * (k + 1) / NUM_SIZES) for k in range(NUM_SIZES)]
