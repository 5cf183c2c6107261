"""Words on a command line that once ended in a traceback: they end in one line and exit code 2, and leave nothing."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from test_policy_safety import foreign

from surefoot.cli.main import main


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The working folder of a command, with files of others."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "FILE").write_text("somebody's")
    (tmp_path / "empty.toml").write_text("robot = {}")
    (tmp_path / "latin.toml").write_bytes(b"name = 'stra\xdfe'")
    foreign(tmp_path)
    before = signal.getsignal(signal.SIGINT)
    yield tmp_path
    signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["train", "--seed", "4294967296"], "seed must be a whole number from 0 to 4294967295, not 4294967296"),
        (["train", "--resume", "[/red]x"], "[/red]x is not a run folder"),
        (["train", "--run", "FILE"], "FILE exists already"),
        (["train", "--run", "x" * 5000], "run must be a path of names of up to 255 bytes"),
        (["train", "--after", "theirs.onnx"], "theirs.onnx is refused: it has the operator 'MatMul'"),
        (["ablate", "--out", "FILE"], "cannot use FILE: File exists"),
        (["reproduce", "--out", "FILE"], "cannot use FILE/trpo-0: Not a directory"),
        (["evaluate", "nominal", "--directions", "4000000"], "directions must be a whole number from 4 to 360"),
        (["evaluate", "nominal", "--robot", "empty.toml"], "empty.toml"),
        (["evaluate", "nominal", "--suite", "latin.toml"], "it is not UTF-8 text"),
        (["evaluate", "a\0b"], "policy must be a path without NUL characters"),
        (["replay", "r.sqlite", "9" * 23], "row must be a whole number from 1 to 9223372036854775807"),
        (["video", "--begin", "nan"], "begin must be a number from -600 to 600, not nan"),
        (["video", "--end", "inf"], "end must be a number from -600 to 600, not inf"),
        (["video", "--fps", "inf"], "fps must be a number above 0 up to 120, not inf"),
        (["video", "--speed", "1e-9"], "speed must be a number from 0.01 to 100, not 1e-09"),
    ],
)
def test_a_hostile_word_is_answered_by_a_line(
    words: list[str], message: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    files = {file: file.read_bytes() for file in folder.rglob("*")}
    monkeypatch.setattr(sys, "argv", ["surefoot", *words])
    with pytest.raises(SystemExit) as end:
        main()
    told = capsys.readouterr()
    assert (end.value.code, told.out) == (2, "")
    assert "Traceback" not in told.err
    assert told.err.splitlines()[-1].startswith("surefoot: ")
    assert message in told.err.splitlines()[-1]
    assert {file: file.read_bytes() for file in folder.rglob("*")} == files, "nothing is left behind, nothing changed"
