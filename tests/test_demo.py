"""The demo: it leaves alone whatever is there already."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest
from page_client import until

from surefoot.cli.demo import Demo, new_folder
from surefoot.errors import UserError


def test_a_new_demo_goes_to_a_new_folder(tmp_path: Path) -> None:
    assert new_folder(tmp_path / "runs" / "demo") == tmp_path / "runs" / "demo"
    assert new_folder(tmp_path / "runs" / "demo") == tmp_path / "runs" / "demo-2"
    (tmp_path / "runs" / "demo-3").write_text("somebody's file")
    assert new_folder(tmp_path / "runs" / "demo") == tmp_path / "runs" / "demo-4"
    assert (tmp_path / "runs" / "demo-3").read_text() == "somebody's file"


def test_a_demo_that_is_refused_leaves_no_folder(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="unknown algorithm"):
        Demo(algorithm="sac", out=tmp_path / "demo").main()
    assert not list(tmp_path.iterdir())


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match=r"cannot make the folder .*file/demo"):
        new_folder(tmp_path / "file" / "demo")


@pytest.mark.slow
def test_a_demo_keeps_every_byte_of_the_one_before(tmp_path: Path) -> None:
    earlier = tmp_path / "runs" / "demo"
    (earlier / "kept").mkdir(parents=True)
    for name in (".surefoot-demo", "config.json", "best.onnx", "kept/2.onnx", "results.sqlite"):
        (earlier / name).write_text(f"{name} of the demo before")
    command = [sys.executable, "-m", "surefoot", "demo", "--minutes", "1"]
    with subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True) as demo:
        assert until((tmp_path / "runs" / "demo-2" / "config.json").exists), "it learns"
        demo.send_signal(signal.SIGINT)
        assert "demo-2" in demo.communicate(timeout=60)[1]
    for name in (".surefoot-demo", "config.json", "best.onnx", "kept/2.onnx", "results.sqlite"):
        assert (earlier / name).read_text() == f"{name} of the demo before"
