"""surefoot replay: run a trial of a results table again."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from rich.console import Console

if TYPE_CHECKING:
    from surefoot.evaluation.results import Row
    from surefoot.task.agent import Agent


@dataclass(frozen=True)
class Replay:
    """Re-run a stored trial of a results table and check that it is bit-identical.

    The exit code is 1 if anything differs. The same bits are promised on the same kind of machine only: another
    processor may round differently.
    """

    results: Annotated[Path, tyro.conf.Positional]
    """Results table (SQLite) of `surefoot evaluate`."""
    row: Annotated[int, tyro.conf.Positional]
    """Number of the trial: column `id` of the table `trials`, which `surefoot evaluate --export` writes out."""
    policy: str | None = None
    """A shipped policy, a policy file, a run folder or a controller. By default a policy is searched for by its digest
    among the shipped ones and in runs/, and a controller by its name."""
    video: Path | None = None
    """Write a film of the trial to this .mp4 or .gif file."""
    picture: Path | None = None
    """Draw a film strip of the trial to this .png or .jpg file."""

    def main(self) -> None:
        """Run the trial again, and exit with code 1 if anything differs."""
        from surefoot.evaluation import replay
        from surefoot.evaluation.results import open_results

        with open_results(self.results) as results:
            row = results.row(self.row)
        policy = replay.policy_of(row, f"row {self.row} of {self.results}", self.policy)
        outcome = replay.replay(row, policy)
        found = replay.differences(row.outcome, outcome)
        output = Console(soft_wrap=True, highlight=False, markup=False)
        output.print(f"{row.policy_name}, {row.scenario}, row {self.row}: {outcome.reason}, {outcome.seconds:.2f} s")
        for name, old, new in found:
            output.print(f"  {name}: stored {old}, now {new}")
        output.print("different" if found else "identical")
        self._show(policy, row, output)
        if found:
            sys.exit(1)

    def _show(self, policy: Agent, row: Row, output: Console) -> None:
        if not (self.video or self.picture):
            return
        from surefoot.rendering.film import save_video
        from surefoot.rendering.image_files import save_picture
        from surefoot.rendering.recording import record
        from surefoot.rendering.strip import filmstrip

        recording = record(policy, row.trial, engine=row.key.setup.engine_word)
        if self.video:
            save_video(self.video, recording)
            output.print(f"video: {self.video}")
        if self.picture:
            save_picture(self.picture, filmstrip([recording]))
            output.print(f"picture: {self.picture}")
