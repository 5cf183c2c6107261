"""Table: texts in rows and columns, for a terminal, for Markdown or for a page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rich import box
from rich.markup import escape
from rich.table import Table as RichTable

_FEW_WORDS = 4
"""A column with a cell of more words is read, not compared, and stands at the left."""


@dataclass(frozen=True)
class Table:
    """Texts in rows and columns; the first column names the row.

    Attributes:
        note: what a reader has to know, in a sentence or two.
    """

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""

    def rich(self) -> RichTable:
        """For the terminal."""
        title, note = escape(self.title), escape(self.note)
        table = RichTable(
            title=title,
            title_justify="left",
            title_style="bold",
            caption=note or None,
            caption_justify="left",
            box=box.SIMPLE_HEAD,
            pad_edge=False,
            collapse_padding=True,
        )
        for i, column in enumerate(self.columns):
            is_words = not i or any(len(row[i].split()) > _FEW_WORDS for row in self.rows)
            # The names of the rows are not shortened before the other columns wrap.
            table.add_column(escape(column), justify="left" if is_words else "right", no_wrap=not i)
        for row in self.rows:
            table.add_row(*map(escape, row))
        return table

    def markdown(self) -> str:
        """For a README."""
        lines = [self.columns, ["---"] + ["---:"] * (len(self.columns) - 1), *self.rows]
        return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"
