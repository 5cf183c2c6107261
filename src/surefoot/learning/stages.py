"""Curriculum stages: runs that follow each other in one folder, each with the networks of the one before.

FOLDER/stages.json   the configuration of every stage, in order
FOLDER/STAGE/        the run folder of a stage

A stage that has used up its budget is done. The same command goes on after an interruption: it skips what is done and
resumes what was begun.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path

from surefoot.errors import UserError
from surefoot.learning.config import TrainConfig
from surefoot.learning.run_folder import RunFolder, discard_beginning, write_whole
from surefoot.learning.schedule import budget_share
from surefoot.learning.train import OnProgress, train

STAGES_FILE = "stages.json"


@dataclasses.dataclass(frozen=True)
class Stage:
    """One stage of a run.

    Attributes:
        name: of the stage and of its run folder.
        config: of its run.
        folder: its run folder.
        start: run folder of the stage before; None for the first one.
    """

    name: str
    config: TrainConfig
    folder: Path
    start: Path | None

    @property
    def is_done(self) -> bool:
        """Is the stage's budget used up?"""
        folder = RunFolder(self.folder)
        if not folder.has_checkpoint:
            return False
        _, state = folder.load_checkpoint()
        num_steps = state["steps"] - state.get("inherited", {}).get("policy_steps", 0)
        return budget_share(self.config, state["seconds"], num_steps) >= 1.0

    def run(self, on_progress: OnProgress | None = None) -> None:
        """Learn this stage, from its checkpoint if there is one.

        Raises:
            UserError: its folder holds something else, or the stage before has not been learned.
            KeyboardInterrupt: on Ctrl-C, after a checkpoint.
        """
        resume = RunFolder(self.folder).has_checkpoint
        if not resume:
            discard_beginning(self.folder)
        if self.start and not RunFolder(self.start).has_checkpoint:
            raise UserError(f"the stage before has not been learned: {self.start} has no checkpoint")
        train(self.config, self.folder, resume, on_progress, None if resume else self.start)


def begin_stages(path: str | Path, configs: Mapping[str, TrainConfig]) -> list[Stage]:
    """Return the stages of a run in a folder, which is made if it is not there.

    Args:
        path: of the folder.
        configs: of the stages by their names, in order.

    Raises:
        UserError: the folder holds something else, or stages with other configurations.
    """
    path = Path(path)
    if (path / STAGES_FILE).exists():
        if {stage.name: stage.config for stage in read_stages(path)} != dict(configs):
            raise UserError(f"{path} was begun with other settings; go on with --resume {path}, or give another --run")
        return read_stages(path)
    if path.exists() and (not path.is_dir() or any(path.iterdir())):
        raise UserError(f"{path} exists already and holds no stages; give another --run")
    path.mkdir(parents=True, exist_ok=True)
    text = json.dumps({name: json.loads(config.to_json()) for name, config in configs.items()}, indent=2)
    write_whole(path / STAGES_FILE, text.encode())
    return read_stages(path)


def read_stages(path: str | Path) -> list[Stage]:
    """Return the stages of a run in a folder, in order.

    Raises:
        UserError: the folder's list of stages cannot be read.
    """
    file = Path(path) / STAGES_FILE
    try:
        told = json.loads(file.read_text())
        configs = {name: TrainConfig.from_json(json.dumps(values)) for name, values in told.items()}
    except OSError as error:
        raise UserError(f"{path} is not a folder of stages: cannot read {file.name}") from error
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise UserError(f"{file} cannot be read as a list of stages: {error}") from error
    folders = [file.parent / name for name in configs]
    return [
        Stage(name, config, folder, start)
        for (name, config), folder, start in zip(configs.items(), folders, [None, *folders[:-1]], strict=True)
    ]


def has_stages(path: str | Path) -> bool:
    """Tell whether a folder is one of stages."""
    return (Path(path) / STAGES_FILE).exists()


def run_folders(path: Path) -> list[Path]:
    """Return the run folders of a run: those of its stages in order, or the folder itself."""
    return [stage.folder for stage in read_stages(path)] if has_stages(path) else [path]
