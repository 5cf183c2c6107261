"""The one error type that a user is meant to read, and the one way to tell a user something in passing."""

from __future__ import annotations

import sys


class UserError(ValueError):
    """Something a user gave is wrong: the message is one line that names the value and the valid ones."""

    def __init__(self, message: str):
        super().__init__(" ".join(message.splitlines()))


def notice(text: str) -> None:
    """Write one line for the user to the standard error."""
    sys.stderr.write(f"surefoot: {text}\n")
