"""ONNX check: the checks of unknown ONNX files before anything runs them, so that their bytes alone define their work.

A file that passes has only operators of a fixed list, brings no code of its own, and cannot grow in memory beyond a
limit. A policy of surefoot refers to no other file. A foreign policy may have its weights in a file beside it, which is
then part of its digest. All other files are refused before onnxruntime sees them.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

import numpy as np

from surefoot.checks import read_bytes, shortened
from surefoot.errors import UserError

if TYPE_CHECKING:
    from onnx import AttributeProto, ModelProto, TensorProto, ValueInfoProto

MAX_BYTES = 64_000_000
"""Of a file."""
MAX_ELEMENTS = 8_000_000
"""Of a tensor: the largest layer of a network of 2,800 units a layer."""
MAX_NODES = 1_000
OWN_OPERATORS = ("Gemm", "Tanh", "Relu", "Elu", "Identity")
"""The operators of networks that surefoot wrote."""
FOREIGN_OPERATORS = (
    "Gemm", "MatMul", "Conv", "LSTM", "GRU", "Add", "Sub", "Mul", "Div", "Neg", "Abs", "Sqrt", "Reciprocal", "Pow",
    "Exp", "Log", "Erf", "Sin", "Cos", "Min", "Max", "Clip", "Relu", "LeakyRelu", "PRelu", "Elu", "Selu", "Celu",
    "Gelu", "Sigmoid", "HardSigmoid", "HardSwish", "Mish", "Tanh", "Softplus", "Softsign", "Softmax", "LogSoftmax",
    "LayerNormalization", "BatchNormalization", "ReduceMean", "ReduceSum", "ReduceMax", "ReduceMin", "ReduceL2",
    "Identity", "Dropout", "Cast", "Constant", "Concat", "Split", "Slice", "Gather", "Reshape", "Flatten", "Squeeze",
    "Unsqueeze", "Transpose", "Shape", "Where", "Equal", "Less", "Greater", "Not", "And", "Or",
)  # fmt: skip
"""The operators that exporters write for trained networks. None of them runs a subgraph or makes a tensor whose size
follows from its inputs' values."""
_DOMAINS = ("", "ai.onnx")


def read_model(data: bytes, source: str, operators: Collection[str], folder: Path | None = None) -> ModelProto:
    """Return the model of an ONNX file of which every part has been looked at; run this model, not the file's bytes.

    It refers to no other file; it has operators of a list and of ONNX's own set only, no subgraph, no function and no
    sparse tensor; its tensors are small, whole and finite; and its nodes are fewer than `MAX_NODES`.

    A foreign model may have weights in files of one folder, which are read into it, and numbers of other kinds.

    Args:
        data: the file's bytes.
        source: by which errors name the file.
        operators: those that the network may have. `Loop`, `If` and `Scan` can never be among them, since their
            subgraphs are refused.
        folder: of the files in which weights of a foreign model may lie; None for a model of surefoot's.

    Raises:
        UserError: the file is no ONNX file, or has anything else.
    """
    model = _parsed(data, source)
    is_foreign = folder is not None
    if model.functions or model.training_info or model.graph.sparse_initializer:
        raise UserError(f"{source} is refused: it has functions, training code or sparse tensors of its own")
    if len(model.graph.node) > MAX_NODES:
        raise UserError(f"{source} is refused: it has {len(model.graph.node)} nodes, more than {MAX_NODES}")
    for node in model.graph.node:
        if node.domain not in _DOMAINS or node.op_type not in operators:
            valid = ", ".join(operators)
            raise UserError(f"{source} is refused: it has the operator '{node.op_type[:60]}'; valid: {valid}")
        for attribute in node.attribute:
            _check_attribute(attribute, source, is_foreign)
    for tensor in model.graph.initializer:
        if folder is not None:
            _take_in(tensor, folder, source)
        _check_tensor(tensor, source, is_foreign)
    return model


def _parsed(data: bytes, source: str) -> ModelProto:
    """The model of a file of which nothing has been looked at but its size."""
    import onnx

    if len(data) > MAX_BYTES:
        raise UserError(f"{source} is not a policy file: it has {len(data):,} bytes, more than {MAX_BYTES:,}")
    model = onnx.ModelProto()
    try:
        model.ParseFromString(data)
        model.DiscardUnknownFields()  # onnxruntime may know a field that this version of onnx does not
    except Exception as error:  # protobuf's error type depends on how it was built
        raise UserError(f"{source} is not a policy file: not a readable ONNX network") from error
    if not model.graph.node:
        raise UserError(f"{source} is not a policy file: not a readable ONNX network")
    return model


def outside_files(model: ModelProto, folder: Path) -> list[Path]:
    """Return the files in a folder that hold weights of a model."""
    entries = [entry for tensor in model.graph.initializer for entry in tensor.external_data]
    return [folder / place for place in dict.fromkeys(entry.value for entry in entries if entry.key == "location")]


def check_growth(model: ModelProto, source: str) -> None:
    """Check that no value of a model is larger than a tensor may be, as far as their sizes follow from the file.

    Args:
        model: with a batch of 1.
        source: by which errors name the file.

    Raises:
        UserError: one is, or its parts do not fit together.
    """
    import onnx

    try:
        inferred = onnx.shape_inference.infer_shapes(model, strict_mode=True, data_prop=True)
    except Exception as error:  # onnx has no error type of its own for it
        raise UserError(f"{source} is not a policy file: not a readable ONNX network") from error
    for value in (*inferred.graph.value_info, *inferred.graph.output):
        sizes = [dim.dim_value for dim in value.type.tensor_type.shape.dim if dim.HasField("dim_value")]
        if _product(sizes) > MAX_ELEMENTS:
            raise UserError(
                f"{source} is refused: its value '{value.name[:60]}' has more than {MAX_ELEMENTS:,} elements"
            )


def check_own_network(model: ModelProto, source: str) -> None:
    """Check that a model is a network as `network_bytes` writes it: a chain of linear layers and activations.

    Raises:
        UserError: it is another one. The message names the first thing that differs.
    """
    graph = model.graph
    _check_value(graph.input, "input", source)
    _check_value(graph.output, "output", source)
    tensors = {tensor.name: tuple(tensor.dims) for tensor in graph.initializer}
    if len(tensors) != len(graph.initializer):
        raise UserError(f"{source} is refused: two of its tensors have the same name")
    value, num_layers = graph.input[0].name, 0
    for node in graph.node:
        given = list(node.input)
        if not given or given[0] != value or len(node.output) != 1:
            raise UserError(f"{source} is refused: its layers are no chain")
        names = given[1:]
        expected = [f"weight_{num_layers}", f"bias_{num_layers}"] if node.op_type == "Gemm" else []
        if names != expected or not set(names) <= set(tensors):
            raise UserError(f"{source} is refused: a layer has not just a weight and a bias of its own")
        if names and (len(tensors[names[0]]), len(tensors[names[1]])) != (2, 1):
            raise UserError(f"{source} is refused: a layer's weight is no matrix, or its bias no vector")
        settings = {attribute.name: (attribute.i, attribute.f) for attribute in node.attribute}
        if settings != ({"transB": (1, 0.0)} if names else {}):
            raise UserError(f"{source} is refused: the operator '{node.op_type}' has settings that no policy has")
        num_layers += bool(names)
        value = node.output[0]
    if value != graph.output[0].name or 2 * num_layers != len(tensors):
        raise UserError(f"{source} is refused: its layers do not end in its output, or some of its tensors are unused")


def _check_value(values: Iterable[ValueInfoProto], kind: str, source: str) -> None:
    """Check that a graph has one input or output: float32 numbers for any number of robots."""
    import onnx

    found = list(values)
    types = [value.type.tensor_type for value in found]
    fits = len(found) == 1 and types[0].elem_type == onnx.TensorProto.FLOAT and len(types[0].shape.dim) == 2
    if not fits or types[0].shape.dim[0].HasField("dim_value"):
        raise UserError(f"{source} is refused: its {kind} must be one float32 array (robots, numbers)")


def _check_attribute(attribute: AttributeProto, source: str, is_foreign: bool) -> None:
    import onnx

    kinds = onnx.AttributeProto
    if attribute.type == kinds.TENSOR:
        _check_tensor(attribute.t, source, is_foreign)
        return
    plain = (kinds.FLOAT, kinds.INT, kinds.STRING, kinds.FLOATS, kinds.INTS, kinds.STRINGS)
    if attribute.type not in plain or attribute.ref_attr_name or attribute.HasField("g") or attribute.graphs:
        raise UserError(f"{source} is refused: '{attribute.name[:60]}' of an operator is no plain number or text")


def _take_in(tensor: TensorProto, folder: Path, source: str) -> None:
    """Read a tensor that lies in a file of a folder into the model itself."""
    import onnx

    if tensor.data_location != onnx.TensorProto.EXTERNAL:
        return
    told = {entry.key: entry.value for entry in tensor.external_data}
    place, name = PurePosixPath(told.get("location", "")), tensor.name[:60]
    if place.is_absolute() or ".." in place.parts or "\\" in str(place) or not place.parts:
        raise UserError(
            f"{source} is refused: its tensor '{name}' lies in {shortened(str(place))}, not in a file beside it"
        )
    data = read_bytes(folder / place, "weights", MAX_BYTES)
    try:
        offset = int(told.get("offset", 0))
        length = int(told.get("length", len(data) - offset))
    except ValueError as error:
        raise UserError(f"{source} is refused: the place of its tensor '{name}' is no number") from error
    if not 0 <= offset <= offset + length <= len(data):
        raise UserError(f"{source} is refused: its tensor '{name}' lies beyond the end of {place}")
    del tensor.external_data[:]
    tensor.data_location = onnx.TensorProto.DEFAULT
    tensor.raw_data = data[offset : offset + length]


def _check_tensor(tensor: TensorProto, source: str, is_foreign: bool) -> None:
    """Check that a tensor lies in the file, is as large as it says, and is finite; a foreign one may hold infinity."""
    import onnx
    from onnx import numpy_helper

    name, kinds = tensor.name[:60], onnx.TensorProto
    if tensor.external_data or tensor.data_location != kinds.DEFAULT:
        raise UserError(f"{source} is refused: its tensor '{name}' lies in another file, which may change")
    if min(tensor.dims, default=1) < 0 or _product(tensor.dims) > MAX_ELEMENTS:
        raise UserError(f"{source} is refused: its tensor '{name}' has more than {MAX_ELEMENTS:,} elements")
    valid = (kinds.FLOAT, kinds.INT64)
    if tensor.data_type not in ((*valid, kinds.DOUBLE, kinds.INT32, kinds.BOOL) if is_foreign else valid):
        raise UserError(f"{source} is refused: its tensor '{name}' holds neither float32 nor int64 numbers")
    try:
        array: np.ndarray = numpy_helper.to_array(tensor)
    except Exception as error:  # onnx has no error type of its own for a tensor whose data do not fit its size
        raise UserError(f"{source} is refused: its tensor '{name}' has not as many elements as it says") from error
    if np.isnan(array).any() if is_foreign else not np.isfinite(array).all():
        raise UserError(f"{source} is refused: its tensor '{name}' has numbers that are not finite")


def _product(sizes: Iterable[int]) -> int:
    """The product of whole numbers, without an overflow."""
    product = 1
    for size in sizes:
        product *= size
    return product


def metadata(model: ModelProto, source: str) -> dict[str, str]:
    """Return the metadata of a model.

    Raises:
        UserError: a key stands in it twice, so that two readers could read different things.
    """
    found = {pair.key: pair.value for pair in model.metadata_props}
    if len(found) != len(model.metadata_props):
        raise UserError(f"{source} is refused: a key stands in its metadata twice")
    return found
