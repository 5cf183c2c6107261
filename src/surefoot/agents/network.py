"""Networks: filtered observation in, joint targets out, at 25 Hz.

A policy file is one ONNX network. Its metadata holds the `Contract` as JSON: all that a stranger needs to run it on
the robot. The observation's normalisation is inside the network.
"""

from __future__ import annotations

import hashlib

import numpy as np

from surefoot.agents.observing import ObservingAgent
from surefoot.agents.onnx_check import OWN_OPERATORS, check_own_network, metadata, read_model
from surefoot.agents.policy_file import ACTIVATIONS, METADATA_KEY
from surefoot.errors import UserError
from surefoot.task.agent import Command
from surefoot.task.contract import Contract
from surefoot.task.memory import Memory


class NetworkAgent(ObservingAgent):
    """A policy read from a file, run by onnxruntime.

    Args:
        data: the file's bytes.
        name: by which tables show the policy.
        source: by which errors name the file; the name without it.

    Attributes:
        digest: SHA-256 of the file, by which results name the policy; the file refers to no other one.

    Raises:
        UserError: the file is no policy that this version can run.
    """

    def __init__(self, data: bytes, name: str, source: str | None = None):
        source = source or name
        import onnxruntime

        model = read_model(data, source, OWN_OPERATORS)
        text = metadata(model, source).get(METADATA_KEY)
        if text is None:
            raise UserError(f"{source} is not a surefoot policy: its metadata has no '{METADATA_KEY}'")
        check_own_network(model, source)
        checked = model.SerializeToString()
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1
        options.log_severity_level = 4
        try:
            self._session = onnxruntime.InferenceSession(checked, options, providers=["CPUExecutionProvider"])
            ends = self._session.get_inputs(), self._session.get_outputs()
            sizes = tuple([tensor.shape[1:] for tensor in tensors] for tensors in ends)
        except Exception as error:  # onnxruntime raises a family of undocumented types for a corrupt file
            raise UserError(f"{source} is not a policy file: not a readable ONNX network") from error
        try:
            contract = Contract.from_json(text)
        except (ValueError, TypeError, KeyError, AttributeError) as error:
            raise UserError(f"{source} has a policy contract that cannot be read: {error}") from error
        super().__init__(contract)
        self.robot = contract.check()
        self.name = name
        self.digest = hashlib.sha256(data).hexdigest()
        self._data, self._source = data, source
        self._check_sizes(sizes)
        self._input = self._session.get_inputs()[0].name
        self._nominal = np.array(contract.nominal_pose)
        self._memory = self.new_memory()

    def __reduce__(self) -> tuple[type[NetworkAgent], tuple[bytes, str, str]]:
        """A policy travels as its file's bytes, so that a worker need not see the file."""
        return NetworkAgent, (self._data, self.name, self._source)

    def new_memory(self) -> Memory:
        """A memory of what the network takes of the past, for a caller that asks for `actions`."""
        sizes = len(self.contract.observations), len(self.contract.joints)
        return Memory(self.contract.past_observations, self.contract.past_actions, *sizes)

    def prepare(self, num_robots: int) -> None:
        """Get ready for so many robots, and forget those of before."""
        self._memory.prepare(num_robots)

    def reset(self, ids: np.ndarray) -> None:
        """Forget robots `ids` (n,), which begin a trial."""
        if self.has_memory:
            self._memory.reset(ids)

    @property
    def has_memory(self) -> bool:
        """Does the network take more than the present observation?"""
        return self.contract.num_inputs > len(self.contract.observations)

    def _check_sizes(self, found: tuple[list[list[int | str]], ...]) -> None:
        """Check the sizes of the inputs and of the outputs."""
        expected = [self.contract.num_inputs], [len(self.contract.joints)]
        if found != ([expected[0]], [expected[1]]):
            inputs, outputs = found
            raise UserError(f"{self._source} maps {inputs} to {outputs} numbers, not {expected[0]} to {expected[1]}")

    @property
    def data(self) -> bytes:
        """The file's bytes."""
        return self._data

    @property
    def hidden(self) -> tuple[int, ...]:
        """Widths of the hidden layers."""
        return tuple(len(bias) for _, bias in self.stored_layers()[:-1])

    def layers(self, mean: np.ndarray, std: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """(weight, bias) of every layer, as `network_bytes` was given them.

        Args:
            mean: of the inputs (num_inputs,); the first layer then acts on (inputs - mean) / std.
            std: of the inputs (num_inputs,).

        Raises:
            UserError: the network is none of tanh, which is all that learning knows.
        """
        if self.activation != "tanh":
            raise UserError(f"{self.name} has {self.activation} between its layers; only tanh networks can learn on")
        (scaled, bias), *others = self.stored_layers()
        return [((scaled * std).astype(np.float32), (bias + scaled @ mean).astype(np.float32)), *others]

    @property
    def activation(self) -> str:
        """The activation between the layers, a key of `policy_file.ACTIVATIONS`; tanh if there is one layer only."""
        words = {operator: word for word, operator in ACTIVATIONS.items()}
        return next((words[kind] for kind in self._operators()[:-1] if kind in words), "tanh")

    @property
    def squash(self) -> bool:
        """Does a tanh follow the last layer?"""
        return self._operators()[-1] != "Gemm"

    def _operators(self) -> list[str]:
        import onnx

        nodes = onnx.load_model_from_string(self._data).graph.node
        return [node.op_type for node in nodes if node.op_type != "Identity"]

    def stored_layers(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """(weight, bias) of every layer as they stand in the file; the first one's hold the normalisation."""
        import onnx
        from onnx import numpy_helper

        graph = onnx.load_model_from_string(self._data).graph
        tensors = {tensor.name: numpy_helper.to_array(tensor).copy() for tensor in graph.initializer}
        return [(tensors[f"weight_{i}"], tensors[f"bias_{i}"]) for i in range(len(tensors) // 2)]

    def actions(self, inputs: np.ndarray) -> np.ndarray:
        """Actions (n, num_joints) float32 for inputs (n, contract.num_inputs).

        The inputs are filtered observations (n, num_observations), and behind them the past that the contract names.
        The actions are what an environment's `step` takes: joint targets in units of `action_scale`, counted from the
        nominal pose, not clipped.
        """
        return self._session.run(None, {self._input: np.asarray(inputs, np.float32)})[0]

    def __call__(self, inputs: np.ndarray, ids: np.ndarray) -> Command:
        """Joint targets for the filtered observations (n, num_observations) of robots `ids` (n,).

        A network with a memory remembers them, and has to be told of robots by `prepare` and `reset`.
        """
        seen = self._memory.inputs(inputs, ids) if self.has_memory else inputs
        actions = np.clip(np.asarray(self.actions(seen), np.float64), -1.0, 1.0)
        if self.has_memory:
            self._memory.add(inputs, actions, ids)
        return Command(self._nominal + self.contract.action_scale * actions)
