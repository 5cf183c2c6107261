"""Choices: the valid values and the meaning of each option, as `--help` shows them."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import textwrap
import types
import typing
from typing import Annotated, Any

import tyro

_TOML = "FILE.toml"
VALID = {
    "activation": "{tanh,relu,elu}",
    "address": "HOST:PORT|local",
    "agent": "POLICY",
    "algorithm": "{trpo,ppo,ddpg}",
    "body": "BODY",
    "direction": "{forward,left,backward,right}|DEGREES",
    "engine": "{mujoco,pybullet}",
    "host": "ADDRESS [NAME ...]",
    "executor": "{local,processes,ray,dask,slurm}",
    "json": "FILE|-",
    "layout": "{rsl_rl,rsl_rl-3,skrl,skrl-shared,sb3,sb3-td3,sb3-sac}",
    "policy": "POLICY",
    "pose": "POSE",
    "preset": f"{{fast,complete,best,paper}}|{_TOML}",
    "results": "TABLE",
    "resume": "FOLDER",
    "robot": f"{{g1,g1_arms,h1,valkyrie}}|{_TOML}",
    "run": "FOLDER",
    "scenario": f"NAME|{_TOML}:NAME",
    "stage": "STAGE",
    "suite": f"{{push,paper,robustness,ring}}|{_TOML}",
    "trial_policy": "POLICY",
    "warm_start": "FOLDER|POLICY",
}
"""Option -> its valid values, the same for all commands that have it; others are shown by their type."""

_TYPES = {"Path": "FILE", "str": "WORD", "float": "NUMBER", "int": "NUMBER"}


def described(command: type) -> type:
    """Give a command's options to tyro with their valid values and their help, and return the command.

    Args:
        command: a dataclass, each of whose fields is followed by a docstring.
    """
    hints, texts = typing.get_type_hints(command, include_extras=True), option_texts(command)
    for field in dataclasses.fields(command):
        shown = valid_values(field.name, hints[field.name])
        hint = "" if field.default in ("", None, ()) else None
        told = tyro.conf.arg(metavar=shown, help=texts.get(field.name), help_behavior_hint=hint)
        command.__annotations__[field.name] = Annotated[hints[field.name], told]
    return command


def option_texts(command: type) -> dict[str, str]:
    """Return the docstring of each option, without its line breaks."""
    found: dict[str, str] = {}
    for parent in reversed([c for c in command.__mro__ if dataclasses.is_dataclass(c)]):
        (tree,) = ast.parse(textwrap.dedent(inspect.getsource(parent))).body
        assert isinstance(tree, ast.ClassDef)
        for statement, after in zip(tree.body, tree.body[1:], strict=False):
            if (
                isinstance(statement, ast.AnnAssign)
                and isinstance(statement.target, ast.Name)
                and isinstance(after, ast.Expr)
                and isinstance(after.value, ast.Constant)
            ):
                found[statement.target.id] = " ".join(str(after.value.value).split())
    return found


def valid_values(option: str, hint: Any) -> str | None:
    """Return what is shown of an option's valid values; None for what tyro shows by itself."""
    if option in VALID:
        return VALID[option]
    plain = typing.get_args(hint)[0] if typing.get_origin(hint) is Annotated else hint
    kinds = typing.get_args(plain) if isinstance(plain, types.UnionType) else (plain,)
    (kind, *others) = [each for each in kinds if each is not types.NoneType]
    return None if others else _TYPES.get(getattr(kind, "__name__", ""))
