"""Learning with real physics: every algorithm beats standing, and its policy file acts as its network does."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from conftest import tiny
from stable_baselines3.common.env_checker import check_env
from stable_baselines3.common.vec_env import VecMonitor
from torch import nn

from surefoot.agents.network import NetworkAgent
from surefoot.agents.policy_file import network_bytes
from surefoot.environments.single import PushRecoveryEnv
from surefoot.learning.actor import actor_network, network_layers
from surefoot.learning.config import TrainConfig
from surefoot.learning.ddpg import ExplorationNoise
from surefoot.learning.models import limit_exploration, make_model
from surefoot.learning.networks import SymmetricNetwork, linear_modules, mlp
from surefoot.learning.preset_file import preset
from surefoot.learning.run_folder import RunFolder
from surefoot.learning.sb3 import SB3VecEnv
from surefoot.learning.train import Trainer, train
from surefoot.task import observation
from surefoot.task.contract import Contract
from surefoot.task.environment import EnvConfig, PushRecoveryVectorEnv
from surefoot.task.random_pushes import DisturbanceConfig

pytestmark = pytest.mark.slow

ALGORITHMS = ("trpo", "ppo", "ddpg")


def make(config: TrainConfig):
    env = PushRecoveryVectorEnv(config.num_envs, config.env)
    venv = SB3VecEnv(env, config.privileged_critic)
    return make_model(config, venv, np.random.default_rng(0), 1e-3), venv


# The three algorithms.

# Pushes that throw over a robot that only holds its pose, and an episode short enough to see many of them.
HARD = DisturbanceConfig(impulse=(26.5, 106.0), first=(0.4, 0.8), interval=(2.4, 3.0))
STEPS = {"trpo": 110_000, "ppo": 90_000, "ddpg": 40_000}


def mean_return(actions: Callable[[np.ndarray], np.ndarray], config: EnvConfig) -> float:
    """Mean reward per robot over 10 s of pushes; a fallen robot earns nothing more."""
    num_envs, num_steps = 64, 250
    env = PushRecoveryVectorEnv(num_envs, config)
    observations, _ = env.reset(seed=7)
    alive, total = np.ones(num_envs, bool), np.zeros(num_envs)
    for _ in range(num_steps):
        observations, rewards, terminated, _, _ = env.step(actions(observations))
        total += rewards * alive
        alive &= ~terminated
    return float(total.mean())


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_a_short_run_beats_holding_the_nominal_pose(algorithm: str, tmp_path: Path) -> None:
    """On pushes it has not seen, of the size it trained with."""
    config = preset("fast", algorithm)
    config = dataclasses.replace(
        config,
        env=dataclasses.replace(config.env, pose="straight", disturbance=HARD),
        minutes=1.0,  # two validations
        schedule_minutes=0.0,
        steps=STEPS[algorithm],
    )
    train(config, tmp_path / "run")
    learned = NetworkAgent((tmp_path / "run" / "last.onnx").read_bytes(), "last")
    standing = mean_return(lambda observations: np.zeros((len(observations), 11)), config.env)
    assert mean_return(learned.actions, config.env) > 1.1 * standing


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_the_policy_file_acts_as_the_network_that_was_trained(algorithm: str) -> None:
    model, venv = make(tiny(algorithm))
    torch.manual_seed(0)
    for parameter in model.policy.parameters():
        parameter.data += 0.1 * torch.randn_like(parameter)
    normalise = venv.normalise
    contract = Contract.of(venv.env.robot, "bent", 0.6)
    data = network_bytes(
        network_layers(actor_network(model)), normalise.mean, normalise.std, algorithm == "ddpg", contract
    )
    inputs = np.random.default_rng(0).standard_normal((16, 47))
    raw = inputs * normalise.std + normalise.mean
    # Whatever a critic is told of the next push, the policy does not know.
    privileged = np.random.default_rng(1).standard_normal((16, model.observation_space.shape[0] - 47))
    expected, _ = model.predict(np.concatenate([inputs, privileged], axis=1, dtype=np.float32), deterministic=True)
    actual = np.clip(NetworkAgent(data, "test").actions(raw), -1.0, 1.0)
    np.testing.assert_allclose(actual, expected, atol=2e-5)


@pytest.mark.parametrize("algorithm", ["trpo", "ppo"])
def test_a_mirrored_policy_acts_alike_on_both_sides_but_for_the_side_that_it_prefers(algorithm: str) -> None:
    model, venv = make(dataclasses.replace(tiny(algorithm), mirror=True))
    for parameter in model.policy.parameters():
        parameter.data += 0.1 * torch.randn_like(parameter)
    robot = venv.env.robot
    (source, sign), joint_source, joint_sign = observation.mirror(robot), robot.mirror_source, robot.mirror_sign
    inputs = np.random.default_rng(0).standard_normal((16, 59)).astype(np.float32)
    # The last twelve are privileged; of these the push along y, its lever along y and its side change sign.
    privileged_sign = [1, 1, 1, -1, 1, 1, -1, -1, 1, 1, 1, 1]
    other_side = np.concatenate([inputs[:, source] * sign, inputs[:, 47:] * privileged_sign], axis=1, dtype=np.float32)
    networks = model.policy.mlp_extractor
    actions = model.predict(inputs, deterministic=True)[0]
    value = model.policy.predict_values(torch.as_tensor(inputs)).detach()
    uneven = model.predict(other_side, deterministic=True)[0] - actions[:, joint_source] * joint_sign
    assert np.abs(uneven).mean() > 0.01
    for network in (networks.policy_net, networks.value_net):
        network.side.data *= -1.0  # the other side is preferred
    mirrored = model.predict(other_side, deterministic=True)[0]
    np.testing.assert_allclose(mirrored, actions[:, joint_source] * joint_sign, atol=1e-5)
    np.testing.assert_allclose(model.policy.predict_values(torch.as_tensor(other_side)).detach(), value, atol=1e-4)
    assert value.std() > 0.1


def test_a_symmetric_critic_learns_from_one_side_of_each_sample_and_both_are_drawn() -> None:
    torch.manual_seed(0)
    inward = np.array([1, 0]), np.array([1.0, 1.0])  # the mirror image of (a, b) is (b, a)
    critic = SymmetricNetwork(mlp(2, [], 1, nn.ReLU), inward, None)
    (linear,) = linear_modules(critic)
    linear.weight.data, linear.bias.data, critic.side.data = torch.tensor([[1.0, 10.0]]), torch.zeros(1), torch.ones(1)
    # f(2, 3) = 2 + 30 + 1 = 33, and its mirror image 3 + 20 - 1 = 22; their mean is 27.5.
    inputs = torch.tensor([[2.0, 3.0]]).repeat(1000, 1)
    drawn = critic.train()(inputs)
    assert set(drawn.flatten().tolist()) == {33.0, 22.0}
    assert drawn.mean().item() == pytest.approx(27.5, abs=1.0)  # a standard deviation of 5.5 / sqrt(1000) = 0.17
    assert set(critic.eval()(inputs).flatten().tolist()) == {27.5}


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_the_critic_is_told_of_the_next_push_and_the_last_observation_of_an_episode_of_its_own(algorithm: str) -> None:
    model, venv = make(tiny(algorithm))
    venv.seed(0)
    first = venv.reset()
    assert first.shape == (8, 59)
    told = [(first, venv.env.privileged_observation())]
    for _ in range(60):
        observations, _, dones, infos = venv.step(np.zeros((8, 11), np.float32))
        told.append((observations, venv.env.privileged_observation()))
        for i in np.flatnonzero(dones):
            assert infos[i]["terminal_observation"].shape == (59,)
    for observations, privileged in told:
        np.testing.assert_allclose(observations[:, 47:], privileged, rtol=1e-6)
    assert max(privileged[:, 0].max() for _, privileged in told) == 1.0
    with torch.no_grad():
        quiet = torch.zeros(1, 59)
        pushed = quiet.clone()
        pushed[0, 47:51] = torch.tensor([1.0, 2.0, 2.0, 0.0])
        if algorithm == "ddpg":
            (before,), (after,) = (model.critic(seen, torch.zeros(1, 11)) for seen in (quiet, pushed))
        else:
            before, after = model.policy.predict_values(quiet), model.policy.predict_values(pushed)
        assert (after - before).abs() > 1e-4
        # The policy is not.
        actions = [model.predict(seen.numpy(), deterministic=True)[0] for seen in (quiet, pushed)]
        np.testing.assert_array_equal(*actions)


def test_learning_while_the_robots_move_depends_on_the_seed_alone() -> None:
    runs = []
    for _ in range(2):
        model, _ = make(tiny("ddpg"))
        model.learn(512)
        assert model._n_updates > 20  # they were made, one per policy step but the first ones
        runs.append([weight for layer in network_layers(actor_network(model)) for weight in layer])
    for first, second in zip(*runs, strict=True):
        np.testing.assert_array_equal(first, second)


def test_networks_are_the_papers() -> None:
    """100-50-25, tanh actor and ReLU critic, separate, linear outputs, a standard deviation of its own."""
    model, _ = make(dataclasses.replace(preset("paper", "ppo"), num_envs=2))
    networks = model.policy.mlp_extractor
    for network, activation, outputs in ((networks.policy_net, "Tanh", 11), (networks.value_net, "ReLU", 1)):
        kinds = [type(module).__name__ for module in network]
        assert kinds == ["Linear", activation] * 3 + ["Linear"]
        assert [network[i].out_features for i in (0, 2, 4, 6)] == [100, 50, 25, outputs]
    assert model.policy.log_std.shape == (11,)


def test_a_new_policy_holds_the_nominal_pose() -> None:
    for algorithm in ALGORITHMS:
        model, _ = make(tiny(algorithm))
        actions, _ = model.predict(np.zeros((1, *model.observation_space.shape), np.float32), deterministic=True)
        assert np.abs(actions).max() < 0.05


# Exploration and averaging.


def test_exploration_keeps_its_deviation_and_its_correlation() -> None:
    noise = ExplorationNoise((3, 2), (0.1, 0.4), 0.8, np.random.default_rng(0))
    drawn = np.stack([noise() for _ in range(20_000)])
    # Least, in between on a logarithmic scale (sqrt(0.1 * 0.4) = 0.2), most; at a correlation of 0.8 the mean of
    # 20,000 draws counts as about 20,000 * (1 - 0.64) / (1 + 0.64) = 4,400 independent ones, so 1.1 % off at 1 sigma.
    np.testing.assert_allclose(drawn.std(axis=(0, 2)), [0.1, 0.2, 0.4], rtol=0.04)
    for lag, expected in ((1, 0.8), (3, 0.512)):
        pairs = np.corrcoef(drawn[:-lag, 2, 0], drawn[lag:, 2, 0])[0, 1]
        assert pairs == pytest.approx(expected, abs=0.04)


def test_exploration_fades_to_the_share_it_is_limited_to() -> None:
    model, _ = make(tiny("ddpg"))
    limit_exploration(model, 0.0, 0.25)
    assert model.action_noise.scale == 0.25
    before = model.action_noise._noise.copy()
    assert np.abs(model.action_noise()).max() < 0.25 * 0.25 * (np.abs(before).max() + 3.0)
    gaussian, _ = make(tiny("trpo"))
    limit_exploration(gaussian, gaussian.policy.log_std[0].item(), 0.5)
    start = np.exp(tiny("trpo").log_std)
    np.testing.assert_allclose(gaussian.policy.log_std.exp().detach(), 0.5 * start, rtol=1e-6)


def test_the_averaged_actor_follows_the_newest_one_with_its_time_constant(tmp_path: Path) -> None:
    config = tiny("ddpg", average_steps=1000.0)
    trainer = Trainer(config, RunFolder.create(tmp_path / "run", config))
    average = trainer.learner.average
    average.restart(9_300)
    before = network_layers(average.averaged)[0][0]
    with torch.no_grad():
        next(iter(trainer.model.policy.actor.mu)).weight += 1.0
    trainer.model.num_timesteps = 10_000
    trainer.advance()
    # 1 - exp(-700 / 1000) = 0.503 of the way to weights that are larger by 1.
    np.testing.assert_allclose(network_layers(average.kept)[0][0] - before, 0.5034, atol=1e-4)
    trainer.advance()  # no steps, no change
    np.testing.assert_allclose(network_layers(average.kept)[0][0] - before, 0.5034, atol=1e-4)


# The environment for SB3.


def test_the_single_environment_passes_sb3s_checker() -> None:
    check_env(PushRecoveryEnv(), warn=False)


def test_the_adapter_tells_falls_from_time_limits_and_hands_over_the_last_observation() -> None:
    config = EnvConfig(
        "valkyrie", pose="bent", episode_s=0.6, disturbance=DisturbanceConfig(impulse=(200.0, 201.0), first=(0.1, 0.1))
    )
    venv = VecMonitor(SB3VecEnv(PushRecoveryVectorEnv(4, config)))
    venv.seed(0)
    venv.reset()
    for _ in range(15):
        observations, _, dones, infos = venv.step(np.zeros((4, 11), np.float32))
    # 200 Ns in the first 0.22 s: after 0.6 s all lean far, but none has reached the ground; the episode is over.
    assert dones.all()
    for i, info in enumerate(infos):
        assert info["TimeLimit.truncated"]
        assert info["episode"]["l"] == 15
        assert np.abs(info["terminal_observation"] - observations[i]).max() > 0.5
