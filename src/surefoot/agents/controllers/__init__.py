"""Controllers: push recovery by laws from the literature, in the same trials as the learned policies.

`ankle`, `hip`, `stand`, `wieber2006a`, `wieber2006b`, `stephens2010` and `urata2011` are one controller each, rebuilt
from its published idea; the other modules are what they stand on. Users bring their own by `my_file.py:MyClass`.
"""

from __future__ import annotations

import ast
import hashlib
import importlib
import importlib.util
import inspect
import sys
from pathlib import Path
from typing import Any

from surefoot.agents.controllers.controller import Command, Controller, ControllerAgent, State
from surefoot.checks import read_text
from surefoot.errors import UserError
from surefoot.extras import advice
from surefoot.robots import Robot
from surefoot.task.guard import in_words

__all__ = ["Command", "Controller", "ControllerAgent", "State", "load_controller", "shipped_controllers"]

PREFIX = "controllers/"
FOUNDATION_VERSION = 1
"""Part of every controller's digest; raise it when `body`, `inverse_dynamics`, `stepping` or `linear_mpc` change what
they compute, so that the results of all controllers are measured anew."""
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
_NEED_SOLVER, _SOLVER = ("wieber2006a", "stephens2010"), "daqp"
"""Some solve quadratic programs, the second one only once it steps: what is missing is named before."""


def shipped_controllers() -> tuple[str, ...]:
    """Names of the controllers that come with the package, as `surefoot evaluate` takes them."""
    return tuple(PREFIX + name for name in _CLASSES)


def load_controller(name: str, robot: Robot) -> ControllerAgent:
    """Load a controller that comes with the package, or the class of a user's own file.

    Args:
        name: `controllers/NAME`, or `FILE.py:CLASS`.
        robot: the robot that it is to drive.

    Raises:
        UserError: there is no such controller, or it cannot be imported.
    """
    if name.startswith(PREFIX):
        row = name.removeprefix(PREFIX)
        if row not in _CLASSES:
            raise UserError(f"unknown controller '{name}'; valid: {', '.join(shipped_controllers())}, or FILE.py:CLASS")
        if row in _NEED_SOLVER and importlib.util.find_spec(_SOLVER) is None:
            raise UserError(advice(_SOLVER) or _SOLVER)
        made = getattr(importlib.import_module(f"surefoot.agents.controllers.{row}"), _CLASSES[row])
        return ControllerAgent(name, made, controller_digest(made), robot)
    file, _, class_name = name.rpartition(":")
    path = Path(file)
    code = read_text(path, "controller")
    made = _class_of(path, class_name)
    return ControllerAgent(name, made, controller_digest(made, code), robot)


def controller_digest(made: Any, code: str | None = None) -> str:
    """Name a controller by what its source says, and by the version of what it stands on.

    The source is that of the modules of its class and of the classes that it inherits from. Comments, docstrings,
    imports and the layout of the lines do not count.

    Args:
        made: its class, or what else makes it.
        code: the source of its own module; without it, the source is looked up.
    """
    classes = made.__mro__ if isinstance(made, type) else (made,)
    modules = dict.fromkeys(getattr(each, "__module__", "builtins") for each in classes)
    sources = [code] if code is not None else []
    sources += [_source(module) for module in modules if code is None or module != made.__module__]
    text = "\n".join(_essence(source) for source in sources)
    name = getattr(made, "__name__", type(made).__name__)
    return hashlib.sha256(f"{text}\n{name}\n{FOUNDATION_VERSION}".encode()).hexdigest()


def _source(module: str) -> str:
    """The source of an imported module; empty for Python's own modules and where there is none."""
    if module.partition(".")[0] in sys.stdlib_module_names:
        return ""
    try:
        return inspect.getsource(sys.modules[module])
    except (KeyError, OSError, TypeError):
        return ""


def _essence(source: str) -> str:
    """A module's code without comments, docstrings and imports, in one spelling."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        for block in ("body", "orelse", "finalbody"):
            statements = getattr(node, block, None)
            if isinstance(statements, list):
                kept = [statement for statement in statements if not _says_nothing(statement)]
                setattr(node, block, kept or ([ast.Pass()] if statements else []))
    return ast.unparse(ast.fix_missing_locations(tree))


def _says_nothing(statement: ast.stmt) -> bool:
    is_text = isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)
    return is_text or isinstance(statement, ast.Import | ast.ImportFrom)


def _class_of(path: Path, class_name: str) -> Any:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec  # by its suffix it is Python
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    sys.modules.setdefault(path.stem, module)  # dataclasses look their module up
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise UserError(f"cannot import {path}: {in_words(error)}") from error
    except SystemExit as error:
        raise UserError(f"cannot import {path}: it ends the program") from error
    made = getattr(module, class_name, None)
    if not callable(made):
        raise UserError(f"{path} has no class '{class_name}'")
    return made
