"""Results of older schemas: shown and reported, gone on with where that is fair."""

from __future__ import annotations

import sqlite3
from dataclasses import replace
from pathlib import Path

import pytest
from conftest import an_outcome, pushed

from surefoot.agents.load import usual_robot
from surefoot.agents.nominal import NominalAgent
from surefoot.errors import UserError
from surefoot.evaluation.replay import check_setup, differences
from surefoot.evaluation.results import Results, open_results
from surefoot.evaluation.results_export import read_threshold_rows, read_thresholds
from surefoot.evaluation.scenarios import Scenario
from surefoot.evaluation.setup import UNKNOWN_PROTOCOL, Setup
from surefoot.physics.pushes import Push
from surefoot.report.evaluations import read_evaluations

DATA = Path(__file__).parent / "data"
LAST_SETUP = "b99561abda483af3922a0c9f21feedc8b53ae3b84ad46d4ec0da364259513f77"
"""Digest of the last setup of schema 2."""


def old_table(folder: Path, setup: str = LAST_SETUP) -> Path:
    """A table that the last code of schema 2 wrote: three scenarios of the nominal pose, seven trials."""
    path = folder / "old.sqlite"
    with sqlite3.connect(path) as db:
        db.executescript((DATA / "schema2.sql").read_text().replace(LAST_SETUP, setup))
    db.close()
    return path


def test_the_old_file_is_left_as_it_is_and_its_copy_is_named_and_used(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = old_table(tmp_path)
    content = path.read_bytes()
    for _ in range(2):
        with open_results(path) as results:
            assert results.path == tmp_path / "old-schema4.sqlite"
            assert len(results.outcomes(results.row(1).key)._known) == 7
        line = f"surefoot: {path} is a results table of version 2; its copy in version 4 is used: {results.path}\n"
        assert capsys.readouterr().err == line
    assert path.read_bytes() == content
    assert sorted(file.name for file in tmp_path.iterdir()) == ["old-schema4.sqlite", "old.sqlite"]


def test_where_no_file_can_be_written_the_copy_is_in_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(old: Path, new: Path) -> None:
        raise OSError("read-only file system")

    monkeypatch.setattr("surefoot.evaluation.results.copy_to", refuse)
    path = old_table(tmp_path)
    with open_results(path) as results:
        assert results.path == path
        assert results.row(1).trial.seed == 0
    assert [file.name for file in tmp_path.iterdir()] == ["old.sqlite"]


def test_trials_of_protocol_1_are_shown_but_not_gone_on_with(tmp_path: Path) -> None:
    agent = NominalAgent(usual_robot())
    with open_results(old_table(tmp_path)) as results:
        rows = [results.row(row_id) for row_id in range(1, 8)]
        assert results.finished_scenarios(agent) == set()
    (key,) = {row.key for row in rows}
    now = results.key_of(agent)
    assert key == now._replace(setup=replace(now.setup, protocol=1))
    with pytest.raises(UserError, match="its protocol was 1 and is now 2"):
        check_setup(key.setup, "row 1")
    # What was not kept then is unknown, and not taken for fair.
    assert not any(row.outcome.is_within_limits(1.1) for row in rows)


def test_a_table_of_schema_3_is_copied_too_and_its_trials_are_kept_as_they_were(tmp_path: Path) -> None:
    agent, trial = NominalAgent(usual_robot()), pushed(6.0, 0)
    path = tmp_path / "last.sqlite"
    with Results(path) as results:
        results.trials_of(agent).put(trial, an_outcome(steps=3), "mine")
    with sqlite3.connect(path) as db:
        db.execute("ALTER TABLE trials DROP COLUMN sustained_speed_ratio")
        db.execute("PRAGMA user_version = 3")
    db.close()
    with open_results(path) as results:
        assert results.path == tmp_path / "last-schema4.sqlite"
        row = results.row(1)
    assert (row.trial, row.scenario) == (trial, "mine")
    assert differences(row.outcome, an_outcome(steps=3, sustained_speed_ratio=float("nan"))) == []


def test_old_words_become_todays(tmp_path: Path) -> None:
    with open_results(old_table(tmp_path)) as results:
        rows = [results.row(row_id) for row_id in range(1, 8)]
        thresholds = results.thresholds_of("nominal-bent")
        fixed = results.fixed_outcomes("nominal-bent")
    assert [row.scenario for row in rows] == ["root_push"] * 4 + ["two"] * 2 + ["own_word"]
    assert [row.trial.full_length for row in rows[:4]] == [True, False] * 2
    assert {row.trial.preceding for row in rows[4:6]} == {Push("root", (0.0, 0.0, 1.0), 6.0)}
    assert rows[6].trial.push == Push("root", (1.0, 0.0, 0.0), 6.0, lever=0.1)
    assert {row.trial.quiet_from for row in rows} == {1.0, 0.5}
    push = Scenario("root_push", directions=2, horizon=2.0, quiet_from=1.0)
    assert [(t.line.scenario, t.line.name, t.size) for t in thresholds] == [
        (push, "forward", 12.0), (push, "backward", 12.0)
    ]  # fmt: skip
    assert {name: len(outcomes) for name, outcomes in fixed.items()} == {"two": 2, "own_word": 1}


def test_an_unknown_setup_is_shown_and_reported_but_not_gone_on_with(tmp_path: Path) -> None:
    path, agent = old_table(tmp_path, "0" * 64), NominalAgent(usual_robot())
    with open_results(path) as results:
        row = results.row(1)
        assert results.trials_of(agent).get(row.trial) is None
        assert results.finished_scenarios(agent) == set()
    assert row.key.setup == Setup(UNKNOWN_PROTOCOL, agent.contract.robot, f"setup {'0' * 64}", "mujoco 4.0.0")
    (evaluation,) = read_evaluations([path])
    assert (evaluation.name, evaluation.wall_s, len(evaluation.thresholds)) == ("nominal-bent", 3.5, 2)
    with pytest.raises(UserError, match="row 1 cannot be run again as it was: it was written before results named"):
        check_setup(row.key.setup, "row 1")


def test_exported_thresholds_of_both_versions_are_read_alike(tmp_path: Path) -> None:
    with open_results(old_table(tmp_path)) as results:
        results.export("thresholds", tmp_path / "new.csv")
    assert "setup" in (DATA / "schema2.csv").read_text().splitlines()[0]
    assert read_threshold_rows(DATA / "schema2.csv") == read_threshold_rows(tmp_path / "new.csv")
    assert [t.size for t in read_thresholds(DATA / "schema2.csv")["nominal-bent"]] == [12.0, 12.0]


def test_a_damaged_old_table_is_refused_and_kept(tmp_path: Path) -> None:
    path = old_table(tmp_path)
    content = path.read_bytes()[: path.stat().st_size // 2]
    path.write_bytes(content)
    with pytest.raises(UserError, match="as a results table"):
        Results(path)
    assert path.read_bytes() == content
