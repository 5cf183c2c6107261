"""What the live page is served by and follows, without a browser: its port, and policies that a run replaces."""

from __future__ import annotations

import shutil
import socket
from dataclasses import replace
from pathlib import Path

import pytest
from page_client import free_port

from surefoot.errors import UserError
from surefoot.viewer.page import Page
from surefoot.viewer.server import check_port
from surefoot.viewer.session import Session
from surefoot.viewer.source import PolicySource

pytestmark = pytest.mark.slow


def test_an_occupied_port_is_named(robot):
    with socket.socket() as occupied:
        occupied.bind(("127.0.0.1", 0))
        occupied.listen()
        port = occupied.getsockname()[1]
        with pytest.raises(
            UserError, match=f"cannot listen on 127.0.0.1:{port}: address already in use; valid: a free"
        ):
            check_port("127.0.0.1", port)
    with pytest.raises(UserError, match=r"cannot listen on 127.0.0.1:70000"):
        check_port("127.0.0.1", 70000)


def test_the_page_listens_on_this_machine_only():
    page = Page(PolicySource("nominal"), port=free_port())
    try:
        assert page.address.startswith("http://127.0.0.1:")
        assert page.server.get_host() == "127.0.0.1"
        with socket.socket() as probe:
            probe.settimeout(2.0)
            assert probe.connect_ex(("127.0.0.2", page.server.get_port())) != 0
    finally:
        page.close()
    assert not page.player.is_alive


# Where policies come from.


@pytest.mark.parametrize(
    ("training", "words"),
    [
        (
            {"algorithm": "dagger", "preset": "best", "policy_steps": 7_800_000, "minutes": 131.2},
            "learned by DAgger, preset best, 7.8 million steps, 131 min",
        ),
        (
            {"algorithm": "ddpg", "preset": "fast", "policy_steps": 3840, "minutes": 0.0997},
            "learned by DDPG, preset fast, 3,840 steps, 0.1 min",
        ),
    ],
)
def test_a_policy_says_how_it_was_learned(training: dict, words: str) -> None:
    source = PolicySource("trpo")
    source.policy.contract = replace(source.policy.contract, training=training)
    assert source.description == words


@pytest.fixture
def run_folder(tmp_path) -> Path:
    folder = tmp_path / "runs" / "mine"
    folder.mkdir(parents=True)
    (folder / "config.json").write_text("{}")
    return folder


def shipped_file(name: str) -> Path:
    import surefoot

    return Path(surefoot.__file__).parent / "agents" / "shipped" / f"{name}.onnx"


def test_a_run_is_watched_while_it_learns(run_folder):
    source = PolicySource(str(run_folder))
    assert source.is_waiting
    assert source.description == "waiting for the first checkpoint"
    assert not source.refresh()
    shutil.copy(shipped_file("ppo"), run_folder / "best.onnx")
    assert source.refresh()
    assert source.policy.name == "mine"
    assert source.policy.contract.training["algorithm"] == "ppo"
    shutil.copy(shipped_file("trpo"), run_folder / "last.onnx")
    assert source.refresh()
    assert source.policy.contract.training["algorithm"] == "trpo", "the newest checkpoint, not the best"
    assert not source.refresh()


def test_a_damaged_checkpoint_is_named_and_the_old_policy_stays(run_folder):
    shutil.copy(shipped_file("trpo"), run_folder / "last.onnx")
    source = PolicySource(str(run_folder))
    policy = source.policy
    (run_folder / "last.onnx").write_bytes(b"half a fi")
    with pytest.raises(UserError, match="is not a policy file"):
        source.refresh()
    assert source.policy is policy
    assert not source.refresh(), "it is told once"


def test_a_session_plays_on_with_a_new_checkpoint(run_folder):
    shutil.copy(shipped_file("trpo"), run_folder / "last.onnx")
    source = PolicySource(str(run_folder))
    session = Session(source.policy, 1)
    session.step()
    shutil.copy(shipped_file("ppo"), run_folder / "last.onnx")
    assert source.refresh()
    session.set_policy(source.policy)
    session.step()
    assert session.policy.contract.training["algorithm"] == "ppo"


@pytest.mark.parametrize("name", ["nowhere", ""])
def test_a_policy_that_is_not_there_is_refused(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UserError, match=r"cannot read policy .*shipped policies: best, ddpg, ppo, trpo"):
        PolicySource(name)
