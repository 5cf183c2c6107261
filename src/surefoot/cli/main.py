"""surefoot: learn, test and ship push-recovery policies for humanoid robots."""

from __future__ import annotations

import difflib
import re
import sys
from typing import NoReturn

from surefoot.cli import interrupt
from surefoot.errors import UserError
from surefoot.extras import advice

_EXTRAS = {"play": "viewer", "report": "report", "table": "report", "pictures": "report", "demo": "report"}
"""Command -> the extra that brings all that it needs; the others need one part each."""


def main() -> None:
    """Run the command that the command line names.

    An error that a user can correct gives one line and exit code 2. Ctrl-C gives exit code 130.
    """
    interrupt.listen()
    try:
        # Imported here, where Ctrl-C ends the wait for the modules without a traceback.
        from surefoot.cli.commands import parsed
        from surefoot.cli.options import check_options

        command = parsed(sys.argv[1:])
        check_options(command)
        command.main()
    except UserError as error:
        _fail(str(error))
    except ModuleNotFoundError as error:
        line = advice(error.name, _EXTRAS.get(sys.argv[1], ""))
        if line is None:
            raise
        _fail(line)
    except OSError as error:  # of a file that no command looked after: a full disk, a folder in the place of a file
        _fail(f"cannot use {error.filename}: {error.strerror}" if error.filename else str(error))
    except KeyboardInterrupt:
        sys.exit(interrupt.EXIT_CODE)


def with_guess(message: str) -> str:
    """A message on an unknown word that lists the valid ones, with the one that may have been meant."""
    told = re.search(r"unknown [\w ]+ '([^']+)'.*?; valid: (.+)$", message)
    told = told or re.search(r"cannot read policy (\S+): .*; shipped policies: (.+)$", message)
    if told is None:
        return message
    close = difflib.get_close_matches(told[1], re.split(r", (?:or )?", told[2]), n=1)
    return f"{message}; did you mean '{close[0]}'?" if close else message


def _fail(message: str) -> NoReturn:
    """Print an error in one line and exit with code 2."""
    from surefoot.cli.terminal import console

    line = with_guess(" ".join(message.splitlines()))
    console.print(f"surefoot: {line}", style="red", markup=False, highlight=False, soft_wrap=True)
    sys.exit(2)
