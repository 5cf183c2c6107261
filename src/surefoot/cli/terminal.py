"""Terminal: the output of all commands, their progress bars, and shared checks of their options."""

from __future__ import annotations

import contextlib
import json
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.status import Status
from rich.text import Text

from surefoot.errors import UserError
from surefoot.extras import advice
from surefoot.whole_file import write_whole

if TYPE_CHECKING:
    from surefoot.evaluation.evaluate import OnProgress
    from surefoot.evaluation.scenarios import Line
    from surefoot.learning.schedule import Progress as TrainingProgress
    from surefoot.robots import Robot

console = Console(stderr=True)
"""Everything but the results goes to standard error."""


def chosen_robot(name: str) -> Robot | None:
    """The robot that a user names by `--robot`; none without a name.

    Raises:
        UserError: there is no such robot, or its description cannot be read.
    """
    from surefoot.robots import load_robot

    return load_robot(name) if name else None


def say(text: str) -> None:
    """Print a line as it is on standard error: names in square brackets are no markup."""
    console.print(text, markup=False, soft_wrap=True)


def working(text: str) -> Status:
    """A spinner with a text beside it, while something is done that takes a while."""
    return console.status(Text(text))


@contextlib.contextmanager
def needs_torch() -> Iterator[None]:
    """Turn a missing package of the extra "learn" into an error that a user can mend."""
    try:
        yield
    except ModuleNotFoundError as error:
        raise UserError(advice(error.name, "learn") or str(error)) from error


@contextlib.contextmanager
def training_bar() -> Iterator[Callable[[TrainingProgress], None]]:
    """A bar with time left, steps/s, episode length, and what the last validation rejected; it fits into 80 columns."""
    columns = (SpinnerColumn(), BarColumn(bar_width=12), TextColumn("{task.fields[says]}"))
    with Progress(*columns, console=console) as bar:
        task = bar.add_task("train", total=1.0, says="starting")

        def show(progress: TrainingProgress) -> None:
            share = progress.share
            left = clock(progress.seconds * (1.0 - share) / share) if share else "all"
            says = (
                f"{left} left, {progress.steps / 1000:,.0f}k steps, {progress.steps_per_s:,.0f}/s, "
                f"episode {progress.episode_length / 25:.1f} s"
            )
            if progress.validation:
                says += f", {'/'.join(f'{ns:.0f}' for ns in progress.validation.main_directions().values())} Ns"
            bar.update(task, completed=progress.share, says=says)

        yield show


@contextlib.contextmanager
def evaluation_bar(num_lines: int) -> Iterator[OnProgress]:
    """A bar of lines done, with what is reached along each line still searched; it fits into 80 columns."""
    columns = (SpinnerColumn(), BarColumn(bar_width=12), TextColumn("{task.fields[says]}"), TimeElapsedColumn())
    with Progress(*columns, console=console) as bar:
        task = bar.add_task("evaluate", total=num_lines, says="pushing")
        before = last_done = 0

        def show(num_trials: int, num_done: int, reached: Sequence[tuple[Line, float]]) -> None:
            nonlocal before, last_done
            if num_done < last_done:  # the next batch of lines has begun
                before += last_done
            last_done = num_done
            sizes = " ".join(f"{size:g}" for _, size in reached[:8])
            says = f"{num_trials:,} trials, {before + num_done}/{num_lines} lines, at {sizes}"
            bar.update(task, completed=before + num_done, says=says[:56])

        yield show


def results_console(json_path: str | None) -> Console:
    """Standard output belongs to the JSON if it is asked for there."""
    return console if json_path == "-" else Console()


def write_json(figures: dict[str, float], path: str) -> None:
    """Write metrics as one flat JSON object to a file, or to standard output if `path` is "-"."""
    known = {key: value if math.isfinite(value) else None for key, value in figures.items()}  # JSON has no NaN
    text = json.dumps(known, indent=2) + "\n"
    if path == "-":
        sys.stdout.write(text)
        return
    write_text(Path(path), text)


def write_text(path: Path, text: str) -> None:
    """Write a file such that the old one stays until the new one is there; into a pipe or a device as it comes.

    Raises:
        UserError: it cannot be written.
    """
    if path.is_file() or not path.exists():
        write_whole(path, text.encode())
        return
    try:
        path.write_text(text)
    except OSError as error:
        raise UserError(f"cannot write {path}: {error.strerror}") from error


def clock(seconds: float) -> str:
    """Minutes and seconds, from an hour on hours and minutes: "4:05", "1 h 20"."""
    if seconds >= 3600.0:
        return f"{int(seconds // 3600)} h {int(seconds % 3600 // 60):02d}"
    return f"{int(seconds // 60)}:{int(seconds % 60):02d}"
