"""What runs with the core's packages alone, while no other can be imported, and how a missing one is named."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from surefoot.extras import MODULES, advice

ROOT = Path(__file__).parent.parent
BLOCKED = f"""
import sys
class Without:
    def __init__(self, finder):
        self.finder = finder
    def find_spec(self, name, path=None, target=None):
        hidden = name.partition(".")[0] in {sorted(MODULES)}
        return None if hidden else self.finder.find_spec(name, path, target)
sys.meta_path[:] = map(Without, sys.meta_path)
"""
"""mujoco brings websockets and PyOpenGL itself; the core uses neither."""
EVALUATES = """
import surefoot
policy = surefoot.load_policy("best")
outcome = surefoot.run_trial(policy, surefoot.Trial(surefoot.horizontal_push("root", 0.0, 60.0)))
assert outcome.recovered, outcome
shove = surefoot.Scenario("shove", search="", directions=1, impulse=60.0, trials=1)
assert surefoot.evaluate(policy, [shove], results="r.sqlite") == []
"""
COMMAND = "from surefoot.cli.main import main\nsys.argv[1:] = {words}\nmain()"
SHOVE = '[[scenario]]\nname = "shove"\nsearch = ""\ndirections = 1\nimpulse = 60\ntrials = 1\n'


def run(code: str, folder: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", BLOCKED + code]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120)


def test_a_shipped_policy_is_evaluated_from_python(tmp_path: Path) -> None:
    done = run(EVALUATES, tmp_path)
    assert (done.returncode, done.stderr) == (0, "")


def test_a_shipped_policy_is_evaluated_by_the_command(tmp_path: Path) -> None:
    (tmp_path / "shove.toml").write_text(SHOVE)
    done = run(COMMAND.format(words=["evaluate", "best", "--suite", "shove.toml", "--json", "f.json"]), tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "f.json").exists()


@pytest.mark.parametrize(
    ("words", "extra"),
    [
        (["train"], "learn"),
        (["play"], "viewer"),
        (["video"], "video"),
        (["report", "r.sqlite"], "report"),
        (["evaluate", "controllers/stephens2010"], "controllers"),
    ],
)
def test_what_is_missing_is_named_with_the_extra_that_brings_it(words: list[str], extra: str, tmp_path: Path) -> None:
    done = run(COMMAND.format(words=words), tmp_path)
    assert done.returncode == 2, done.stderr
    assert done.stderr.startswith("surefoot: this needs ")
    assert done.stderr.endswith(f": pip install 'surefoot[{extra}]'\n")
    assert done.stderr.count("\n") == 1


def test_a_script_is_told_the_same(tmp_path: Path) -> None:
    done = run("import surefoot\nsurefoot.train", tmp_path)
    assert done.stderr.splitlines()[-1].endswith(": pip install 'surefoot[learn]'")


def test_every_extra_that_is_named_is_one_that_can_be_installed() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    assert set(MODULES.values()) <= set(extras)
    assert not any("torch==" in line for lines in extras.values() for line in lines), "pinned in constraints.txt only"
    assert "torch==" in (ROOT / "constraints.txt").read_text()
    assert len(project["dependencies"]) == 7
    assert advice("viser.uplot", "viewer") == "this needs viser: pip install 'surefoot[viewer]'"
    assert advice("PIL", "report") == "this needs PIL: pip install 'surefoot[report]'"
    assert advice("PIL") == "this needs PIL: pip install 'surefoot[video]'"
    assert advice("surefoot.nothing") is None
