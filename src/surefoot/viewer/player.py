"""Player: one thread that runs a session in real time and carries out every action on it.

Browsers are served in threads of their own. Their requests are queued (`do`) and carried out between two frames, so
that nothing else needs a lock.
"""

from __future__ import annotations

import queue
import threading
import time
import traceback
from collections.abc import Callable

from surefoot.checks import check_number
from surefoot.errors import UserError
from surefoot.rates import CONTROL_HZ, TICKS_PER_STEP
from surefoot.viewer.playback import Playback, Shown
from surefoot.viewer.session import Session

MAX_BEHIND = 3
"""Policy steps per frame at most: a slow machine plays in slow motion instead of choking."""
MIN_SPEED = 0.05
"""The slowest motion, as a share of real time."""
MAX_SKIPPED = 10
"""Frames one after the other that may fail to be shown."""
FEW = 4
"""Up to so many robots are drawn 50 times a second, more 25 times."""


class Player:
    """Plays a session.

    Args:
        session: what is played.
        show: called for every frame with what is shown and the tick of its last step to show.
        is_watched: does anybody look? Nothing is simulated meanwhile if not.
        on_step: called with what is shown after every policy step.

    Attributes:
        session: the robots that live on.
        playback: what is shown in their place, while they wait; none most of the time.
        paused: by the user.
        real_time: share of `speed` that was reached over the last second.
        frame_rate: frames per second over the last second.
    """

    def __init__(
        self,
        session: Session,
        show: Callable[[Shown, int], None],
        is_watched: Callable[[], bool],
        on_step: Callable[[Shown], None] = lambda shown: None,
    ):
        self.session = session
        self.playback: Playback | None = None
        self.paused = False
        self._speed = 1.0
        self.real_time = 1.0
        self.frame_rate = 0.0
        self._show = show
        self._is_watched = is_watched
        self._on_step = on_step
        self._asked: queue.SimpleQueue[Callable[[Session], object]] = queue.SimpleQueue()
        self._position = 0.0
        self._num_skipped = 0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="player", daemon=True)

    @property
    def speed(self) -> float:
        """1 is real time, 0.1 a tenth of it.

        Raises:
            UserError: when it is set to anything but a number from `MIN_SPEED` to 1.
        """
        return self._speed

    @speed.setter
    def speed(self, speed: float) -> None:
        self._speed = float(check_number("speed", speed, MIN_SPEED, 1.0))

    @property
    def frames_per_second(self) -> int:
        """The frame rate that is aimed at."""
        return 50 if self.session.num_robots <= FEW else 25

    @property
    def shown(self) -> Shown:
        """The session or playback that the page shows now."""
        return self.playback or self.session

    @property
    def is_alive(self) -> bool:
        """Does its thread run?"""
        return self._thread.is_alive()

    def do(self, action: Callable[[Session], object]) -> None:
        """Do something to the session before the next frame; its errors become the session's message."""
        self._asked.put(action)

    def single_step(self) -> None:
        """Pause, and advance by one policy step."""
        self.paused = True
        self.do(lambda session: self._step())

    def start(self) -> None:
        """Begin to play."""
        self._thread.start()

    def stop(self) -> None:
        """Stop and wait for the end."""
        self._stop.set()
        self._thread.join(timeout=5.0)

    def frame(self) -> int:
        """One frame: what was asked for, then as many policy steps as its time needs. Returns how many."""
        self._do_what_was_asked()
        steps = 0
        if not self.paused:
            self._position += self.speed * CONTROL_HZ / self.frames_per_second
            while self._position >= TICKS_PER_STEP and steps < MAX_BEHIND:
                self._step()
                steps += 1
        shown = self.shown
        self._show_or_skip(shown, min(int(self._position), len(shown.ticks) - 1))
        return steps

    def _show_or_skip(self, session: Session | Playback, tick: int) -> None:
        """Show a frame, or skip it: viser sets an event of another thread's, which fails at times."""
        try:
            self._show(session, tick)
            self._num_skipped = 0
        except RuntimeError:
            self._num_skipped += 1
            if self._num_skipped > MAX_SKIPPED:
                raise

    def _step(self) -> None:
        if self.playback and self.playback.is_over:
            self.playback = None
        self.shown.step()
        self._on_step(self.shown)
        self._position = TICKS_PER_STEP - 1.0 if self.paused else max(self._position - TICKS_PER_STEP, 0.0)

    def _do_what_was_asked(self) -> None:
        while not self._asked.empty():
            try:
                self._asked.get()(self.session)
            except UserError as error:
                self.session.message = str(error)
            except Exception as error:  # of what one browser asked for: the others play on
                self.session.message = f"could not do that: {type(error).__name__}: {error}"
                traceback.print_exc()

    def _run(self) -> None:
        due, counted, frames, steps = time.monotonic(), time.monotonic(), 0, 0
        while not self._stop.is_set():
            if not self._is_watched():
                self._stop.wait(0.05)
                due = counted = time.monotonic()
                frames = steps = 0
                continue
            try:
                steps += self.frame()
            except Exception:  # whatever a policy or a browser did, the page stays up and says so
                self.paused = True
                self.session.message = "stopped by an error: " + traceback.format_exc(limit=-1).splitlines()[-1]
                traceback.print_exc()
            frames += 1
            due = max(due + 1.0 / self.frames_per_second, time.monotonic() - 0.1)
            self._stop.wait(max(due - time.monotonic(), 0.0))
            passed = time.monotonic() - counted
            if passed > 1.0:
                self.frame_rate = frames / passed
                self.real_time = steps * TICKS_PER_STEP / CONTROL_HZ / passed / self.speed
                counted, frames, steps = time.monotonic(), 0, 0
