"""Robots and policies in the same ring: one table for robots of different sizes."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from conftest import TIPTOE, an_outcome

from surefoot.agents.load import usual_robot
from surefoot.agents.nominal import NominalAgent
from surefoot.evaluation.protocol import protocol_for
from surefoot.evaluation.results import Results
from surefoot.evaluation.scenarios import Scenario, with_limits
from surefoot.evaluation.suites import RING
from surefoot.evaluation.threshold_search import Threshold
from surefoot.report.evaluations import read_evaluations
from surefoot.report.page_figures import comparison_figures
from surefoot.report.page_tables import side_by_side
from surefoot.report.ring_table import ring_table
from surefoot.robots import Robot, load_robot


@pytest.fixture(scope="module")
def tables(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """A results table of the nominal pose of two robots: every line holds 20 cells of its grid, the first one 10."""
    folder = tmp_path_factory.mktemp("ring")
    return [fill(folder / f"{i}.sqlite", robot) for i, robot in enumerate((usual_robot(), load_robot(str(TIPTOE))))]


def fill(path: Path, robot: Robot) -> Path:
    agent = NominalAgent(robot)
    agent.name = "pose"
    with Results(path) as results:
        thresholds = []
        for scenario in with_limits(RING):
            for i, line in enumerate(scenario.lines(protocol_for(robot))):
                if scenario.search:
                    size = line.size(20 if i else 10)
                    thresholds.append(Threshold(line, size, 40, 39, 0.87, 1.0, "share"))
                else:
                    for trial in line.fixed_trials():
                        results.trials_of(agent).put(trial, an_outcome(quiet_drift=0.012), scenario.name)
        results.add_thresholds(agent, thresholds)
        results.add_scenarios(agent, list(RING), wall_s=1.0)
    return path


def test_a_row_has_what_makes_robots_comparable(tables: list[Path]) -> None:
    evaluations = read_evaluations(tables)
    table = ring_table(evaluations)
    first, second = (dict(zip(table.columns, row, strict=True)) for row in table.rows)
    # Worst of ten, best of twenty cells of 6 Ns: 60 and 120 Ns, over 137.29 kg 0.44 and 0.87 Ns/kg.
    assert (first["robot"], first["agent"], first["directions"]) == ("Valkyrie", "pose", "16")
    assert first["any"] == first["within limits"] == first["no step"] == first["torso"] == first["J50"] == "60 / 120"
    assert first["[Ns/kg]"] == "0.44 / 0.87"
    assert first["quiet"] == "1.2 cm, 2.0 W"
    # The CoM of the bent pose is 1.1 m above the soles: sqrt(9.81 x 1.1) = 3.3 m/s, and 0.44 / 3.3 = 0.13.
    assert float(first["J / (m sqrt(g z))"].split(" / ")[0]) == pytest.approx(0.437 / math.sqrt(9.81 * 1.1), abs=0.01)
    # Per mass the other robot's grid is the same but for whole newtons.
    per_mass = [float(part) for part in second["[Ns/kg]"].split(" / ")]
    assert per_mass == pytest.approx([0.44, 0.87], rel=0.05)
    assert second["any"] != first["any"]


def test_agents_of_one_name_stay_apart_by_their_robots_in_one_results_file(tmp_path: Path) -> None:
    robots = usual_robot(), load_robot(str(TIPTOE))
    for robot in robots:
        fill(tmp_path / "both.sqlite", robot)
    evaluations = read_evaluations([tmp_path / "both.sqlite"])
    assert {e.name for e in evaluations} == {f"pose ({robot.name})" for robot in robots}
    assert {(row[0], row[1]) for row in ring_table(evaluations).rows} == {(robot.title, "pose") for robot in robots}
    for e in evaluations:
        # 16 directions in 4 scenarios at the root and 2 at the torso are searched, 4 of them within limits as well.
        assert {threshold.line.protocol for threshold in e.thresholds} == {protocol_for(e.robot)}
        assert len(e.thresholds) == len({(t.line.scenario.name, t.line.name) for t in e.thresholds})
        assert len(e.fixed["quiet"]) == 8


def test_results_without_a_search_have_no_map_of_thresholds(tmp_path: Path) -> None:
    with Results(tmp_path / "fixed.sqlite") as results:
        for robot in (usual_robot(), load_robot(str(TIPTOE))):
            agent, scenario = NominalAgent(robot), Scenario("shove", search="", impulse=20.0, directions=1, trials=1)
            agent.name = "pose"
            results.trials_of(agent).put(scenario.lines()[0].fixed_trials()[0], an_outcome(), "shove")
            results.add_scenarios(agent, [scenario], wall_s=1.0)
    evaluations = read_evaluations([tmp_path / "fixed.sqlite"])
    assert [e.name for e in evaluations] == [f"pose ({e.robot.name})" for e in evaluations]
    assert comparison_figures(evaluations, {}) == []


def test_several_robots_have_one_table_and_one_map_and_the_rest_is_of_the_first(tables: list[Path]) -> None:
    evaluations = read_evaluations(tables)
    titles = [table.title for table in side_by_side(evaluations)]
    assert titles[:2] == ["Robots and policies in the same ring", "Table I: largest rejected impulse [Ns]"]
    (table_1,) = [table for table in side_by_side(evaluations) if table.title.startswith("Table I:")]
    assert len(table_1.rows) == 2  # the first robot's pose, and the no-step bound
    assert [figure.slug for figure in comparison_figures(evaluations, {})] == ["ring", "table-1"]
