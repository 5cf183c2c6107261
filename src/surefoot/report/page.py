"""Page: one self-contained HTML file from results tables, and the same tables as Markdown."""

from __future__ import annotations

import importlib.resources
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import jinja2

from surefoot.errors import UserError
from surefoot.evaluation.protocol import protocol_for
from surefoot.evaluation.replay import check_setup, find_policy
from surefoot.report import paper
from surefoot.report.evaluations import Evaluation, read_evaluations
from surefoot.report.figure import Figure
from surefoot.report.page_figures import Curves, comparison_figures, policy_figures
from surefoot.report.page_tables import of_policy, side_by_side, versions_table
from surefoot.report.table import Table
from surefoot.report.thresholds import LATERAL, SAGITTAL, by_scenario, root_pushes, root_words, worse_of
from surefoot.task.agent import Agent
from surefoot.version import __version__

MAX_SECTIONS = 4
"""With more policies than this, only the best of each algorithm has a section of its own."""
MOST_SECTIONS = 6
"""And no more than these, so that the page stays below 5 MB: a section with its film strip has about 0.6 MB."""


@dataclass(frozen=True)
class Card:
    """One figure of the headline beside the paper's."""

    words: str
    value: float
    paper: float
    unit: str

    @property
    def share(self) -> float:
        """Of the larger of the two, in percent."""
        return 100.0 * self.value / max(self.value, self.paper, 1e-9)

    @property
    def paper_share(self) -> float:
        """Of the larger of the two, in percent."""
        return 100.0 * self.paper / max(self.value, self.paper, 1e-9)


@dataclass(frozen=True)
class Section:
    """All about one policy."""

    evaluation: Evaluation
    tables: list[Table]
    figures: list[Figure]
    notes: list[str]

    @property
    def name(self) -> str:
        """The policy's name."""
        return self.evaluation.name

    @property
    def slug(self) -> str:
        """The section's anchor."""
        return "policy-" + "".join(c if c.isalnum() else "-" for c in self.name)


@dataclass(frozen=True)
class Report:
    """The contents of the page; the first evaluation is the best."""

    evaluations: list[Evaluation]
    comparison: list[Table]
    comparison_figures: list[Figure]
    sections: list[Section]

    @property
    def versions(self) -> Table:
        """Where the figures come from."""
        return versions_table(self.evaluations)

    def html(self) -> str:
        """The page; it loads nothing."""
        text = (importlib.resources.files("surefoot.report") / "template.html").read_text()
        environment = jinja2.Environment(
            autoescape=True,
            undefined=jinja2.StrictUndefined,
            trim_blocks=True,
            lstrip_blocks=True,
            extensions=["jinja2.ext.do"],
        )
        environment.tests["wordy"] = _is_wordy
        best = self.evaluations[0]
        return environment.from_string(text).render(
            report=self,
            best=best,
            root=root_words(best.robot),
            cards=headline(best),
            protocol=protocol_for(best.robot),
            version=__version__,
        )

    def markdown(self) -> str:
        """All tables, for a README."""
        parts = ["# Results\n", *(_markdown(table, 2) for table in self.comparison)]
        for section in self.sections:
            parts += [f"## {section.name}\n", *(_markdown(table, 3) for table in section.tables)]
        return "\n".join([*parts, _markdown(self.versions, 2)])


def make_report(
    files: Sequence[str | Path],
    curves: Curves,
    policies: Sequence[str | Path] = (),
    run_trials: bool = True,
    on_progress: Callable[[str], None] = lambda words: None,
) -> Report:
    """Read results and draw them.

    Args:
        files: results tables.
        curves: learning curves, by algorithm.
        policies: files and run folders of policies that are neither shipped nor in runs/.
        run_trials: run the few single trials again that are drawn.
        on_progress: told what is being done.

    Raises:
        UserError: a file cannot be read as results.
    """
    on_progress("reading results")
    evaluations = sorted(read_evaluations(files), key=lambda e: -e.worst)
    sections = []
    for e in _with_section(evaluations):
        on_progress(f"drawing {e.name}")
        policy, notes = None, []
        if run_trials:
            try:
                policy = _policy_of(e, policies)
            except UserError as error:
                notes.append(f"No figures of single trials: {error}.")
        figures, more = policy_figures(e, policy)
        sections.append(Section(e, of_policy(e), figures, notes + more))
    on_progress("drawing all policies")
    return Report(evaluations, side_by_side(evaluations), comparison_figures(evaluations, curves), sections)


def headline(e: Evaluation) -> list[Card]:
    """The figures that sum a policy up, as far as they were measured."""
    found, cards = by_scenario(e.thresholds), []
    if e.has_main_directions:
        pushes, theirs = root_pushes(e.thresholds), paper.algorithm_row(e.algorithm) or paper.TABLE_1["trpo"]
        cards.append(Card("sagittal, worse side", worse_of(pushes, SAGITTAL).size, theirs.sagittal, "Ns"))
        cards.append(Card("lateral, worse side", worse_of(pushes, LATERAL).size, theirs.lateral, "Ns"))
    lines = found.get("root_push_no_step", {})
    for plane, names in (("sagittal", SAGITTAL), ("lateral", LATERAL)):
        if set(names) <= set(lines):
            words = f"without a step, {plane}"
            cards.append(Card(words, worse_of(lines, names).size, getattr(paper.WITHOUT_STEP, plane), "Ns"))
    for scenario, words, theirs_, unit in (
        ("landing_height", "drop height", paper.LANDING_HEIGHT, "m"),
        ("combined", "pushed after a lift", paper.COMBINED[1], "Ns"),
    ):
        if scenario in found:
            cards.append(Card(words, min(t.size for t in found[scenario].values()), theirs_, unit))
    return cards


def _is_wordy(column: Sequence[str]) -> bool:
    """Does a table's column hold words rather than numbers?"""
    filled = [cell for cell in column if cell]
    return 2 * sum(cell[:1].isdigit() or cell[:1] in "(-" for cell in filled) < len(filled)


def _with_section(evaluations: Sequence[Evaluation]) -> list[Evaluation]:
    if len(evaluations) <= MAX_SECTIONS:
        return list(evaluations)
    best: dict[str, Evaluation] = {}
    for e in evaluations:  # the best come first
        best.setdefault(e.algorithm, e)
    return list(best.values())[:MOST_SECTIONS]


def _policy_of(e: Evaluation, policies: Sequence[str | Path]) -> Agent:
    check_setup(e.key.setup, e.name)
    for given in policies:
        try:
            return find_policy(e.policy_name, e.key[0], given, e.contract.robot)
        except UserError:
            continue
    return find_policy(e.policy_name, e.key[0], robot_name=e.contract.robot)


def _markdown(table: Table, level: int) -> str:
    note = f"\n{table.note}\n" if table.note else ""
    return f"{'#' * level} {table.title}\n\n{table.markdown()}{note}"
