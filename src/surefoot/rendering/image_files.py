"""Image files: the writing of pictures and films."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import imageio.v2 as imageio
import numpy as np
from PIL import Image

from surefoot.errors import UserError

PICTURE_SUFFIXES = (".png", ".jpg")
VIDEO_SUFFIXES = (".mp4", ".gif")


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
    """Check that a film of this width and height [pixels] can be written there.

    Raises:
        UserError: it cannot.
    """
    if _checked(path, VIDEO_SUFFIXES).suffix.lower() == ".mp4" and (size[0] % 2 or size[1] % 2):
        raise UserError(f"an .mp4 cannot have {size[0]} x {size[1]} pixels; valid: even numbers")


def check_picture(path: str | Path) -> None:
    """Check that a picture can be written there.

    Raises:
        UserError: it cannot.
    """
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
