"""The results table: nothing is run twice, nothing is lost, and a file that is something else is left alone."""

from __future__ import annotations

import csv
import os
import signal
import sqlite3
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pyarrow.parquet
import pytest
from conftest import an_outcome

from surefoot.agents.load import usual_robot
from surefoot.agents.nominal import NominalAgent
from surefoot.errors import UserError
from surefoot.evaluation.evaluate import find_thresholds
from surefoot.evaluation.results import Results
from surefoot.evaluation.results_export import read_measured, read_thresholds
from surefoot.evaluation.scenarios import Scenario
from surefoot.evaluation.setup import Measured
from surefoot.evaluation.suites import PAPER, ROBUSTNESS
from surefoot.evaluation.threshold_search import Threshold
from surefoot.evaluation.trial_json import trial_from_json, trial_to_json
from surefoot.evaluation.trials import Trial, run_list
from surefoot.physics.pushes import Drop, Push
from surefoot.robots.domain import DomainParameters
from surefoot.task.imperfections import Imperfections

TRIAL = Trial(Push("root", (0.0, -1.0, 0.0), 42.0), seed=3, full_length=False)
OUTCOME = an_outcome(
    seconds=3.4, foot_shift=0.0123, com_speed=float("nan"), quiet_steps=float("nan"), hip=True, steps=3,
    torque_peaks=(1.0, 2.5, 3.0, 4.0, 5.0, 1 / 3),
)  # fmt: skip
SHORT = Scenario("short", horizon=2.0, quiet_from=1.0)


# Trials and outcomes.


def test_an_outcome_comes_back_as_it_was(tmp_path: Path) -> None:
    path, policy = tmp_path / "r.sqlite", NominalAgent(usual_robot())
    with Results(path) as results:
        results.trials_of(policy).put(TRIAL, OUTCOME)
    with Results(path) as results:
        assert repr(results.trials_of(policy).get(TRIAL)) == repr(OUTCOME)


@pytest.mark.parametrize("scenario", [*PAPER, *ROBUSTNESS], ids=lambda scenario: scenario.name)
def test_every_scenarios_trials_come_back_from_json_as_they_were(scenario: Scenario) -> None:
    for line in scenario.lines():
        trials = [line.trial(7, seed, whole) for seed, whole in ((0, True), (5, False))] if scenario.search else []
        for trial in trials or line.fixed_trials():
            text = trial_to_json(trial)
            assert trial_from_json(text) == trial
            assert trial_to_json(trial_from_json(text)) == text


def test_only_what_is_unusual_is_written() -> None:
    assert trial_to_json(Trial()) == "{}"
    assert (
        trial_to_json(TRIAL)
        == '{"full_length": false, "push": {"direction": [0.0, -1.0, 0.0], "impulse": 42.0}, "seed": 3}'
    )
    odd = Trial(
        Push("torso", impulse=6.0, lever=0.0),
        preceding=Push(impulse=1.0),
        drop=Drop(0.0, roll=0.1),
        imperfections=Imperfections(latency=0.01),
        domain=DomainParameters(friction=0.5),
    )
    assert trial_from_json(trial_to_json(odd)) == odd


def test_no_two_trials_share_a_text() -> None:
    changes = (
        {"seed": 1}, {"full_length": False}, {"horizon": 9.0}, {"quiet_from": 0.0}, {"drop": Drop(0.0)},
        {"preceding": Push()},
        {"push": Push(lever=0.0)}, {"domain": DomainParameters(slope=0.1)},
        {"imperfections": Imperfections(sensor_bias=0.1)},
    )  # fmt: skip
    texts = {trial_to_json(trial) for trial in (Trial(), *(Trial(**change) for change in changes))}
    assert len(texts) == len(changes) + 1


def test_another_policys_trials_are_not_its_own(tmp_path: Path) -> None:
    with Results(tmp_path / "r.sqlite") as results:
        results.trials_of(NominalAgent(usual_robot(), "bent")).put(TRIAL, OUTCOME)
        assert results.trials_of(NominalAgent(usual_robot(), "straight")).get(TRIAL) is None


def test_a_row_is_enough_to_run_its_trial_again(tmp_path: Path) -> None:
    policy = NominalAgent(usual_robot())
    trial = Trial(Push("torso", (0.0, 1.0, 0.0), 300.0, lever=0.32), seed=7)
    outcome = run_list(policy, [trial], num_slots=1)[trial]
    with Results(tmp_path / "r.sqlite") as results:
        store = results.trials_of(policy)
        store.put(TRIAL, OUTCOME)
        store.put(trial, outcome, "torso_push")
        row = results.row(2)
        assert (row.policy_name, row.key.agent, row.scenario) == (policy.name, policy.digest, "torso_push")
        assert repr(run_list(policy, [row.trial], num_slots=1)[row.trial]) == repr(row.outcome) == repr(outcome)
        for missing in (0, 3, -1):
            with pytest.raises(UserError, match=rf"r\.sqlite has no row {missing}; valid: 1 to 2"):
                results.row(missing)


# Thresholds and scenarios.


def test_an_evaluation_that_is_done_runs_nothing_when_done_again(tmp_path: Path) -> None:
    policy, lines = NominalAgent(usual_robot(), "straight"), SHORT.lines()[2:3]
    trials_done = []
    for _ in range(2):
        with Results(tmp_path / "r.sqlite") as results:
            count = [0]

            def progress(done: int, num_lines: int, reached: list, count: list[int] = count) -> None:
                count[0] = done

            thresholds = find_thresholds(policy, lines, results.trials_of(policy), progress, num_slots=32)
            results.add_thresholds(policy, thresholds)
            trials_done.append(count[0])
            assert results.thresholds_of(policy.name) == thresholds
    assert trials_done[0] > 40
    assert trials_done[1] == 0


def a_threshold(scenario: Scenario, line: int, size: float, trials: int = 40) -> Threshold:
    return Threshold(scenario.lines()[line], size, trials, trials, 0.91, 1.0, "share")


def test_thresholds_of_every_unit_come_back_from_a_file_as_they_were(tmp_path: Path) -> None:
    policy = NominalAgent(usual_robot())
    tilt = Scenario("landing_tilt", search="tilt", drop=0.4, directions=("left", 30.0))
    late = Scenario("late", preceding_impulse=60.0, push_interval=(0.3, 2.0), friction=0.5, latency=0.02)
    kept = [a_threshold(tilt, 1, 5.0), a_threshold(tilt, 0, 3.0), a_threshold(late, 3, 0.0, trials=0)]
    with Results(tmp_path / "r.sqlite") as results:
        results.trials_of(policy)
        results.add_thresholds(policy, kept)
        assert results.thresholds_of(policy.name) == kept
        results.add_thresholds(policy, [a_threshold(tilt, 0, 4.0)])  # in place of the 3 degrees to the left
        assert [threshold.size for threshold in results.thresholds_of(policy.name)] == [5.0, 4.0, 0.0]
        results.export("thresholds", tmp_path / "t.csv")
        assert read_thresholds(tmp_path / "t.csv") == {policy.name: results.thresholds_of(policy.name)}


def test_of_several_tables_the_first_that_has_a_policy_counts(tmp_path: Path) -> None:
    straight, bent = NominalAgent(usual_robot(), "straight"), NominalAgent(usual_robot(), "bent")
    push = Scenario("root_push")
    for name, agents, size in (("a", [bent], 48.0), ("b", [bent, straight], 30.0)):
        with Results(tmp_path / f"{name}.sqlite") as results:
            for agent in agents:
                results.trials_of(agent)
                results.add_thresholds(agent, [a_threshold(push, 0, size)])
            results.export("thresholds", tmp_path / f"{name}.csv")
    found = read_measured([tmp_path / "a.csv", tmp_path / "b.csv"])
    assert {key: [t.size for t in thresholds] for key, thresholds in found.items()} == {
        Measured("nominal-bent", "valkyrie"): [48.0],
        Measured("nominal-straight", "valkyrie"): [30.0],
    }


def test_fixed_outcomes_are_those_of_the_scenarios_that_were_run(tmp_path: Path) -> None:
    policy = NominalAgent(usual_robot())
    quiet, other = (Scenario(name, search="", directions=2, trials=2) for name in ("quiet", "other"))
    other = replace(other, impulse=6.0)
    with Results(tmp_path / "r.sqlite") as results:
        store = results.trials_of(policy)
        for scenario in (quiet, other):
            for line in scenario.lines():
                for trial in line.fixed_trials():
                    store.put(trial, an_outcome(steps=trial.seed), scenario.name)
        results.add_scenarios(policy, [quiet, SHORT], 12.0)
        found = results.fixed_outcomes(policy.name)
    assert set(found) == {"quiet"}
    assert set(found["quiet"]) == {trial for line in quiet.lines() for trial in line.fixed_trials()}
    assert {outcome.steps for outcome in found["quiet"].values()} == {0, 1}


def test_a_policy_learned_anew_under_the_same_name_is_not_mixed_with_the_old_one(tmp_path: Path) -> None:
    old, new = NominalAgent(usual_robot(), "straight"), NominalAgent(usual_robot(), "bent")
    old.name = new.name
    assert old.digest != new.digest
    quiet, standing = (Scenario(name, search="", directions=1, trials=1) for name in ("quiet", "standing"))
    (trial,) = quiet.lines()[0].fixed_trials()
    with Results(tmp_path / "r.sqlite") as results:
        for policy, directions, drift in ((old, 4, 0.1), (new, 2, 0.2)):
            line = Scenario("root_push", directions=directions)
            results.trials_of(policy).put(trial, an_outcome(quiet_drift=drift))
            results.add_thresholds(policy, [a_threshold(line, i, 60.0 * directions) for i in range(directions)])
            results.add_scenarios(policy, [quiet, standing] if policy is old else [quiet], 1.0)
        assert [threshold.size for threshold in results.thresholds_of(new.name)] == [120.0, 120.0]
        fixed = results.fixed_outcomes(new.name)
        results.export("thresholds", tmp_path / "t.csv")
    assert {name: [outcome.quiet_drift for outcome in trials.values()] for name, trials in fixed.items()} == {
        "quiet": [0.2]
    }
    assert len(read_thresholds(tmp_path / "t.csv")[new.name]) == 2


def test_the_audit_is_the_largest_share_of_all_trials(tmp_path: Path) -> None:
    policy = NominalAgent(usual_robot())
    with Results(tmp_path / "r.sqlite") as results:
        store = results.trials_of(policy)
        store.put(Trial(seed=0), an_outcome(torque_ratio=0.4, speed_ratio=0.9))
        store.put(Trial(seed=1), an_outcome(torque_ratio=0.8, speed_ratio=0.1))
        results.trials_of(NominalAgent(usual_robot(), "straight")).put(
            Trial(), an_outcome(torque_ratio=1.0, speed_ratio=1.0)
        )
        assert results.audit(policy) == (0.8, 0.9)


# Killed, and taken up again.


@pytest.mark.slow
def test_a_killed_evaluation_loses_at_most_the_last_moment_and_goes_on(tmp_path: Path) -> None:
    """Kill the process with SIGKILL in the middle: what it had committed is there and is not run again."""
    path = tmp_path / "r.sqlite"
    script = (
        "from surefoot.agents.load import load_agent\n"
        "from surefoot.evaluation.evaluate import find_thresholds\n"
        "from surefoot.evaluation.results import Results\n"
        "from surefoot.evaluation.scenarios import Scenario\n"
        f"policy = load_agent('nominal'); results = Results({str(path)!r})\n"
        "lines = Scenario('short', horizon=2.0, quiet_from=1.0).lines()[2:3]\n"
        "find_thresholds(policy, lines, results.trials_of(policy), num_slots=8, num_threads=1)\n"
    )
    process = subprocess.Popen([sys.executable, "-c", script])
    try:
        deadline = time.monotonic() + 120.0
        while time.monotonic() < deadline and _num_trials(path) < 10 and process.poll() is None:
            time.sleep(0.02)
    finally:
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
    before = _num_trials(path)
    assert before >= 10
    policy, done = NominalAgent(usual_robot()), []
    with Results(path) as results:
        store = results.trials_of(policy)
        find_thresholds(policy, SHORT.lines()[2:3], store, lambda *_: done.append(1), num_slots=32)
    # Every trial that was run now is a new row: none was there before.
    assert _num_trials(path) == before + len(done)
    assert len(done) > 0


# Files.


def test_tables_are_exported_to_csv_and_parquet(tmp_path: Path) -> None:
    policy = NominalAgent(usual_robot())
    trials = [Trial(Push(impulse=impulse), seed=0, full_length=False) for impulse in (0.0, 6.0)]
    outcomes = run_list(policy, trials, num_slots=2)
    with Results(tmp_path / "r.sqlite") as results:
        store = results.trials_of(policy)
        for trial, outcome in outcomes.items():
            store.put(trial, outcome, "gentle")
        results.export("trials", tmp_path / "t.csv")
        results.export("trials", tmp_path / "t.parquet")
        with pytest.raises(UserError, match=r"unknown format '\.xls' of .*; valid: \.csv, \.parquet"):
            results.export("trials", tmp_path / "t.xls")
        with pytest.raises(UserError, match="unknown table 'x'; valid: policies, trials, thresholds, scenarios"):
            results.export("x", tmp_path / "t.csv")
    with (tmp_path / "t.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert sorted(float(row["impulse_Ns"]) for row in rows) == [0.0, 6.0]
    assert {(row["scenario"], row["body"], row["angle_deg"]) for row in rows} == {("gentle", "root", "0")}
    table = pyarrow.parquet.read_table(tmp_path / "t.parquet")
    assert table.column("seconds").to_pylist() == [float(row["seconds"]) for row in rows]


def test_a_lift_has_no_angle(tmp_path: Path) -> None:
    with Results(tmp_path / "r.sqlite") as results:
        results.trials_of(NominalAgent(usual_robot())).put(
            Trial(Push(direction=(0.0, 0.0, 1.0), impulse=50.0)), OUTCOME
        )
    with sqlite3.connect(tmp_path / "r.sqlite") as db:
        assert db.execute("SELECT angle_deg FROM trials").fetchall() == [(None,)]


@pytest.mark.parametrize("content", [b"not a database, but long enough to be read as one" * 30, b"\0" * 4096])
def test_a_file_that_is_no_results_table_is_refused_and_kept(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "r.sqlite"
    path.write_bytes(content)
    with pytest.raises(UserError, match="as a results table"):
        Results(path)
    assert path.read_bytes() == content


@pytest.mark.parametrize("version", [0, 1, 99])
def test_a_table_of_another_version_is_refused_and_kept(tmp_path: Path, version: int) -> None:
    path = tmp_path / "r.sqlite"
    with sqlite3.connect(path) as db:
        db.execute("CREATE TABLE trials (id INTEGER PRIMARY KEY, impulse_Ns REAL)")
        db.execute("INSERT INTO trials VALUES (1, 42.0)")
        db.execute(f"PRAGMA user_version = {version}")
    db.close()
    content = path.read_bytes()
    with pytest.raises(UserError, match=rf"is a results table of version {version}, not 4; give another file"):
        Results(path)
    assert path.read_bytes() == content


@pytest.mark.parametrize("share", [0.01, 0.3, 0.7, 0.99])
def test_a_truncated_table_is_refused_and_kept(tmp_path: Path, share: float) -> None:
    path = tmp_path / "r.sqlite"
    with Results(path) as results:
        store = results.trials_of(NominalAgent(usual_robot()))
        for seed in range(200):
            store.put(Trial(seed=seed), OUTCOME)
    content = path.read_bytes()[: int(share * path.stat().st_size)]
    path.write_bytes(content)
    with pytest.raises(UserError, match="as a results table"), Results(path) as results:
        results.trials_of(NominalAgent(usual_robot()))
    assert path.read_bytes() == content


@pytest.mark.parametrize("text", ["", "name,size\nx,1\n", "name,definition,direction,angle_rad,size\nx,{,a,0,1\n"])
def test_a_csv_that_holds_no_thresholds_is_refused_or_empty(tmp_path: Path, text: str) -> None:
    (tmp_path / "t.csv").write_text(text)
    if not text:
        assert read_thresholds(tmp_path / "t.csv") == {}
        return
    with pytest.raises(UserError, match="is not a table of thresholds"):
        read_thresholds(tmp_path / "t.csv")


def _num_trials(path: Path) -> int:
    if not path.exists():
        return 0
    try:
        with sqlite3.connect(path) as db:
            return db.execute("SELECT count(*) FROM trials").fetchone()[0]
    except sqlite3.OperationalError:
        return 0
