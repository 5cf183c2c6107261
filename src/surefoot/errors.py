"""Errors: the one error type that is meant for users, and the one way to print a notice for them."""

from __future__ import annotations

import sys


class UserError(ValueError):
    """An error in a user's input. Its message is one line that names the value and the valid ones."""

    def __init__(self, message: str):
        super().__init__(" ".join(message.splitlines()))


def notice(text: str) -> None:
    """Write one line for the user to the standard error."""
    sys.stderr.write(f"surefoot: {text}\n")
