"""surefoot export: give a policy to another runtime: its file with all terms, and vectors to check itself against."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from surefoot.cli.terminal import say, working
from surefoot.errors import UserError


@dataclass(frozen=True)
class Export:
    """Give a policy to another runtime (docs/policy-file.md, examples/deploy)."""

    policy: Annotated[str, tyro.conf.Positional]
    """A shipped policy's name, a policy file (.onnx), or a run folder."""
    onnx: Path | None = None
    """Write the policy file with all its terms to this .onnx file; files of before there were terms lack them."""
    vectors: Path | None = None
    """Write golden vectors to this .csv file: every number on the way of a run of one second."""

    def main(self) -> None:
        """Write what is asked for."""
        from surefoot.agents.load import load_policy
        from surefoot.agents.policy_file import with_terms
        from surefoot.evaluation.golden_vectors import golden_vectors
        from surefoot.whole_file import write_whole

        for name, file, suffix in (("onnx", self.onnx, ".onnx"), ("vectors", self.vectors, ".csv")):
            if file and file.suffix != suffix:
                raise UserError(f"--{name} must be a {suffix} file, not {file}")
        if not self.onnx and not self.vectors:
            raise UserError("nothing to export; name a file by --onnx or --vectors")
        policy = load_policy(self.policy)
        if self.onnx:
            write_whole(self.onnx, with_terms(policy.data))
            say(f"policy: {self.onnx}")
        if self.vectors:
            with working(f"running {policy.name}"):
                found = golden_vectors(policy)
            found.write(self.vectors)
            say(f"vectors: {self.vectors}, {len(found.rows)} rows of {len(found.columns)} numbers")
