"""The oracle: planned offsets act from the push on, and find what the pose alone does not reject."""

from __future__ import annotations

import csv
import dataclasses
from pathlib import Path

import numpy as np
import pytest
from conftest import pushed

from surefoot.agents.load import load_agent, usual_robot
from surefoot.agents.nominal import NominalAgent
from surefoot.cli.oracle import COLUMNS, Oracle
from surefoot.errors import UserError
from surefoot.evaluation import oracle
from surefoot.evaluation.oracle import MOTION_S, NUM_KNOTS, PlannedAgent, largest_possible
from surefoot.evaluation.scenarios import Scenario
from surefoot.rates import POLICY_HZ


def test_a_plan_moves_the_targets_from_the_push_on_and_only_those_of_its_robot() -> None:
    agent = NominalAgent(usual_robot(), "bent")
    plans = np.zeros((2, 3, agent.robot.num_joints))
    plans[1, :, 4] = 0.1, 0.2, 0.3
    planned, ids = PlannedAgent(agent, plans), np.array([0, 1])
    planned.reset(ids)
    targets = np.array([planned(np.zeros((2, 47)), ids).joint_target for _ in range(30)]) - agent.contract.nominal_pose
    # The robot has a second to settle, 25 policy steps; then come the three steps of its plan, and nothing after them.
    expected = np.zeros(30)
    expected[25:28] = 0.1, 0.2, 0.3
    np.testing.assert_allclose(targets[:, 1, 4], expected, atol=1e-12)
    np.testing.assert_allclose(np.delete(targets[:, 1], 4, axis=-1), 0.0, atol=1e-12)
    np.testing.assert_allclose(targets[:, 0], 0.0, atol=1e-12)


def test_offsets_are_linear_between_the_knots_and_end_at_zero() -> None:
    knots = np.arange(1.0, NUM_KNOTS + 1.0)[None, :, None]
    (plan,) = oracle._plans(knots)
    assert len(plan) == round(MOTION_S * POLICY_HZ) == 32
    # Eight knots and the zero after them are 1.3 / 8 = 0.1625 s apart: at step 4, 0.16 s, knot 1 + 0.16 / 0.1625.
    assert plan[0, 0] == 1.0
    assert plan[4, 0] == pytest.approx(1.0 + 0.16 / 0.1625)
    # At step 31, 1.24 s, the way from knot 8 at 1.1375 s to zero at 1.3 s is 0.1025 / 0.1625 done.
    assert plan[31, 0] == pytest.approx(8.0 * (1.0 - 0.1025 / 0.1625))


def test_a_planned_motion_rejects_what_the_pose_alone_does_not(monkeypatch: pytest.MonkeyPatch) -> None:
    # A small search, enough for one cell beyond the pose's own 48 Ns backward.
    for name, value in {"NUM_SAMPLES": 48, "NUM_ELITES": 8, "MAX_ITERATIONS": 6, "NUM_CHECKS": 8}.items():
        monkeypatch.setattr(oracle, name, value)
    agent = load_agent("nominal")
    line = Scenario("mine", directions=("backward",), without_step=True).lines()[0]
    line = dataclasses.replace(line, protocol=dataclasses.replace(line.protocol, impulse_end=54.0))
    shares: list[float] = []
    found = largest_possible(agent, line, 9, lambda size, iteration, share: shares.append(share))
    assert shares
    assert found.size == 54.0
    trials = [line.trial(9, 9_000_000 + i, full_length=True) for i in range(8)]
    outcomes = oracle._run(agent, np.repeat(found.knots[None], 8, axis=0), trials, 0)
    assert sum(map(line.succeeded, outcomes)) == found.succeeded >= 4


def test_equal_trials_keep_outcomes_of_their_own() -> None:
    agent, trial = NominalAgent(usual_robot(), "bent"), dataclasses.replace(pushed(12.0, 0), horizon=2.0)
    knots = np.zeros((2, NUM_KNOTS, agent.robot.num_joints))
    knots[1, :, 3] = 0.3  # one knee bends, the other robot stands
    still, moved = oracle._run(agent, knots, [trial, trial], 1)
    assert moved.root_tilt > still.root_tilt


def test_a_search_goes_on_from_its_table_and_another_table_is_refused(tmp_path: Path) -> None:
    table = tmp_path / "oracle.csv"
    names = ("forward", "left", "backward", "right")
    with table.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(COLUMNS)
        for i, name in enumerate(names):
            writer.writerow(("nominal-bent", "root_push_no_step", name, 90 * i, 60 + 6 * i, "Ns", 12, 16))
    content = table.read_bytes()
    Oracle(directions=4, export=table, picture=tmp_path / "oracle.png").main()
    assert table.read_bytes() == content
    assert (tmp_path / "oracle.png").stat().st_size > 10_000
    table.write_text("a,b\n1,2\n")
    with pytest.raises(UserError, match="is not a table of the oracle: its columns must be agent, scenario"):
        Oracle(directions=4, export=table).main()
