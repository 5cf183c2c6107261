"""Shared folder: the check that a worker sees the folder to which it must write."""

from __future__ import annotations

from pathlib import Path

from surefoot.errors import UserError


def check_shared(folder: Path) -> None:
    """Check on a worker that a folder is there that who asked has made.

    Raises:
        UserError: it is not.
    """
    if not folder.is_dir():
        raise UserError(f"it does not see the folder {folder.absolute()}; give one that all workers share")
