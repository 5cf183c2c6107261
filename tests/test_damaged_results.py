"""Damaged results tables and tables of thresholds: refused in one line when they are opened, and left as they are."""

from __future__ import annotations

import contextlib
import csv
import io
import os
import sqlite3
import threading
import time
from pathlib import Path

import pytest
from conftest import an_outcome

from surefoot.agents.load import usual_robot
from surefoot.agents.nominal import NominalAgent
from surefoot.errors import UserError
from surefoot.evaluation.results import Results
from surefoot.evaluation.results_export import read_thresholds
from surefoot.evaluation.scenarios import Scenario
from surefoot.evaluation.threshold_search import Threshold
from surefoot.evaluation.trial_store import TrialStore
from surefoot.evaluation.trials import Trial
from surefoot.physics.pushes import Push
from surefoot.report.evaluations import read_evaluations

SCENARIO = Scenario("root_push")


@pytest.fixture
def table(tmp_path: Path) -> Path:
    """One trial, one threshold and one finished scenario of the nominal pose."""
    path, agent = tmp_path / "r.sqlite", NominalAgent(usual_robot())
    with Results(path) as results:
        results.trials_of(agent).put(Trial(Push(impulse=42.0)), an_outcome(), "root_push")
        results.add_thresholds(agent, [Threshold(line, 42.0, 40, 39, 0.9, 1.0, "share") for line in SCENARIO.lines()])
        results.add_scenarios(agent, [SCENARIO], 1.0)
    return path


def damage(path: Path, *statements: str) -> bytes:
    with contextlib.closing(sqlite3.connect(path)) as db:
        for statement in statements:
            db.execute(statement)
        db.commit()
    return path.read_bytes()


@pytest.mark.parametrize(
    ("statement", "message"),
    [
        # What runs by itself.
        (
            "CREATE VIEW v AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i FROM n) SELECT i FROM n",
            "it has a view 'v' of its own",
        ),
        ("CREATE TRIGGER t AFTER INSERT ON trials BEGIN DELETE FROM policies; END", "it has a trigger 't' of its own"),
        ("CREATE INDEX i ON trials (abs(seed))", "it has a index 'i' of its own"),
        ("CREATE TABLE more (a)", "its table 'more' has not the columns it needs"),
        ("ALTER TABLE trials ADD COLUMN more TEXT", "its table 'trials' has not the columns it needs"),
        ("ALTER TABLE trials RENAME COLUMN seed TO sown", "its table 'trials' has not the columns it needs"),
        ("DROP TABLE scenarios", "its table 'scenarios' has not the columns it needs"),
        # Values of other types and sizes.
        ("UPDATE trials SET seed = 'x'", "row 1 of 'trials' has a value of a wrong type"),
        ("UPDATE trials SET torque_ratio = x'00'", "row 1 of 'trials' has a value of a wrong type"),
        ("UPDATE policies SET name = zeroblob(10)", "row 1 of 'policies' has a value of a wrong type"),
        ("UPDATE policies SET name = printf('%.*c', 200000, 'x')", "row 1 of 'policies' has a value of a wrong type"),
        ("UPDATE thresholds SET size = 'large'", "row 1 of 'thresholds' has a value of a wrong type"),
    ],
)
def test_what_is_no_table_of_ours_is_refused_when_it_is_opened(statement: str, message: str, table: Path) -> None:
    content = damage(table, statement)
    with pytest.raises(UserError, match=message):
        Results(table)
    assert table.read_bytes() == content


@pytest.mark.parametrize(
    ("statement", "message"),
    [
        ("UPDATE trials SET torque_peaks = '{'", "cannot read a list of numbers: it is not valid JSON"),
        ("UPDATE trials SET torque_peaks = '[\"x\"]'", "a list of numbers is needed, not"),
        ("UPDATE trials SET torque_peaks = printf('%.*c', 90000, '[')", "nested too deeply"),
        ("UPDATE trials SET trial = '[]'", "a trial must be a JSON object"),
        ("UPDATE trials SET trial = '{\"push\": 3}'", "a trial's push must be a table, not 3"),
        ('UPDATE trials SET trial = \'{"push": {"impulse": 1e999}}\'', "a trial's push: impulse must be a number"),
        ("UPDATE trials SET trial = '{\"seed\": -1}'", "a trial's seed must be a number from 0 to"),
        ("UPDATE trials SET trial = '{\"horizon\": 1e9}'", "a trial's horizon must be a number above 0 up to 3600"),
        ("UPDATE thresholds SET trials = 1000000000000000000", "trials must be a number from 0 to 10000, not 10"),
        ("UPDATE thresholds SET recovered = 41", "recovered must be a number from 0 to 40, not 41"),
        ("UPDATE thresholds SET size = 9e999", "size must be a number from 0 to 100000, not inf"),
        ("UPDATE thresholds SET definition = '3'", "a scenario must be a JSON object, not 3"),
        (
            'UPDATE thresholds SET definition = \'{"name": "a", "search": "", "trials": 1000000000000000000}\'',
            r"a scenario \(a\): trials must be a whole number from 1 to 10000",
        ),
        (
            'UPDATE scenarios SET definition = \'{"name": "a", "search": "", "trials": 9999, "directions": 360}\'',
            "3,599,640 trials are too many; valid: up to 100,000",
        ),
        ("UPDATE policies SET contract = '{\"robot\": 3}'", "r.sqlite has a row that cannot be read"),
    ],
)
def test_a_row_that_cannot_be_read_is_named_with_its_file(statement: str, message: str, table: Path) -> None:
    damage(table, statement)
    with pytest.raises(UserError, match=message) as error:
        read_evaluations([table])
    assert str(table) in str(error.value)
    assert "\n" not in str(error.value)


def test_a_name_that_is_not_utf_8_is_read_with_signs_in_place_of_its_damaged_bytes(table: Path) -> None:
    damage(table, "UPDATE policies SET name = CAST(x'61ff62' AS TEXT)")
    assert [evaluation.name for evaluation in read_evaluations([table])] == ["a\ufffdb"]


def test_pipes_and_folders_are_no_results_tables(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for name in ("pipe", "."):
        with pytest.raises(UserError, match="it is no regular file"):
            Results(tmp_path / name)


def test_a_trial_is_safe_half_a_second_after_it_came_even_if_no_other_comes(tmp_path: Path) -> None:
    path, agent = tmp_path / "r.sqlite", NominalAgent(usual_robot())
    results = Results(path)
    results.trials_of(agent).put(Trial(seed=1), an_outcome())
    deadline = time.monotonic() + 0.5
    while (found := _num_trials(path)) == 0 and time.monotonic() < deadline:
        time.sleep(0.02)
    assert found == 1  # as another process sees it: what a kill would leave
    results.close()


def test_outcomes_are_safe_even_if_the_thread_that_commits_gets_no_turn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(threading.Timer, "start", lambda timer: None)
    path, agent, came = tmp_path / "r.sqlite", NominalAgent(usual_robot()), list[float]()
    results = Results(path)
    store = results.trials_of(agent)
    while len(came) < 12 or came[-1] - came[0] < 0.6:
        came.append(time.monotonic())
        store.put(Trial(seed=len(came)), an_outcome())
        assert _num_trials(path) >= sum(at < time.monotonic() - 0.5 for at in came)
        time.sleep(0.05)
    results.close()


def test_a_full_disk_ends_an_evaluation_in_one_line(tmp_path: Path) -> None:
    path, agent = tmp_path / "r.sqlite", NominalAgent(usual_robot())
    with Results(path) as results:
        store = results.trials_of(agent)
        pages = results._db.execute("PRAGMA page_count").fetchone()[0]
        results._db.execute(f"PRAGMA max_page_count = {pages}")  # SQLite then says what it says of a full disk
        with pytest.raises(UserError, match=r"cannot write .*r\.sqlite: database or disk is full; all until then"):
            put_many(store)


def put_many(store: TrialStore) -> None:
    for seed in range(1000):
        store.put(Trial(seed=seed), an_outcome())


def _num_trials(path: Path) -> int:
    with contextlib.closing(sqlite3.connect(path)) as db:
        return db.execute("SELECT count(*) FROM trials").fetchone()[0]


@pytest.fixture
def exported(table: Path, tmp_path: Path) -> list[dict[str, str]]:
    with Results(table) as results:
        results.export("thresholds", tmp_path / "t.csv")
    with (tmp_path / "t.csv").open(newline="") as stream:
        return list(csv.DictReader(stream))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"size": "inf"}, "size must be a number from 0 to 100000, not inf"),
        ({"size": "-6"}, "size must be a number from 0 to 100000, not -6"),
        ({"trials": "1" + "0" * 18}, "trials must be a number from 0 to 10000"),
        ({"trials": "9" * 5000}, "is not a table of thresholds"),
        ({"protocol": "1e5"}, "is not a table of thresholds"),
        ({"definition": "[" * 20_000}, "nested too deeply"),
        ({"definition": '{"name": "a", "horizon": "x"}'}, "horizon must be a number from 2 to 600, not x"),
        ({"angle_rad": "nan"}, "angle_rad must be a number from -10 to 10, not nan"),
        ({"name": "x" * 200_000}, "is not a table of thresholds: field larger than field limit"),
        ({"name": "a\0b"}, "is not a table of thresholds"),
    ],
)
def test_a_table_of_thresholds_with_a_wrong_value_is_refused(
    change: dict[str, str], message: str, exported: list[dict[str, str]], tmp_path: Path
) -> None:
    text = io.StringIO()
    writer = csv.DictWriter(text, list(exported[0]))
    writer.writeheader()
    writer.writerows([exported[0] | change, *exported[1:]])
    (tmp_path / "mine.csv").write_text(text.getvalue())
    with pytest.raises(UserError, match=message):
        read_thresholds(tmp_path / "mine.csv")
