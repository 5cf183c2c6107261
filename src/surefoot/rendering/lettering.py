"""Lettering: words and the legend of the marks, written into pictures."""

from __future__ import annotations

import functools
from pathlib import Path

import matplotlib
from PIL import Image, ImageDraw, ImageFont

from surefoot.evaluation.outcome import Outcome
from surefoot.rendering.renderer import LEGEND

INK, GREY = "#1c2430", "#6b7686"
_GOOD, _BAD = "#1d7f45", "#c22f2a"


def verdict_ink(outcome: Outcome) -> str:
    """The colour in which an outcome is written."""
    return _GOOD if outcome.recovered else _BAD


def write_label(picture: Image.Image, corner: tuple[float, float], text: str, size: float, ground: str) -> None:
    """Write white text of this size [pixels] on a see-through box whose corner is at the top left."""
    draw, (x, y) = ImageDraw.Draw(picture, "RGBA"), corner
    box = (x, y, x + draw.textlength(text, font=font_of(size)) + 0.8 * size, y + 1.5 * size)
    # Whole pixels: Pillow draws the corners twice where they overlap.
    draw.rounded_rectangle([round(edge) for edge in box], radius=round(0.3 * size), fill=ground + "c8")
    draw.text((x + 0.4 * size, y + 0.75 * size), text, fill="white", font=font_of(size), anchor="lm")


LEAST_LEGIBLE = 4.0
"""Size of the smallest letters that can be read [pixels]."""


@functools.cache
def font_of(size: float) -> ImageFont.FreeTypeFont:
    """DejaVu Sans Bold of this size [pixels]; it comes with matplotlib, and so is the same on every machine."""
    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts/ttf/DejaVuSans-Bold.ttf"), size)


def draw_legend(picture: Image.Image, middle: tuple[float, float], size: float, ink: str, edge: str) -> None:
    """Write what the marks mean, from the point `middle` to the right; letters are of this size [pixels] or smaller.

    Nothing is written where they would be smaller than `LEAST_LEGIBLE`.
    """
    draw, (x, y) = ImageDraw.Draw(picture), middle
    length = sum(draw.textlength("●" + word, font=font_of(size)) + 1.25 * size for word, _ in LEGEND)
    size *= min(1.0, (picture.width - 2 * x) / length)
    if size < LEAST_LEGIBLE:
        return
    font = font_of(size)
    for word, color in LEGEND:
        dot = tuple(round(255 * c) for c in color[:3])
        for text, fill, space in (("●", dot, 0.25 * size), (word, ink, size)):
            draw.text((x, y), text, fill=fill, font=font, anchor="lm", stroke_width=0.08 * size, stroke_fill=edge)
            x += draw.textlength(text, font=font) + space
