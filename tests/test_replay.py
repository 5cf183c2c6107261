"""Replay: a stored trial comes out again to the last bit, however many neighbours it had, and a changed one is told."""

from __future__ import annotations

import dataclasses
import importlib.resources
import json
import sqlite3
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from surefoot.agents.load import load_policy, shipped_policies, usual_robot
from surefoot.agents.nominal import NominalAgent
from surefoot.errors import UserError
from surefoot.evaluation import replay
from surefoot.evaluation.results import Results
from surefoot.evaluation.scenarios import Scenario
from surefoot.evaluation.suites import NOISE
from surefoot.evaluation.trials import Trial, run_list
from surefoot.physics.mujoco_engine import ENGINE_NAME

NETWORK = shipped_policies()[-1]
"""Any will do."""


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ten trials of a shipped network in one batch, short ones: rows 1 to 10."""
    policy, path = load_policy(NETWORK), tmp_path_factory.mktemp("replay") / "r.sqlite"
    scenarios = (Scenario("push", horizon=2.0, quiet_from=1.0), dataclasses.replace(NOISE["noise_both"], horizon=6.0))
    trials = [line.trial(25, seed, full_length=True) for seed, s in enumerate(scenarios) for line in s.lines()]
    trials += [scenarios[0].lines()[i].trial(50, 3, full_length=True) for i in range(2)]
    with Results(path) as results:
        store = results.trials_of(policy)
        for trial, outcome in run_list(policy, trials).items():
            store.put(trial, outcome, "push")
    return path


def surefoot(*arguments: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "surefoot", *map(str, arguments)]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=300)


def changed(table: Path, folder: Path, column: str, value: object, row: int = 1) -> Path:
    """A copy of the table with another value in one of its cells."""
    copy = folder / "changed.sqlite"
    copy.write_bytes(table.read_bytes())
    with sqlite3.connect(copy) as db:
        db.execute(f"UPDATE trials SET {column} = ? WHERE id = ?", (value, row))
    db.close()
    return copy


@pytest.mark.parametrize("num_rows", [1, 2, 3, 7, 64, 191])
def test_a_network_gives_the_same_bits_in_every_batch(num_rows: int) -> None:
    """What a replay rests on: onnxruntime promises nothing of the kind."""
    policy = load_policy(NETWORK)
    observations = np.random.default_rng(0).standard_normal((192, 47))
    whole = policy.actions(observations)
    for first in (0, 1):
        some = slice(first, first + num_rows)
        assert (policy.actions(observations[some]) == whole[some]).all()


def test_every_row_comes_out_again_alone(table: Path) -> None:
    policy = load_policy(NETWORK)
    with Results(table) as results:
        rows = [results.row(i) for i in range(1, 11)]
    assert len({row.outcome.reason for row in rows} | {row.outcome.steps for row in rows}) > 3
    for row in rows:
        assert replay.differences(row.outcome, replay.replay(row, policy)) == []


def test_differences_are_of_bits_and_nan_equals_nan(table: Path) -> None:
    with Results(table) as results:
        before = dataclasses.replace(results.row(1).outcome, quiet_drift=float("nan"), com_speed=0.1)
    after = dataclasses.replace(before, com_speed=np.nextafter(0.1, 1.0), steps=before.steps + 1)
    assert replay.differences(before, before) == []
    assert [name for name, _, _ in replay.differences(before, after)] == ["com_speed", "steps"]


def test_the_command_says_identical(table: Path, tmp_path: Path) -> None:
    done = surefoot("replay", table, "1", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    first, second = done.stdout.splitlines()
    assert first.startswith(f"{NETWORK}, push, row 1: ")
    assert second == "identical"


def test_the_command_lists_what_differs_and_exits_with_1(table: Path, tmp_path: Path) -> None:
    with Results(table) as results:
        speed = results.row(1).outcome.speed_ratio
    done = surefoot("replay", changed(table, tmp_path, "speed_ratio", 9.5), "1", cwd=tmp_path)
    assert done.returncode == 1
    assert done.stdout.splitlines()[1:] == [f"  speed_ratio: stored 9.5, now {speed}", "different"]


def test_a_row_that_is_not_there_is_named(table: Path, tmp_path: Path) -> None:
    done = surefoot("replay", table, "11", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (2, f"surefoot: {table} has no row 11; valid: 1 to 10\n")


def test_a_table_that_is_not_there_is_named_and_not_made(tmp_path: Path) -> None:
    done = surefoot("replay", "none.sqlite", "1", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith("surefoot: there is no results table none.sqlite")
    assert not (tmp_path / "none.sqlite").exists()


def test_another_setup_is_refused(table: Path, tmp_path: Path) -> None:
    copy = changed(table, tmp_path, "engine", "mujoco 3.1")
    done = surefoot("replay", copy, "1", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr == (
        f"surefoot: row 1 of {copy} cannot be run again as it was: its engine was mujoco 3.1 and is now {ENGINE_NAME}\n"
    )


def test_a_policy_is_found_by_its_digest_and_another_one_is_refused(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    shipped, nominal = load_policy(NETWORK), NominalAgent(usual_robot(), "straight")
    assert replay.find_policy("it", shipped.digest).digest == shipped.digest
    assert replay.find_policy("it", nominal.digest).name == "nominal-straight"
    with pytest.raises(
        UserError, match=r"no policy 'it' of digest 000000000000 among the shipped ones \(.*give it wit"
    ):
        replay.find_policy("it", "0" * 64)
    with pytest.raises(UserError, match=rf"{NETWORK} is another policy: its digest is {shipped.digest[:12]}, that of"):
        replay.find_policy("it", "0" * 64, NETWORK)


def test_a_policy_is_found_in_runs_and_in_a_given_run_folder(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    source = importlib.resources.files("surefoot.agents") / "shipped" / f"{NETWORK}.onnx"
    folder = tmp_path / "runs" / "study" / "trpo-0"
    folder.mkdir(parents=True)
    (folder / "last.onnx").write_bytes(source.read_bytes())
    digest = load_policy(NETWORK).digest
    monkeypatch.setattr(replay, "shipped_policies", lambda: ())
    assert replay.find_policy("it", digest).digest == digest
    assert replay.find_policy("it", digest, folder).digest == digest


def test_a_stored_trial_is_the_whole_recipe(table: Path) -> None:
    """Nothing but the row's JSON says what is run."""
    with sqlite3.connect(table) as db:
        text, row_id = db.execute("SELECT trial, id FROM trials WHERE seed = 1 LIMIT 1").fetchone()
    db.close()
    with Results(table) as results:
        trial = results.row(row_id).trial
    assert json.loads(text)["imperfections"] == {"action_noise": 0.1, "observation_noise": 0.5}
    assert isinstance(trial, Trial)
    assert trial.horizon == 6.0
