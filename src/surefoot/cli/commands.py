"""Commands: the table of all commands, and the parsing of a command line."""

from __future__ import annotations

import dataclasses
import inspect
import sys
from collections.abc import Sequence
from typing import Any

import tyro
from rich.console import Console
from rich.table import Table

from surefoot.cli.agent import AgentCommand
from surefoot.cli.bench import Bench
from surefoot.cli.choices import described
from surefoot.cli.demo import Demo
from surefoot.cli.docs import Docs
from surefoot.cli.evaluate import Evaluate
from surefoot.cli.export import Export
from surefoot.cli.old_words import renewed
from surefoot.cli.oracle import Oracle
from surefoot.cli.play import Play
from surefoot.cli.replay import Replay
from surefoot.cli.report import Pictures, Report
from surefoot.cli.report import Table as TableCommand
from surefoot.cli.reproduce import Reproduce
from surefoot.cli.robot import CheckRobot
from surefoot.cli.settings import unknown_option
from surefoot.cli.strategies import Strategies
from surefoot.cli.terminal import console
from surefoot.cli.train import Ablate, Select, Train
from surefoot.cli.video import Picture, Video
from surefoot.errors import UserError
from surefoot.version import __version__

COMMANDS: dict[str, Any] = {
    "train": Train,
    "evaluate": Evaluate,
    "agent": AgentCommand,
    "export": Export,
    "strategies": Strategies,
    "oracle": Oracle,
    "replay": Replay,
    "report": Report,
    "table": TableCommand,
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
    "docs": Docs,
}


def parsed(arguments: Sequence[str]) -> Any:
    """The command that these words of a command line name, with its options; its `main` runs it.

    Raises:
        UserError: there is no such command, or it has no such option.
    """
    words, notes = renewed(arguments)
    for note in notes:
        console.print(f"surefoot: {note}", markup=False, highlight=False, soft_wrap=True)
    if words[:1] in (["--version"], ["-V"]):
        print(f"surefoot {__version__}")
        sys.exit(0)
    if not words or words[0] in ("--help", "-h"):
        print_commands()
        sys.exit(0)
    name, *options = words
    if name.startswith("-"):
        raise UserError(f"unknown option '{name}'; a command comes first; valid: {', '.join(COMMANDS)}")
    if name not in COMMANDS:
        raise UserError(f"unknown command '{name}'; valid: {', '.join(COMMANDS)}")
    command = described(COMMANDS[name])
    found: Any
    found, others = tyro.cli(
        command, args=options, prog=f"surefoot {name}", return_unknown_args=True, config=(tyro.conf.FlagCreatePairsOff,)
    )
    if not others:
        return found
    if isinstance(found, Train):
        return dataclasses.replace(found, settings=tuple(others))
    valid = [f"--{field.name.replace('_', '-')}" for field in dataclasses.fields(command)]
    raise UserError(unknown_option(others[0], valid))


def print_commands() -> None:
    """Print the commands, each with the first sentence of its help."""
    table = Table(box=None, show_header=False, padding=(0, 1), pad_edge=False)
    for name, command in COMMANDS.items():
        (first, *_) = inspect.getdoc(command).split("\n\n")  # type: ignore[union-attr] # ruff asks for docstrings
        table.add_row(f"  {name}", " ".join(first.split()))
    output = Console(highlight=False)
    output.print("usage: surefoot COMMAND [OPTIONS]\n\nTeach humanoid robots to keep their balance when pushed.\n")
    output.print(table)
    output.print("\nsurefoot COMMAND --help explains a command, surefoot docs shows the documentation.", markup=False)
