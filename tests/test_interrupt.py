"""Ctrl-C: it ends a command whenever it comes, and shows no traceback."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
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
def test_ctrl_c_while_a_command_loads_its_modules_shows_no_traceback(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "surefoot", "evaluate", "nominal"]
    begun = [subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True) for _ in range(3)]
    for process in begun:
        time.sleep(0.4)  # the first loads the first modules then, the third the last ones
        process.send_signal(signal.SIGINT)
    for process in begun:
        with process:
            assert "Traceback" not in process.communicate(timeout=60)[1]
        assert process.returncode == interrupt.EXIT_CODE
