"""Fine-tuning: a run may begin with a policy alone; its critic is learned first, while the policy stays."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import torch
from conftest import tiny

import surefoot.learning.warm_start as warm_start_module
from surefoot.agents.load import load_policy
from surefoot.agents.network import NetworkAgent
from surefoot.errors import UserError
from surefoot.learning.actor import actor_network, network_layers
from surefoot.learning.config import TrainConfig
from surefoot.learning.run_folder import RunFolder
from surefoot.learning.train import Trainer, train
from surefoot.task.environment import EnvConfig

pytestmark = pytest.mark.slow

ALGORITHMS = ("trpo", "ppo", "ddpg")


@pytest.fixture(scope="module", params=ALGORITHMS)
def learned(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[TrainConfig, Path]:
    """A policy file, and how it was learned."""
    config = tiny(request.param)
    folder = tmp_path_factory.mktemp(request.param) / "run"
    train(config, folder)
    return config, folder / "last.onnx"


def fine_tuning(config: TrainConfig, file: Path, folder: Path, **changes) -> Trainer:
    config = dataclasses.replace(config, **changes)
    return Trainer(config, RunFolder.create(folder, config), start=load_policy(file))


def acts(policy: NetworkAgent) -> np.ndarray:
    observations = np.random.default_rng(0).normal(scale=0.3, size=(50, 47))
    return policy.actions(observations)


def test_a_run_after_a_policy_begins_with_its_actions_and_its_record(
    learned: tuple[TrainConfig, Path], tmp_path: Path
) -> None:
    config, file = learned
    policy = load_policy(file)
    trainer = fine_tuning(config, file, tmp_path / "run")
    begun = NetworkAgent(trainer.policy_bytes(), "begun")
    np.testing.assert_allclose(acts(begun), acts(policy), atol=1e-5)
    assert trainer.progress.steps == 0
    record, before = begun.contract.training, policy.contract.training
    assert record["policy_steps"] == before["policy_steps"] > 0
    assert record["after"] == {key: before[key] for key in ("preset", "seed", "policy_steps", "minutes")}
    # What explores is the same actor, and not only what is kept.
    for ours, averaged in zip(
        *map(network_layers, (actor_network(trainer.model), trainer.learner.average.averaged)), strict=True
    ):
        np.testing.assert_allclose(ours[0], averaged[0], atol=1e-6)


def test_the_critic_learns_first_and_the_actor_after_it(
    learned: tuple[TrainConfig, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config, file = learned
    monkeypatch.setattr(warm_start_module, "CRITIC_FIRST_STEPS", 300)
    trainer = fine_tuning(config, file, tmp_path / "run", steps=256)
    value = _critic_weight(trainer)
    trainer.run()
    trainer.advance()
    held = NetworkAgent(trainer.policy_bytes(), "held")
    np.testing.assert_allclose(acts(held), acts(load_policy(file)), atol=1e-5)
    assert not torch.equal(_critic_weight(trainer), value)
    if config.algorithm != "ddpg":
        assert trainer.model.policy.log_std.eq(config.log_std).all()
    more = dataclasses.replace(config, steps=1024)
    resumed = Trainer(more, RunFolder(tmp_path / "run"), resume=True)
    resumed.run()
    freed = NetworkAgent(resumed.policy_bytes(), "freed")
    assert np.abs(acts(freed) - acts(held)).max() > 1e-4


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"algorithm": "ppo"}, "learned with algorithm ddpg, this run has ppo"),
        ({"actor": (10, 10)}, r"learned with hidden layers \(100, 50, 25\), this run has \(10, 10\)"),
        (
            {"env": EnvConfig("valkyrie", pose="bent", action_scale=0.6)},
            "learned with action_scale 0.8, this run has 0.6",
        ),
        ({"env": EnvConfig("valkyrie", pose="straight", action_scale=0.8)}, "learned with nominal pose"),
    ],
    ids=["algorithm", "layers", "action scale", "pose"],
)
def test_a_run_cannot_begin_with_a_policy_that_does_not_fit(change: dict, message: str, tmp_path: Path) -> None:
    config = dataclasses.replace(tiny("ddpg"), env=EnvConfig("valkyrie", pose="bent", action_scale=0.8))
    with pytest.raises(UserError, match=message):
        train(dataclasses.replace(config, **change), tmp_path / "run", start="ddpg")
    assert not (tmp_path / "run").exists()
    with pytest.raises(UserError, match=r"cannot read policy nobody: .*shipped policies: best, ddpg, ppo, trpo"):
        train(config, tmp_path / "run", start="nobody")


def _critic_weight(trainer: Trainer) -> torch.Tensor:
    state = trainer.model.policy.state_dict()
    name = next(
        name for name in state if name.startswith(("critic.", "mlp_extractor.value_net")) and state[name].ndim == 2
    )
    return state[name].clone()
