"""Replay of what drove another robot: foreign policy, controller and nominal pose come out again to the last bit."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import TIPTOE
from test_foreign import as_mjlab_writes, weights_for, write_network

from surefoot.agents.load import load_agent
from surefoot.cli.main import main
from surefoot.evaluation.results import Results
from surefoot.evaluation.scenarios import Scenario
from surefoot.evaluation.trials import run_list
from surefoot.robots import Robot, load_robot
from surefoot.task.agent import Agent


@pytest.fixture(scope="module")
def tiptoe() -> Robot:
    return load_robot(TIPTOE)


@pytest.fixture(scope="module")
def foreign(tiptoe: Robot, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A network that moves the joints a little, with the metadata that mjlab writes."""
    order = np.arange(tiptoe.num_joints)
    file = tmp_path_factory.mktemp("foreign") / "policy.onnx"
    return write_network(file, weights_for(tiptoe), as_mjlab_writes(tiptoe, order), batch="robots")


def table(agent: Agent, file: Path) -> Path:
    """Five short trials of an agent, run together: rows 1 to 5."""
    lines = Scenario("push", horizon=2.0, quiet_from=1.0, directions=5).lines()
    trials = [line.trial(3, seed, full_length=True) for seed, line in enumerate(lines)]
    with Results(file) as results:
        store = results.trials_of(agent)
        for trial, outcome in run_list(agent, trials, num_slots=5).items():
            store.put(trial, outcome, "push")
    return file


def replayed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *words: str | Path
) -> tuple[int, str]:
    """Exit code of `surefoot replay`, and what it says."""
    monkeypatch.setattr(sys, "argv", ["surefoot", "replay", *map(str, words)])
    try:
        main()
    except SystemExit as end:
        return int(end.code or 0), "".join(capsys.readouterr())
    return 0, "".join(capsys.readouterr())


@pytest.mark.parametrize("name", ["foreign", "controllers/stand", "nominal"])
def test_a_trial_of_another_robot_is_replayed_bit_for_bit(
    name: str,
    foreign: Path,
    tiptoe: Robot,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    file = table(load_agent(str(foreign) if name == "foreign" else name, tiptoe), tmp_path / "r.sqlite")
    for row in (1, 4):
        code, said = replayed(monkeypatch, capsys, file, str(row))
        assert (code, "identical" in said) == (0, True), said


def test_a_changed_foreign_policy_is_another_one(
    foreign: Path, tiptoe: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file = table(load_agent(str(foreign), tiptoe), tmp_path / "r.sqlite")
    other = tmp_path / "other.onnx"
    write_network(other, 2.0 * weights_for(tiptoe), as_mjlab_writes(tiptoe, np.arange(tiptoe.num_joints)))
    code, said = replayed(monkeypatch, capsys, file, "1", "--policy", other)
    assert code == 2
    assert "other.onnx is another policy: its digest is" in said
    assert "Traceback" not in said
