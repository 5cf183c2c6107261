"""Run folder: what a training run leaves on disk, written so that an interrupt or a full disk loses nothing older.

config.json      the configuration
curve.csv        the learning curve: one row per validation
checkpoint.npz   everything needed to go on: networks, optimisers, random generators (arrays and JSON, no pickle)
best.onnx        the best policy by its validation
last.onnx        the newest one
kept/*.onnx      every policy that was validated, by its minute
events.out...    TensorBoard logs
"""

from __future__ import annotations

import csv
import io
import json
import os
import shutil
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import torch

from surefoot.agents.policy_file import SUFFIX
from surefoot.errors import UserError
from surefoot.learning.config import TrainConfig
from surefoot.learning.curve import read_curve

KEPT = "kept"
_JSON = "__json__"
_RUN_FILES = ("config.json", "curve.csv", "best.onnx", "last.onnx")


class RunFolder:
    """One run's folder.

    Args:
        path: of the folder.
    """

    def __init__(self, path: str | Path):
        self.path = Path(path)

    @classmethod
    def create(cls, path: str | Path, config: TrainConfig) -> RunFolder:
        """Make a new folder.

        Raises:
            UserError: it exists already and holds something.
        """
        folder = cls(path)
        if folder.path.exists() and (not folder.path.is_dir() or any(folder.path.iterdir())):
            raise UserError(f"{path} exists already; resume it with --resume, or give another --run")
        folder.path.mkdir(parents=True, exist_ok=True)
        write_whole(folder.path / "config.json", config.to_json().encode())
        return folder

    @property
    def has_checkpoint(self) -> bool:
        """Can a run go on from here?"""
        return (self.path / "checkpoint.npz").exists()

    def config(self) -> TrainConfig:
        """Return the configuration.

        Raises:
            UserError: the folder is not a run folder.
        """
        file = self.path / "config.json"
        try:
            return TrainConfig.from_json(file.read_text())
        except OSError as error:
            raise UserError(f"{self.path} is not a run folder: cannot read {file.name}") from error
        except (ValueError, TypeError, KeyError, AttributeError) as error:
            raise UserError(f"{file} cannot be read as a training configuration: {error}") from error

    def save_checkpoint(self, parameters: dict[str, dict[str, Any]], state: dict[str, Any]) -> None:
        """Keep SB3's `get_parameters()` and a JSON-able state."""
        arrays: dict[str, np.ndarray] = {}
        skeleton = _take_arrays({"parameters": parameters, "state": state}, "", arrays)
        buffer = io.BytesIO()
        arrays[_JSON] = np.array(json.dumps(skeleton))
        np.savez(buffer, allow_pickle=False, **arrays)
        write_whole(self.path / "checkpoint.npz", buffer.getvalue())

    def load_checkpoint(self) -> tuple[dict[str, dict[str, Any]], dict[str, Any]]:
        """What `save_checkpoint` kept.

        Raises:
            UserError: there is no checkpoint, or it is damaged.
        """
        file = self.path / "checkpoint.npz"
        try:
            with file.open("rb") as stream, np.load(stream, allow_pickle=False) as arrays:
                whole = _put_arrays(json.loads(str(arrays[_JSON])), arrays)
            return whole["parameters"], whole["state"]
        except FileNotFoundError as error:
            raise UserError(f"{self.path} has no checkpoint to resume from") from error
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
            raise UserError(f"{file} is damaged: {error}") from error

    def save_policy(self, name: str, data: bytes) -> None:
        """Keep a policy file under "best", "last" or `KEPT`/minute."""
        file = self.path / f"{name}{SUFFIX}"
        file.parent.mkdir(exist_ok=True)
        write_whole(file, data)

    def append_curve(self, row: dict[str, float]) -> None:
        """Add a row to the learning curve."""
        file = self.path / "curve.csv"
        new = not file.exists()
        with file.open("a", newline="") as stream:
            writer = csv.DictWriter(stream, fieldnames=list(row))
            if new:
                writer.writeheader()
            writer.writerow({key: f"{value:.6g}" for key, value in row.items()})

    def curve(self) -> list[dict[str, float]]:
        """The learning curve so far."""
        file = self.path / "curve.csv"
        return read_curve(file) if file.exists() else []


def discard_beginning(path: Path) -> None:
    """Remove what a training left that was killed before its first checkpoint.

    Raises:
        UserError: the folder holds something that no training wrote.
    """
    if not path.exists():
        return
    strange = [f.name for f in path.iterdir() if f.name not in _RUN_FILES and not f.name.startswith((".", "events."))]
    if strange:
        raise UserError(f"{path} holds {strange[0]}, which no training wrote; give another folder")
    shutil.rmtree(path)


def write_whole(path: Path, data: bytes) -> None:
    """Write a file such that the old one stays until the new one is safely there.

    Raises:
        UserError: it could not be written, a full disk for example.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with temporary.open("wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        temporary.replace(path)
    except OSError as error:
        raise UserError(f"cannot write {path}: {error.strerror or error}; what was there before is kept") from error
    finally:
        temporary.unlink(missing_ok=True)


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
