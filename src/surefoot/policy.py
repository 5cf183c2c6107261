"""Policy: filtered observation in, action out, at 25 Hz; and the file that carries one without torch or pickle.

A policy file is one ONNX network. Its metadata holds the `Contract` as JSON: all that a stranger needs to run it on
the robot. The observation's normalisation is inside the network.
"""

from __future__ import annotations

import dataclasses
import hashlib
import importlib.resources
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from surefoot import observation
from surefoot.errors import UserError
from surefoot.robot import Robot, load_robot
from surefoot.signals import CUTOFF_HZ
from surefoot.simulation import CONTROL_HZ, POLICY_HZ

METADATA_KEY = "surefoot"
FORMAT = 1
SUFFIX = ".onnx"
BEST = {"best": "ddpg"}
"""The shipped policy that rejects most has this name too."""


@dataclass(frozen=True)
class Contract:
    """All that is needed to use a policy.

    Attributes:
        robot: its name.
        joints: joint order of the action and of the observation's joint parts.
        nominal_pose: joint angles that an action of zero means [rad].
        action_scale: joint angle [rad] per unit of action, which is clipped to [-1, 1] first.
        observations: names of the observation's components, in order.
        stiffness, damping: impedance gains per joint [Nm/rad, Nms/rad].
        torque_limit, velocity_limit: per joint [Nm, rad/s].
        policy_hz, control_hz: rates of the policy and of the joint control.
        filter_cutoff_hz: of the first-order Butterworth low-pass on the observation at `control_hz`.
        target_path: how joint targets are reached within a policy step.
        training: where the policy comes from (algorithm, preset, seed, steps, minutes, versions).
    """

    robot: str
    joints: tuple[str, ...]
    nominal_pose: tuple[float, ...]
    action_scale: float
    observations: tuple[str, ...]
    stiffness: tuple[float, ...]
    damping: tuple[float, ...]
    torque_limit: tuple[float, ...]
    velocity_limit: tuple[float, ...]
    policy_hz: int = POLICY_HZ
    control_hz: int = CONTROL_HZ
    filter_cutoff_hz: float = CUTOFF_HZ
    target_path: str = "cubic"
    training: dict[str, Any] = field(default_factory=dict)
    format: int = FORMAT

    @classmethod
    def of(cls, robot: Robot, pose: str, action_scale: float, training: dict[str, Any] | None = None) -> Contract:
        """The contract of a policy for this robot as this version of surefoot runs it."""
        return cls(
            robot=robot.name,
            joints=robot.joint_names,
            nominal_pose=tuple(robot.pose(pose).tolist()),
            action_scale=action_scale,
            observations=observation.component_names(robot),
            stiffness=tuple(robot.stiffness.tolist()),
            damping=tuple(robot.damping.tolist()),
            torque_limit=tuple(robot.torque_limit.tolist()),
            velocity_limit=tuple(robot.velocity_limit.tolist()),
            training=training or {},
        )

    def check(self) -> Robot:
        """The robot that the policy is for.

        Raises:
            UserError: this version of surefoot cannot honour the contract.
        """
        robot = load_robot(self.robot)
        self._check_numbers(robot)
        expected = Contract.of(robot, next(iter(robot.poses)), self.action_scale)
        free = {"nominal_pose", "action_scale", "training"}
        for name in (f.name for f in dataclasses.fields(self) if f.name not in free):
            if getattr(self, name) != getattr(expected, name):
                raise UserError(
                    f"policy's {name} is {getattr(self, name)}, but {robot.name} has {getattr(expected, name)}"
                )
        return robot

    def _check_numbers(self, robot: Robot) -> None:
        pose, scale = self.nominal_pose, self.action_scale
        if not (isinstance(pose, tuple) and len(pose) == robot.num_joints and all(map(_is_finite, pose))):
            raise UserError(f"policy's nominal_pose must be {robot.num_joints} finite angles, not {pose}")
        if not (_is_finite(scale) and scale > 0):
            raise UserError(f"policy's action_scale must be positive, not {scale}")

    def to_json(self) -> str:
        return json.dumps(dataclasses.asdict(self))

    @classmethod
    def from_json(cls, text: str) -> Contract:
        """Raises ValueError, TypeError or KeyError for anything that `to_json` does not write."""
        values: Any = {k: tuple(v) if isinstance(v, list) else v for k, v in json.loads(text).items()}
        return cls(**values)


def _is_finite(value: object) -> bool:
    return isinstance(value, int | float) and math.isfinite(value)


class Entrant(Protocol):
    """Whoever enters the trials, a policy or a controller: by what results name it."""

    @property
    def name(self) -> str: ...

    @property
    def contract(self) -> Contract: ...

    @property
    def digest(self) -> str:
        """By which results name it: equal only for those that act alike."""
        ...


class Policy(Entrant, Protocol):
    """Anything that maps what a robot can measure to joint targets."""

    def reset(self, ids: np.ndarray) -> None:
        """Robots `ids` (n,) begin a trial: forget them."""

    def __call__(self, observations: np.ndarray, ids: np.ndarray) -> np.ndarray:
        """Actions (n, num_joints) for the filtered observations (n, 47) of robots `ids` (n,)."""
        ...


class NetworkPolicy:
    """A policy read from a file, run by onnxruntime.

    Args:
        data: the file's bytes.
        name: by which tables show the policy.
        source: by which errors name the file; the name without it.

    Attributes:
        digest: SHA-256 of the file, by which results name the policy.
    """

    def __init__(self, data: bytes, name: str, source: str | None = None):
        source = source or name
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1
        options.log_severity_level = 4
        try:
            self._session = onnxruntime.InferenceSession(data, options, providers=["CPUExecutionProvider"])
        except Exception as error:  # onnxruntime raises a family of undocumented types for a corrupt file
            raise UserError(f"{source} is not a policy file: not a readable ONNX network") from error
        text = self._session.get_modelmeta().custom_metadata_map.get(METADATA_KEY)
        if text is None:
            raise UserError(f"{source} is not a surefoot policy: its metadata has no '{METADATA_KEY}'")
        try:
            self.contract = Contract.from_json(text)
        except (ValueError, TypeError, KeyError, AttributeError) as error:
            raise UserError(f"{source} has a policy contract that cannot be read: {error}") from error
        self.robot = self.contract.check()
        self.name = name
        self.digest = hashlib.sha256(data).hexdigest()
        self._data = data
        self._check_sizes(source)
        self._input = self._session.get_inputs()[0].name

    def _check_sizes(self, source: str) -> None:
        expected = [len(self.contract.observations)], [len(self.contract.joints)]
        found = [t.shape[1:] for t in self._session.get_inputs()], [t.shape[1:] for t in self._session.get_outputs()]
        if found != ([expected[0]], [expected[1]]):
            raise UserError(f"{source} maps {found[0]} to {found[1]} numbers, not {expected[0]} to {expected[1]}")

    @property
    def hidden(self) -> tuple[int, ...]:
        """Widths of the hidden layers."""
        return tuple(len(bias) for _, bias in self._stored_layers()[:-1])

    def layers(self, mean: np.ndarray, std: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """(weight, bias) of every layer, the first one as it acts on (observation - mean) / std: what `network_bytes`
        was given."""
        (scaled, bias), *others = self._stored_layers()
        return [((scaled * std).astype(np.float32), (bias + scaled @ mean).astype(np.float32)), *others]

    def _stored_layers(self) -> list[tuple[np.ndarray, np.ndarray]]:
        import onnx
        from onnx import numpy_helper

        graph = onnx.load_model_from_string(self._data).graph
        tensors = {tensor.name: numpy_helper.to_array(tensor).copy() for tensor in graph.initializer}
        return [(tensors[f"weight_{i}"], tensors[f"bias_{i}"]) for i in range(len(tensors) // 2)]

    def reset(self, ids: np.ndarray) -> None:
        """A feed-forward network remembers nothing."""

    def __call__(self, observations: np.ndarray, ids: np.ndarray) -> np.ndarray:
        return self._session.run(None, {self._input: np.asarray(observations, np.float32)})[0]


class NominalPolicy:
    """Holds the nominal pose by the joint impedance alone: the least that any policy has to beat."""

    def __init__(self, robot: Robot | None = None, pose: str = "bent", action_scale: float = 1.0):
        robot = robot or load_robot()
        self.name = f"nominal-{pose}"
        self.contract = Contract.of(robot, pose, action_scale)
        self.digest = hashlib.sha256(self.contract.to_json().encode()).hexdigest()

    def reset(self, ids: np.ndarray) -> None:
        """Nothing to forget."""

    def __call__(self, observations: np.ndarray, ids: np.ndarray) -> np.ndarray:
        return np.zeros((len(observations), len(self.contract.joints)))


def shipped_policies() -> tuple[str, ...]:
    """Names of the policies that come with the package."""
    folder = importlib.resources.files("surefoot") / "policies"
    if not folder.is_dir():
        return ()
    return tuple(sorted(file.name.removesuffix(SUFFIX) for file in folder.iterdir() if file.name.endswith(SUFFIX)))


def load_policy(name: str | Path) -> NetworkPolicy:
    """Read a policy that comes with the package, a policy file, or the best policy of a run folder.

    "best" is the shipped policy that rejects most.

    Raises:
        UserError: there is no such policy, or it is not one that this version can run.
    """
    name = BEST.get(str(name), name)
    if str(name) in shipped_policies():
        file = importlib.resources.files("surefoot") / "policies" / f"{name}{SUFFIX}"
        return NetworkPolicy(file.read_bytes(), str(name))
    path = Path(name)
    path_of_file = path / f"best{SUFFIX}" if path.is_dir() else path
    try:
        data = path_of_file.read_bytes()
    except OSError as error:
        shipped = f"; shipped policies: {', '.join(shipped_policies())}" if shipped_policies() else ""
        raise UserError(f"cannot read policy {path_of_file}: {error.strerror or error}{shipped}") from error
    return NetworkPolicy(data, name=path.stem, source=str(path_of_file))


def network_bytes(
    layers: list[tuple[np.ndarray, np.ndarray]], mean: np.ndarray, std: np.ndarray, squash: bool, contract: Contract
) -> bytes:
    """A policy file: (observation - mean) / std through a tanh network.

    Args:
        layers: (weight (out, in), bias (out,)) of every linear layer; tanh between them.
        mean, std: of the observation (47,).
        squash: tanh on the output too.
    """
    import onnx
    from onnx import TensorProto, helper, numpy_helper

    # The normalisation is folded into the first layer: W (x - mean) / std + b.
    first_weight, first_bias = layers[0]
    scaled = first_weight / std
    layers = [(scaled, first_bias - scaled @ mean), *layers[1:]]
    nodes, tensors, value = [], [], "observation"
    for i, (weight, bias) in enumerate(layers):
        tensors.append(numpy_helper.from_array(weight.astype(np.float32), f"weight_{i}"))
        tensors.append(numpy_helper.from_array(bias.astype(np.float32), f"bias_{i}"))
        nodes.append(helper.make_node("Gemm", [value, f"weight_{i}", f"bias_{i}"], [f"linear_{i}"], transB=1))
        value = f"linear_{i}"
        if squash or i < len(layers) - 1:
            nodes.append(helper.make_node("Tanh", [value], [f"tanh_{i}"]))
            value = f"tanh_{i}"
    nodes.append(helper.make_node("Identity", [value], ["action"]))
    graph = helper.make_graph(
        nodes,
        "policy",
        [helper.make_tensor_value_info("observation", TensorProto.FLOAT, ["robots", layers[0][0].shape[1]])],
        [helper.make_tensor_value_info("action", TensorProto.FLOAT, ["robots", layers[-1][0].shape[0]])],
        tensors,
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    helper.set_model_props(model, {METADATA_KEY: contract.to_json()})
    onnx.checker.check_model(model)
    return model.SerializeToString()


def with_record(data: bytes, **entries: Any) -> bytes:
    """A policy file with further entries in its training record."""
    import onnx

    model = onnx.load_model_from_string(data)
    (text,) = [pair.value for pair in model.metadata_props if pair.key == METADATA_KEY]
    contract = Contract.from_json(text)
    del model.metadata_props[:]
    contract = dataclasses.replace(contract, training=contract.training | entries)
    onnx.helper.set_model_props(model, {METADATA_KEY: contract.to_json()})
    return model.SerializeToString()


def mean_bytes(policies: Sequence[bytes], **entries: Any) -> bytes:
    """A policy file whose weights are the mean of several's, else like the last one.

    Args:
        policies: files of one network's shape, from a single run.
        entries: for its training record.
    """
    import onnx
    from onnx import numpy_helper

    models = [onnx.load_model_from_string(data) for data in policies]
    for tensors in zip(*(model.graph.initializer for model in models), strict=True):
        mean = np.mean([numpy_helper.to_array(tensor) for tensor in tensors], axis=0)
        tensors[-1].CopyFrom(numpy_helper.from_array(mean, tensors[-1].name))
    return with_record(models[-1].SerializeToString(), mean_of=len(models), **entries)
