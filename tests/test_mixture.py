"""The mixture: what its file says, what its gates do, and what it learns."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import torch
from conftest import make_env

from surefoot.agents.load import load_policy
from surefoot.agents.network import NetworkAgent
from surefoot.errors import UserError
from surefoot.learning.config import TrainConfig
from surefoot.learning.distill import Distiller
from surefoot.learning.mixture import MIDDLE, Layers, MixtureNetwork
from surefoot.learning.networks import linear_modules
from surefoot.learning.preset_file import preset
from surefoot.learning.run_folder import RunFolder
from surefoot.learning.student import MixtureStudent
from surefoot.learning.warm_start import warm_start
from surefoot.task.random_pushes import DisturbanceConfig

NUM_OBSERVED, NUM_INPUTS, NUM_JOINTS = 47, 464, 11


def some_layers(rng: np.random.Generator, sizes: tuple[int, ...]) -> Layers:
    pairs = zip(sizes[:-1], sizes[1:], strict=True)
    return [(rng.normal(size=(o, i)) / np.sqrt(i), 0.1 * rng.normal(size=o)) for i, o in pairs]


@pytest.fixture
def teachers() -> list[Layers]:
    """Three, the last of which has a layer more."""
    rng = np.random.default_rng(0)
    sizes = NUM_OBSERVED, 200, 100, 50, NUM_JOINTS
    return [some_layers(rng, sizes), some_layers(rng, sizes), some_layers(rng, (*sizes, NUM_JOINTS))]


@pytest.fixture
def mixture(teachers: list[Layers]) -> MixtureNetwork:
    torch.manual_seed(0)
    network = MixtureNetwork(NUM_INPUTS, NUM_OBSERVED, (64, 48), teachers)
    with torch.no_grad():  # one that corrects its observation, and chooses now this teacher and now that one
        last = linear_modules(network.trunk)[-1]
        last.weight *= 200.0
        last.bias[-2:] = MIDDLE
    return network


def through(layers: Layers, values: np.ndarray) -> np.ndarray:
    """What a chain of linear layers with tanh between them makes of float32 numbers."""
    *hidden, (weight, bias) = [(weight.astype(np.float32), bias.astype(np.float32)) for weight, bias in layers]
    for each, shift in hidden:
        values = np.tanh(values @ each.T + shift)
    return values @ weight.T + bias


def test_the_chain_of_layers_does_what_the_mixture_does(mixture: MixtureNetwork) -> None:
    inputs = np.random.default_rng(1).normal(size=(500, NUM_INPUTS)).astype(np.float32)
    with torch.no_grad():
        actions, clear, logit = (part.numpy() for part in mixture.parts(torch.from_numpy(inputs)))
    assert np.abs(clear - inputs[:, :NUM_OBSERVED]).max() > 0.1
    assert 0.2 < (logit > 0.0).mean() < 0.8
    np.testing.assert_allclose(through(mixture.layers(), inputs), actions, atol=2e-3)


def test_a_new_mixture_does_what_the_second_teacher_does(teachers: list[Layers]) -> None:
    inputs = np.random.default_rng(1).normal(size=(100, NUM_INPUTS)).astype(np.float32)
    network = MixtureNetwork(NUM_INPUTS, NUM_OBSERVED, (64, 48), teachers)
    with torch.no_grad():
        linear_modules(network.trunk)[-1].weight.zero_()
        actions = network(torch.from_numpy(inputs)).numpy()
    # Its gates have z = CLOSED (1 - tanh(0)) = 4, so that each other teacher has sech(4)^2 = 0.0013 of the say.
    first, second, third = (through(layers, inputs[:, :NUM_OBSERVED]) for layers in teachers)
    np.testing.assert_allclose(actions, second + 0.00134 * (first + third - 2.0 * second), atol=1e-4)


@pytest.mark.parametrize(("place", "teacher"), [(-2, 0), (-1, 2)])
def test_a_gate_that_is_open_lets_its_teacher_act(teachers: list[Layers], place: int, teacher: int) -> None:
    inputs = np.random.default_rng(1).normal(size=(100, NUM_INPUTS)).astype(np.float32)
    network = MixtureNetwork(NUM_INPUTS, NUM_OBSERVED, (64, 48), teachers)
    with torch.no_grad():
        last = linear_modules(network.trunk)[-1]
        last.weight.zero_()
        last.bias[-2:] = -5.0  # tanh(5) = 0.9999: z = 7.9996, and for the one that is open 0.0004
        last.bias[place] = 5.0
    expected = through(teachers[teacher], inputs[:, :NUM_OBSERVED])
    np.testing.assert_allclose(through(network.layers(), inputs), expected, atol=1e-3)


# Learning.


def mixture_config() -> TrainConfig:
    """A mixture of two shipped policies for tiny runs."""
    pushes = DisturbanceConfig(impulse=(20.0, 120.0), first=(0.2, 0.6))
    env = make_env(1, pose="bent", action_scale=0.6, disturbance=pushes, noise_share=0.5, observation_noise=0.5).config
    far = {"policy": "ddpg", "capture_point": (0.15,), "falling": 2.0}
    teachers = ({"policy": "trpo"}, {"policy": "ppo", "capture_point": (0.05,)}, far)
    hyper = {"teachers": teachers, "mixture": True, "learning_rate": 1e-3, "batch_size": 64, "gradient_steps": 4.0}
    values = {"steps": 400, "num_envs": 8, "actor": (32, 32), "noise": (0.0, 0.02), "env": env, "hyper": hyper}
    return dataclasses.replace(preset("best/student", "ddpg"), **values)


def test_a_mixture_learns_what_its_sensors_hide_and_which_teacher_fits(tmp_path: Path) -> None:
    config = mixture_config()
    distiller = Distiller(config, RunFolder.create(tmp_path / "mixture", config), num_threads=1)
    student = distiller.student
    assert isinstance(student, MixtureStudent)
    observations = distiller.begin()
    errors = []
    for step in range(60):
        observations = distiller.step(observations)
        if step in (10, 59):
            inputs, targets, _ = distiller.labels.draw(512, np.random.default_rng(0))
            with torch.no_grad():
                errors.append(float(student.error(inputs, targets).mean()))
    assert errors[1] < 0.7 * errors[0]
    # The file does what the student does.
    raw = student.memory.inputs(observations, np.arange(8))
    policy = NetworkAgent(student.policy_bytes({}), "mixture")
    expected = student.act(student.normalise(raw))
    np.testing.assert_allclose(np.clip(policy.actions(raw), -1.0, 1.0), expected, atol=2e-3)


def test_a_mixture_refuses_teachers_that_it_cannot_take_in(tmp_path: Path) -> None:
    def refusal(**changes: object) -> str:
        config = mixture_config()
        config = dataclasses.replace(config, hyper={**config.hyper, **changes})
        with pytest.raises(UserError) as error:
            Distiller(config, RunFolder(tmp_path / "mixture"), num_threads=1)
        return str(error.value)

    assert "has 2 or more teachers and 2 hidden layers, not 1 and 2" in refusal(teachers=({"policy": "trpo"},))
    config = mixture_config()
    wide = dataclasses.replace(config, env=dataclasses.replace(config.env, action_scale=0.8))
    with pytest.raises(UserError, match=r"has the action scale 0\.6, less than the mixture's 0\.8"):
        Distiller(wide, RunFolder(tmp_path / "mixture"), num_threads=1)


def test_a_mixture_goes_on_with_the_trunk_of_another_whose_teachers_may_be_others(tmp_path: Path) -> None:
    config = mixture_config()
    first = Distiller(config, RunFolder.create(tmp_path / "first", config), num_threads=1)
    observations = first.begin()
    for _ in range(5):
        observations = first.step(observations)
    file = tmp_path / "first.onnx"
    file.write_bytes(first.student.policy_bytes({}))
    far, *others = reversed(config.hyper["teachers"])
    config = dataclasses.replace(
        config, hyper={**config.hyper, "teachers": (others[1], others[0], {**far, "falling": 1.0})}
    )
    start = warm_start(config, file)
    assert isinstance(start, NetworkAgent)
    second = Distiller(config, RunFolder.create(tmp_path / "second", config), start=start, num_threads=1)
    inputs = torch.from_numpy(first.student.inputs(observations))
    with torch.no_grad():
        was, now = first.student.network.trunk(inputs), second.student.network.trunk(inputs)
    np.testing.assert_allclose(now, was, atol=1e-3)
    with pytest.raises(UserError, match="a mixture cannot go on with ppo: it has another number of inputs"):
        second.student.take_policy(load_policy("ppo"))
