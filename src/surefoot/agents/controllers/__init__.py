"""Controllers: push recovery by laws from the literature, in the same trials as the learned policies.

Each module but the first five is one row of Table IV, rebuilt from its published idea; users bring their own by
`my_file.py:MyClass`.
"""

from __future__ import annotations

import functools
import hashlib
import importlib
import importlib.util
import sys
from pathlib import Path

from surefoot.agents.agent import Policy
from surefoot.agents.controllers.controller import Command, Controller, ControllerAgent, State
from surefoot.agents.load import load_policy
from surefoot.agents.nominal import NominalAgent
from surefoot.errors import UserError

__all__ = ["Command", "Controller", "ControllerAgent", "State", "load_agent", "load_controller", "shipped_controllers"]

PREFIX = "controllers/"
_CLASSES = {
    "stand": "Stand",
    "ankle": "Ankle",
    "hip": "Hip",
    "wieber2006a": "TrajectoryFreeMPC",
    "wieber2006b": "ReferenceAdaptation",
    "stephens2010": "SteppingMPC",
    "urata2011": "FootPlacement",
}
"""Module -> its controller."""


def shipped_controllers() -> tuple[str, ...]:
    """Names of the controllers that come with the package, as `surefoot evaluate` takes them."""
    return tuple(PREFIX + name for name in _CLASSES)


def load_agent(name: str) -> Policy | ControllerAgent:
    """Whoever is meant by a name: `controllers/NAME`, `FILE.py:CLASS`, "nominal", or a policy.

    Raises:
        UserError: there is none of this name, or it cannot be run.
    """
    if name.startswith(PREFIX) or ".py:" in name:
        return load_controller(name)
    return NominalAgent() if name == "nominal" else load_policy(name)


def load_controller(name: str) -> ControllerAgent:
    """A controller that comes with the package, or the class of a user's own file.

    Raises:
        UserError: there is no such controller, or it cannot be imported.
    """
    if name.startswith(PREFIX):
        row = name.removeprefix(PREFIX)
        if row not in _CLASSES:
            raise UserError(f"unknown controller '{name}'; valid: {', '.join(shipped_controllers())}, or FILE.py:CLASS")
        made = getattr(importlib.import_module(f"surefoot.agents.controllers.{row}"), _CLASSES[row])
        return ControllerAgent(name, made, _digest(name.encode()))
    file, _, class_name = name.rpartition(":")
    path = Path(file)
    try:
        code = path.read_bytes()
    except OSError as error:
        raise UserError(f"cannot read controller {path}: {error.strerror or error}") from error
    return ControllerAgent(name, _class_of(path, class_name), _digest(code + class_name.encode()))


def _class_of(path: Path, class_name: str):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec  # by its suffix it is Python
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    sys.modules.setdefault(path.stem, module)  # dataclasses look their module up
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise UserError(f"cannot import {path}: {type(error).__name__}: {error}") from error
    if not hasattr(module, class_name):
        raise UserError(f"{path} has no class '{class_name}'")
    return getattr(module, class_name)


def _digest(code: bytes) -> str:
    return hashlib.sha256(code + _package_code()).hexdigest()


@functools.cache
def _package_code() -> bytes:
    return b"".join(file.read_bytes() for file in sorted(Path(__file__).parent.glob("*.py")))
