"""Filming: the drawing of one film at a time in a separate process, which can be cancelled."""

from __future__ import annotations

import contextlib
import os
import pickle
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Sequence
from pathlib import Path

from surefoot.errors import UserError
from surefoot.robots import Robot
from surefoot.viewer.clip import Shot

CANCELLED = "the film was cancelled"


class Filming:
    """Draws films.

    Args:
        show: called with the share of the film that is done, 0 to 1, and with None when it is over.
    """

    def __init__(self, show: Callable[[float | None], object]):
        self._show = show
        self._busy = threading.Lock()
        self._changing = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._is_cancelled = False

    @property
    def is_busy(self) -> bool:
        """Is a film being drawn?"""
        return self._busy.locked()

    def draw(self, robot: Robot, shots: Sequence[Shot]) -> bytes:
        """The film as an MP4 file's bytes; waits for them.

        Raises:
            UserError: another one is being drawn, it was cancelled, or it cannot be drawn.
        """
        if not shots:
            raise UserError("nothing has been recorded yet")
        if not self._busy.acquire(blocking=False):
            raise UserError("another film is being drawn; wait for it, or cancel it")
        try:
            self._is_cancelled = False
            self._show(0.0)
            with tempfile.TemporaryDirectory(prefix="surefoot-") as folder:
                return self._drawn(robot, shots, Path(folder))
        finally:
            self._busy.release()
            self._show(None)

    def cancel(self) -> None:
        """End the film that is being drawn, if there is one."""
        with self._changing:
            self._is_cancelled = True
            if self._process and self._process.poll() is None:
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(self._process.pid, signal.SIGKILL)  # with ffmpeg, which it has started

    def _drawn(self, robot: Robot, shots: Sequence[Shot], folder: Path) -> bytes:
        film, errors = folder / "surefoot.mp4", folder / "errors.txt"
        command = [sys.executable, "-m", "surefoot.viewer.film_process", str(film)]
        with errors.open("wb") as stderr:
            with self._changing:
                if self._is_cancelled:
                    raise UserError(CANCELLED)
                # In a session of its own, where the terminal's Ctrl-C does not reach it.
                self._process = process = subprocess.Popen(
                    command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=stderr, start_new_session=True
                )
            with process:
                self._follow(process, (robot.name, tuple(shots)), len(shots))
        if self._is_cancelled:
            raise UserError(CANCELLED)
        if process.returncode:
            reason = (errors.read_text(errors="replace").strip().splitlines() or ["no reason was given"])[-1]
            raise UserError(f"the film could not be drawn: {reason}")
        return film.read_bytes()

    def _follow(self, process: subprocess.Popen[bytes], task: tuple[str, tuple[Shot, ...]], num_shots: int) -> None:
        assert process.stdin is not None
        assert process.stdout is not None
        with contextlib.suppress(BrokenPipeError):  # it has ended, and says why
            process.stdin.write(pickle.dumps(task))
            process.stdin.close()
        for line in process.stdout:
            if line.strip().isdigit():
                self._show(int(line) / num_shots)
