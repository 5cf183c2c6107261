"""Checks of what comes from outside: every option of every command has a range, and files are read within limits."""

import dataclasses
import math
import os
import typing
from pathlib import Path

import pytest

from surefoot.checks import check_fields, check_number, parse_json, parse_toml, read_text
from surefoot.cli.commands import COMMANDS
from surefoot.cli.options import LIMITS, check_options
from surefoot.cli.play import Play
from surefoot.cli.replay import Replay
from surefoot.cli.train import Train
from surefoot.cli.video import Picture, Video
from surefoot.errors import UserError
from surefoot.learning.config import TrainConfig
from surefoot.learning.preset_file import preset


@pytest.mark.parametrize("command", COMMANDS.values())
def test_every_number_on_a_command_line_has_a_range(command: type) -> None:
    hints = typing.get_type_hints(command)
    numbers = [name for name, hint in hints.items() if "int" in str(hint) or "float" in str(hint)]
    assert [name for name in numbers if name not in LIMITS] == []


@pytest.mark.parametrize(
    ("command", "message"),
    [
        (Train(seed=2**32), "seed must be a whole number from 0 to 4294967295, not 4294967296"),
        (Train(minutes=math.nan), "minutes must be a number above 0 up to 100000, not nan"),
        (Train(run=Path("a\0b")), "run must be a path without NUL characters"),
        (Train(run=Path("x" * 5000)), "run must be a path of names of up to 255 bytes"),
        (Train(preset="x" * 5000), "preset must be a path of names of up to 255 bytes"),
        (Replay(Path("r.sqlite"), 10**23), "row must be a whole number from 1 to 9223372036854775807, not 1000"),
        (Video(begin=math.nan), "begin must be a number from -600 to 600, not nan"),
        (Video(end=math.inf), "end must be a number from -600 to 600, not inf"),
        (Video(fps=math.inf), "fps must be a number above 0 up to 120, not inf"),
        (Video(speed=1e-9), "speed must be a number from 0.01 to 100, not 1e-09"),
        (Video(begin=3.0, end=2.0), "end must be after begin"),
        # 6.5 s at a hundredth of the speed of life are 650 s, and at 120 per second 78,000 pictures.
        (Video(speed=0.01, fps=120.0), "78,000 pictures of 960 x 720 pixels are too many"),
        (Video(out=Path("a.gif"), end=10.0), "262 pictures of 960 x 720 pixels are too many"),
        (Picture(times=(0.1,) * 2000), "2,000 pictures of 260 x 320 pixels are too many"),
        (Play(port=65536), "port must be a whole number from 0 to 65535, not 65536"),
    ],
)
def test_an_option_that_would_cause_too_much_is_refused_before_anything_is_done(command: object, message: str) -> None:
    with pytest.raises(UserError, match=message):
        check_options(command)


def test_every_command_passes_with_its_own_defaults() -> None:
    for command in COMMANDS.values():
        needed = [f for f in dataclasses.fields(command) if f.default is dataclasses.MISSING]
        check_options(command(**{field.name: 1 if field.name == "row" else "x" for field in needed}))


def test_a_message_stays_short_however_large_the_number() -> None:
    with pytest.raises(UserError, match="not a whole number of more than 60 digits"):
        check_number("size", 10**10_000, 0, 1)


def test_only_regular_files_below_a_size_are_read(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "large").write_text("x" * 101)
    (tmp_path / "latin").write_bytes(b"stra\xdfe")
    for name, message in (
        ("pipe", "it is a device or a pipe"),
        ("large", "it has 101 bytes, more than 100"),
        ("latin", "it is not UTF-8 text"),
        (".", "it is a folder"),
        ("nothing", "No such file"),
    ):
        with pytest.raises(UserError, match=message):
            read_text(tmp_path / name, "notes", 100)
    with pytest.raises(UserError, match="it is a device or a pipe"):
        read_text("/dev/zero", "notes", 100)


def test_text_that_nests_too_deeply_is_refused() -> None:
    with pytest.raises(UserError, match="nested too deeply"):
        parse_json("[" * 100_000, "notes")
    with pytest.raises(UserError, match="nested too deeply"):
        parse_toml("a = " + "[" * 100_000, "notes")
    with pytest.raises(UserError, match="not valid JSON"):
        parse_json("9" * 5000, "notes")


def test_a_value_of_a_wrong_type_is_named_with_the_right_one() -> None:
    values = dataclasses.asdict(preset("fast", "ddpg"))
    check_fields(TrainConfig, values | {"actor": [100, 50]}, "config.json")  # a list stands for a tuple
    for change, message in (
        ({"num_envs": "256"}, "config.json: num_envs must be a whole number, not 256"),
        ({"mirror": 1}, "mirror must be true or false, not 1"),
        ({"minutes": True}, "minutes must be a number, not True"),
        ({"minutes": math.inf}, "minutes must be a number, not inf"),
        ({"steps": "x"}, "steps must be a whole number or nothing, not x"),
        ({"noise": [0.1]}, "noise must be a list of 2 items: a number, a number, not"),
        ({"actor": [100, None]}, "actor must be a list, each item of which is a whole number, not"),
        ({"hyper": []}, "hyper must be a table, not"),
    ):
        with pytest.raises(UserError, match=message):
            check_fields(TrainConfig, values | change, "config.json")
