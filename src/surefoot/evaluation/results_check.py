"""Results check: the checks of an unknown results table for our tables, columns and types.

SQLite runs code that a file brings (views, triggers, defaults), and keeps a value of any type in a column of any type.
Anything that surefoot did not write is therefore refused when a file is opened.
"""

from __future__ import annotations

import contextlib
import sqlite3
import stat
from collections.abc import Iterator
from pathlib import Path

from surefoot.checks import check_path
from surefoot.errors import UserError
from surefoot.evaluation.results_schema import TABLES

MAX_VALUE_BYTES = 10_000_000
"""Of a single value."""
_MAX_TEXT = 100_000
"""Characters of a text."""
_TYPES = {"INTEGER": "'integer'", "REAL": "'real', 'integer'", "TEXT": "'text'"}


@contextlib.contextmanager
def using(path: str | Path) -> Iterator[None]:
    """Turn an error of SQLite into one that names the file.

    Raises:
        UserError: the file could not be used.
    """
    try:
        yield
    except sqlite3.Error as error:
        raise UserError(f"cannot use {path} as a results table: {error}") from error


@contextlib.contextmanager
def reading(path: str | Path) -> Iterator[None]:
    """Turn whatever a damaged row raises into an error that names the file; errors of SQLite stay what they are.

    Raises:
        UserError: a row could not be read.
    """
    try:
        yield
    except sqlite3.Error:
        raise
    except (ValueError, TypeError, KeyError, OverflowError) as error:
        raise UserError(f"{path} has a row that cannot be read: {error}") from error


def connect(path: str | Path) -> sqlite3.Connection:
    """Open a file as an SQLite database in which no value can be larger than `MAX_VALUE_BYTES`.

    Raises:
        UserError: the path is that of a folder, a pipe or a device.
    """
    if str(path) != ":memory:":
        check_path("results", path)
        with contextlib.suppress(FileNotFoundError):
            if not stat.S_ISREG(Path(path).stat().st_mode):
                raise UserError(f"cannot use {path} as a results table: it is no regular file")
    # A thread of its own commits what waits for it.
    db = sqlite3.connect(path, timeout=60.0, check_same_thread=False)
    db.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_VALUE_BYTES)
    db.text_factory = lambda data: data.decode(errors="replace")  # by itself it fails wherever a damaged text is read
    db.execute("PRAGMA trusted_schema = OFF")
    return db


def check_only_tables(db: sqlite3.Connection, path: str | Path) -> None:
    """Check that a database holds tables and the indices of their keys, and nothing that runs by itself.

    Raises:
        UserError: there is a view, a trigger, a virtual table, or an index of somebody's own.
    """
    try:
        objects = db.execute("SELECT type, name, sql, rootpage FROM sqlite_master").fetchall()
    except UnicodeDecodeError as error:
        raise UserError(f"cannot use {path} as a results table: a name in it is not UTF-8") from error
    for kind, name, sql, root in objects:
        is_plain = (kind == "table" and root) or (kind == "index" and sql is None)
        if not is_plain:
            raise UserError(f"cannot use {path} as a results table: it has a {kind} '{str(name)[:60]}' of its own")


def check_results(db: sqlite3.Connection, path: str | Path) -> None:
    """Check that a database has today's tables and nothing else in them.

    Raises:
        UserError: a table or a column is missing or is another one, or a value has another type.
    """
    with contextlib.closing(sqlite3.connect(":memory:")) as ours:
        ours.executescript(TABLES)
        expected = _columns(ours)
    found = _columns(db)
    if found != expected:
        odd = [name for name in {**expected, **found} if found.get(name) != expected.get(name)]
        raise UserError(f"cannot use {path} as a results table: its table '{odd[0][:60]}' has not the columns it needs")
    for table, columns in expected.items():
        wrong = " OR ".join(_is_wrong(name, kind, bool(needed or key)) for name, kind, needed, key in columns)
        row = db.execute(f"SELECT rowid FROM {table} WHERE {wrong} LIMIT 1").fetchone()
        if row:
            raise UserError(
                f"cannot use {path} as a results table: row {row[0]} of '{table}' has a value of a wrong type"
            )


def _is_wrong(column: str, kind: str, is_needed: bool) -> str:
    """The condition on a column's value that it is none of its type."""
    kinds = _TYPES[kind] + ("" if is_needed else ", 'null'")
    condition = f"typeof({column}) NOT IN ({kinds})"
    return f"{condition} OR length({column}) > {_MAX_TEXT}" if kind == "TEXT" else condition


def _columns(db: sqlite3.Connection) -> dict[str, list[tuple[str, str, int, int]]]:
    """Table -> name, type, "is needed" and place in the key of its columns; hidden and computed ones have no type."""
    names = [name for (name,) in db.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
    return {
        name: [
            (column, "" if hidden or default is not None else kind, needed, key)
            for column, kind, needed, default, key, hidden in db.execute(
                "SELECT name, type, [notnull], dflt_value, pk, hidden FROM pragma_table_xinfo(?)", (name,)
            )
        ]
        for name in names
    }
