"""Training runs: they leave all their files, can be interrupted and resumed, begin with each other, lose nothing."""

import dataclasses
import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import torch
from conftest import tiny
from stable_baselines3 import DDPG

import surefoot.whole_file as whole_file_module
from surefoot.agents.load import load_policy
from surefoot.agents.network import NetworkAgent
from surefoot.errors import UserError
from surefoot.learning.actor import actor_network, network_layers
from surefoot.learning.run_folder import RunFolder
from surefoot.learning.train import Trainer, train
from surefoot.task.environment import EnvConfig

pytestmark = pytest.mark.slow

ALGORITHMS = ("trpo", "ppo", "ddpg")


def test_a_run_leaves_all_its_files(tmp_path: Path) -> None:
    train(tiny("ppo"), tmp_path / "run")
    names = {file.name.split(".")[0] for file in (tmp_path / "run").iterdir()}
    assert names == {"config", "beginning", "curve", "checkpoint", "best", "last", "kept", "events"}
    folder = RunFolder(tmp_path / "run")
    assert folder.config() == tiny("ppo")
    (row,) = folder.curve()
    assert row["steps"] >= 512
    training = load_policy(tmp_path / "run").contract.training
    assert training["algorithm"] == "ppo"
    assert training["policy_steps"] == row["steps"]
    (kept,) = (tmp_path / "run" / "kept").iterdir()
    assert kept.read_bytes() == (tmp_path / "run" / "last.onnx").read_bytes()


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_a_resumed_run_goes_on_where_it_was(algorithm: str, tmp_path: Path) -> None:
    config = tiny(algorithm)
    first = train(config, tmp_path / "run")
    more = dataclasses.replace(config, steps=1024)
    second = Trainer(more, RunFolder(tmp_path / "run"), resume=True)
    assert second.model.num_timesteps == first.model.num_timesteps
    for name, value in first.model.policy.state_dict().items():
        assert torch.equal(value, second.model.policy.state_dict()[name]), name
    assert _optimizer_steps(second.model) == _optimizer_steps(first.model) > 0
    second.run()
    assert second.model.num_timesteps >= 1024
    assert [row["steps"] for row in RunFolder(tmp_path / "run").curve()][-1] >= 1024


def test_a_run_may_begin_with_the_networks_of_another(tmp_path: Path) -> None:
    config = tiny("ddpg", average_steps=1000.0)
    parent = train(config, tmp_path / "parent")
    heir = Trainer(config, RunFolder.create(tmp_path / "heir", config), start=RunFolder(tmp_path / "parent"))
    layers = zip(*(network_layers(actor_network(trainer.model)) for trainer in (heir, parent)), strict=True)
    assert all(np.array_equal(ours, theirs) for pair in layers for ours, theirs in zip(*pair, strict=True))
    assert heir.progress.steps == 0
    heir.run()
    assert heir.progress.steps == 512
    record = load_policy(tmp_path / "heir").contract.training
    assert record["policy_steps"] == 1024
    assert record["after"] == {
        "preset": "fast",
        "seed": 0,
        "policy_steps": 512,
        "minutes": pytest.approx(parent.progress.seconds / 60.0, abs=0.01),
    }
    more = dataclasses.replace(config, steps=600)
    resumed = Trainer(more, RunFolder(tmp_path / "heir"), resume=True)
    resumed.run()
    assert resumed.progress.steps >= 600
    assert NetworkAgent(resumed.policy_bytes(), "resumed").contract.training["after"] == record["after"]


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_a_critic_that_begins_without_a_privileged_observation_has_the_same_values_until_it_learns(
    algorithm: str, tmp_path: Path
) -> None:
    blind = dataclasses.replace(tiny(algorithm), privileged_critic=False)
    parent = train(blind, tmp_path / "parent")
    config = dataclasses.replace(blind, privileged_critic=True)
    heir = Trainer(config, RunFolder.create(tmp_path / "heir", config), start=RunFolder(tmp_path / "parent"))
    rng = np.random.default_rng(0)
    seen, action = (torch.as_tensor(rng.normal(size=(20, n)), dtype=torch.float32) for n in (59, 11))
    for before, after in zip(
        _values(parent.model, seen[:, :47], action), _values(heir.model, seen, action), strict=True
    ):
        torch.testing.assert_close(after, before)
    actions = [
        model.predict(inputs, deterministic=True)[0]
        for model, inputs in ((parent.model, seen[:, :47]), (heir.model, seen))
    ]
    np.testing.assert_allclose(*actions, atol=1e-6)
    assert _optimizer_steps(heir.model) == _optimizer_steps(parent.model) > 0
    heir.run()
    width = 59 + 11 * (algorithm == "ddpg")
    weight = next(weight for weight in heir.model.policy.state_dict().values() if weight.shape == (256, width))
    assert weight[:, 47:59].abs().max() > 1e-4


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"algorithm": "trpo"}, "was learned with algorithm ddpg, this run has trpo"),
        ({"actor": (10, 10)}, r"was learned with actor \(100, 50, 25\), this run has \(10, 10\)"),
        (
            {"env": EnvConfig("valkyrie", pose="bent", action_scale=0.9)},
            "was learned with action_scale 0.6, this run has 0.9",
        ),
    ],
    ids=["algorithm", "layers", "action scale"],
)
def test_a_run_cannot_begin_with_networks_that_do_not_fit(change: dict, message: str, tmp_path: Path) -> None:
    config = tiny("ddpg")
    RunFolder.create(tmp_path / "parent", config)
    with pytest.raises(UserError, match=message):
        train(dataclasses.replace(config, **change), tmp_path / "heir", start=tmp_path / "parent")
    assert not (tmp_path / "heir").exists()


def test_an_interrupted_command_can_be_resumed(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "surefoot", "train", "--algorithm", "trpo", "--run", "run", "--steps", "1000000"]
    process = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 90.0
    while not list(tmp_path.glob("run/events*")) and time.monotonic() < deadline:
        time.sleep(0.2)
    time.sleep(4.0)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=90)
    assert process.returncode == 130, errors
    assert "go on with: surefoot train --resume run" in errors
    steps = RunFolder(tmp_path / "run").load_checkpoint()[1]["steps"]
    resume = [sys.executable, "-m", "surefoot", "train", "--resume", "run", "--steps", str(steps + 1)]
    subprocess.run(resume, cwd=tmp_path, check=True, capture_output=True)
    assert RunFolder(tmp_path / "run").load_checkpoint()[1]["steps"] > steps


def test_a_full_disk_in_mid_checkpoint_loses_no_earlier_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = RunFolder.create(tmp_path / "run", tiny("ppo"))
    folder.save_checkpoint({"policy": {"w": torch.ones(3)}}, {"steps": 1})

    def no_space(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(whole_file_module.os, "fsync", no_space)
    with pytest.raises(UserError, match=r"cannot write .*checkpoint\.npz: No space left on device; what was there"):
        folder.save_checkpoint({"policy": {"w": torch.zeros(3)}}, {"steps": 2})
    parameters, state = folder.load_checkpoint()
    assert state["steps"] == 1
    assert torch.equal(parameters["policy"]["w"], torch.ones(3))
    assert sorted(file.name for file in folder.path.iterdir()) == ["beginning.json", "checkpoint.npz", "config.json"]


def test_a_checkpoint_holds_no_pickle(tmp_path: Path) -> None:
    train(tiny("ddpg"), tmp_path / "run")
    with np.load(tmp_path / "run" / "checkpoint.npz", allow_pickle=False) as arrays:
        assert all(arrays[name].dtype != object for name in arrays)


def test_damaged_run_folders_are_refused_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"is not a run folder: cannot read config\.json"):
        RunFolder(tmp_path / "nothing").config()
    folder = RunFolder.create(tmp_path / "run", tiny("ppo"))
    with pytest.raises(UserError, match="has no checkpoint to resume from"):
        folder.load_checkpoint()
    (folder.path / "checkpoint.npz").write_bytes(b"PK\x03\x04 and no more")
    with pytest.raises(UserError, match=r"checkpoint\.npz is damaged"):
        folder.load_checkpoint()
    (folder.path / "config.json").write_text(json.dumps({"algorithm": "ppo"}))
    with pytest.raises(UserError, match=r"config\.json cannot be read as a training configuration"):
        folder.config()
    with pytest.raises(UserError, match=r"exists already; resume it with --resume, or give another --run"):
        RunFolder.create(folder.path, tiny("ppo"))


def _values(model, seen: torch.Tensor, action: torch.Tensor) -> list[torch.Tensor]:
    """What the critics think of states, or of actions in them."""
    with torch.no_grad():
        if isinstance(model, DDPG):
            return [critic(seen, action)[0] for critic in (model.critic, model.critic_target)]
        return [model.policy.predict_values(seen)]


def _optimizer_steps(model) -> float:
    optimizer = model.actor.optimizer if hasattr(model, "actor") else model.policy.optimizer
    return max(float(state["step"]) for state in optimizer.state_dict()["state"].values())
