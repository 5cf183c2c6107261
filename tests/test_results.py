"""The results table: nothing is run twice, nothing is lost, and a file that is something else is left alone."""

import csv
import os
import signal
import sqlite3
import subprocess
import sys
import time
from pathlib import Path

import pyarrow.parquet
import pytest

from surefoot.disturbance import Push
from surefoot.errors import UserError
from surefoot.evaluation import find_thresholds, push_lines
from surefoot.policy import NominalPolicy
from surefoot.results import Results
from surefoot.trials import Outcome, Trial, run_list

TRIAL = Trial(Push("pelvis", (0.0, -1.0, 0.0), 42.0), seed=3, whole=False)
OUTCOME = Outcome(True, "recovered", 3.4, 0.0123, float("nan"), 0.5, 0.25)


def test_an_outcome_comes_back_as_it_was(tmp_path: Path) -> None:
    path, policy = tmp_path / "r.sqlite", NominalPolicy()
    with Results(path) as results:
        results.trials_of(policy).put(TRIAL, OUTCOME)
    with Results(path) as results:
        assert repr(results.trials_of(policy).get(TRIAL)) == repr(OUTCOME)


def test_another_policys_trials_are_not_its_own(tmp_path: Path) -> None:
    with Results(tmp_path / "r.sqlite") as results:
        results.trials_of(NominalPolicy(pose="bent")).put(TRIAL, OUTCOME)
        assert results.trials_of(NominalPolicy(pose="straight")).get(TRIAL) is None


def test_an_evaluation_that_is_done_runs_nothing_when_done_again(tmp_path: Path) -> None:
    policy, lines = NominalPolicy(pose="straight"), push_lines()[2:3]
    trials_done = []
    for _ in range(2):
        with Results(tmp_path / "r.sqlite") as results:
            count = [0]

            def progress(done: int, reached: list[float], count: list[int] = count) -> None:
                count[0] = done

            thresholds = find_thresholds(policy, lines, results.trials_of(policy), progress)
            results.add_thresholds(policy, thresholds)
            trials_done.append(count[0])
            assert results.thresholds_of(policy.name) == thresholds
    assert trials_done[0] > 40
    assert trials_done[1] == 0


def test_a_killed_evaluation_loses_at_most_the_last_moment(tmp_path: Path) -> None:
    """Kill the process with SIGKILL in the middle; what it had committed is there and the file is sound."""
    path = tmp_path / "r.sqlite"
    script = (
        "from surefoot.evaluation import *; from surefoot.results import *; from surefoot.policy import *\n"
        f"policy = NominalPolicy(); results = Results({str(path)!r})\n"
        "find_thresholds(policy, push_lines(), results.trials_of(policy))\n"
    )
    process = subprocess.Popen([sys.executable, "-c", script])
    try:
        deadline = time.monotonic() + 60.0
        while time.monotonic() < deadline and _num_trials(path) < 20:
            time.sleep(0.1)
    finally:
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
    before = _num_trials(path)
    assert before >= 20
    with Results(path) as results:
        results.trials_of(NominalPolicy())
    assert _num_trials(path) == before


def test_tables_are_exported_to_csv_and_parquet(tmp_path: Path) -> None:
    policy = NominalPolicy()
    trials = [Trial(Push(impulse=impulse), seed=0, whole=False) for impulse in (0.0, 6.0)]
    outcomes = run_list(policy, trials, num_slots=2)
    with Results(tmp_path / "r.sqlite") as results:
        store = results.trials_of(policy)
        for trial, outcome in outcomes.items():
            store.put(trial, outcome)
        results.export("trials", tmp_path / "t.csv")
        results.export("trials", tmp_path / "t.parquet")
        with pytest.raises(UserError, match=r"unknown format '\.xls' of .*; valid: \.csv, \.parquet"):
            results.export("trials", tmp_path / "t.xls")
        with pytest.raises(UserError, match="unknown table 'x'; valid: policies, trials, thresholds"):
            results.export("x", tmp_path / "t.csv")
    with (tmp_path / "t.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert sorted(float(row["impulse_Ns"]) for row in rows) == [0.0, 6.0]
    table = pyarrow.parquet.read_table(tmp_path / "t.parquet")
    assert table.column("seconds").to_pylist() == [float(row["seconds"]) for row in rows]


@pytest.mark.parametrize("content", [b"not a database, but long enough to be read as one" * 30, b"\0" * 4096])
def test_a_file_that_is_no_results_table_is_refused_and_kept(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "r.sqlite"
    path.write_bytes(content)
    with pytest.raises(UserError, match="as a results table"):
        Results(path)
    assert path.read_bytes() == content


def test_a_table_of_another_version_is_refused_and_kept(tmp_path: Path) -> None:
    path = tmp_path / "r.sqlite"
    with sqlite3.connect(path) as db:
        db.execute("CREATE TABLE trials (x)")
        db.execute("PRAGMA user_version = 99")
    with pytest.raises(UserError, match=r"is a results table of version 99, not 1; give another file"):
        Results(path)
    assert sqlite3.connect(path).execute("PRAGMA user_version").fetchone() == (99,)


def _num_trials(path: Path) -> int:
    if not path.exists():
        return 0
    try:
        with sqlite3.connect(path) as db:
            return db.execute("SELECT count(*) FROM trials").fetchone()[0]
    except sqlite3.OperationalError:
        return 0
