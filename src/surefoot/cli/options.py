"""Options: the checks of a command line's values before a command runs.

Every number has a range. Its upper end keeps the resulting work (robots, trials, pictures, files, time) within a
computer's means. Every path must be valid on this system. A value that cannot be checked by itself, such as a body's
name, is checked where it is looked up.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any, NamedTuple

from surefoot.checks import MAX_SEED, check_number, check_path
from surefoot.errors import UserError


class Limit(NamedTuple):
    """The valid numbers of an option.

    Attributes:
        low, high: the smallest and the largest one.
        above: the number must be larger than `low`.
    """

    low: float
    high: float
    above: bool = False


LIMITS = {
    "action_scale": Limit(0.0, 100.0),
    "begin": Limit(-600.0, 600.0),
    "directions": Limit(4, 360),
    "duration": Limit(0.0, 5.0, above=True),
    "end": Limit(-600.0, 600.0),
    "film_minutes": Limit(0.0, 100_000.0, above=True),
    "fps": Limit(0.0, 120.0, above=True),
    "impulse": Limit(0.0, 100_000.0, above=True),
    "largest": Limit(0.0, 100_000.0),
    "lever": Limit(-1.1, 1.0),
    "mean_minutes": Limit(0.0, 100_000.0, above=True),
    "minutes": Limit(0.0, 100_000.0, above=True),
    "port": Limit(0, 65_535),
    "robots": Limit(1, 64),
    "rounds": Limit(1, 1_000),
    "row": Limit(1, 2**63 - 1),
    "seconds": Limit(0.0, 3_600.0, above=True),
    "seed": Limit(0, MAX_SEED),
    "size": Limit(16, 4_096),
    "speed": Limit(0.01, 100.0),
    "steps": Limit(1, 10**12),
    "times": Limit(-600.0, 600.0),
    "trials": Limit(1, 100),
    "workers": Limit(1, 100_000),
}
"""Option -> its valid numbers, the same for all commands that have it."""

_ANY = Limit(-1e12, 1e12)
MAX_FILM_PIXELS = 2_000_000_000
"""Of all pictures of a film together; a minute of 960 x 720 pixels at 25 pictures per second has half of that."""
MAX_PICTURE_PIXELS = 100_000_000
"""Of a film strip, and of a .gif, whose pictures are held in memory together."""


def check_options(command: Any) -> None:
    """Check every option of a command.

    Args:
        command: a dataclass whose fields are the options.

    Raises:
        UserError: a number is out of its range, or a path cannot be one.
    """
    for field in dataclasses.fields(command):
        value = getattr(command, field.name)
        for each in value if isinstance(value, tuple | list) else (value,):
            _check(field.name, each)
    options = {field.name for field in dataclasses.fields(command)}
    if {"begin", "end", "fps", "size", "speed"} <= options:
        _check_film(command)
    elif {"impulse", "times", "size"} <= options:
        _check_pixels(command.size, max(len(command.impulse), 1) * len(command.times), MAX_PICTURE_PIXELS)


def _check(option: str, value: Any) -> None:
    name = option.replace("_", "-")
    if isinstance(value, str | Path):
        check_path(name, value)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        low, high, above = LIMITS.get(option, _ANY)
        check_number(name, value, low, high, above=above, whole=isinstance(value, int))


def _check_film(film: Any) -> None:
    """Check that a film has a beginning before its end, and not more pixels than can be drawn."""
    if film.end <= film.begin:
        raise UserError(f"end must be after begin, not {film.end:g} s with a begin of {film.begin:g} s")
    at_most = MAX_PICTURE_PIXELS if film.out.suffix.lower() == ".gif" else MAX_FILM_PIXELS
    _check_pixels(film.size, (film.end - film.begin) / film.speed * film.fps, at_most)


def _check_pixels(size: tuple[int, int], num_pictures: float, at_most: int) -> None:
    width, height = size
    if width * height * num_pictures > at_most:
        raise UserError(
            f"{num_pictures:,.0f} pictures of {width} x {height} pixels are too many; valid: {at_most:,} pixels in all"
        )
