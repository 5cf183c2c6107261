"""Film process: the separate process that draws the live page's film: python -m surefoot.viewer.film_process.

It reads a robot's name and the shots from standard input, and writes a line to standard output for every picture drawn.
"""

from __future__ import annotations

import os
import pickle
import sys
from pathlib import Path

from surefoot.errors import UserError
from surefoot.robots import load_robot
from surefoot.viewer.clip import save_clip

_NICE = 10
"""The page's own process goes first."""


def main() -> None:
    """Draw the film that standard input describes into the file that the command line names."""
    os.nice(_NICE)
    # From the page's process, and from nowhere else: nobody's file is read here.
    name, shots = pickle.load(sys.stdin.buffer)
    try:
        save_clip(Path(sys.argv[1]), load_robot(name), shots, on_picture=_tell)
    except UserError as error:
        sys.exit(str(error))


def _tell(number: int) -> None:
    print(number, flush=True)  # fails if the page's process has gone, and so ends this one


if __name__ == "__main__":
    main()
