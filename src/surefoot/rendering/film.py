"""Films: a recorded trial as moving pictures, with its time and its verdict."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image

from surefoot.errors import UserError
from surefoot.evaluation.trials import Trial
from surefoot.rendering.image_files import write_film
from surefoot.rendering.lettering import INK, draw_legend, verdict_ink, write_label
from surefoot.rendering.moment import Moment
from surefoot.rendering.recording import Recording
from surefoot.rendering.renderer import AFTERGLOW, Renderer
from surefoot.rendering.words import trial_words

_HOLD = 0.8
"""A film rests on its last picture for this time [s]."""


def draw_moment(scene: Renderer, trial: Trial, moment: Moment, afterglow: float = AFTERGLOW) -> np.ndarray:
    """A picture of a trial's moment with the push that began last, uint8 (height, width, 3).

    Args:
        scene: draws it.
        trial: trial of the moment.
        moment: what is shown.
        afterglow: as for `Renderer.draw`; 0 for a push that is drawn only while it acts.
    """
    first = min(push.start for push in trial.pushes)
    begun = [push for push in trial.pushes if push.start - first <= moment.time]
    push = max(begun or [trial.push], key=lambda push: push.start)
    return scene.draw(dataclasses.replace(moment, time=moment.time - (push.start - first)), push, afterglow)


def frames(
    recording: Recording,
    fps: float = 25,
    size: tuple[int, int] = (640, 480),
    begin: float = -0.5,
    end: float = np.inf,
    speed: float = 1.0,
) -> Iterator[np.ndarray]:
    """The pictures of a film, uint8 (height, width, 3), with the time and the verdict written in.

    Args:
        recording: what is shown.
        fps: pictures per second.
        size: width and height [pixels].
        begin: from where on, since the beginning of the push [s].
        end: up to where, since the beginning of the push [s].
        speed: 0.5 for half the speed of life.

    Raises:
        UserError: `fps` or `speed` is not positive, or there is no OpenGL to draw with.
    """
    if not (fps > 0 and speed > 0):
        raise UserError(f"fps and speed must be positive, not {fps:g} and {speed:g}")
    times, step = recording.times, speed / fps
    last = min(end, times[-1])
    with Renderer(recording.robot, *size, recording.trial.domain) as scene:
        for time in np.arange(max(begin, times[0]), last + 1e-9, step):
            yield np.array(_stamped(scene, recording, recording.at(time)))
        ending = np.array(_stamped(scene, recording, recording.at(last), verdict=last == times[-1]))
    for _ in range(round(_HOLD * fps)):
        yield ending


def save_video(
    path: str | Path, recording: Recording, fps: float = 25, size: tuple[int, int] = (640, 480), **options: float
) -> None:
    """Write a film of a trial as .mp4 (H.264) or .gif.

    Args:
        path: path of the film.
        recording: the recorded trial.
        fps: pictures per second.
        size: width and height [pixels]; even for .mp4.
        options: `begin`, `end` and `speed` of `frames`.

    Raises:
        UserError: the suffix or size is not supported, the file cannot be written, or there is no OpenGL to draw with.
    """
    write_film(path, frames(recording, fps, size, **options), fps, size)


def _stamped(scene: Renderer, recording: Recording, moment: Moment, verdict: bool = False) -> Image.Image:
    picture = Image.fromarray(draw_moment(scene, recording.trial, moment))
    unit = picture.height / 480
    write_label(picture, (12 * unit, 12 * unit), trial_words(recording.trial), 22 * unit, INK)
    write_label(picture, (12 * unit, 48 * unit), recording.policy, 14 * unit, INK)
    write_label(picture, (12 * unit, 400 * unit), f"{moment.time:.2f} s", 22 * unit, INK)
    if verdict:
        write_label(
            picture, (120 * unit, 400 * unit), recording.outcome.reason, 22 * unit, verdict_ink(recording.outcome)
        )
    draw_legend(picture, (14 * unit, 458 * unit), 13 * unit, "white", INK)
    return picture
