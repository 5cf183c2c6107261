"""surefoot bench: measure the speed of every layer."""

from __future__ import annotations

from dataclasses import dataclass

from surefoot.cli.terminal import needs_torch, results_console, working, write_json


@dataclass(frozen=True)
class Bench:
    """Measure the speed of every layer, as ratios in one run."""

    seconds: float = 20.0
    """Time to measure each ratio [s]."""
    robot: str = ""
    """The robot: a shipped robot's name, or a description (.toml, surefoot docs your-robot). The default is
    the shipped policies' robot."""
    paper_suite: bool = False
    """Also measure how long the suite `paper` takes for `ppo` in four directions, some minutes on two cores."""
    json: str | None = None
    """Write the figures as one flat JSON object to this file; - means standard output."""

    def main(self) -> None:
        """Measure, print and write."""
        with needs_torch():
            import torch  # noqa: F401
        from surefoot.cli.benchmarks import bench_table, run_bench

        with working("measuring") as status:
            figures = run_bench(
                self.seconds, lambda stage: status.update(f"measuring {stage}"), self.robot, self.paper_suite
            )
        results_console(self.json).print(bench_table(figures, self.robot))
        if self.json:
            write_json(figures, self.json)
