"""The wheel, as a stranger gets it: outside the checkout, in an environment of its own."""

import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parent.parent
SCRIPT = """
import importlib.metadata
import sys
from pathlib import Path
import surefoot
from surefoot.agents.load import load_agent
from surefoot.evaluation.evaluate import push_lines
from surefoot.evaluation.trials import run_list

assert Path(surefoot.__file__).is_relative_to(sys.prefix), surefoot.__file__
trial = push_lines()[0].trial(10, 0, full_length=True)  # 60 Ns
assert run_list(load_agent("best"), [trial], num_slots=1)[trial].recovered
heavy = {"torch", "gymnasium", "viser", "trimesh", "jinja2", "pyarrow", "matplotlib", "pillow", "imageio"}
installed = {found.name.lower() for found in importlib.metadata.distributions()}
assert not heavy & installed, heavy & installed
"""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", str(folder), str(ROOT)]
    subprocess.run(command, check=True)
    (path,) = folder.glob("surefoot-*.whl")
    return path


def test_the_wheel_holds_all_that_the_package_reads(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
    shipped = {
        str(p.relative_to(ROOT / "src")) for p in (ROOT / "src").rglob("*") if p.suffix in (".py", ".xml", ".onnx")
    }
    assert {name for name in shipped if "egg-info" not in name} <= names


def test_the_wheel_works_in_an_empty_environment_outside_the_checkout(wheel: Path, tmp_path: Path) -> None:
    """Installed with the core's packages only, it evaluates a shipped policy."""
    venv.create(tmp_path / "env", with_pip=True)
    python = tmp_path / "env" / "bin" / "python"
    constraints = ["--constraint", str(ROOT / "constraints.txt")]
    subprocess.run([python, "-m", "pip", "install", "--quiet", *constraints, str(wheel)], check=True, cwd=tmp_path)
    subprocess.run([python, "-c", SCRIPT], check=True, cwd=tmp_path)
    listed = subprocess.run([tmp_path / "env/bin/surefoot", "--help"], check=True, cwd=tmp_path, capture_output=True)
    assert b"evaluate" in listed.stdout
    page = subprocess.run(
        [tmp_path / "env/bin/surefoot", "docs", "method"], check=True, cwd=tmp_path, capture_output=True
    )
    assert page.stdout.decode() == (ROOT / "docs" / "method.md").read_text()
    refused = subprocess.run([tmp_path / "env/bin/surefoot", "train"], cwd=tmp_path, capture_output=True, text=True)
    assert refused.returncode == 2
    assert refused.stderr == "surefoot: this needs torch: pip install 'surefoot[learn]'\n"
