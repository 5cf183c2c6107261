from __future__ import annotations

import dataclasses
import hashlib
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import onnx
import pytest

from surefoot.agents.load import load_policy, shipped_policies
from surefoot.agents.network import NetworkAgent
from surefoot.agents.nominal import NominalAgent
from surefoot.agents.policy_file import network_bytes
from surefoot.errors import UserError
from surefoot.robots import Robot
from surefoot.task import observation
from surefoot.task.contract import Contract

SIZES = (47, 10, 7, 11)


@pytest.fixture(scope="module")
def contract(robot: Robot) -> Contract:
    return Contract.of(
        robot, "bent", 0.5, {"algorithm": "PPO", "seed": 3, "layers": [10, 7], "notes": {"minutes": 1.5}}
    )


def random_network(seed: int) -> tuple[list[tuple[np.ndarray, np.ndarray]], np.ndarray, np.ndarray]:
    """Layers, mean and std."""
    rng = np.random.default_rng(seed)
    layers = [
        (rng.normal(size=(n, m)) / np.sqrt(m), rng.normal(size=n)) for m, n in zip(SIZES, SIZES[1:], strict=False)
    ]
    return layers, rng.normal(size=47), rng.uniform(0.1, 3.0, 47)


def forward(layers: list, mean: np.ndarray, std: np.ndarray, squash: bool, observations: np.ndarray) -> np.ndarray:
    """The same network in NumPy, in double precision and with the normalisation before the first layer."""
    value = (observations - mean) / std
    for i, (weight, bias) in enumerate(layers):
        value = value @ weight.T + bias
        if squash or i < len(layers) - 1:
            value = np.tanh(value)
    return value


def policy_file(contract: Contract, seed: int = 0) -> bytes:
    layers, mean, std = random_network(seed)
    return network_bytes(layers, mean, std, squash=True, contract=contract)


def with_contract(contract: Contract, **changes: object) -> bytes:
    """A policy file whose contract says something else."""
    values = dataclasses.asdict(contract) | changes
    model = onnx.load_model_from_string(policy_file(contract))
    onnx.helper.set_model_props(model, {"surefoot": json.dumps(values)})
    return model.SerializeToString()


def refusal(data: bytes) -> str:
    with pytest.raises(UserError) as error:
        NetworkAgent(data, "mine")
    assert "\n" not in str(error.value)
    return str(error.value)


# Networks.


@pytest.mark.parametrize("squash", [True, False])
def test_a_policy_file_computes_what_its_layers_do(contract: Contract, squash: bool) -> None:
    layers, mean, std = random_network(1)
    policy = NetworkAgent(network_bytes(layers, mean, std, squash, contract), "mine")
    observations = np.random.default_rng(2).normal(size=(20, 47))
    expected = forward(layers, mean, std, squash, observations)
    actions = policy.actions(observations)
    np.testing.assert_allclose(actions, expected, rtol=0, atol=1e-5)
    if not squash:
        assert np.abs(expected).max() > 1.0  # the output is linear


def test_joint_targets_are_the_clipped_and_scaled_actions_around_the_nominal_pose(contract: Contract) -> None:
    policy = NetworkAgent(policy_file(contract), "mine")
    observations = 30.0 * np.random.default_rng(4).normal(size=(20, 47))
    actions = policy.actions(observations)
    assert actions.dtype == np.float32
    command = policy(observations, np.arange(20))
    # The contract's action scale is 0.5 rad.
    expected = np.array(contract.nominal_pose) + 0.5 * np.clip(actions.astype(np.float64), -1.0, 1.0)
    np.testing.assert_array_equal(command.joint_target, expected)
    assert command.joint_torque is None
    assert (policy.rate_hz, policy.path, policy.inputs) == (25, "cubic", "observation")


def test_a_single_layer_is_linear_and_normalised(contract: Contract) -> None:
    weight = np.zeros((11, 47))
    weight[3, 5] = 2.0
    mean, std = np.full(47, 0.5), np.full(47, 4.0)
    policy = NetworkAgent(network_bytes([(weight, np.full(11, 0.25))], mean, std, False, contract), "mine")
    observations = np.zeros((1, 47))
    observations[0, 5] = 2.5
    # 2 * (2.5 - 0.5) / 4 + 0.25 = 1.25
    expected = np.full((1, 11), 0.25)
    expected[0, 3] = 1.25
    np.testing.assert_allclose(policy.actions(observations), expected, rtol=1e-6)


def test_a_policy_acts_on_each_robot_by_itself(contract: Contract) -> None:
    policy = NetworkAgent(policy_file(contract), "mine")
    observations = np.random.default_rng(5).normal(size=(9, 47))
    together = policy(observations, np.arange(9)).joint_target
    one_by_one = np.concatenate([policy(observations[i : i + 1], np.array([i])).joint_target for i in range(9)])
    np.testing.assert_allclose(together, one_by_one, rtol=0, atol=1e-6)
    assert np.ptp(together, axis=0).min() > 1e-3


def test_the_same_network_gives_the_same_file_and_another_does_not(contract: Contract) -> None:
    data = policy_file(contract)
    assert data == policy_file(contract)
    assert NetworkAgent(data, "mine").digest == hashlib.sha256(data).hexdigest()
    assert NetworkAgent(policy_file(contract, seed=9), "mine").digest != hashlib.sha256(data).hexdigest()


# Contracts.


def test_a_contract_survives_its_file_to_the_last_bit(contract: Contract) -> None:
    assert Contract.from_json(contract.to_json()) == contract
    assert NetworkAgent(policy_file(contract), "mine").contract == contract


def test_a_contract_says_all_that_is_needed_to_run_a_policy(robot: Robot, contract: Contract) -> None:
    assert contract.robot == "valkyrie"
    assert contract.joints == robot.joint_names
    assert contract.nominal_pose == tuple(robot.pose("bent"))
    assert contract.action_scale == 0.5
    assert contract.observations == observation.component_names(robot)
    assert contract.stiffness[:4] == (3000.0, 1500.0, 2000.0, 2000.0)
    assert contract.damping[:4] == (300.0, 150.0, 180.0, 120.0)
    assert contract.torque_limit[:5] == (150.0, 350.0, 350.0, 350.0, 205.0)
    assert contract.velocity_limit[:4] == pytest.approx((9.0, 6.11, 6.11, 11.0), rel=1e-12)
    assert (contract.policy_hz, contract.control_hz, contract.filter_cutoff_hz) == (25, 500, 10.0)
    assert (contract.target_path, contract.format) == ("cubic", 1)
    assert contract.training["algorithm"] == "PPO"


def test_a_contract_for_this_robot_is_honoured(robot: Robot, contract: Contract) -> None:
    assert contract.check() is robot
    free = dataclasses.replace(contract, nominal_pose=(0.1,) * 11, action_scale=0.2, training={})
    assert free.check() is robot


def test_the_nominal_policy_asks_for_its_pose_and_nothing_else(robot: Robot) -> None:
    policy = NominalAgent(robot, "straight")
    assert policy.name == "nominal-straight"
    assert policy.contract.nominal_pose == (0.0,) * 11
    observations = np.random.default_rng(0).normal(size=(3, 47))
    command = policy(observations, np.arange(3))
    np.testing.assert_array_equal(command.joint_target, np.zeros((3, 11)))
    assert command.joint_torque is None
    assert policy.digest != NominalAgent(robot, "bent").digest
    assert policy.digest == NominalAgent(robot, "straight").digest


# Files.


def test_a_file_and_its_folder_load_the_same_policy(tmp_path: Path, contract: Contract) -> None:
    folder = tmp_path / "my-run"
    folder.mkdir()
    (folder / "best.onnx").write_bytes(policy_file(contract))
    by_folder, by_file = load_policy(folder), load_policy(str(folder / "best.onnx"))
    assert by_folder.digest == by_file.digest
    assert (by_folder.name, by_file.name) == ("my-run", "best")
    observations = np.random.default_rng(0).normal(size=(2, 47))
    np.testing.assert_array_equal(by_folder.actions(observations), by_file.actions(observations))


def test_a_policy_runs_without_torch(tmp_path: Path, contract: Contract) -> None:
    file = tmp_path / "policy.onnx"
    file.write_bytes(policy_file(contract))
    code = f"""
import sys
import numpy as np
from surefoot.agents.load import load_policy
from surefoot.evaluation.trials import run_list
actions = load_policy({str(file)!r}).actions(np.zeros((1, 47)))
assert actions.shape == (1, 11) and np.isfinite(actions).all()
learners = [name for name in ("torch", "stable_baselines3", "sb3_contrib") if name in sys.modules]
print(learners)
"""
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (result.stdout, result.returncode) == ("[]\n", 0), result.stderr


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    shipped = f"; shipped policies: {', '.join(shipped_policies())}" if shipped_policies() else ""
    for path, file in ((tmp_path / "no.onnx", "no.onnx"), (tmp_path, "best.onnx")):
        with pytest.raises(UserError) as error:
            load_policy(path)
        assert str(error.value) == f"cannot read policy {tmp_path / file}: No such file or directory{shipped}"


def test_a_damaged_file_is_named_by_its_path(tmp_path: Path) -> None:
    file = tmp_path / "broken.onnx"
    file.write_bytes(b"nothing of use")
    with pytest.raises(UserError) as error:
        load_policy(file)
    assert str(error.value) == f"{file} is not a policy file: not a readable ONNX network"


@pytest.mark.parametrize("name", shipped_policies())
def test_a_shipped_policy_is_loaded_by_its_name_and_acts(robot: Robot, name: str) -> None:
    policy = load_policy(name)
    assert policy.name == name
    assert policy.contract.check() is robot
    actions = policy.actions(np.random.default_rng(0).normal(size=(4, policy.contract.num_inputs)))
    assert actions.shape == (4, 11)
    assert np.isfinite(actions).all()
    assert np.ptp(actions, axis=0).max() > 0.01


def test_best_is_a_policy_of_its_own() -> None:
    assert load_policy("best").contract.training["algorithm"] == "dagger"


@pytest.mark.parametrize("damage", ["nothing", "text", "random", "cut", "pickle"])
def test_a_file_that_is_no_network_is_refused(contract: Contract, damage: str) -> None:
    whole = policy_file(contract)
    data = {
        "nothing": b"",
        "text": b"# not a policy\n",
        "random": np.random.default_rng(0).bytes(3000),
        "cut": whole[: len(whole) // 2],
        "pickle": b"\x80\x04\x95\x0b\x00\x00\x00\x00\x00\x00\x00\x8c\x07weights\x94.",
    }[damage]
    assert refusal(data) == "mine is not a policy file: not a readable ONNX network"


def test_a_network_of_somebody_else_is_refused(contract: Contract) -> None:
    model = onnx.load_model_from_string(policy_file(contract))
    del model.metadata_props[:]
    message = "mine is not a surefoot policy: its metadata has no 'surefoot'"
    assert refusal(model.SerializeToString()) == message
    onnx.helper.set_model_props(model, {"author": "somebody"})
    assert refusal(model.SerializeToString()) == message


@pytest.mark.parametrize("text", ["", "{", "[1, 2]", "3", "null", "{}", '{"robot": "valkyrie"}', '"valkyrie"'])
def test_a_contract_that_cannot_be_read_is_refused(contract: Contract, text: str) -> None:
    model = onnx.load_model_from_string(policy_file(contract))
    onnx.helper.set_model_props(model, {"surefoot": text})
    assert refusal(model.SerializeToString()).startswith("mine has a policy contract that cannot be read: ")


def test_a_contract_with_an_unknown_clause_is_refused(contract: Contract) -> None:
    assert "'gait'" in refusal(with_contract(contract, gait="walk"))


def test_a_policy_for_another_robot_is_refused(contract: Contract) -> None:
    assert (
        refusal(with_contract(contract, robot="atlas"))
        == "unknown robot 'atlas'; valid: g1, g1_arms, h1, valkyrie, or a description (.toml)"
    )


def test_a_policy_with_another_joint_order_is_refused(robot: Robot, contract: Contract) -> None:
    order = (*robot.joint_names[6:], *robot.joint_names[:6])
    expected = f"policy's joints is {order}, but valkyrie has {robot.joint_names}"
    assert refusal(with_contract(contract, joints=order)) == expected


@pytest.mark.parametrize(
    ("clause", "value", "message"),
    [
        ("policy_hz", 50, "policy's policy_hz is 50, but valkyrie has 25"),
        ("control_hz", 1000, "policy's control_hz is 1000, but valkyrie has 500"),
        ("filter_cutoff_hz", 5.0, "policy's filter_cutoff_hz is 5.0, but valkyrie has 10.0"),
        ("target_path", "linear", "policy's target_path is linear, but valkyrie has cubic"),
        ("format", 2, "policy's format is 2, but valkyrie has 1"),
        ("action_scale", 0.0, "policy's action_scale must be positive, not 0.0"),
        ("action_scale", float("nan"), "policy's action_scale must be positive, not nan"),
        ("action_scale", float("inf"), "policy's action_scale must be positive, not inf"),
        ("nominal_pose", [0.0, 0.1], "policy's nominal_pose must be 11 finite angles, not (0.0, 0.1)"),
    ],
)
def test_a_clause_that_cannot_be_honoured_is_named(
    contract: Contract, clause: str, value: object, message: str
) -> None:
    assert refusal(with_contract(contract, **{clause: value})) == message


@pytest.mark.parametrize("clause", ["stiffness", "damping", "torque_limit", "velocity_limit", "observations"])
def test_gains_limits_and_observations_that_differ_are_named(contract: Contract, clause: str) -> None:
    values = list(getattr(contract, clause))
    values[0], values[1] = values[1], values[0]
    assert refusal(with_contract(contract, **{clause: values})).startswith(f"policy's {clause} is (")


def test_a_pose_of_numbers_that_are_not_finite_is_refused(contract: Contract) -> None:
    pose = [float("nan"), *[0.0] * 10]
    assert refusal(with_contract(contract, nominal_pose=pose)).startswith("policy's nominal_pose must be 11 finite")


@pytest.mark.parametrize(
    ("clause", "value"),
    [("nominal_pose", ["0.1"] * 11), ("nominal_pose", None), ("action_scale", "1"), ("action_scale", None)],
)
def test_clauses_of_a_wrong_type_are_refused_as_the_users_error(contract: Contract, clause: str, value: object) -> None:
    assert clause in refusal(with_contract(contract, **{clause: value}))


@pytest.mark.parametrize("sizes", [(47, 5), (30, 11)], ids=["5 actions", "30 observations"])
def test_a_network_that_does_not_fit_its_contract_is_refused_when_it_is_loaded(
    contract: Contract, sizes: tuple[int, int]
) -> None:
    num_observations, num_actions = sizes
    layers = [(np.zeros((num_actions, num_observations)), np.zeros(num_actions))]
    refusal(network_bytes(layers, np.zeros(num_observations), np.ones(num_observations), True, contract))
