"""Controllers by their names: files that hold none, digests, and the example."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest
from conftest import pushed

from surefoot.agents.controllers import load_controller, shipped_controllers
from surefoot.agents.controllers.step_times import StepTimes, Timing
from surefoot.agents.load import load_agent
from surefoot.errors import UserError
from surefoot.evaluation.replay import differences, find_policy, replay
from surefoot.evaluation.results import Results
from surefoot.evaluation.trials import Trial, run_list
from surefoot.physics.pushes import Drop
from surefoot.report.timing_table import timing_metrics, timing_table
from surefoot.robots import Robot

ROOT = Path(__file__).parent.parent


@pytest.mark.parametrize(
    ("name", "message"),
    [
        (
            "controllers/unknown",
            "unknown controller 'controllers/unknown'; valid: controllers/stand, controllers/ankle",
        ),
        ("nowhere.py:Mine", "cannot read controller nowhere.py: No such file or directory"),
    ],
)
def test_an_unknown_controller_is_refused(name: str, message: str) -> None:
    with pytest.raises(UserError) as error:
        load_agent(name)
    assert str(error.value).startswith(message)


MADE = "class Mine:\n def __init__(self, robot, num_robots): pass\n"


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("import nothing_of_the_kind", "cannot import {}: ModuleNotFoundError: No module named 'nothing_of_the_kind'"),
        ("class Other: rate_hz = 100", "{} has no class 'Mine'"),
        (MADE + " rate_hz = 60", "{}:Mine must have a rate_hz of 25, 50, 100, 125, 250, 500, not 60"),
        (MADE, "{}:Mine must have a rate_hz of 25, 50, 100, 125, 250, 500, not None"),
        (MADE + " rate_hz = 50\n path = 'zigzag'", "{}:Mine's path must be cubic or line or hold, not zigzag"),
        ("class Mine: rate_hz = 50", "{}:Mine cannot be made for valkyrie: TypeError: Mine() takes no arguments"),
        (MADE + " rate_hz = 50\n pose = 'seated'", "unknown pose 'seated' of valkyrie; valid: straight, bent"),
        (
            MADE + " rate_hz = 50\n pose = [0.0, 0.1]",
            "{}:Mine's pose must be 11 finite angles, one for each joint of valkyrie, or the name of a pose: straight, "
            "bent",
        ),
        (
            MADE + " rate_hz = 50\n stiffness = [20.0] * 12",
            "{}:Mine's stiffness must be 11 numbers, one for each joint of valkyrie, not (12,)",
        ),
        (MADE + " rate_hz = 50\n stiffness = [0.0] * 11", "{}:Mine's stiffness of torso_pitch must be positive, not 0"),
        (
            MADE + " rate_hz = 50\n damping = [1.0] * 10 + [-1.0]",
            "{}:Mine's damping of right_ankle_roll must be zero or more, not -1",
        ),
    ],
)
def test_a_file_that_holds_no_controller_is_refused(tmp_path: Path, code: str, message: str) -> None:
    file = tmp_path / "mine.py"
    file.write_text(code)
    with pytest.raises(UserError) as error:
        load_agent(f"{file}:Mine")
    assert str(error.value) == message.format(file)


def test_controllers_have_names_contracts_and_digests_of_their_own(robot: Robot) -> None:
    found = [load_controller(name, robot) for name in shipped_controllers()]
    assert len({entrant.digest for entrant in found}) == len(found) == 7
    for entrant in found:
        assert entrant.contract.nominal_pose == tuple(robot.pose("bent"))
        assert entrant.contract.training == {"controller": entrant.name}
        assert entrant.contract.policy_hz == entrant.rate_hz


def test_the_example_holds_pushes_that_the_pose_alone_does_not() -> None:
    file = ROOT / "examples" / "capture_point.py"
    lines = [line for line in file.read_text().splitlines() if line.strip()]
    assert len(lines) < 50
    trials = [pushed(60.0, seed, full_length=False) for seed in range(4)]
    mine = run_list(load_agent(f"{file}:CapturePoint"), trials, num_slots=4, num_threads=1)
    pose = run_list(load_agent("controllers/stand"), trials, num_slots=4, num_threads=1)
    assert all(outcome.recovered for outcome in mine.values())
    assert not all(outcome.recovered for outcome in pose.values())


def test_a_controllers_trial_is_replayed_bit_for_bit_alone(tmp_path: Path) -> None:
    entrant = load_agent("controllers/ankle")
    trials = [dataclasses.replace(pushed(48.0, 0, full_length=False)), Trial(seed=1, drop=Drop(0.2), full_length=False)]
    outcomes = run_list(entrant, trials, num_slots=2, num_threads=1)
    with Results(tmp_path / "r.sqlite") as results:
        store = results.trials_of(entrant)
        for trial in trials:
            store.put(trial, outcomes[trial], "test")
        for row_id in (1, 2):
            row = results.row(row_id)
            again = replay(row, find_policy(row.policy_name, row.key.agent))
            assert differences(row.outcome, again) == []


def test_times_per_control_step_are_kept_shown_and_given_to_machines(tmp_path: Path) -> None:
    timing = Timing(250, 1000, 3, 8.4e-05, 0.0021, 2760, 12, 0.0009, 0.0044, "2 x not finite")
    entrant = load_agent("controllers/stand")
    with Results(tmp_path / "r.sqlite") as results:
        assert results.timing(results.key_of(entrant)) is None
        results.add_timing(entrant, timing)
        assert results.timing(results.key_of(entrant)) == timing
    (row,) = timing_table({"mine": timing}).rows
    assert list(row) == ["mine", "250", "84", "2100", "3 of 1000", "900", "4400", "12 of 2760", "2 x not finite"]
    documented = (ROOT / "docs" / "figures.md").read_text()
    figures = timing_metrics(timing)
    assert (figures["control.step_us_median"], figures["control.alone_us_p99"]) == (84.0, 4400.0)
    assert all(f"`{key}`" in documented for key in figures)


def test_quantiles_count_robots_and_deadlines_their_rate() -> None:
    times = StepTimes(100)
    times.add(0.3, 100)  # 3 ms each
    times.add(0.02, 1)  # 20 ms
    times.add(0.01, 99)  # 0.1 ms each
    assert (times.num_steps, times.num_missed) == (200, 1)
    # In order: 99 x 0.1, 100 x 3, 1 x 20 ms; the 100th is the first of the slower ones.
    assert times.quantile(0.5) == pytest.approx(0.003)
    assert times.quantile(0.99) == pytest.approx(0.003)
    assert times.quantile(1.0) == pytest.approx(0.02)
