"""Curriculum stages: runs that follow each other in one folder, each with the networks of the one before.

FOLDER/stages.json   the configuration of every stage, in order
FOLDER/STAGE/        the run folder of a stage

A stage that has used up its budget is done. After an interruption the same command continues: it skips finished stages
and resumes the one that was under way.
"""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Mapping
from pathlib import Path

from surefoot.checks import parse_json_table, read_text, shortened
from surefoot.errors import UserError
from surefoot.learning.config import TrainConfig
from surefoot.learning.crew import Crew
from surefoot.learning.run_folder import RunFolder
from surefoot.learning.train import OnProgress, go_on, is_done
from surefoot.learning.training_log import TENSORBOARD, LogConfig
from surefoot.whole_file import sweep, write_whole

STAGES_FILE = "stages.json"
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,60}")


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
        return is_done(folder, self.config)

    def run(
        self, on_progress: OnProgress | None = None, log: LogConfig = TENSORBOARD, crew: Crew | None = None
    ) -> None:
        """Learn this stage, from its checkpoint if there is one; arguments are those of `go_on`.

        Raises:
            UserError: its folder holds something else, or the stage before has not been learned.
            KeyboardInterrupt: on Ctrl-C, after a checkpoint.
        """
        if self.start and not RunFolder(self.start).has_checkpoint:
            raise UserError(f"the stage before has not been learned: {self.start} has no checkpoint")
        go_on(self.config, self.folder, on_progress, self.start, log, crew)


def begin_stages(path: str | Path, configs: Mapping[str, TrainConfig]) -> list[Stage]:
    """Return the stages of a run in a folder, which is made if it is not there.

    Args:
        path: of the folder.
        configs: of the stages by their names, in order.

    Raises:
        UserError: the folder holds something else, or stages with other configurations.
    """
    path = Path(path)
    sweep(path)
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
    if not file.exists():
        raise UserError(f"{path} is not a folder of stages: cannot read {file.name}")
    try:
        told = parse_json_table(read_text(file, "list of stages"), str(file))
        strange = [name for name in told if not _NAME.fullmatch(name)]
        if strange or not told:
            raise UserError(f"{file} must hold stages with plain names, not {shortened(list(told))}")
        configs = {name: TrainConfig.from_json(json.dumps(values)) for name, values in told.items()}
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
