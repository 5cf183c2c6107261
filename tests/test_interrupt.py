"""Ctrl-C: it ends a command whenever it comes, and shows no traceback."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from surefoot.cli import interrupt

SWALLOWS = """
import os, signal
try:
    os.kill(os.getpid(), signal.SIGINT)
except BaseException:
    print("swallowed")
"""
"""A module that is interrupted while it loads, and makes nothing of it; compiled modules do the same."""


def python(code: str, folder: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", "from surefoot.cli import interrupt\n" + code]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=60)


def test_a_module_that_swallows_ctrl_c_while_it_loads_does_not_keep_the_command_alive(tmp_path: Path) -> None:
    (tmp_path / "swallows.py").write_text(SWALLOWS)
    done = python("import sys; sys.path.insert(0, '.')\ninterrupt.listen()\nimport swallows\nprint('alive')", tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (interrupt.EXIT_CODE, "", "")


def test_outside_of_imports_ctrl_c_is_an_exception_and_in_a_block_with_nothing_to_lose_the_end(tmp_path: Path) -> None:
    raised = "interrupt.listen()\ntry: signal.raise_signal(signal.SIGINT)\nexcept KeyboardInterrupt: print('caught')"
    ended = "interrupt.listen()\nwith interrupt.ends_at_once():\n try: signal.raise_signal(signal.SIGINT)\n finally: 0"
    first, second = (python(f"import signal\n{code}", tmp_path) for code in (raised, ended))
    assert (first.returncode, first.stdout, first.stderr) == (0, "caught\n", "")
    assert (second.returncode, second.stdout, second.stderr) == (interrupt.EXIT_CODE, "", "")


def test_who_ignores_ctrl_c_goes_on_ignoring_it(tmp_path: Path) -> None:
    code = "interrupt.listen()\nwith interrupt.ends_at_once(): signal.raise_signal(signal.SIGINT)\nprint('alive')"
    done = python(f"import signal\nsignal.signal(signal.SIGINT, signal.SIG_IGN)\n{code}", tmp_path)
    assert (done.returncode, done.stdout) == (0, "alive\n")


@pytest.mark.slow
@pytest.mark.parametrize("module", ["tyro", "numpy", "mujoco", "viser"])
def test_ctrl_c_while_a_command_loads_its_modules_shows_no_traceback(module: str, tmp_path: Path) -> None:
    # Python says of every module when it has loaded it; the next one is being loaded then, or the page begins.
    command = [sys.executable, "-X", "importtime", "-m", "surefoot", "play", "nominal", "--port", "0"]
    with subprocess.Popen(
        command,
        cwd=tmp_path,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a job in the background may ignore it
    ) as process:
        assert process.stderr
        assert any(line.split("|")[-1].strip() == module for line in process.stderr)
        process.send_signal(signal.SIGINT)
        assert "Traceback" not in process.communicate(timeout=60)[1]
        assert process.returncode == interrupt.EXIT_CODE
