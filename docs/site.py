"""Site: additions to docs/ for the documentation site, namely pages from elsewhere and the commands from the code.

mkdocs calls these functions (`hooks` in mkdocs.yml); `make docs` builds the site.
"""

from __future__ import annotations

import dataclasses
import inspect
import re
import sys
import typing
from pathlib import Path
from posixpath import normpath, relpath
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "src"))
PAGES = ["CONTRIBUTING.md", "CHANGELOG.md", "results/README.md", "results/ablations/README.md"]
PAGES += ["results/least-motion/README.md", "results/engines/README.md"]
LINKED = [
    *ROOT.glob("results/*.csv"),
    *ROOT.glob("results/*.json"),
    *ROOT.glob("results/*.md"),
    *ROOT.glob("examples/*.*"),
]
_LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)#\s]+)(#[^)\s]*)?\)")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add what lies outside docs/, at its place in the repository, and the page of the commands."""
    linked = [str(path.relative_to(ROOT)) for path in LINKED]
    for name in dict.fromkeys([*PAGES, *(name for name in linked if not name.endswith(".md") or name in PAGES)]):
        files.append(File.generated(config, name, abs_src_path=str(ROOT / name)))
    files.append(File.generated(config, "commands.md", content=commands_page()))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Let links lead to where the site has their targets; one to what the site does not hold becomes plain text."""
    source = page.file.src_uri
    here = source if source in PAGES else f"docs/{source}"

    def moved(link: re.Match[str]) -> str:
        picture, words, target, anchor = link.groups()
        if "://" in target:
            return link[0]
        in_repository = normpath(f"{Path(here).parent}/{target}")
        place = in_repository.removeprefix("docs/")
        if files.get_file_from_path(place):
            return f"{picture}[{words}]({relpath(place, str(Path(source).parent))}{anchor or ''})"
        if (ROOT / in_repository).exists() and not place.endswith(".md"):
            return f"{words} (`{in_repository}`)"
        return link[0]

    return _LINK.sub(moved, markdown)


def commands_page() -> str:
    """Every command with its options, as `--help` has them."""
    from surefoot.cli.choices import option_texts, valid_values
    from surefoot.cli.commands import COMMANDS

    parts = ["# Commands", "This page lists the options that `surefoot COMMAND --help` shows, from the same source."]
    for name, command in COMMANDS.items():
        parts += [f"## surefoot {name}", inspect.cleandoc(command.__doc__)]
        hints, texts = typing.get_type_hints(command, include_extras=True), option_texts(command)
        rows = [
            f"| `{_option(field, hints[field.name])}` | {_cell(valid_values(field.name, hints[field.name]) or '')} "
            f"| {_cell(texts[field.name])} | {_default(field)} |"
            for field in dataclasses.fields(command)
            if field.name in texts
        ]
        parts.append("\n".join(["| option | values | meaning | default |", "|---|---|---|---|", *rows]))
    return "\n\n".join(parts) + "\n"


def _option(field: dataclasses.Field[Any], hint: Any) -> str:
    positional = "Positional" in str(hint)
    return field.name.upper() if positional else f"--{field.name.replace('_', '-')}"


def _default(field: dataclasses.Field[Any]) -> str:
    empty = field.default in ("", None, (), dataclasses.MISSING)
    return "" if empty else f"`{field.default}`".replace("(", "").replace(",)", "").replace(")", "").replace("'", "")


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("<", "&lt;")
