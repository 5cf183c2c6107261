"""Strips: trials as rows of pictures, in the style of the paper's figures 1 and 2."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence

import numpy as np
from PIL import Image, ImageDraw

from surefoot.errors import UserError
from surefoot.evaluation.protocol import protocol_for
from surefoot.rendering.film import draw_moment
from surefoot.rendering.lettering import GREY, INK, draw_legend, font_of, verdict_ink, write_label
from surefoot.rendering.recording import Recording
from surefoot.rendering.renderer import Renderer
from surefoot.rendering.words import trial_words

STRIP_TIMES = (0.1, 0.3, 0.6, 1.0, 2.0, 4.0)
"""When the pictures of a strip are taken, since the beginning of the push [s]."""

LEAST_LETTERS = 23
"""Size of the smallest letters of a strip [pixels]: 12 where the report shows it at 0.54 of its width."""


def filmstrip(
    recordings: Sequence[Recording], times: Sequence[float] = STRIP_TIMES, cell: tuple[int, int] = (260, 320)
) -> np.ndarray:
    """Trials as rows of pictures, in the manner of the paper's figures 1 and 2: uint8 (height, width, 3).

    A trial that ends before the last time shows its last moment once.

    Args:
        recordings: a row each.
        times: since the beginning of the push [s], one picture each.
        cell: width and height of a picture [pixels].

    Raises:
        UserError: there is nothing to show, or no OpenGL to draw with.
    """
    if not len(recordings) or not len(times):
        raise UserError(f"a strip needs recordings and times, not {len(recordings)} and {len(times)} of them")
    margin, gap, footer = 260, 4, 48
    width = margin + len(times) * (cell[0] + gap)
    strip = Image.new("RGB", (width, len(recordings) * (cell[1] + gap) + footer), "white")
    for row, recording in enumerate(recordings):
        top = row * (cell[1] + gap)
        _write_caption(strip, top, recording)
        for column, picture in enumerate(_strip_pictures(recording, sorted(times), cell)):
            strip.paste(picture, (margin + column * (cell[0] + gap), top))
    draw_legend(strip, (margin, strip.height - footer // 2), LEAST_LETTERS, INK, "white")
    return np.array(strip)


def _strip_pictures(recording: Recording, times: Sequence[float], size: tuple[int, int]) -> Iterator[Image.Image]:
    outcome, last = recording.outcome, recording.times[-1]
    with Renderer(recording.robot, *size, recording.trial.domain) as scene:
        for time in times:
            is_over = time > last + 1e-9
            picture = Image.fromarray(draw_moment(scene, recording.trial, recording.at(time), afterglow=0.0))
            words = f"{outcome.reason}, {outcome.seconds:.2f} s" if is_over else f"{time:g} s"
            write_label(picture, (8, 8), words, LEAST_LETTERS, verdict_ink(recording.outcome) if is_over else INK)
            yield picture
            if is_over:
                return


def _write_caption(strip: Image.Image, top: float, recording: Recording) -> None:
    draw, y = ImageDraw.Draw(strip), top + 16
    stayed = recording.outcome.is_without_step(protocol_for(recording.robot).step_length)
    verdict = [recording.outcome.reason] + ["without a step"] * stayed
    lines = [(text, 26, INK) for text in textwrap.wrap(trial_words(recording.trial), 14)]
    lines += [(text, LEAST_LETTERS, verdict_ink(recording.outcome)) for text in verdict]
    lines += [(text, LEAST_LETTERS, GREY) for text in textwrap.wrap(recording.policy, 15)]
    for text, size, ink in lines:
        draw.text((14, y), text, fill=ink, font=font_of(size))
        y += 1.45 * size
