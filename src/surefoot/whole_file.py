"""Whole files: files written so that the old one stays until the new one is complete, and the clean-up after a kill."""

from __future__ import annotations

import contextlib
import os
import re
from pathlib import Path

from surefoot.errors import UserError

_TEMPORARY = re.compile(r"\.(?P<name>.+)\.(?P<pid>\d+)")


def write_whole(path: Path, data: bytes) -> None:
    """Write a file such that the old one stays until the new one is safely there.

    What a killed process left of an attempt to write the same file is removed.

    Raises:
        UserError: it could not be written, a full disk for example.
    """
    if path.exists() and not path.is_file():
        raise UserError(f"cannot write {path}: it is no regular file")
    sweep(path.parent, path.name)
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with temporary.open("wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        temporary.replace(path)
    except OSError as error:
        raise UserError(f"cannot write {path}: {error.strerror or error}; what was there before is kept") from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


def sweep(folder: Path, name: str | None = None) -> None:
    """Remove the temporary files that killed processes left in a folder.

    Args:
        folder: it may be missing.
        name: of the file that was to be written; any without it.
    """
    with contextlib.suppress(OSError):
        for file in folder.iterdir():
            found = _TEMPORARY.fullmatch(file.name)
            if found and name in (None, found["name"]) and not _is_running(int(found["pid"])):
                file.unlink(missing_ok=True)


def _is_running(pid: int) -> bool:
    if pid == os.getpid():
        return False
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:  # it runs for somebody else
        return True
    return True
