"""Commands: all that the command line knows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import tyro

from surefoot.cli.agent import AgentCommand
from surefoot.cli.bench import Bench
from surefoot.cli.demo import Demo
from surefoot.cli.evaluate import Evaluate
from surefoot.cli.old_words import renewed
from surefoot.cli.oracle import Oracle
from surefoot.cli.play import Play
from surefoot.cli.replay import Replay
from surefoot.cli.report import Pictures, Report, Table
from surefoot.cli.reproduce import Reproduce
from surefoot.cli.robot import CheckRobot
from surefoot.cli.terminal import console
from surefoot.cli.train import Ablate, Select, Train
from surefoot.cli.video import Picture, Video

COMMANDS: dict[str, Callable[..., Any]] = {
    "train": Train,
    "evaluate": Evaluate,
    "agent": AgentCommand,
    "oracle": Oracle,
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
    "robot": CheckRobot,
}


def parsed(arguments: Sequence[str]) -> Any:
    """The command that these words of a command line name, with its options; its `main` runs it."""
    words, notes = renewed(arguments)
    for note in notes:
        console.print(f"surefoot: {note}", markup=False, highlight=False, soft_wrap=True)
    description = "surefoot: learn, test and ship push-recovery policies for humanoid robots."
    return tyro.extras.subcommand_cli_from_dict(COMMANDS, args=words, prog="surefoot", description=description)
