"""surefoot docs: show the documentation of the installed package in the terminal."""

from __future__ import annotations

import importlib.metadata
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from rich.markdown import Markdown

from surefoot.errors import UserError

_INSTALLED = "share/doc/surefoot"
"""Where a wheel puts the pages, below the environment's folder."""


@dataclass(frozen=True)
class Docs:
    """Show a page of the documentation in the terminal, or list all of them."""

    page: Annotated[str, tyro.conf.Positional] = ""
    """Name of a page, such as method. Without it, all pages are listed."""

    def main(self) -> None:
        """Print the page, as it is if nobody looks at a terminal."""
        found = pages()
        console = Console()
        if not self.page:
            width = max(map(len, found))
            for name, path in found.items():
                console.print(f"  {name:{width}}  {_title(path)}", highlight=False, markup=False)
            return
        name = self.page.rpartition("/")[2].removesuffix(".md")
        if name not in found:
            raise UserError(f"unknown page '{self.page}'; valid: {', '.join(found)}")
        text = found[name].read_text()
        if console.is_terminal:
            console.print(Markdown(text))
        else:
            sys.stdout.write(text)


def pages() -> dict[str, Path]:
    """Name of a page -> its file: those of the checkout, or those that were installed with the package.

    Raises:
        UserError: there are none.
    """
    checkout = Path(__file__).parents[3] / "docs"
    files = list(checkout.glob("*.md")) if (checkout / "index.md").exists() else _installed()
    if not files:
        raise UserError("the documentation was not installed with the package")
    return {path.stem: path for path in sorted(files)}


def _installed() -> list[Path]:
    listed = importlib.metadata.files("surefoot") or []
    return [Path(str(file.locate())).resolve() for file in listed if _INSTALLED in file.as_posix()]


def _title(path: Path) -> str:
    return next((line[2:] for line in path.read_text().splitlines() if line.startswith("# ")), "")
