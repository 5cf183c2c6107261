"""surefoot robot check: what was understood of a description, and what of it is wrong or suspicious."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from conftest import TIPTOE

from surefoot.cli.main import main


def check(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, *words: str) -> tuple[int, str]:
    """Exit code and standard output of `surefoot robot check`."""
    monkeypatch.setattr(sys, "argv", ["surefoot", "robot", "check", *words])
    code = 0
    try:
        main()
    except SystemExit as end:
        code = int(end.code or 0)
    return code, capsys.readouterr().out


def test_a_sound_robot_is_understood_and_stands(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    code, text = check(capsys, monkeypatch, "valkyrie")
    assert code == 0
    assert "137.29 kg" in text
    assert "4 of 4 trials" in text
    assert "left_knee_pitch" in text


def test_gains_that_cannot_hold_the_pose_are_named_and_the_exit_code_says_so(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for file in TIPTOE.parent.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    weak = tmp_path / TIPTOE.name
    text = weak.read_text()
    assert "stiffness = 150" in text
    weak.write_text(text.replace("stiffness = 150", "stiffness = 3"))
    code, text = check(capsys, monkeypatch, str(weak))
    assert code == 1
    assert "wrong" in text
    assert "0 of 4 trials" in text
