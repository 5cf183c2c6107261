"""surefoot report, table and pictures: show the contents of results tables."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro
from rich.console import Console
from rich.text import Text

from surefoot.cli.terminal import say, working, write_text
from surefoot.errors import UserError


@dataclass(frozen=True)
class Report:
    """Make one HTML page from results tables, with every table and figure of the paper.

    The command reads results. It runs again only the single trials that it draws (motion, footprints and film strips,
    six for each policy). This needs the policies, and OpenGL for the film strips. Missing parts are left out with a
    note.
    """

    results: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Results tables (SQLite) of `surefoot evaluate`; the page compares all their policies."""
    out: Path = Path("report.html")
    """File of the page."""
    markdown: Path | None = None
    """Also write the tables to this file as Markdown."""
    curves: Path | None = None
    """Folder with learning curves: run folders, or ALGORITHM-SEED.csv as in results/curves."""
    policies: tuple[str, ...] = ()
    """Policy files and run folders that are neither shipped nor in runs/."""
    trials: bool = True
    """Run the drawn trials again."""

    def main(self) -> None:
        """Write the page."""
        from surefoot.learning.curve import read_curves
        from surefoot.report.page import make_report

        curves = read_curves(self.curves) if self.curves else {}
        with working("reading") as status:
            tell: Callable[[str], None] = lambda words: status.update(Text(words))  # noqa: E731
            report = make_report(self.results, curves, self.policies, self.trials, tell)
        write_text(self.out, report.html())
        for section in report.sections:
            for note in section.notes:
                say(f"{section.name}: {note}")
        say(f"page: {self.out}, {self.out.stat().st_size / 1e6:.1f} MB")
        if self.markdown:
            write_text(self.markdown, report.markdown())
            say(f"tables: {self.markdown}")


@dataclass(frozen=True)
class Table:
    """Print a table of exported thresholds, for a terminal or a page."""

    thresholds: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Files (.csv) that `surefoot evaluate --export-thresholds` wrote. If a policy is in several of them, the first
    one counts."""
    show: Literal["main", "summary", "worst", "seeds", "kept"] = "main"
    """main: Table I beside the paper's. summary: one row for each policy. worst: the worst direction of every scenario.
    seeds: median and range over the policies of one algorithm, which are named ALGORITHM-SEED. kept: what another
    engine keeps of the rejected impulses."""
    markdown: bool = False
    """Print Markdown instead of a drawn table."""

    def main(self) -> None:
        """Print the table."""
        from surefoot.agents.load import usual_robot
        from surefoot.evaluation.results_export import read_measured
        from surefoot.report.engine_table import kept_table
        from surefoot.report.paper_tables import table_1
        from surefoot.report.threshold_tables import seeds_table, summary_table, worst_table

        measured = read_measured(self.thresholds)
        policies = {key.shown: found for key, found in measured.items()}
        if self.show == "seeds":
            table = seeds_table((name.rsplit("-", 1)[0], found) for name, found in policies.items())
        elif self.show == "summary":
            table = summary_table(measured)
        elif self.show == "kept":
            table = kept_table(measured)
        elif self.show == "worst":
            table = worst_table(policies, usual_robot())
        else:
            table = table_1(policies, usual_robot())
        if self.markdown:
            sys.stdout.write(table.markdown())
        else:
            Console().print(table.rich())


@dataclass(frozen=True)
class Pictures:
    """Draw the pictures of results: bars beside the paper's, polar map, strategies, learning curves, film strip."""

    thresholds: Path = Path("results/thresholds.csv")
    """A .csv file that `surefoot evaluate --export-thresholds` wrote."""
    curves: Path = Path("results/curves")
    """Folder with learning curves: ALGORITHM-SEED.csv, or the curve.csv of one run."""
    policy: str = "best"
    """The policy of the film strip, as for `surefoot evaluate`; it must be among the thresholds."""
    out: Path = Path("docs/pictures")
    """Folder for the pictures."""
    strategies: Path = Path("results/strategies.csv")
    """A .csv file that `surefoot strategies` wrote. If it exists, two pictures are drawn: the policies of a robot, and
    robots and engines side by side."""

    def main(self) -> None:
        """Draw the pictures."""
        from surefoot.agents.load import load_policy
        from surefoot.evaluation.results_export import read_thresholds
        from surefoot.evaluation.strategy_map import read_strategies
        from surefoot.learning.curve import read_curves
        from surefoot.report.learning_plots import learning_curves
        from surefoot.report.result_pictures import draw_strategies, draw_strip, draw_thresholds

        policies, policy = read_thresholds(self.thresholds), load_policy(self.policy)
        if policy.name not in policies:
            raise UserError(f"no thresholds of '{policy.name}' in {self.thresholds}; valid: {', '.join(policies)}")
        self.out.mkdir(parents=True, exist_ok=True)
        with working("drawing pictures"):
            drawn = draw_thresholds(policies, policy.robot, self.out)
            if self.strategies.exists():
                drawn += draw_strategies(read_strategies(self.strategies), policy, self.out)
            drawn.append(self.out / "curves.png")
            learning_curves(read_curves(self.curves), drawn[-1])
            try:
                drawn.append(draw_strip(policy, policies[policy.name], self.out / "strip.png"))
            except UserError as error:  # a machine without OpenGL still gets the plots
                say(f"no film strip: {error}")
        for picture in drawn:
            say(f"picture: {picture}")
