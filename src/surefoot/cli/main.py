"""surefoot: learn, test and ship push-recovery policies for humanoid robots."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import tyro

from surefoot.cli.evaluate import Bench, Evaluate, Replay, Table
from surefoot.cli.report import Demo, Pictures, Report
from surefoot.cli.terminal import console
from surefoot.cli.train import Ablate, Reproduce, Select, Train
from surefoot.cli.video import Picture, Play, Video
from surefoot.errors import UserError

COMMANDS: dict[str, Callable[..., Any]] = {
    "train": Train,
    "evaluate": Evaluate,
    "replay": Replay,
    "report": Report,
    "table": Table,
    "bench": Bench,
    "demo": Demo,
    "reproduce": Reproduce,
    "ablate": Ablate,
    "select": Select,
    "pictures": Pictures,
    "play": Play,
    "video": Video,
    "picture": Picture,
}


def main() -> None:
    """Entry point: errors that a user can mend are one line and exit code 2; Ctrl-C is 130."""
    command = tyro.extras.subcommand_cli_from_dict(COMMANDS, prog="surefoot", description=__doc__)
    try:
        command.main()
    except UserError as error:
        console.print(f"surefoot: {error}", style="red", markup=False, highlight=False, soft_wrap=True)
        sys.exit(2)
    except KeyboardInterrupt:
        sys.exit(130)
