"""Actors of other libraries as policies and back: what they answer stays the same, and no pickle is loaded."""

from __future__ import annotations

import io
import os
import pickle
import zipfile
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import torch
from stable_baselines3 import DDPG, PPO, SAC
from torch import nn

import surefoot
from surefoot.agents.load import load_policy
from surefoot.cli.export import Export
from surefoot.errors import UserError
from surefoot.learning.exchange import LAYOUTS, policy_from, put_policy, read_actor, state_dict
from surefoot.report.page import make_report

NUM_INPUTS, NUM_ACTIONS = 47, 11
WHEN_LOADED = "loaded.txt"


@pytest.fixture(scope="module")
def env():
    env = gym.make("surefoot/PushRecovery-v0")
    yield env
    env.close()


@pytest.fixture(scope="module")
def observations(env) -> np.ndarray:
    """Of a robot under random actions, float32 (20, 47)."""
    env.action_space.seed(0)
    first, _ = env.reset(seed=0)
    return np.array([first, *(env.step(env.action_space.sample())[0] for _ in range(19))])


def model(kind: type, env: gym.Env, activation: type[nn.Module], layers: tuple[int, ...] = (16, 8)):
    torch.manual_seed(1)
    net = {"pi": list(layers), "vf": [8], "qf": [8]}
    arch = {key: net[key] for key in (("pi", "vf") if kind is PPO else ("pi", "qf"))}
    return kind("MlpPolicy", env, policy_kwargs={"net_arch": arch, "activation_fn": activation}, device="cpu")


@pytest.mark.parametrize(
    ("kind", "activation"), [(PPO, nn.Tanh), (PPO, nn.ELU), (DDPG, nn.ReLU), (DDPG, nn.Tanh), (SAC, nn.ReLU)]
)
def test_a_model_of_stable_baselines3_acts_the_same_as_a_policy_from_its_file_and_from_itself(
    env, observations, tmp_path: Path, kind: type, activation: type[nn.Module]
) -> None:
    other = model(kind, env, activation)
    other.save(tmp_path / "model.zip")
    expected, _ = other.predict(observations, deterministic=True)
    for policy in (policy_from(other), policy_from(tmp_path / "model.zip", activation=activation.__name__.lower())):
        found = np.clip(policy.actions(observations), -1.0, 1.0)
        assert found == pytest.approx(expected, abs=1e-5)
        assert policy.contract.action_scale == env.unwrapped.batch.loop.action_scale
        assert list(policy.contract.nominal_pose) == env.unwrapped.batch.loop.nominal.tolist()


def test_a_policy_from_another_library_is_evaluated_like_any_other(env, tmp_path: Path) -> None:
    policy = policy_from(model(PPO, env, nn.ELU))
    (tmp_path / "p.onnx").write_bytes(policy.data)
    outcome = surefoot.run_trial(load_policy(tmp_path / "p.onnx"), surefoot.Trial(full_length=False))
    assert outcome.recovered, "an actor that has only begun to learn holds the nominal pose"


def test_the_report_shows_a_policy_of_which_only_the_library_is_known(env, tmp_path: Path) -> None:
    shove = surefoot.Scenario("shove", search="", directions=1, impulse=6.0, trials=1, horizon=2.0, quiet_from=1.0)
    surefoot.evaluate(policy_from(model(PPO, env, nn.Tanh)), [shove], results=tmp_path / "r.sqlite")
    page = make_report([tmp_path / "r.sqlite"], {}, run_trials=False).html()
    assert "<small>stable-baselines3 (PPO, A2C, TRPO)</small>" in page


def mlp(*sizes: int) -> nn.Sequential:
    torch.manual_seed(2)
    layers: list[nn.Module] = []
    for before, after in zip(sizes[:-1], sizes[1:], strict=True):
        layers += [nn.Linear(before, after), nn.ELU()]
    return nn.Sequential(*layers[:-1])


def prefixed(prefix: str, module: nn.Module) -> dict[str, torch.Tensor]:
    return {f"{prefix}.{name}": tensor for name, tensor in module.state_dict().items()}


def checkpoints() -> dict[str, tuple[dict, nn.Module, np.ndarray, np.ndarray]]:
    """By layout: what the library saves, its network, and the observation's mean and deviation as it uses them.

    rsl_rl adds 0.01 to the deviation, skrl 1e-8 to the root of the variance.
    """
    network, head = mlp(NUM_INPUTS, 12, 10, NUM_ACTIONS), nn.Linear(10, NUM_ACTIONS)
    trunk = mlp(NUM_INPUTS, 12, 10)
    with_head = nn.Sequential(*trunk, nn.ELU(), head)
    rng = np.random.default_rng(0)
    mean, std = rng.normal(size=NUM_INPUTS), rng.uniform(0.5, 2.0, NUM_INPUTS)
    statistics = {"_mean": torch.tensor(mean)[None], "_std": torch.tensor(std)[None], "_var": torch.tensor(std)[None]}
    scaler = {"running_mean": torch.tensor(mean), "running_variance": torch.tensor(std**2)}
    new = prefixed("mlp", network) | {f"obs_normalizer.{key}": value for key, value in statistics.items()}
    old = prefixed("actor", network) | {f"actor_obs_normalizer.{key}": value for key, value in statistics.items()}
    own = prefixed("net_container", with_head) | {"log_std_parameter": torch.zeros(NUM_ACTIONS)}
    shared = (
        prefixed("net_container", trunk) | prefixed("policy_layer", head) | prefixed("value_layer", nn.Linear(10, 1))
    )
    optimizer = {"optimizer_state_dict": {"state": {}, "param_groups": []}, "iter": 300, "infos": None}
    no_mean, no_std = np.zeros(NUM_INPUTS), np.ones(NUM_INPUTS)
    return {
        "rsl_rl": ({"actor_state_dict": new} | optimizer, network, mean, std + 1e-2),
        "rsl_rl-3": ({"model_state_dict": old} | optimizer, network, mean, std + 1e-2),
        "skrl": ({"policy": own, "observation_preprocessor": scaler}, with_head, mean, std + 1e-8),
        "skrl-shared": ({"policy": shared, "value": shared}, with_head, no_mean, no_std),
    }


@pytest.mark.parametrize("layout", ["rsl_rl", "rsl_rl-3", "skrl", "skrl-shared"])
def test_a_checkpoint_of_rsl_rl_and_skrl_acts_the_same_as_a_policy(observations, tmp_path: Path, layout: str) -> None:
    saved, network, mean, deviation = checkpoints()[layout]
    torch.save(saved, tmp_path / "model_300.pt")
    policy = policy_from(tmp_path / "model_300.pt")
    with torch.no_grad():
        expected = network(torch.tensor((observations - mean) / deviation, dtype=torch.float32)).numpy()
    assert policy.actions(observations) == pytest.approx(expected, abs=1e-4)
    assert policy.activation == "elu"
    assert policy.contract.training["algorithm"].startswith(layout[:4])


@pytest.mark.parametrize("layout", [name for name, names in LAYOUTS.items() if not names.squash])
def test_there_and_back_is_the_same_network(observations, layout: str) -> None:
    ppo = load_policy("ppo")
    again = policy_from(state_dict(ppo, layout), activation="tanh")
    assert again.actions(observations) == pytest.approx(ppo.actions(observations), abs=1e-5)


def test_a_model_learns_on_from_a_policy(env, observations) -> None:
    ppo = load_policy("ppo")
    other = model(PPO, env, nn.Tanh, ppo.hidden)
    put_policy(ppo, other)
    found, _ = other.predict(observations, deterministic=True)
    assert found == pytest.approx(np.clip(ppo.actions(observations), -1.0, 1.0), abs=1e-5)
    ddpg = load_policy("ddpg")
    another = model(DDPG, env, nn.Tanh, ddpg.hidden)
    put_policy(ddpg, another)
    assert another.predict(observations)[0] == pytest.approx(ddpg.actions(observations), abs=1e-5)
    assert another.actor_target(torch.tensor(observations)).detach().numpy() == pytest.approx(
        ddpg.actions(observations), abs=1e-5
    )


def test_what_does_not_fit_is_named(env) -> None:
    ppo, ddpg = load_policy("ppo"), load_policy("ddpg")
    with pytest.raises(UserError, match=r"the model's actor has other layers than ppo, which has \(200, 100, 50\)"):
        put_policy(ppo, model(PPO, env, nn.Tanh))
    with pytest.raises(UserError, match="the model's activation is relu, that of ppo is tanh"):
        put_policy(ppo, model(PPO, env, nn.ReLU, ppo.hidden))
    with pytest.raises(
        UserError, match="ddpg has a tanh behind its last layer, unlike rsl_rl; valid: sb3-td3, sb3-sac"
    ):
        state_dict(ddpg, "rsl_rl")
    with pytest.raises(UserError, match="unknown layout 'brax'; valid: sb3, sb3-td3, sb3-sac, rsl_rl"):
        state_dict(ppo, "brax")
    with pytest.raises(UserError, match=r"the actor maps 46 numbers to 11; valkyrie has 47 and 11"):
        policy_from({"actor_state_dict": prefixed("mlp", mlp(46, 8, NUM_ACTIONS))})
    with pytest.raises(UserError, match="unknown activation 'gelu'; valid: tanh, relu, elu"):
        read_actor({}, "gelu")
    with pytest.raises(UserError, match="holds no actor of linear layers that is known"):
        policy_from({"actor_state_dict": {"cnn.0.weight": torch.zeros(3, 3)}})


def test_learning_does_not_go_on_from_a_network_that_it_does_not_know(env) -> None:
    policy = policy_from(model(PPO, env, nn.ELU))
    with pytest.raises(UserError, match="policy has elu between its layers; only tanh networks can learn on"):
        policy.layers(np.zeros(NUM_INPUTS), np.ones(NUM_INPUTS))


class Bomb:
    """Whoever unpickles it makes a file."""

    def __reduce__(self):
        return os.mknod, (WHEN_LOADED,)


def test_no_pickle_of_a_checkpoint_is_loaded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    bomb = pickle.dumps(Bomb())
    Path("bomb.pt").write_bytes(bomb)
    with zipfile.ZipFile("bomb.zip", "w") as archive:
        archive.writestr("policy.pth", bomb)
    torch.save({"actor_state_dict": {}, "infos": Bomb()}, "infos.pt")
    Path("text.pt").write_text("no checkpoint")
    for name in ("bomb.pt", "bomb.zip", "infos.pt", "text.pt"):
        with pytest.raises(UserError, match=f"{name} is no checkpoint that can be read without running code in it"):
            policy_from(name)
    assert not Path(WHEN_LOADED).exists()


def test_the_pickled_part_of_a_model_is_not_looked_at(env, tmp_path: Path) -> None:
    other = model(PPO, env, nn.Tanh)
    other.save(tmp_path / "model.zip")
    with zipfile.ZipFile(tmp_path / "model.zip") as archive:
        weights = archive.read("policy.pth")
    with zipfile.ZipFile(tmp_path / "bomb.zip", "w") as archive:
        archive.writestr("policy.pth", weights)
        archive.writestr("data", pickle.dumps(Bomb()))
    assert policy_from(tmp_path / "bomb.zip").hidden == (16, 8)


def test_the_command_takes_a_checkpoint_and_gives_a_policy_and_back(
    tmp_path: Path, observations, capsys: pytest.CaptureFixture[str]
) -> None:
    saved, *_ = checkpoints()["rsl_rl"]
    torch.save(saved, tmp_path / "model.pt")
    Export(str(tmp_path / "model.pt"), onnx=tmp_path / "p.onnx", action_scale=0.5).main()
    policy = load_policy(tmp_path / "p.onnx")
    assert policy.contract.action_scale == 0.5
    Export(str(tmp_path / "p.onnx"), weights=tmp_path / "back.pt", layout="skrl").main()
    back = torch.load(io.BytesIO((tmp_path / "back.pt").read_bytes()), weights_only=True)
    assert sorted(back["policy"])[-2:] == ["net_container.4.bias", "net_container.4.weight"]
    assert policy_from(back).actions(observations) == pytest.approx(policy.actions(observations), abs=1e-5)
    said = " ".join(capsys.readouterr().err.split())
    assert "rsl_rl, layers of (12, 10), elu between them" in said
    assert "laid out for skrl; elu between the layers" in said
