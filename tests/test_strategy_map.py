"""The strategy map: which strategy counts for a cell, what the command writes, and what is drawn of it."""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np
import pytest
from conftest import an_outcome
from PIL import Image

from surefoot.agents.load import load_policy
from surefoot.agents.nominal import NominalAgent
from surefoot.cli.options import check_options
from surefoot.cli.strategies import Strategies
from surefoot.errors import UserError
from surefoot.evaluation.protocol import PROTOCOL
from surefoot.evaluation.strategy_map import (
    GIVES_WAY,
    StrategyCell,
    cell_strategy,
    map_strategies,
    read_strategies,
    strategy_of,
    write_strategies,
)
from surefoot.evaluation.trials import Trial, run_trial
from surefoot.physics.pushes import horizontal_push
from surefoot.report.result_pictures import draw_strategies
from surefoot.report.strategy_plots import STRATEGY_COLORS, side_by_side
from surefoot.robots import Robot

STEP_LENGTH = 0.03


@pytest.mark.parametrize(
    ("did", "strategy"),
    [
        ({}, "none"),
        ({"ankle": True}, "ankle"),
        ({"ankle": True, "hip": True}, "hip"),
        ({"ankle": True, "foot_tilt": True}, "foot tilt"),
        ({"hip": True, "steps": 1}, "1 step"),
        ({"steps": 2}, "2 steps"),
        ({"steps": 7}, "3+ steps"),
        ({"ankle": True, "foot_shift": 0.2}, "1 step"),
    ],
)
def test_the_strongest_strategy_of_a_trial_counts(did: dict, strategy: str) -> None:
    quiet = {"ankle": False, "hip": False, "foot_tilt": False, "steps": 0, "foot_shift": 0.0}
    assert strategy_of(an_outcome(recovered=True, **(quiet | did)), STEP_LENGTH) == strategy


def test_a_cell_has_the_median_strategy_of_those_that_recover_unless_more_than_one_in_ten_falls() -> None:
    """Of none, ankle, 2 steps the median is ankle; nine of ten hold, eight of ten give way."""
    quiet = {"recovered": True, "hip": False, "foot_tilt": False, "foot_shift": 0.0}
    sways, ankle = (an_outcome(**quiet, ankle=is_used, steps=0) for is_used in (False, True))
    steps, falls = an_outcome(**quiet, ankle=True, steps=2), an_outcome(recovered=False)
    assert cell_strategy([sways, ankle, steps], STEP_LENGTH) == "ankle"
    assert cell_strategy([*[steps] * 9, falls], STEP_LENGTH) == "2 steps"
    assert cell_strategy([*[steps] * 8, falls, falls], STEP_LENGTH) == GIVES_WAY


def test_the_nominal_pose_sways_by_its_ankles_and_falls_where_single_trials_do(robot: Robot) -> None:
    agent = NominalAgent(robot)
    cells = map_strategies(agent, num_directions=4, largest=110.0, num_trials=1)
    assert [(cell.angle_deg, cell.impulse) for cell in cells] == [
        (angle, impulse) for impulse in (36.0, 72.0, 108.0) for angle in (0.0, 90.0, 180.0, 270.0)
    ]
    for cell in cells:
        trial = Trial(horizontal_push("root", cell.angle_deg, cell.impulse), 0, full_length=False)
        assert (cell.strategy == GIVES_WAY) == (not run_trial(agent, trial).recovered)
    assert {cell.strategy for cell in cells if cell.impulse == 108.0} == {GIVES_WAY}
    assert any(cell.strategy == "ankle" for cell in cells if cell.impulse == 36.0)


def a_cell(**changes: object) -> StrategyCell:
    values = {"name": "one", "robot": "valkyrie", "engine": "mujoco 4.0.0", "protocol": 2, "mass": 137.0}
    values |= {"angle_deg": 0.0, "impulse": 36.0, "trials": 4, "recovered": 4, "strategy": "hip"}
    return StrategyCell(**(values | changes))  # type: ignore[arg-type]


def test_a_table_keeps_other_agents_and_engines_and_replaces_its_own(tmp_path: Path) -> None:
    table = tmp_path / "s.csv"
    write_strategies(table, [a_cell(), a_cell(name="two")])
    write_strategies(table, [a_cell(strategy="1 step"), a_cell(engine="pybullet 3.2")])
    assert read_strategies(table) == [a_cell(name="two"), a_cell(strategy="1 step"), a_cell(engine="pybullet 3.2")]


@pytest.mark.parametrize(("old", "new"), [("hip", "cartwheel"), ("36.0", "nan"), ("137.0", "0"), (",4,4,", ",four,4,")])
def test_a_damaged_table_is_named(tmp_path: Path, old: str, new: str) -> None:
    table = tmp_path / "s.csv"
    write_strategies(table, [a_cell()])
    table.write_text(table.read_text().replace(old, new))
    with pytest.raises(UserError, match=r"s\.csv is not a table of strategies|must be"):
        read_strategies(table)


def pixels(path: Path) -> np.ndarray:
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"))


def shares(path: Path) -> dict[str, float]:
    """Share of the picture's pixels in the colour of each strategy."""
    found = pixels(path).reshape(-1, 3)
    colors = {name: np.rint(255 * np.array(matplotlib.colors.to_rgb(c))) for name, c in STRATEGY_COLORS.items()}
    return {name: float((np.abs(found - color).max(axis=1) <= 1).mean()) for name, color in colors.items()}


def test_a_map_has_the_colours_of_its_cells_in_the_shares_of_their_rings(tmp_path: Path) -> None:
    """Two rings of equal width around a middle: their areas are as 1 to 3."""
    angles = np.arange(0.0, 360.0, 22.5).tolist()
    cells = [a_cell(angle_deg=angle, impulse=36.0, strategy="hip") for angle in angles]
    cells += [a_cell(angle_deg=angle, impulse=72.0, strategy="3+ steps") for angle in angles]
    side_by_side(cells, tmp_path / "map.png")
    found = shares(tmp_path / "map.png")
    assert found["3+ steps"] / found["hip"] == pytest.approx(3.0, rel=0.1)
    assert found["2 steps"] < 0.1 * found["hip"], "only its patch in the legend"


def test_robots_are_drawn_by_mass_and_engines_side_by_side_with_their_policy(tmp_path: Path) -> None:
    cells = [a_cell(), a_cell(engine="pybullet 3.2"), a_cell(name="small", robot="g1", mass=33.0, impulse=8.0)]
    drawn = draw_strategies([*cells, a_cell(name="alone"), a_cell(name="ppo")], load_policy("ppo"), tmp_path)
    assert [path.name for path in drawn] == ["strategies.png", "strategies-robots.png"]
    widths = [pixels(path).shape[1] for path in drawn]
    assert widths[1] == pytest.approx(4 / 3 * widths[0], abs=2), "one, ppo, one in PyBullet, small: four, not five"


def test_the_command_names_wrong_numbers(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="directions must be a multiple of 4, not 6"):
        Strategies(directions=6).main()
    with pytest.raises(UserError, match="trials must be a whole number from 1 to 100, not 0"):
        check_options(Strategies(trials=0))
    with pytest.raises(UserError, match="no strategies to draw"):
        side_by_side([], tmp_path / "map.png")


def test_the_committed_table_is_one_of_todays_protocol() -> None:
    cells = read_strategies(Path(__file__).parents[1] / "results" / "strategies.csv")
    assert {cell.protocol for cell in cells} == {PROTOCOL.version}
    assert "best" in {cell.name for cell in cells}
