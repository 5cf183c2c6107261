"""Every block of code in the README and the docs does what it says: commands are understood, Python runs, TOML is read.

A comment above a block of Python says what is different about it:
`<!-- slow -->` takes longer than a second, `<!-- slow, with A -> B -->` is run with B in the place of A.
"""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import NamedTuple

import pytest

from surefoot.cli.commands import parsed
from surefoot.cli.options import check_options
from surefoot.cli.train import Train
from surefoot.evaluation.scenario_file import suite

ROOT = Path(__file__).parent.parent
PAGES = sorted(
    [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("results/**/*.md"), *ROOT.glob("examples/**/*.md")]
)
FENCE = re.compile(
    r"^(?:<!-- (?P<note>slow[^\n]*?) -->\n)?(?P<indent> *)```(?P<language>\w*)[^\n]*\n(?P<text>.*?)^ *```$",
    re.DOTALL | re.MULTILINE,
)


class Block(NamedTuple):
    """A block of a page; `note` is what the comment above it says."""

    page: str
    line: int
    language: str
    text: str
    note: str

    def __str__(self) -> str:
        return f"{self.page}:{self.line}"

    def with_changes(self) -> str:
        text = self.text
        for change in self.note.partition(", with ")[2].split("; "):
            old, arrow, new = change.partition(" -> ")
            assert not arrow or old in text, f"{self}: '{old}' is not in the block"
            text = text.replace(old, new) if arrow else text
        return text


def blocks(language: str) -> list[Block]:
    found = []
    for page in PAGES:
        text = page.read_text()
        for match in FENCE.finditer(text):
            lines = [line.removeprefix(match["indent"]) for line in match["text"].splitlines()]
            at = text.count("\n", 0, match.start("text"))
            found.append(
                Block(str(page.relative_to(ROOT)), at, match["language"], "\n".join(lines) + "\n", match["note"] or "")
            )
    return [block for block in found if block.language == language]


SHELL = [*blocks("sh"), *blocks("")]
COMMANDS = [
    pytest.param(line.strip(), id=f"{block.page}:{block.line + 1 + i}")
    for block in SHELL
    for i, line in enumerate(block.text.splitlines())
    if re.match(r"(\.venv/bin/)?surefoot( |$)", line.strip())
]
PYTHON = blocks("python")


def test_the_pages_hold_blocks_of_every_kind() -> None:
    assert len(COMMANDS) > 30
    assert len(PYTHON) > 3
    assert blocks("toml")


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_is_understood(command: str) -> None:
    _, *words = shlex.split(command.replace("\\", ""), comments=True)
    if words in (["--version"], []) or "--help" in words:
        return
    found = parsed(words)
    check_options(found)
    if isinstance(found, Train) and found.settings:
        assert found._config(found.stage or "")


def test_targets_of_make_and_extras_of_the_package_exist() -> None:
    text = "\n".join(block.text for block in SHELL)
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    assert set(re.findall(r"^make ([a-z-]+)", text, re.MULTILINE)) <= targets
    extras = set(tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"])
    prose = "\n".join(page.read_text() for page in PAGES)
    named = {name for group in re.findall(r"surefoot\[([\w,]+)\]", prose) for name in group.split(",")}
    assert named <= extras


@pytest.mark.parametrize("block", blocks("toml"), ids=str)
def test_toml_is_read(block: Block, tmp_path: Path) -> None:
    values = tomllib.loads(block.text)
    if "scenario" in values:
        (tmp_path / "s.toml").write_text(block.text)
        assert suite(str(tmp_path / "s.toml"))


@pytest.mark.parametrize("block", PYTHON, ids=str)
def test_python_is_valid(block: Block) -> None:
    compile(block.text, str(block), "exec")


def run_in_one_process(chosen: list[Block], folder: Path) -> None:
    """Run blocks one after the other, each with names of its own, in a folder with the examples."""
    shutil.copytree(ROOT / "examples", folder / "examples")
    script = "\n".join(
        f"print({str(block)!r}, flush=True)\nexec(compile({block.with_changes()!r}, {str(block)!r}, 'exec'), {{}})"
        for block in chosen
    )
    done = subprocess.run([sys.executable, "-c", script], cwd=folder, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout.splitlines()[-1] + "\n" + done.stderr


def test_python_runs(tmp_path: Path) -> None:
    run_in_one_process([block for block in PYTHON if not block.note], tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("block", [block for block in PYTHON if block.note], ids=str)
def test_python_that_takes_its_time_runs(block: Block, tmp_path: Path) -> None:
    run_in_one_process([block], tmp_path)
