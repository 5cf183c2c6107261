"""surefoot: learn, test and ship push-recovery policies for humanoid robots."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any, NoReturn

import tyro

from surefoot.cli.agent import AgentCommand
from surefoot.cli.bench import Bench
from surefoot.cli.demo import Demo
from surefoot.cli.evaluate import Evaluate
from surefoot.cli.old_words import renewed
from surefoot.cli.options import check_options
from surefoot.cli.oracle import Oracle
from surefoot.cli.play import Play
from surefoot.cli.replay import Replay
from surefoot.cli.report import Pictures, Report, Table
from surefoot.cli.reproduce import Reproduce
from surefoot.cli.terminal import console
from surefoot.cli.train import Ablate, Select, Train
from surefoot.cli.video import Picture, Video
from surefoot.errors import UserError

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
}


def main() -> None:
    """Run the command that the command line names.

    An error that a user can mend is one line and exit code 2; Ctrl-C is exit code 130.
    """
    arguments, notes = renewed(sys.argv[1:])
    for note in notes:
        console.print(f"surefoot: {note}", markup=False, highlight=False, soft_wrap=True)
    command = tyro.extras.subcommand_cli_from_dict(COMMANDS, args=arguments, prog="surefoot", description=__doc__)
    try:
        check_options(command)
        command.main()
    except UserError as error:
        _fail(str(error))
    except OSError as error:  # of a file that no command looked after: a full disk, a folder in the place of a file
        _fail(f"cannot use {error.filename}: {error.strerror}" if error.filename else str(error))
    except KeyboardInterrupt:
        sys.exit(130)


def _fail(message: str) -> NoReturn:
    """Print an error in one line and exit with code 2."""
    line = " ".join(message.splitlines())
    console.print(f"surefoot: {line}", style="red", markup=False, highlight=False, soft_wrap=True)
    sys.exit(2)
