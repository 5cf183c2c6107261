"""Learning curve: the table that a run leaves, one row per probe; read here without torch."""

from __future__ import annotations

import csv
from pathlib import Path

from surefoot.errors import UserError


def read_curve(path: str | Path) -> list[dict[str, float]]:
    """Rows of a learning curve: "minutes", "steps", "recovered" and more, see `Trainer`.

    Raises:
        UserError: the file cannot be read as one.
    """
    try:
        with Path(path).open(newline="") as stream:
            return [{key: float(value) for key, value in row.items()} for row in csv.DictReader(stream)]
    except OSError as error:
        raise UserError(f"cannot read {path}: {error.strerror or error}") from error
    except (TypeError, ValueError) as error:
        raise UserError(f"{path} is not a learning curve: {error}") from error
