"""Presets: named training configurations, one flat TOML file each, with one table per algorithm.

A preset of several curriculum stages is a folder of such files, `NUMBER-STAGE.toml`. The stages of an algorithm are the
files that have a table for it, in the order of their numbers; each stage begins with the networks of the one before.
The stages of `best` are learned by different algorithms: each of its files has a single table, and all are stages.
"""

from __future__ import annotations

import dataclasses
import importlib.resources
import tomllib
from collections.abc import Mapping
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from surefoot.errors import UserError
from surefoot.learning.config import TakeoverConfig, TrainConfig
from surefoot.task.environment import EnvConfig
from surefoot.task.random_pushes import DisturbanceConfig

ALGORITHMS = ("trpo", "ppo", "ddpg")
PRESETS = ("paper", "fast", "complete", "best")
STAGED = "complete"
MIXED = ("best",)
"""Presets whose stages have an algorithm of their own each, whatever algorithm is asked for."""
OLD_PRESETS = {"wide": 0, "steady": 1, "complete": -1}
"""Names of version 0.1 -> the stage of `complete`; to be dropped with version 0.3."""
SUFFIX = ".toml"

_UNTOLD = ("algorithm", "preset", "seed", "env", "hyper", "takeover")
_TOLD_BY_PYTHON = ("disturbance", "extra_terms")


def preset(name: str, algorithm: str) -> TrainConfig:
    """Return the preset for an algorithm.

    Args:
        name: name of a shipped preset, "PRESET/STAGE" for a stage of one, or a TOML file of your own.
        algorithm: "trpo", "ppo" or "ddpg"; it is ignored for the stages of `best`. A file of your own may also have a
            table for "dagger".

    Raises:
        UserError: there is no such preset, stage or algorithm, or a key of the file is wrong.
    """
    _check_algorithm(algorithm)
    if name.endswith(SUFFIX):
        return _read(Path(name), algorithm, Path(name).stem)
    if name == "wide" and algorithm != "ddpg":
        return _wide_on_policy(algorithm)
    told = old_stage(name, algorithm) if name != STAGED else None
    head, _, stage = (told or name).partition("/")
    if head not in PRESETS:
        raise UserError(f"unknown preset '{name}'; valid: {', '.join(PRESETS)}, or a {SUFFIX} file")
    stages = stage_files(head, algorithm)
    if stage in stages:
        return _read(stages[stage], None if head in MIXED else algorithm, f"{head}/{stage}")
    if stage or stages:
        valid = ", ".join(f"{head}/{each}" for each in stages) or f"none, '{head}' is a preset without stages"
        raise UserError(f"'{name}' is not one stage of a preset; valid for {algorithm}: {valid}")
    return _read(_folder() / f"{head}{SUFFIX}", algorithm, head)


def stage_files(name: str, algorithm: str) -> dict[str, Traversable]:
    """Return the files of a preset's stages for an algorithm by the stages' names, in order; empty if it has none.

    Raises:
        UserError: there is no such algorithm.
    """
    _check_algorithm(algorithm)
    folder = _folder() / name
    if name not in PRESETS or not folder.is_dir():
        return {}
    files = sorted((file for file in folder.iterdir() if file.name.endswith(SUFFIX)), key=lambda file: file.name)
    having = [file for file in files if name in MIXED or algorithm in tomllib.loads(file.read_text())]
    return {file.name.removesuffix(SUFFIX).partition("-")[2]: file for file in having}


def old_stage(name: str, algorithm: str) -> str | None:
    """Return what a preset's name of version 0.1 is called now, "complete/STAGE"; None for other names."""
    if name not in OLD_PRESETS:
        return None
    return f"{STAGED}/{list(stage_files(STAGED, algorithm))[OLD_PRESETS[name]]}"


def _check_algorithm(algorithm: str) -> None:
    if algorithm not in ALGORITHMS:
        raise UserError(f"unknown algorithm '{algorithm}'; valid: {', '.join(ALGORITHMS)}")


def _folder() -> Traversable:
    return importlib.resources.files("surefoot") / "learning" / "presets"


def _read(file: Traversable, algorithm: str | None, name: str) -> TrainConfig:
    """Return the configuration of an algorithm's table of a file, or of its only one."""
    try:
        tables = tomllib.loads(file.read_text())
    except OSError as error:
        raise UserError(f"cannot read preset {file}: {error.strerror or error}") from error
    except (ValueError, RecursionError) as error:
        raise UserError(f"{file} is not a TOML file: {error}") from error
    if algorithm is None:
        (algorithm,) = tables
    if algorithm not in tables:
        raise UserError(f"the preset '{name}' has no table for '{algorithm}'; it has: {', '.join(tables)}")
    table = tables[algorithm]
    _check_keys(file, algorithm, table, TrainConfig, ("env", "hyper", "takeover"))
    for key in ("env", "hyper"):
        if not isinstance(table.get(key), dict):
            raise UserError(f"{file} has no table [{algorithm}.{key}]")
    _check_keys(file, f"{algorithm}.takeover", table.get("takeover", {}), TakeoverConfig, ())
    _check_keys(file, f"{algorithm}.env", table["env"], EnvConfig, ("disturbance",))
    _check_keys(file, f"{algorithm}.env.disturbance", table["env"].get("disturbance", {}), DisturbanceConfig, ())
    try:
        return TrainConfig.from_values({**table, "algorithm": algorithm, "preset": name})
    except TypeError as error:
        raise UserError(f"{file}: {error}") from error


def _check_keys(file: Traversable, table: str, values: Mapping[str, Any], known: type, tables: tuple[str, ...]) -> None:
    """Raise UserError for a key of a table that its configuration does not have."""
    fields = [field.name for field in dataclasses.fields(known)]
    valid = [name for name in fields if name not in (*_UNTOLD, *_TOLD_BY_PYTHON)]
    for key in values:
        if key not in (*valid, *tables):
            raise UserError(f"unknown key '{key}' in [{table}] of {file}; valid: {', '.join((*valid, *tables))}")


def _wide_on_policy(algorithm: str) -> TrainConfig:
    """Return the preset `wide` of version 0.1 for TRPO and PPO, with which nothing was ever learned."""
    fast, first = preset("fast", algorithm), preset(f"{STAGED}/pushes", "ddpg")
    return dataclasses.replace(fast, preset="wide", minutes=34.0, schedule_minutes=34.0, env=first.env)
