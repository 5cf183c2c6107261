"""Mutations: one damage after the other to bytes, text, nested values and databases, from one generator."""

from __future__ import annotations

import contextlib
import json
import random
import re
import sqlite3
from pathlib import Path
from typing import Any

NUMBERS = (
    "-1", "0", "1e308", "1e999", "-1e999", "nan", "inf", "-inf", "1" + "0" * 18, "9" * 23, "9" * 5000, "4294967296",
    "1e-320", "0x10", "", "x", "true", "2.5", "-0.0",
)  # fmt: skip
TEXTS = ("", "x" * 5000, "\0", "\x1b[31m", "[/red]", "../../etc/passwd", "/dev/zero", "a\nb", "\ud7ff\U0001f600", "nan")
DEEP: Any = None
for _ in range(600):
    DEEP = [DEEP]
VALUES = (
    None, True, False, -1, 0, 1, 2**32, 10**18, 10**30, 10**400, 1e308, float("inf"), float("nan"), -1e-300, 2.5, [],
    {}, [[]], [None] * 3, {"a": 1}, DEEP, *TEXTS,
)  # fmt: skip


def damaged_bytes(rng: random.Random, data: bytes) -> bytes:
    """Some bits, bytes and blocks of `data` changed, lost, doubled or moved."""
    found = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 5, 20))):
        at = rng.randrange(max(len(found), 1))
        size = rng.choice((1, 1, 4, 16, 200))
        kind = rng.randrange(7)
        if kind == 0 and found:
            found[at] ^= 1 << rng.randrange(8)
        elif kind == 1:
            found[at : at + size] = rng.randbytes(size)
        elif kind == 2:
            del found[at : at + size]
        elif kind == 3:
            found[at:at] = rng.randbytes(size)
        elif kind == 4:
            found[at:at] = found[at : at + size]
        elif kind == 5:
            found[at : at + size] = rng.choice((b"\0", b"\xff")) * size
        elif rng.random() < 0.3:
            del found[at:]
    return bytes(found)


def damaged_text(rng: random.Random, text: str) -> str:
    """Some numbers, quoted texts, keys and lines of `text` replaced, lost or doubled."""
    for _ in range(rng.choice((1, 1, 2, 4))):
        kind = rng.randrange(6)
        lines = text.splitlines(keepends=True) or [""]
        at = rng.randrange(len(lines))
        if kind == 0:
            text = _replaced(rng, text, r"-?\d+(\.\d+)?(e-?\d+)?", rng.choice(NUMBERS))
        elif kind == 1:
            text = _replaced(rng, text, r'"[^"\n]*"', json.dumps(rng.choice(TEXTS)))
        elif kind == 2:
            text = "".join(lines[:at] + lines[at + 1 :])
        elif kind == 3:
            text = "".join(lines[:at] + [lines[at]] * 2 + lines[at + 1 :])
        elif kind == 4:
            text = _replaced(
                rng, text, r"[\w.]+", rng.choice(("x", "[", "{}", '"a"', "[" * 2000, "true", "[[]]", "a.b"))
            )
        else:
            text = damaged_bytes(rng, text.encode("utf-8", "surrogatepass")).decode("utf-8", "replace")
    return text


def _replaced(rng: random.Random, text: str, pattern: str, new: str) -> str:
    found = list(re.finditer(pattern, text))
    if not found:
        return text + new
    match = rng.choice(found)
    return text[: match.start()] + new + text[match.end() :]


def damaged_value(rng: random.Random, value: Any) -> Any:
    """A nested value of which some parts are others, lost or renamed."""
    value = _copied(value)
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        places = list(_places(value))
        if not places:
            return _copied(rng.choice(VALUES))
        holder, key = rng.choice(places)
        kind = rng.randrange(8)
        if kind == 0:
            del holder[key]
        elif kind == 1 and isinstance(holder, dict):
            holder[rng.choice(("more", "", "x" * 300, str(key) + "_"))] = _copied(holder[key])
        elif kind == 2 and isinstance(holder[key], list):
            holder[key] = holder[key] * rng.choice((0, 2, 50))
        elif kind == 3 and isinstance(holder[key], int | float):
            holder[key] = _product(holder[key], rng.choice((-1, 0, 1e6, 10**12, 0.5)))
        else:
            holder[key] = _copied(rng.choice(VALUES))
    return value


def _product(number: float, factor: float) -> float:
    """Both multiplied; as a whole number where that is too large for a float."""
    try:
        return number * factor
    except OverflowError:
        return number * int(factor)


def _copied(value: Any) -> Any:
    """The same value with lists and tables of its own, which later damage changes nowhere else."""
    if value is DEEP:
        return value
    if isinstance(value, dict):
        return {key: _copied(item) for key, item in value.items()}
    return [_copied(item) for item in value] if isinstance(value, list) else value


def _places(value: Any) -> Any:
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in list(items):
        yield value, key
        if item is not DEEP:
            yield from _places(item)


STATEMENTS = (
    "CREATE VIEW v AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i FROM n",
    "CREATE TRIGGER t AFTER INSERT ON trials BEGIN DELETE FROM policies; END",
    "DROP TABLE thresholds",
    "ALTER TABLE trials ADD COLUMN more",
    "PRAGMA user_version = 2",
    "PRAGMA user_version = 3",
    "PRAGMA user_version = 99",
    "DELETE FROM policies",
)


def damage_database(rng: random.Random, file: Path) -> None:
    """Change some cells of a database, or its tables, or its bytes."""
    if rng.random() < 0.35:
        file.write_bytes(damaged_bytes(rng, file.read_bytes()))
        return
    with contextlib.closing(sqlite3.connect(file)) as db:
        db.text_factory = lambda data: data.decode(errors="replace")
        tables = [name for (name,) in db.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
        for _ in range(rng.choice((1, 1, 2, 5))):
            with contextlib.suppress(sqlite3.Error, OverflowError, UnicodeError):
                if rng.random() < 0.15:
                    db.execute(rng.choice(STATEMENTS))
                    continue
                table = rng.choice(tables)
                columns = [row[1] for row in db.execute(f"PRAGMA table_info({table})")]
                if not columns:  # the table was dropped
                    continue
                column = rng.choice(columns)
                row = db.execute(f"SELECT {column} FROM {table} LIMIT 1").fetchone() or (None,)
                old = row[0]
                db.execute(f"UPDATE {table} SET {column} = ?", (_cell(rng, old),))
        db.commit()


def _cell(rng: random.Random, old: Any) -> Any:
    if isinstance(old, str) and old[:1] in "{[" and rng.random() < 0.8:
        if rng.random() < 0.5:
            with contextlib.suppress(ValueError, RecursionError):  # it has been damaged before
                return json.dumps(damaged_value(rng, json.loads(old)))
        return damaged_text(rng, old)
    return rng.choice((None, "", "{", "x" * 200_000, b"\0\1", -1, 10**18, 1e308, float("inf"), 2.5, *TEXTS))
