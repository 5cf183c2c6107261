"""Network: a foreign ONNX file, run by onnxruntime alone for many robots at once."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from surefoot.agents.onnx_check import (
    FOREIGN_OPERATORS,
    MAX_BYTES,
    check_growth,
    metadata,
    outside_files,
    read_model,
)
from surefoot.checks import read_bytes
from surefoot.errors import UserError

if TYPE_CHECKING:
    from onnx import ModelProto

_SAME = 1e-4
"""A network that is run for many robots at once may differ from one that is run for each by this share."""


class Network:
    """One vector of observations in, one vector of actions out.

    A file with a batch of 1 is changed in memory to take any number of robots. Where that changes what it answers, it
    is run for one robot after the other.

    Args:
        file: the ONNX file.

    Attributes:
        files: its path, and those of the weights that lie outside it.
        metadata: key -> text, as whoever exported it wrote them.
        num_inputs, num_outputs: numbers per robot.

    Raises:
        UserError: the file cannot be read, has parts that are refused (see `read_model`), or is no network of one input
            and one output vector.
    """

    def __init__(self, file: Path | str):
        self.file = Path(file)
        folder, source = self.file.parent, str(self.file)
        data = read_bytes(self.file, "policy", MAX_BYTES)
        self.files = (self.file, *_outside(data, folder))
        self._model = read_model(data, source, FOREIGN_OPERATORS, folder)
        self.metadata = metadata(self._model, source)
        self._session = self._opened(self._model)
        inputs, outputs = self._session.get_inputs(), self._session.get_outputs()
        if len(inputs) != 1 or not outputs:
            names = ", ".join(each.name for each in inputs)
            raise UserError(f"{self.file}: has {len(inputs)} inputs ({names}); a policy has one vector of observations")
        self._input, self._output = inputs[0].name, outputs[0].name
        self.num_inputs, self.num_outputs = self._size(inputs[0]), self._size(outputs[0])
        check_growth(self._for(1), source)
        self._whole_batch: Any = self._session if isinstance(inputs[0].shape[0], str | None) else self._widened()

    def __call__(self, observations: np.ndarray) -> np.ndarray:
        """Actions (n, num_outputs) float64 for observations (n, num_inputs)."""
        observations = np.asarray(observations, np.float32)
        if self._whole_batch is None:
            rows = [self._run(self._session, observations[row : row + 1]) for row in range(len(observations))]
            return np.concatenate(rows)
        return self._run(self._whole_batch, observations)

    def _run(self, session: Any, observations: np.ndarray) -> np.ndarray:
        return np.asarray(session.run([self._output], {self._input: observations})[0], np.float64)

    def _opened(self, model: ModelProto) -> Any:
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1
        options.log_severity_level = 4
        try:
            return onnxruntime.InferenceSession(model.SerializeToString(), options, providers=["CPUExecutionProvider"])
        except Exception as error:  # onnxruntime raises a family of undocumented types
            raise UserError(f"{self.file} is not a policy file: not a readable ONNX network") from error

    def _size(self, tensor: Any) -> int:
        shape = tensor.shape
        if tensor.type != "tensor(float)" or len(shape) != 2 or not isinstance(shape[1], int):
            raise UserError(
                f"{self.file}: '{tensor.name}' is a {tensor.type} of shape {shape}; a policy's are float vectors, "
                "[robots, numbers]"
            )
        return shape[1]

    def _widened(self) -> Any:
        """The same network for any number of robots; None if it is not the same then."""
        some = np.random.default_rng(0).standard_normal((3, self.num_inputs)).astype(np.float32)
        try:
            session = self._opened(self._for(None))
            together = self._run(session, some)
        except Exception:  # some part of the network insists on a batch of 1
            return None
        alone = np.concatenate([self._run(self._session, some[row : row + 1]) for row in range(len(some))])
        is_same = together.shape == alone.shape and np.allclose(together, alone, rtol=_SAME, atol=_SAME)
        return session if is_same else None

    def _for(self, num_robots: int | None) -> ModelProto:
        """The network for so many robots, or for any number."""
        import onnx

        model = onnx.ModelProto()
        model.CopyFrom(self._model)
        for tensor in (*model.graph.input, *model.graph.output):
            dims = tensor.type.tensor_type.shape.dim
            if dims and num_robots:
                dims[0].dim_value = num_robots
            elif dims:
                dims[0].dim_param = "robots"
        del model.graph.value_info[:]  # what is known of the shapes between them was known for another batch
        return model


def read_metadata(file: Path) -> dict[str, str] | None:
    """The metadata of an ONNX file; None if it is none, or cannot be read."""
    import onnx

    try:
        model = onnx.load_model_from_string(read_bytes(file, "policy", MAX_BYTES))
    except Exception:  # protobuf's and onnx's own types, and the system's
        return None
    return {entry.key: entry.value for entry in model.metadata_props}


def _outside(data: bytes, folder: Path) -> list[Path]:
    """Files in a folder that hold weights of an ONNX file."""
    import onnx

    try:
        return outside_files(onnx.load_model_from_string(data), folder)
    except Exception:  # whoever opens it says so
        return []
