"""Checks: the checks of input from outside, which are numbers, texts, values of files, and the files themselves.

The same functions check a command line, a file and a message of the live page, so that all of them refuse the same
numbers.
"""

from __future__ import annotations

import dataclasses
import functools
import json
import math
import stat
import tomllib
import types
import typing
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Union, get_args, get_origin

from surefoot.errors import UserError

MAX_SEED = 2**32 - 1
"""The largest seed that every random generator of ours takes."""
MAX_TEXT_BYTES = 4_000_000
"""Of a text file that a user gives."""
MAX_NAME, MAX_PATH = 255, 4095
"""Bytes of a file's name and of its whole path; Linux allows no more."""


def check_number(
    name: str, value: Any, low: float = -math.inf, high: float = math.inf, *, whole: bool = False, above: bool = False
) -> float:
    """Return a number that is finite and within a range.

    Args:
        name: of the value, for the message.
        value: anything.
        low: the smallest valid number.
        high: the largest valid number.
        whole: it must be a whole number.
        above: it must be larger than `low`.

    Raises:
        UserError: it is anything else; the message names the value and the range.
    """
    fits = is_number(value) and low <= value <= high and not (above and value <= low)
    if fits and not (whole and value != int(value)):
        return int(value) if whole else value
    kind = "a whole number" if whole else "a number"
    begin = "" if low == -math.inf else f" above {_plain(low)}" if above else f" from {_plain(low)}"
    end = "" if high == math.inf else f" up to {_plain(high)}" if above or not begin else f" to {_plain(high)}"
    raise UserError(f"{name} must be {kind}{begin}{end}, not {shortened(value)}")


def _plain(limit: float) -> str:
    return str(int(limit)) if limit == int(limit) else f"{limit:g}"


def is_number(value: Any) -> bool:
    """Tell whether a value is a finite number; True and False are none."""
    if isinstance(value, bool):
        return False
    # An integer is finite, however large; `math.isfinite` would have to make a float of it.
    return isinstance(value, int) or (isinstance(value, float) and math.isfinite(value))


def check_text(name: str, value: Any, max_length: int = 1000) -> str:
    """Return a text that is not too long and has no control characters.

    Raises:
        UserError: it is anything else.
    """
    if isinstance(value, str) and len(value) <= max_length and value.isprintable():
        return value
    raise UserError(f"{name} must be a text of up to {max_length} printable characters, not {shortened(value)}")


def check_path(name: str, path: str | Path) -> None:
    """Check that a path can be one of this system.

    Raises:
        UserError: it has a NUL character, is not valid Unicode, or is too long.
    """
    text = str(path)
    if "\0" in text:
        raise UserError(f"{name} must be a path without NUL characters, not {shortened(text)}")
    try:
        sizes = [len(part.encode()) for part in (text, *text.split("/"))]
    except UnicodeEncodeError as error:
        raise UserError(f"{name} must be a path of valid Unicode, not {shortened(text)}") from error
    if sizes[0] > MAX_PATH or max(sizes[1:]) > MAX_NAME:
        raise UserError(f"{name} must be a path of names of up to {MAX_NAME} bytes, not {shortened(text)}")


def shortened(value: Any, length: int = 60) -> str:
    """Return a value as an error shows it: in one line, and not longer than a line."""
    if isinstance(value, int) and abs(value) >= 10**length:
        return f"a whole number of more than {length} digits"
    text = value if isinstance(value, str) and value.isprintable() else repr(value)
    return text if len(text) <= length else f"{text[:length]}..."


def read_bytes(path: str | Path, what: str, max_bytes: int = MAX_TEXT_BYTES) -> bytes:
    """Return the content of a regular file.

    Args:
        path: of the file.
        what: the file is to be, for the message.
        max_bytes: a larger file is not read.

    Raises:
        UserError: it is missing, is no regular file, is too large, or cannot be read.
    """
    path = Path(path)
    check_path(what, path)
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            kind = "a folder" if stat.S_ISDIR(status.st_mode) else "a device or a pipe"
            raise UserError(f"cannot read {what} {shortened(str(path), 200)}: it is {kind}")
        if status.st_size > max_bytes:
            size = f"{status.st_size:,} bytes, more than {max_bytes:,}"
            raise UserError(f"cannot read {what} {shortened(str(path), 200)}: it has {size}")
        with path.open("rb") as stream:
            return stream.read(max_bytes)
    except OSError as error:
        raise UserError(f"cannot read {what} {shortened(str(path), 200)}: {error.strerror or error}") from error


def read_text(path: str | Path, what: str, max_bytes: int = MAX_TEXT_BYTES) -> str:
    """Return the content of a regular text file in UTF-8; arguments and errors are those of `read_bytes`."""
    try:
        return read_bytes(path, what, max_bytes).decode()
    except UnicodeDecodeError as error:
        raise UserError(f"cannot read {what} {shortened(str(path), 200)}: it is not UTF-8 text: {error}") from error


def parse_toml(text: str, what: str) -> dict[str, Any]:
    """Return the tables of a TOML text.

    Raises:
        UserError: the text is no TOML, has a number of thousands of digits, or nests too deeply.
    """
    return _parsed(tomllib.loads, text, what, "TOML")


def parse_json(text: str, what: str) -> Any:
    """Return the value of a JSON text; errors are those of `parse_toml`."""
    return _parsed(json.loads, text, what, "JSON")


def parse_json_table(text: str, what: str) -> dict[str, Any]:
    """Return the value of a JSON text that is to be an object; errors are those of `parse_toml`."""
    value = parse_json(text, what)
    if not isinstance(value, dict):
        raise UserError(f"{what} must be a JSON object, not {shortened(value)}")
    return value


def _parsed(parse: Callable[[str], Any], text: str, what: str, language: str) -> Any:
    try:
        return parse(text)
    except ValueError as error:
        raise UserError(f"cannot read {what}: it is not valid {language}: {shortened(str(error), 200)}") from error
    except RecursionError as error:
        raise UserError(f"cannot read {what}: its {language} is nested too deeply") from error


def check_fields(kind: type, values: Mapping[str, Any], where: str) -> None:
    """Check that values have the types that the fields of a dataclass are annotated with.

    A whole number stands for a float, and a list for a tuple. True and False stand for no number, and numbers must be
    finite. Values that are no fields of the dataclass are not looked at.

    Args:
        kind: the dataclass.
        values: by the names of its fields.
        where: they stand, for the message.

    Raises:
        UserError: a value has another type.
    """
    annotations = _annotations(kind)
    for name, value in values.items():
        if name in annotations and not fits(value, annotations[name]):
            raise UserError(f"{where}: {name} must be {_words(annotations[name])}, not {shortened(value)}")


@functools.cache
def _annotations(kind: type) -> dict[str, Any]:
    return typing.get_type_hints(kind)


def fits(value: Any, annotation: Any) -> bool:
    """Tell whether a value has the type of an annotation, as `check_fields` has it."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if annotation is Any:
        return True
    if origin in (Union, types.UnionType):
        return any(fits(value, each) for each in arguments)
    if origin is typing.Literal:
        return any(type(value) is type(each) and value == each for each in arguments)
    if origin is tuple:
        return isinstance(value, list | tuple) and _items_fit(value, arguments)
    if origin is not None:  # a mapping
        return isinstance(value, Mapping) and all(
            fits(key, arguments[0]) and fits(item, arguments[1]) for key, item in value.items()
        )
    if dataclasses.is_dataclass(annotation):  # a table as well, whose own fields are checked by themselves
        return isinstance(value, Mapping | annotation)
    if annotation is float:
        return is_number(value)
    if annotation is int:
        return isinstance(value, int) and not isinstance(value, bool)
    return value is None if annotation in (None, type(None)) else isinstance(value, annotation)


def _items_fit(values: list[Any] | tuple[Any, ...], kinds: tuple[Any, ...]) -> bool:
    if len(kinds) == 2 and kinds[1] is Ellipsis:
        return all(fits(value, kinds[0]) for value in values)
    return len(values) == len(kinds) and all(fits(value, kind) for value, kind in zip(values, kinds, strict=True))


_WORDS = {str: "a text", int: "a whole number", float: "a number", bool: "true or false", type(None): "nothing"}


def _words(annotation: Any) -> str:
    """The type of an annotation as an error names it."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin in (Union, types.UnionType):
        return " or ".join(_words(each) for each in arguments)
    if origin is typing.Literal:
        return " or ".join(map(str, arguments))
    if origin is tuple:
        if len(arguments) == 2 and arguments[1] is Ellipsis:
            return f"a list, each item of which is {_words(arguments[0])}"
        return f"a list of {len(arguments)} items: {', '.join(map(_words, arguments))}"
    return _WORDS.get(annotation, "a table")
