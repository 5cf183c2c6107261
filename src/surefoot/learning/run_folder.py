"""Run folder: the files of a training run, written so that a kill or a full disk loses nothing older.

beginning.json   the origin of the run, and the speed by which its minutes were converted into policy steps
config.json      the configuration
checkpoint.npz   everything needed to continue (networks, optimisers, random generators; arrays and JSON, no pickle),
                 and the newest contents of the files below
curve.csv        the learning curve: one row per validation
best.onnx        the best policy by its validation
last.onnx        the newest policy
kept/*.onnx      every policy that was validated, by its minute
events.out...    TensorBoard logs

A run commits its state only by writing the checkpoint. The files below it in this list are written after it, from its
contents, and written again when the run continues. A best policy, its score and its row of the curve therefore always
agree.
"""

from __future__ import annotations

import io
import json
import re
import shutil
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch

from surefoot.agents.policy_file import SUFFIX
from surefoot.checks import is_number, parse_json, parse_json_table, read_text, shortened
from surefoot.errors import UserError
from surefoot.learning.config import TrainConfig
from surefoot.learning.curve import read_curve
from surefoot.whole_file import sweep, write_whole

KEPT = "kept"
BEST, LAST, CURVE = f"best{SUFFIX}", f"last{SUFFIX}", "curve.csv"
_CONFIG, _BEGINNING, _CHECKPOINT = "config.json", "beginning.json", "checkpoint.npz"
_JSON = "__json__"
_FILE = "__file__/"
_FILES = re.compile(rf"best\{SUFFIX}|last\{SUFFIX}|curve\.csv|{KEPT}/[0-9]+\.[0-9]\{SUFFIX}")
"""Names of the files that a checkpoint may hold."""
_BEGUN_FILES = (_CONFIG, _BEGINNING, CURVE, BEST, LAST, KEPT)
MAX_CHECKPOINT_BYTES = 500_000_000


class RunFolder:
    """One run's folder.

    Args:
        path: of the folder.
    """

    def __init__(self, path: str | Path):
        self.path = Path(path)

    @classmethod
    def create(cls, path: str | Path, config: TrainConfig, start: str = "") -> RunFolder:
        """Make a new folder.

        Args:
            path: of the folder.
            config: of the run.
            start: what the run begins with, if not with new networks.

        Raises:
            UserError: it exists already and holds something.
        """
        folder = cls(path)
        if folder.path.exists() and (not folder.path.is_dir() or folder._is_in_use()):
            raise UserError(f"{path} exists already; resume it with --resume, or give another --run")
        folder.path.mkdir(parents=True, exist_ok=True)
        folder.note(start=start)
        write_whole(folder.path / _CONFIG, config.to_json().encode())
        return folder

    @classmethod
    def begin(cls, path: str | Path, config: TrainConfig, start: str = "") -> RunFolder:
        """Make a new folder, or go on with one that the same command began.

        Arguments are those of `create`.

        Raises:
            UserError: it holds a run of another configuration, or something that no training wrote.
        """
        folder = cls(path)
        sweep(folder.path)
        if not (folder.path / _CONFIG).exists():
            return cls.create(path, config, start)
        if not folder.is_of(config, start):
            raise UserError(f"{path} was begun with other settings; resume it with --resume, or give another --run")
        return folder

    def _is_in_use(self) -> bool:
        """Does it hold more than the first file of a run that was killed right after?"""
        sweep(self.path)
        return any(file.name != _BEGINNING for file in self.path.iterdir())

    def is_of(self, config: TrainConfig, start: str = "") -> bool:
        """Tell whether it was begun with this configuration and with this start, see `create`.

        Raises:
            UserError: the folder is not a run folder.
        """
        # As text, since the functions of extra reward terms do not come back from it.
        told = parse_json(read_text(self.path / _CONFIG, "training configuration"), f"{self.path / _CONFIG}")
        return told == json.loads(config.to_json()) and self.beginning().get("start", start) == start

    @property
    def has_checkpoint(self) -> bool:
        """Can a run go on from here?"""
        return (self.path / _CHECKPOINT).exists()

    def config(self) -> TrainConfig:
        """Return the configuration.

        Raises:
            UserError: the folder is not a run folder.
        """
        file = self.path / _CONFIG
        if not file.exists():
            raise UserError(f"{self.path} is not a run folder: cannot read {file.name}")
        try:
            return TrainConfig.from_json(read_text(file, "training configuration"))
        except (ValueError, TypeError, KeyError, AttributeError) as error:
            raise UserError(f"{file} cannot be read as a training configuration: {error}") from error

    def beginning(self) -> dict[str, Any]:
        """Return what the run began with, see `note`; nothing for a run of version 0.1.

        Raises:
            UserError: the file is damaged.
        """
        file = self.path / _BEGINNING
        return parse_json_table(read_text(file, "beginning"), str(file)) if file.exists() else {}

    def note(self, **entries: Any) -> None:
        """Add to what is known of the run's beginning: "start", and the speed that was measured."""
        write_whole(self.path / _BEGINNING, json.dumps({**self.beginning(), **entries}, indent=2).encode())

    def save_checkpoint(
        self, parameters: dict[str, dict[str, Any]], state: dict[str, Any], files: Mapping[str, bytes] | None = None
    ) -> None:
        """Keep SB3's `get_parameters()`, a JSON-able state and the run's files, all of them or none.

        Args:
            parameters: of the networks and optimisers.
            state: all else that is needed to go on.
            files: name in the folder -> content.

        Raises:
            UserError: it could not be written, a full disk for example.
        """
        arrays: dict[str, np.ndarray] = {}
        skeleton = _take_arrays({"parameters": parameters, "state": state}, "", arrays)
        arrays[_JSON] = np.array(json.dumps(skeleton))
        files = files or {}
        arrays |= {_FILE + name: np.frombuffer(data, np.uint8) for name, data in files.items()}
        buffer = io.BytesIO()
        np.savez(buffer, allow_pickle=False, **arrays)
        write_whole(self.path / _CHECKPOINT, buffer.getvalue())
        self._settle(files)

    def load_checkpoint(self) -> tuple[dict[str, dict[str, Any]], dict[str, Any]]:
        """Return the parameters and the state that `save_checkpoint` kept.

        Raises:
            UserError: there is no checkpoint, or it is damaged.
        """
        file = self.path / _CHECKPOINT
        try:
            _check_archive(file)
            with file.open("rb") as stream, np.load(stream, allow_pickle=False) as arrays:
                whole = _put_arrays(parse_json(str(arrays[_JSON]), "its JSON"), arrays)
            _check_counts(whole["state"])
            return whole["parameters"], whole["state"]
        except FileNotFoundError as error:
            raise UserError(f"{self.path} has no checkpoint to resume from") from error
        except _DAMAGE as error:
            raise UserError(f"{file} is damaged: {error}") from error

    def num_steps(self) -> int:
        """Policy steps of this run until its checkpoint.

        Raises:
            UserError: there is no checkpoint, or it is damaged.
        """
        _, state = self.load_checkpoint()
        return int(self._count(state, "steps") - state.get("inherited", {}).get("policy_steps", 0))

    def seconds(self) -> float:
        """Time that this run has learned until its checkpoint [s]; errors are those of `num_steps`."""
        _, state = self.load_checkpoint()
        return float(self._count(state, "seconds"))

    def _count(self, state: Mapping[str, Any], name: str) -> float:
        if name not in state:
            raise UserError(f"{self.path / _CHECKPOINT} is damaged: it does not say its {name}")
        return float(state[name])

    def restore_files(self) -> dict[str, bytes]:
        """Return the files that the checkpoint holds, after making the folder's own agree with them.

        A checkpoint of version 0.1 holds none; the folder's own are then returned, without a row of the curve that a
        kill cut short.

        Raises:
            UserError: the checkpoint is damaged.
        """
        file = self.path / _CHECKPOINT
        try:
            _check_archive(file)
            with file.open("rb") as stream, np.load(stream, allow_pickle=False) as arrays:
                names = [name.removeprefix(_FILE) for name in arrays.files if name.startswith(_FILE)]
                strange = [name for name in names if not _FILES.fullmatch(name)]
                if strange:
                    raise ValueError(f"it holds a file named '{strange[0][:60]}'")
                files = {name: arrays[_FILE + name].astype(np.uint8).tobytes() for name in names}
        except _DAMAGE as error:
            raise UserError(f"{file} is damaged: {error}") from error
        if not files:
            files = {name: (self.path / name).read_bytes() for name in (BEST, LAST) if (self.path / name).exists()}
            if (self.path / CURVE).exists():
                files[CURVE] = _whole_rows((self.path / CURVE).read_bytes())
        self._settle(files)
        return files

    def _settle(self, files: Mapping[str, bytes]) -> None:
        """Make the folder's files those of a checkpoint."""
        sweep(self.path)
        sweep(self.path / KEPT)
        for name, data in files.items():
            file = self.path / name
            file.parent.mkdir(exist_ok=True)
            if not file.exists() or file.read_bytes() != data:
                write_whole(file, data)

    def curve(self) -> list[dict[str, float]]:
        """The learning curve so far."""
        file = self.path / CURVE
        return read_curve(file) if file.exists() else []


def discard_beginning(path: Path) -> None:
    """Remove what a training left that was killed before its first checkpoint.

    Raises:
        UserError: the folder holds something that no training wrote.
    """
    if not path.exists():
        return
    if not path.is_dir():
        raise UserError(f"{path} exists already and is no folder; give another folder")
    strange = [f.name for f in path.iterdir() if f.name not in _BEGUN_FILES and not f.name.startswith((".", "events."))]
    if strange:
        raise UserError(f"{path} holds {strange[0]}, which no training wrote; give another folder")
    shutil.rmtree(path)


_DAMAGE = (
    OSError, ValueError, KeyError, TypeError, AttributeError, IndexError, EOFError, RecursionError, zipfile.BadZipFile,
    NotImplementedError,  # of a zip file of a later version
)  # fmt: skip
"""The errors of reading a damaged checkpoint."""


def _check_counts(state: Mapping[str, Any]) -> None:
    """Check what is counted on from one session to the next; ValueError for anything but numbers."""
    inherited = state.get("inherited", {})
    if not isinstance(inherited, dict):
        raise ValueError(f"inherited must be a table, not {shortened(inherited)}")
    for name, value in {**state, **inherited}.items():
        if name in ("steps", "seconds", "policy_steps", "minutes") and not is_number(value):
            raise ValueError(f"{name} must be a number, not {shortened(value)}")


def _check_archive(file: Path) -> None:
    """Check that a checkpoint is a plain archive, which needs no more memory than its size on disk."""
    if file.stat().st_size > MAX_CHECKPOINT_BYTES:
        raise ValueError(f"it has more than {MAX_CHECKPOINT_BYTES:,} bytes")
    with zipfile.ZipFile(file) as archive:
        entries = archive.infolist()
    if any(entry.compress_type != zipfile.ZIP_STORED for entry in entries):
        raise ValueError("it is compressed")
    if sum(entry.file_size for entry in entries) > MAX_CHECKPOINT_BYTES:
        raise ValueError(f"it holds more than {MAX_CHECKPOINT_BYTES:,} bytes")


def _whole_rows(curve: bytes) -> bytes:
    """The curve without a last row that was cut short."""
    lines = curve.splitlines(keepends=True)
    if lines and (not lines[-1].endswith(b"\n") or lines[-1].count(b",") != lines[0].count(b",")):
        lines.pop()
    return b"".join(lines)


def _take_arrays(value: Any, path: str, arrays: dict[str, np.ndarray]) -> Any:
    """A copy of nested dicts and lists in which every tensor or array is replaced by a reference to `arrays`."""
    if isinstance(value, torch.Tensor | np.ndarray):
        arrays[path] = value.detach().cpu().numpy() if isinstance(value, torch.Tensor) else value
        return {"array": path, "tensor": isinstance(value, torch.Tensor)}
    if isinstance(value, dict):
        items = [[key, _take_arrays(item, f"{path}/{key}", arrays)] for key, item in value.items()]
        return {"dict": items}  # as pairs, since an optimiser's keys are integers
    if isinstance(value, list | tuple):
        return {"list": [_take_arrays(item, f"{path}/{i}", arrays) for i, item in enumerate(value)]}
    return {"value": value}


def _put_arrays(value: Any, arrays: Any) -> Any:
    """The inverse of `_take_arrays`; tuples come back as lists."""
    if "array" in value:
        array = arrays[value["array"]]
        return torch.from_numpy(array.copy()) if value["tensor"] else array
    if "dict" in value:
        return {key: _put_arrays(item, arrays) for key, item in value["dict"]}
    if "list" in value:
        return [_put_arrays(item, arrays) for item in value["list"]]
    return value["value"]
