"""Clip: a film of a played robot's last seconds, drawn without a browser."""

from __future__ import annotations

import dataclasses
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from surefoot.errors import UserError
from surefoot.physics.pushes import Push
from surefoot.rates import POLICY_DT, POLICY_HZ
from surefoot.rendering.image_files import write_film
from surefoot.rendering.moment import Moment
from surefoot.rendering.renderer import Renderer
from surefoot.robots import Robot
from surefoot.viewer.playback import Shown

SECONDS = 8.0
SIZE = (640, 480)


@dataclass(frozen=True, eq=False)
class Shot:
    """A moment, and its robot's last push as one of 40 ms with the same end, from whose start the time counts [s]."""

    moment: Moment
    push: Push | None


class ClipRecorder:
    """Keeps the last `SECONDS` of one robot."""

    def __init__(self) -> None:
        self._shots: deque[Shot] = deque(maxlen=round(SECONDS * POLICY_HZ))

    def clear(self) -> None:
        """Forget everything."""
        self._shots.clear()

    def add(self, shown: Shown, robot: int) -> None:
        """Remember the last tick of the last step that is shown."""
        pushes, times = shown.pushes, shown.since(-1)[robot]
        slot = int(times.argmin())
        since, force = float(times[slot]), pushes.force[robot, slot]
        strength = float(np.linalg.norm(force))
        push = None
        if since < np.inf and strength > 1.0:
            direction = tuple((force / strength).tolist())
            body = _pushable(shown.robot, int(pushes.body[robot, slot]))
            push = Push(body, direction, strength * POLICY_DT, duration=POLICY_DT)
        moment = dataclasses.replace(Moment.of(shown.ticks, robot), time=max(since + POLICY_DT, 0.0))
        self._shots.append(Shot(moment, push))

    def shots(self) -> tuple[Shot, ...]:
        """The remembered moments, the oldest first."""
        return tuple(self._shots)


def save_clip(
    path: Path, robot: Robot, shots: tuple[Shot, ...], on_picture: Callable[[int], object] = lambda number: None
) -> None:
    """Write what was recorded as .mp4 or .gif, in real time.

    Args:
        path: of the film.
        robot: the shown robot.
        shots: a picture each.
        on_picture: called with the number of pictures drawn, after each.

    Raises:
        UserError: there is nothing to write, no OpenGL to draw with, or the file cannot be written.
    """
    if not shots:
        raise UserError("nothing has been recorded yet")

    def pictures() -> Iterator[np.ndarray]:
        with Renderer(robot, *SIZE) as scene:
            for number, shot in enumerate(shots, start=1):
                yield scene.draw(shot.moment, shot.push)
                on_picture(number)

    write_film(path, pictures(), POLICY_HZ, SIZE)


def _pushable(robot: Robot, body: int) -> str:
    """The name of a body, or of the next pushable one above it in the tree (body ids count downwards)."""
    names = {robot.body_id(name): name for name in robot.pushable}
    return next(names[number] for number in range(body, -1, -1) if number in names)
