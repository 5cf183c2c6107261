"""Video: real trials recorded and drawn with their forces, as pictures, strips and films."""

from __future__ import annotations

import dataclasses
import functools
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import imageio.v2 as imageio
import matplotlib
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from surefoot.agents.agent import Policy
from surefoot.agents.controllers.controller import ControllerAgent
from surefoot.errors import UserError
from surefoot.evaluation.outcome import Outcome
from surefoot.evaluation.trials import Trial, TrialSource, draws, run_trials
from surefoot.physics.pushes import Push
from surefoot.physics.step_record import StepRecord
from surefoot.rates import CONTROL_DT, CONTROL_HZ
from surefoot.rendering.renderer import LEGEND, Moment, Renderer
from surefoot.robots.robot import Robot, load_robot

PICTURE_SUFFIXES = (".png", ".jpg")
VIDEO_SUFFIXES = (".mp4", ".gif")
STRIP_TIMES = (0.1, 0.3, 0.6, 1.0, 2.0, 4.0)

_HOLD = 0.8
"""A film stays on its last picture for so long [s]."""
_INK, _GREY, _GOOD, _BAD = "#1c2430", "#6b7686", "#1d7f45", "#c22f2a"

_WAYS = (
    *("forward", "forward left", "left", "backward left"),
    *("backward", "backward right", "right", "forward right"),
)


@dataclass(frozen=True, eq=False)
class Recording:
    """A trial that was run, moment by moment at `fps`, from the start of its settling time to its verdict."""

    policy: str
    robot: Robot
    trial: Trial
    outcome: Outcome
    fps: int
    moments: tuple[Moment, ...]

    @functools.cached_property
    def times(self) -> np.ndarray:
        """Since the beginning of the push (num_moments,) [s]."""
        return np.array([moment.time for moment in self.moments])

    def at(self, time: float) -> Moment:
        """The first moment that is not before `time`; else the last."""
        return self.moments[min(int(np.searchsorted(self.times, time - 1e-9)), len(self.moments) - 1)]


def record(policy: Policy | ControllerAgent, trial: Trial, fps: int = 50) -> Recording:
    """Run one trial and keep what a picture shows of it.

    Args:
        fps: moments per second of simulated time.

    Raises:
        UserError: `fps` does not divide the 500 ticks of a second.
    """
    valid = [rate for rate in range(1, CONTROL_HZ + 1) if CONTROL_HZ % rate == 0]
    if fps not in valid:
        raise UserError(f"cannot record {fps} frames per second; valid: {', '.join(map(str, valid))}")
    recorder = _Recorder(trial, len(policy.contract.joints), CONTROL_HZ // fps)
    run_trials(policy, recorder, num_slots=1, num_threads=1, on_step=recorder.watch, domain=trial.domain)
    return Recording(
        policy.name, load_robot(policy.contract.robot), trial, recorder.outcome, fps, recorder.timed_moments()
    )


class _Recorder(TrialSource):
    """The source of a single trial, and the one who watches it."""

    outcome: Outcome

    def __init__(self, trial: Trial, num_joints: int, stride: int):
        self._trial = trial
        self._todo: list[Trial] = [trial]
        _, self._begin = draws(trial, num_joints)
        self._stride = stride
        self._num_ticks = 0
        self._seen: list[tuple[int, Moment]] = []

    def next(self) -> Trial | None:
        return self._todo.pop() if self._todo else None

    def report(self, trial: Trial, outcome: Outcome) -> None:
        self.outcome = outcome

    def watch(self, slots: np.ndarray, ticks: StepRecord) -> None:
        for tick in range(-self._num_ticks % self._stride, len(ticks), self._stride):
            self._seen.append((self._num_ticks + tick, Moment.of(ticks, tick=tick)))
        self._num_ticks += len(ticks)

    def timed_moments(self) -> tuple[Moment, ...]:
        begin = self._begin + round(min(push.start for push in self._trial.pushes) * CONTROL_HZ)
        return tuple(dataclasses.replace(moment, time=(tick - begin) * CONTROL_DT) for tick, moment in self._seen)


def push_words(push: Push) -> str:
    """A push in words: "240 Ns forward", "108 Ns left at the left shank", "90 Ns at 30°"."""
    x, y, z = push.direction
    angle = float(np.degrees(np.arctan2(y, x))) % 360.0
    eighth = round(angle / 45.0)
    if abs(z) > np.hypot(x, y):
        way = "up" if z > 0 else "down"
    elif abs(angle - 45.0 * eighth) < 1.0:
        way = _WAYS[eighth % 8]
    else:
        way = f"at {angle:.0f}°"
    body = "" if push.body == "root" else f" at the {push.body.replace('_', ' ')}"
    return f"{push.impulse:g} Ns {way}{body}"


def trial_words(trial: Trial) -> str:
    """A trial's disturbance in words: "drop from 0.4 m, leaning", "500 Ns up, then 70 Ns forward"."""
    parts = []
    if trial.drop:
        parts.append(f"drop from {trial.drop.height:g} m" + ", leaning" * bool(trial.drop.roll or trial.drop.pitch))
    parts += [push_words(push) for push in trial.pushes if push.impulse]
    return ", then ".join(parts) or "no push"


def draw_moment(scene: Renderer, trial: Trial, moment: Moment) -> np.ndarray:
    """A picture of a trial's moment with the push that began last, uint8 (height, width, 3)."""
    first = min(push.start for push in trial.pushes)
    begun = [push for push in trial.pushes if push.start - first <= moment.time]
    push = max(begun or [trial.push], key=lambda push: push.start)
    return scene.draw(dataclasses.replace(moment, time=moment.time - (push.start - first)), push)


def filmstrip(
    recordings: Sequence[Recording], times: Sequence[float] = STRIP_TIMES, cell: tuple[int, int] = (260, 320)
) -> np.ndarray:
    """Trials as rows of pictures, in the manner of the paper's figures 1 and 2: uint8 (height, width, 3).

    A trial that ends before the last time shows its last moment once.

    Args:
        times: since the beginning of the push [s], one picture each.
        cell: width and height of a picture [pixels].

    Raises:
        UserError: there is nothing to show, or no OpenGL to draw with.
    """
    if not len(recordings) or not len(times):
        raise UserError(f"a strip needs recordings and times, not {len(recordings)} and {len(times)} of them")
    margin, gap, footer = 210, 4, 44
    width = margin + len(times) * (cell[0] + gap)
    strip = Image.new("RGB", (width, len(recordings) * (cell[1] + gap) + footer), "white")
    for row, recording in enumerate(recordings):
        top = row * (cell[1] + gap)
        _write_caption(strip, top, recording)
        for column, picture in enumerate(_strip_pictures(recording, sorted(times), cell)):
            strip.paste(picture, (margin + column * (cell[0] + gap), top))
    _draw_legend(strip, (margin, strip.height - footer // 2), 16, _INK, "white")
    return np.array(strip)


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
        begin, end: which part of the trial, since the beginning of the push [s].
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


def save_picture(path: str | Path, image: np.ndarray) -> None:
    """Write a picture, uint8 (height, width, 3), as .png or .jpg.

    Raises:
        UserError: the suffix is another, or the file cannot be written.
    """
    path = _checked(path, PICTURE_SUFFIXES)
    try:
        Image.fromarray(image).save(path)
    except OSError as error:
        raise UserError(f"cannot write {path}: {error.strerror or error}") from error


def save_video(
    path: str | Path, recording: Recording, fps: float = 25, size: tuple[int, int] = (640, 480), **options: float
) -> None:
    """Write a film of a trial as .mp4 (H.264) or .gif.

    Args:
        size: width and height [pixels]; even for .mp4.
        options: `begin`, `end` and `speed` of `frames`.

    Raises:
        UserError: the suffix or the size will not do, the file cannot be written, or there is no OpenGL to draw with.
    """
    write_film(path, frames(recording, fps, size, **options), fps, size)


def write_film(path: str | Path, pictures: Iterator[np.ndarray], fps: float, size: tuple[int, int]) -> None:
    """Write pictures, uint8 (height, width, 3), as .mp4 (H.264) or .gif; `size` is their width and height.

    Raises:
        UserError: the suffix or the size will not do, or the file cannot be written.
    """
    check_film(path, size)
    path = Path(path)
    try:
        if path.suffix.lower() == ".gif":
            _write_gif(path, pictures, fps)
            return
        film: Any = imageio.get_writer(path, fps=fps, codec="libx264", quality=8, macro_block_size=2)
        with film:
            for picture in pictures:
                film.append_data(picture)
    except OSError as error:
        raise UserError(f"cannot write {path}: {error.strerror or error}") from error


def check_film(path: str | Path, size: tuple[int, int]) -> None:
    """Raises UserError: a film cannot be written there, or not of this size."""
    if _checked(path, VIDEO_SUFFIXES).suffix.lower() == ".mp4" and (size[0] % 2 or size[1] % 2):
        raise UserError(f"an .mp4 cannot have {size[0]} x {size[1]} pixels; valid: even numbers")


def check_picture(path: str | Path) -> None:
    """Raises UserError: a picture cannot be written there."""
    _checked(path, PICTURE_SUFFIXES)


def _write_gif(path: Path, pictures: Iterator[np.ndarray], fps: float) -> None:
    images = [Image.fromarray(picture) for picture in pictures]
    # One palette for all, from the whole film: no flicker, and still areas cost nothing. MAXCOVERAGE keeps the colours
    # of small marks, k-means those of the large areas.
    some = np.concatenate([np.asarray(image) for image in images[:: max(1, len(images) // 8)]])
    palette = Image.fromarray(some).quantize(256, Image.Quantize.MAXCOVERAGE, kmeans=3)
    first, *rest = (image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images)
    first.save(path, save_all=True, append_images=rest, duration=1000 / fps, loop=0, optimize=False)


def _checked(path: str | Path, valid: tuple[str, ...]) -> Path:
    path = Path(path)
    if path.suffix.lower() not in valid:
        raise UserError(f"cannot write '{path}': unknown suffix '{path.suffix}'; valid: {', '.join(valid)}")
    if not path.parent.is_dir():
        raise UserError(f"cannot write '{path}': there is no folder '{path.parent}'")
    return path


def _strip_pictures(recording: Recording, times: Sequence[float], size: tuple[int, int]) -> Iterator[Image.Image]:
    outcome, last = recording.outcome, recording.times[-1]
    with Renderer(recording.robot, *size, recording.trial.domain) as scene:
        for time in times:
            is_over = time > last + 1e-9
            picture = Image.fromarray(draw_moment(scene, recording.trial, recording.at(time)))
            words = f"{outcome.reason}, {outcome.seconds:.2f} s" if is_over else f"{time:g} s"
            _label(picture, (8, 8), words, 17, _verdict_ink(recording) if is_over else _INK)
            yield picture
            if is_over:
                return


def _stamped(scene: Renderer, recording: Recording, moment: Moment, verdict: bool = False) -> Image.Image:
    picture = Image.fromarray(draw_moment(scene, recording.trial, moment))
    unit = picture.height / 480
    _label(picture, (12 * unit, 12 * unit), trial_words(recording.trial), 22 * unit, _INK)
    _label(picture, (12 * unit, 48 * unit), recording.policy, 14 * unit, _INK)
    _label(picture, (12 * unit, 400 * unit), f"{moment.time:.2f} s", 22 * unit, _INK)
    if verdict:
        _label(picture, (120 * unit, 400 * unit), recording.outcome.reason, 22 * unit, _verdict_ink(recording))
    _draw_legend(picture, (14 * unit, 458 * unit), 13 * unit, "white", _INK)
    return picture


def _write_caption(strip: Image.Image, top: float, recording: Recording) -> None:
    draw, y = ImageDraw.Draw(strip), top + 16
    verdict = [recording.outcome.reason] + ["without a step"] * recording.outcome.without_step
    lines = [(text, 21, _INK) for text in textwrap.wrap(trial_words(recording.trial), 14)]
    lines += [(text, 18, _verdict_ink(recording)) for text in verdict]
    lines += [(text, 14, _GREY) for text in textwrap.wrap(recording.policy, 20)]
    for text, size, ink in lines:
        draw.text((14, y), text, fill=ink, font=_font(size))
        y += 1.45 * size


def _verdict_ink(recording: Recording) -> str:
    return _GOOD if recording.outcome.recovered else _BAD


def _label(picture: Image.Image, corner: tuple[float, float], text: str, size: float, ground: str) -> None:
    """White text on a see-through box."""
    draw, (x, y) = ImageDraw.Draw(picture, "RGBA"), corner
    box = (x, y, x + draw.textlength(text, font=_font(size)) + 0.8 * size, y + 1.5 * size)
    # Whole pixels: Pillow draws the corners twice where they overlap.
    draw.rounded_rectangle([round(edge) for edge in box], radius=round(0.3 * size), fill=ground + "c8")
    draw.text((x + 0.4 * size, y + 0.75 * size), text, fill="white", font=_font(size), anchor="lm")


def _draw_legend(picture: Image.Image, middle: tuple[float, float], size: float, ink: str, edge: str) -> None:
    """What the marks mean, from `middle` to the right."""
    draw, (x, y) = ImageDraw.Draw(picture), middle
    length = sum(draw.textlength("●" + word, font=_font(size)) + 1.25 * size for word, _ in LEGEND)
    size *= min(1.0, (picture.width - 2 * x) / length)
    font = _font(size)
    for word, color in LEGEND:
        dot = tuple(round(255 * c) for c in color[:3])
        for text, fill, space in (("●", dot, 0.25 * size), (word, ink, size)):
            draw.text((x, y), text, fill=fill, font=font, anchor="lm", stroke_width=0.08 * size, stroke_fill=edge)
            x += draw.textlength(text, font=font) + space


@functools.cache
def _font(size: float) -> ImageFont.FreeTypeFont:
    """DejaVu Sans Bold as it comes with matplotlib: the same on every machine."""
    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts/ttf/DejaVuSans-Bold.ttf"), size)
