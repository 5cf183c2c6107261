"""Figure: a plot or a picture of the page, with its caption and the numbers that it shows."""

from __future__ import annotations

import base64
import csv
import hashlib
import io
import re
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypedDict

import matplotlib
import numpy as np
from PIL import Image

from surefoot.report.plot_style import GREY, INK, PALE

_FONT = "ui-sans-serif, system-ui, sans-serif"
_THEMED = {
    INK: "var(--ink)",
    GREY: "var(--muted)",
    PALE: "var(--line)",
    "#ffffff": "var(--card)",
}
"""Colours of the plots that the page's light and dark styles replace."""
_WORTH_A_TRY = 100_000
"""No PNG of a plot is smaller than so many bytes."""


@dataclass(frozen=True)
class Figure:
    """A figure of the page.

    Attributes:
        slug: for anchors and file names.
        svg: as markup; empty if it is an image.
        image: as a data URI; empty if it is SVG.
        rows: the numbers behind it, the first row naming the columns.
        wide: to be scrolled rather than shrunk on a narrow screen.
        alone: in a row of its own, though it is not wide.
    """

    slug: str
    title: str
    caption: str
    rows: Sequence[Sequence[object]]
    svg: str = ""
    image: str = ""
    wide: bool = False
    alone: bool = False

    @property
    def csv_uri(self) -> str:
        """The numbers as a file to save."""
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows(self.rows)
        return "data:text/csv;base64," + base64.b64encode(text.getvalue().encode()).decode()


class Markup(TypedDict):
    """The part of a figure that is drawn: keyword arguments of `Figure`."""

    svg: str
    image: str


def drawn(draw: Callable[[Path], None]) -> Markup:
    """A plot as SVG markup or as a PNG's data URI, whatever is smaller: keyword arguments of `Figure`."""
    with tempfile.TemporaryDirectory() as folder, matplotlib.rc_context({"svg.fonttype": "none"}):
        vector, pixels = Path(folder) / "plot.svg", Path(folder) / "plot.png"
        draw(vector)
        svg = _inline(vector.read_text())
        if len(svg) < _WORTH_A_TRY:
            return {"svg": svg, "image": ""}
        draw(pixels)
        image = "data:image/png;base64," + base64.b64encode(pixels.read_bytes()).decode()
    return {"svg": svg, "image": ""} if len(svg) <= len(image) else {"svg": "", "image": image}


def webp(image: np.ndarray) -> str:
    """A picture, uint8 (height, width, 3), as a data URI."""
    data = io.BytesIO()
    Image.fromarray(image).save(data, "webp", quality=80, method=6)
    return "data:image/webp;base64," + base64.b64encode(data.getvalue()).decode()


def _inline(text: str) -> str:
    """Matplotlib's SVG file as markup within a page: no header, the page's colours and font, ids of its own."""
    own = hashlib.sha256(text.encode()).hexdigest()[:8]
    text = re.sub(r"<metadata>.*?</metadata>", "", text[text.index("<svg") :], flags=re.DOTALL)
    text = re.sub(r'(<svg[^>]*?) width="[^"]*"', r"\1", text)
    text = re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", text)
    text = re.sub(r'(id="|href="#|url\(#)', rf"\1f{own}-", text)
    text = re.sub(r"(-?\d+\.\d\d)\d+", r"\1", text)  # a hundredth of a point is enough
    text = text.replace("'DejaVu Sans'", _FONT)
    for color, variable in _THEMED.items():
        text = text.replace(color, variable)
    return text
