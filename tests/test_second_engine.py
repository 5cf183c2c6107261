"""Results of two engines in one table: neither hides the other, and each goes on where it was."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from conftest import an_outcome

from surefoot.agents.load import usual_robot
from surefoot.agents.nominal import NominalAgent
from surefoot.errors import UserError
from surefoot.evaluation.evaluate import evaluate_and_store
from surefoot.evaluation.replay import replay as run_again
from surefoot.evaluation.results import Results
from surefoot.evaluation.results_export import read_thresholds
from surefoot.evaluation.scenarios import Line, Scenario
from surefoot.evaluation.setup import Measured, Setup
from surefoot.evaluation.threshold_search import Threshold
from surefoot.physics.engines import ENGINES
from surefoot.report.engine_table import engine_table, kept_table
from surefoot.report.evaluations import read_evaluations

POLICY = NominalAgent(usual_robot())
DROP = Scenario("low_drop", search="", drop=0.02, directions=("forward",), trials=2, horizon=2.0, quiet_from=1.0)


def threshold(size: float) -> Threshold:
    (line,) = Scenario("root_push", directions=("forward",)).lines()
    return Threshold(line, size, 40, 40, 0.91, 1.0, "search")


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One scenario in both engines, MuJoCo first, and a threshold of each."""
    path = tmp_path_factory.mktemp("engines") / "results.sqlite"
    for engine, size in (("mujoco", 60.0), ("pybullet", 54.0)):
        with Results(path, engine) as results:
            evaluate_and_store(POLICY, [DROP], results)
            results.add_thresholds(POLICY, [threshold(size)])
    return path


def test_each_engine_has_rows_of_its_own(table: Path) -> None:
    for engine, size in (("mujoco", 60.0), ("pybullet", 54.0)):
        with Results(table, engine) as results:
            assert [t.size for t in results.thresholds_of(POLICY.name)] == [size]
            outcomes = results.fixed_outcomes(POLICY.name)["low_drop"]
            assert [o.reason for o in outcomes.values()] == ["recovered"] * 2
            assert results.key_of(POLICY).setup.engine == ENGINES[engine].title()
            assert {t.size for t in results.thresholds_of(POLICY.name, "mujoco")} == {60.0}


def test_what_one_engine_knows_is_not_taken_for_the_others(table: Path) -> None:
    peaks = []
    for engine in ENGINES:
        with Results(table, engine) as results:
            peaks.append([o.speed_ratio for o in results.fixed_outcomes(POLICY.name)["low_drop"].values()])
    assert set(peaks[0]).isdisjoint(peaks[1])
    assert peaks[0] == pytest.approx(peaks[1], rel=0.5)


def test_a_second_evaluation_runs_nothing_again(table: Path) -> None:
    done: list[int] = []
    with Results(table, "pybullet") as results:
        evaluate_and_store(POLICY, [DROP], results, lambda trials, lines, reached: done.append(trials))
    assert done == []


def test_a_trial_in_the_other_engine_is_replayed_bit_for_bit(table: Path) -> None:
    with Results(table) as results:
        rows = [results.row(number) for number in range(1, 5)]
    assert [row.key.setup.engine_word for row in rows] == ["mujoco"] * 2 + ["pybullet"] * 2
    assert run_again(rows[3], POLICY) == rows[3].outcome


def test_a_report_and_an_export_name_the_engine_behind_the_policy(table: Path, tmp_path: Path) -> None:
    sizes = {POLICY.name: 60.0, f"{POLICY.name} in pybullet": 54.0}
    assert {e.name: e.thresholds[0].size for e in read_evaluations([table])} == sizes
    with Results(table) as results:
        results.export("thresholds", tmp_path / "thresholds.csv")
    found = read_thresholds(tmp_path / "thresholds.csv")
    assert {name: t.size for name, (t,) in found.items()} == sizes


def test_the_report_says_what_the_other_engine_keeps(table: Path) -> None:
    first, second = read_evaluations([table])
    found = engine_table([first, second])
    name = f"{POLICY.name} in pybullet"
    # 54 of 60 Ns are 0.90; both low drops recover in both engines, and Wilson's interval of 2 of 2 begins at 0.34.
    assert found.rows == [
        [name, "pelvis push, forward", "60", "54", "0.90", "", "", "", ""],
        [name, "low drop", "", "", "", "2/2", "0", "0", "0.34 to 1.00"],
        [name, "every trial in both", "", "", "", "2/2", "0", "0", "0.34 to 1.00"],
    ]
    assert "less than" not in found.note
    assert engine_table([second]).rows == engine_table([first]).rows == []


def test_what_is_kept_at_a_threshold_is_told_from_the_same_trials(table: Path) -> None:
    first, second = read_evaluations([table])
    ours, theirs = threshold(60.0), threshold(42.0)
    trials = [ours.line.trial(10, seed, full_length=True) for seed in range(4)]
    outcomes = [an_outcome(recovered=good) for good in (True, True, False, False)]
    others = [an_outcome(recovered=good) for good in (True, False, True, False)]
    first = replace(first, thresholds=[ours], fixed={}, outcomes=dict(zip(trials, outcomes, strict=True)))
    second = replace(second, thresholds=[theirs], outcomes=dict(zip(trials, others, strict=True)))
    found = engine_table([first, second])
    # Of four trials one recovers in both: the Wilson interval of 1 of 4 is 0.05 to 0.70.
    counts = ["1/4", "1", "1", "0.05 to 0.70"]
    assert [row[2:] for row in found.rows] == [["60", "42", "0.70", *counts], ["", "", "", *counts]]
    assert found.note.endswith(f"Kept to less than 0.8: {POLICY.name} in pybullet, pelvis push, forward (0.70).")


def test_a_table_of_exported_thresholds_says_what_is_kept_in_each_direction() -> None:
    left = Line(threshold(60.0).line.scenario, "left", 1.57)
    no_left = replace(threshold(0.0), line=left)
    policies = {
        Measured("a", "valkyrie"): [threshold(60.0), no_left],
        Measured("a", "valkyrie", "pybullet"): [threshold(48.0), replace(no_left, size=6.0)],
        Measured("b", "valkyrie", "pybullet"): [threshold(48.0)],
        Measured("a", "g1", "pybullet"): [threshold(48.0)],
    }
    found = kept_table(policies)
    assert found.columns == ["policy", "engine", "joint speeds", "forward", "left"]
    # 48 of 60 Ns are 0.80; nothing has a ratio to 0 Ns; what only one engine has is no row.
    assert found.rows == [["a", "pybullet", "any", "48 / 60 = 0.80", "6 / 0"]]


def test_rows_of_before_there_were_engines_count_as_mujocos() -> None:
    assert Setup(0, "valkyrie", "setup abc", "unknown").engine_word == "mujoco"
    assert Setup(2, "valkyrie", "abc", "pybullet 3.2.6").shown("ddpg") == "ddpg in pybullet"
    assert Setup(2, "valkyrie", "abc", "mujoco 4.0.0").shown("ddpg") == "ddpg"


def test_an_engine_that_is_not_there_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("surefoot.physics.pybullet_engine.importlib.util.find_spec", lambda name: None)
    with pytest.raises(UserError, match=r"^engine pybullet: this needs pybullet: pip install 'surefoot\[pybullet\]'$"):
        Setup.now("valkyrie", "pybullet")


def test_the_command_takes_the_engine_and_refuses_an_unknown_one(tmp_path: Path) -> None:
    suite = tmp_path / "low.toml"
    keys = ('name = "low_drop"', 'search = ""', "drop = 0.02", 'directions = ["forward"]', "trials = 2")
    suite.write_text("\n".join(["[[scenario]]", *keys, "horizon = 2.0", "quiet_from = 1.0"]))
    command = [sys.executable, "-m", "surefoot", "evaluate", "nominal", "--suite", str(suite)]
    done = subprocess.run(
        [*command, "--engine", "pybullet", "--json", "-"], capture_output=True, text=True, cwd=tmp_path, timeout=120
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("{")
    with Results(tmp_path / "results.sqlite", "pybullet") as results:
        assert results.finished_scenarios(POLICY) == {"low_drop"}
    refused = subprocess.run(
        [*command, "--engine", "bullet"], capture_output=True, text=True, cwd=tmp_path, timeout=120
    )
    assert refused.returncode == 2
    assert refused.stderr.startswith("surefoot: unknown engine 'bullet'; valid: mujoco, pybullet")
