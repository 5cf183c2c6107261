"""surefoot: teach humanoid robots to keep their balance when pushed, and measure how hard a push they survive.

The names in `__all__` are the interface for scripts. Each is loaded when it is first used, so that ``import surefoot``
stays light. If gymnasium is installed, the import also registers the environment there:
``gymnasium.make("surefoot/PushRecovery-v0")``.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from surefoot.extras import advice
from surefoot.version import __version__

if TYPE_CHECKING:
    from surefoot.agents.load import load_agent, load_policy, shipped_policies
    from surefoot.environments.batch import PushRecoveryBatch
    from surefoot.environments.single import PushRecoveryEnv
    from surefoot.errors import UserError
    from surefoot.evaluation.evaluate import evaluate
    from surefoot.evaluation.outcome import Outcome
    from surefoot.evaluation.scenarios import Scenario
    from surefoot.evaluation.threshold_search import Threshold
    from surefoot.evaluation.trials import Trial, run_trial
    from surefoot.executors import Executor, open_executor
    from surefoot.learning.config import TrainConfig
    from surefoot.learning.exchange import policy_from, put_policy, state_dict
    from surefoot.learning.preset_file import preset
    from surefoot.learning.train import train
    from surefoot.physics.pushes import Drop, Push, horizontal_push
    from surefoot.rendering.film import save_video
    from surefoot.rendering.recording import record
    from surefoot.robots import Robot, load_robot, shipped_robots
    from surefoot.task.environment import EnvConfig
    from surefoot.task.random_pushes import DisturbanceConfig
    from surefoot.task.reward import Term

_HOMES = {
    "agents.load": ("load_agent", "load_policy", "shipped_policies"),
    "environments.batch": ("PushRecoveryBatch",),
    "environments.single": ("PushRecoveryEnv",),
    "errors": ("UserError",),
    "evaluation.evaluate": ("evaluate",),
    "evaluation.outcome": ("Outcome",),
    "evaluation.scenarios": ("Scenario",),
    "evaluation.threshold_search": ("Threshold",),
    "evaluation.trials": ("Trial", "run_trial"),
    "executors": ("Executor", "open_executor"),
    "learning.config": ("TrainConfig",),
    "learning.exchange": ("policy_from", "put_policy", "state_dict"),
    "learning.preset_file": ("preset",),
    "learning.train": ("train",),
    "physics.pushes": ("Drop", "Push", "horizontal_push"),
    "rendering.film": ("save_video",),
    "rendering.recording": ("record",),
    "robots": ("Robot", "load_robot", "shipped_robots"),
    "task.environment": ("EnvConfig",),
    "task.random_pushes": ("DisturbanceConfig",),
    "task.reward": ("Term",),
}
"""Module -> what of it stands here."""

_MODULES = {name: module for module, names in _HOMES.items() for name in names}

__all__ = [
    "DisturbanceConfig",
    "Drop",
    "EnvConfig",
    "Executor",
    "Outcome",
    "Push",
    "PushRecoveryBatch",
    "PushRecoveryEnv",
    "Robot",
    "Scenario",
    "Term",
    "Threshold",
    "TrainConfig",
    "Trial",
    "UserError",
    "__version__",
    "evaluate",
    "horizontal_push",
    "load_agent",
    "load_policy",
    "load_robot",
    "open_executor",
    "policy_from",
    "preset",
    "put_policy",
    "record",
    "run_trial",
    "save_video",
    "shipped_policies",
    "shipped_robots",
    "state_dict",
    "train",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'surefoot' has no attribute '{name}'; valid: {', '.join(__all__)}")
    try:
        value = getattr(importlib.import_module(f"surefoot.{_MODULES[name]}"), name)
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(advice(error.name) or str(error), name=error.name) from error
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)


def _is_the_command() -> bool:
    """Is this process the command `surefoot`? It needs no environments of gymnasium, whose modules take their time."""
    words = sys.orig_argv
    return Path(sys.argv[0]).stem == "surefoot" or ("-m" in words and "surefoot" in words[words.index("-m") + 1 :][:1])


if not _is_the_command() and importlib.util.find_spec("gymnasium"):
    importlib.import_module("surefoot.environments").register()
