"""The lines to beat, as a table."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from conftest import TIPTOE

from surefoot.agents.load import usual_robot
from surefoot.evaluation.results_export import read_thresholds
from surefoot.report.targets import FIVE_MINUTES, TARGETS, first_table, targets_for, targets_of, targets_table
from surefoot.report.thresholds import LATERAL, SAGITTAL, root_pushes, worse_of
from surefoot.robots import load_robot

FIGURES = {"root_push.directions": 4, "root_push.sagittal": 306.0, "root_push.lateral": 240.0}


def reached(algorithm: str, **figures: float) -> dict[str, str]:
    found = FIGURES | {key.replace("__", "."): v for key, v in figures.items()}
    table = targets_table("mine", algorithm, found, usual_robot())
    return {row[0]: row[-1] for row in table.rows}


def test_an_algorithm_is_held_to_the_papers_row_for_it() -> None:
    rows = {target.words: target for target in targets_of("ppo")}
    assert (rows["sagittal, worse of two"].paper, rows["lateral, worse side"].paper) == (192.0, 36.0)
    assert reached("ppo") == {"sagittal, worse of two": "yes", "lateral, worse side": "yes"}
    # DDPG is to reach 300 Ns on both.
    assert reached("ddpg") == {"sagittal, worse of two": "yes", "lateral, worse side": "no"}


def test_what_was_not_tested_is_left_out() -> None:
    assert "any joint speeds, worst of 16 directions" not in reached("trpo", root_push__worst=450.0)
    assert (
        reached("trpo", root_push__worst=450.0, root_push__directions=16)["any joint speeds, worst of 16 directions"]
        == "yes"
    )


def test_limits_from_above_are_not_to_be_exceeded_and_a_fall_misses_them() -> None:
    words = "60 s undisturbed, mean power"
    assert reached("trpo", quiet__mean_power_W=5.0)[words] == "yes"
    assert reached("trpo", quiet__mean_power_W=5.5)[words] == "no"
    assert reached("trpo", quiet__mean_power_W=math.nan)[words] == "no"


def test_our_targets_are_the_papers_figures_or_beyond_them() -> None:
    for target in (*TARGETS, *targets_of("trpo"), *targets_of("ppo"), *targets_of("ddpg")):
        assert target.at_most or target.paper is None or target.value >= target.paper


def test_another_robot_is_held_to_the_same_cells_of_its_own_grid_and_not_to_the_papers_figures() -> None:
    lines = {target.words: target for target in targets_for(load_robot(TIPTOE), "ppo")}
    # 300 Ns are 50 cells of 6 Ns, and a cell of the second robot is 0.36 Ns.
    assert (lines["sagittal, worse of two"].value, lines["sagittal, worse of two"].paper) == (18.0, None)
    # 1.5 m x 0.455 m / 0.986129 m.
    assert lines["landing, height"].value == 0.6921
    assert targets_for(usual_robot(), "ppo") == targets_of("ppo")


def test_a_policy_of_a_few_minutes_is_set_beside_the_paper_and_beside_five_minutes() -> None:
    table = first_table("demo", "ddpg", 3.0, FIGURES)
    assert table.columns == ("hardest push [Ns]", "demo, 3 min", "five minutes", "the paper")
    assert table.rows[0] == ("forward or backward", "306", "234 (210 to 300)", "75")
    assert table.rows[1] == ("to the left or right", "240", "282 (276 to 300)", "160")
    assert "no" not in [cell for row in table.rows for cell in row]


def test_what_five_minutes_give_is_what_the_committed_table_of_seeds_says() -> None:
    committed = read_thresholds(Path(__file__).parent.parent / "results" / "seeds.csv")
    seeds = [root_pushes(found) for name, found in committed.items() if name.startswith("ddpg")]
    for plane, directions in (("sagittal", SAGITTAL), ("lateral", LATERAL)):
        sizes = [worse_of(pushes, directions).size for pushes in seeds]
        assert FIVE_MINUTES[plane] == (min(sizes), float(np.median(sizes)), max(sizes))
