"""The documentation says what the committed results and the code say."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest

from surefoot.agents.controllers import shipped_controllers
from surefoot.agents.load import load_policy, shipped_policies
from surefoot.cli.benchmarks import run_bench
from surefoot.cli.main import main
from surefoot.evaluation.evaluate import push_lines
from surefoot.evaluation.results_export import read_thresholds
from surefoot.evaluation.scenarios import DIRECTIONS, canonical_name
from surefoot.evaluation.suites import PAPER
from surefoot.learning.ablations import LEFT_OUT
from surefoot.learning.curve import read_curve
from surefoot.report import metrics as figures
from surefoot.report.ablations import ablation_table
from surefoot.report.thresholds import root_pushes
from surefoot.robots import load_robot

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parent.parent
THRESHOLDS = ROOT / "results" / "thresholds.csv"

TABLE = re.compile(
    r"<!-- (?P<name>[^:\n]+): (?P<command>surefoot table [^\n]* --markdown) -->\n"
    r"(?P<text>.*?)<!-- end of (?P=name) -->",
    re.DOTALL,
)


@pytest.mark.parametrize(
    ("page", "num_tables"),
    [("README.md", 1), ("docs/controllers.md", 2), ("results/README.md", 3), ("results/engines/README.md", 2)],
)
def test_a_pages_tables_are_what_their_commands_print(
    page: str, num_tables: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.chdir(ROOT)
    found = list(TABLE.finditer((ROOT / page).read_text()))
    assert len(found) == num_tables
    for block in found:
        monkeypatch.setattr(sys, "argv", block["command"].split())
        main()
        assert block["text"] == capsys.readouterr().out


def test_the_recipes_ablations_are_the_committed_ones() -> None:
    folder = ROOT / "results" / "ablations" / "left-out"
    table = ablation_table({name: read_curve(folder / f"{name}.csv") for name in LEFT_OUT})
    assert table.markdown() in (ROOT / "docs" / "recipe.md").read_text()


def test_every_shipped_controller_has_its_thresholds() -> None:
    assert set(read_thresholds(ROOT / "results" / "controllers.csv")) == set(shipped_controllers())


def test_those_that_step_hold_more_than_those_that_stand() -> None:
    found = read_thresholds(ROOT / "results" / "controllers.csv")
    worst = {name: [root_pushes(rows)[d].size for d in DIRECTIONS] for name, rows in found.items()}
    stepping = [worst.pop(f"controllers/{name}") for name in ("stephens2010", "urata2011")]
    for sizes in stepping:
        assert all(size > max(others) for size, others in zip(sizes, zip(*worst.values(), strict=True), strict=True))


def test_every_shipped_policy_has_its_thresholds_and_its_curve() -> None:
    assert shipped_policies()
    found = read_thresholds(THRESHOLDS)
    for name in shipped_policies():
        assert {line.name for line in push_lines()} <= {threshold.line.name for threshold in found[name]}
        training = load_policy(name).contract.training
        curve = f"curves/{training['algorithm']}-{training['seed']}.csv"
        assert (ROOT / "results" / ("least-motion/best.csv" if name == "best" else curve)).exists()


def test_a_shipped_policy_holds_the_papers_bound_in_all_four_directions() -> None:
    """53 Ns forward and backward and 78 Ns to the sides, equation (6): 54 and 78 on the grid of 6 Ns."""
    found = [root_pushes(thresholds) for thresholds in read_thresholds(THRESHOLDS).values()]
    best = max(found, key=lambda pushes: min(t.size for t in pushes.values()))
    assert min(best[d].size for d in ("forward", "backward")) >= 54.0
    assert min(best[d].size for d in ("left", "right")) >= 78.0


@pytest.mark.parametrize(
    "link_source", sorted(p.relative_to(ROOT) for p in ROOT.glob("*.md")) + [Path("docs/method.md")]
)
def test_links_lead_somewhere(link_source: Path) -> None:
    text = (ROOT / link_source).read_text()
    targets = [t for t in re.findall(r"\]\(([^)#]+)\)", text) if "://" not in t]
    missing = [target for target in targets if not (ROOT / link_source.parent / target).exists()]
    assert not missing


def test_every_figure_for_machines_is_documented() -> None:
    documented = (ROOT / "docs" / "figures.md").read_text()
    found = run_bench(seconds=0.5)
    # No bounds on times here: a shared machine breaks any. `surefoot bench` sets them beside their goals.
    assert all(np.isfinite(figure) and figure > 0.0 for figure in found.values())
    thresholds = [t for t in read_thresholds(THRESHOLDS)["nominal-bent"] if t.line.name in DIRECTIONS]
    robot = load_robot("valkyrie")
    found |= figures.flat_metrics(thresholds, {}, (1.0, 1.0), robot, robot.pose("bent"), 1.0)
    searched = "|".join(scenario.name for scenario in PAPER if scenario.search)
    for key in found:
        today = canonical_name(key, robot.root)  # the last version's names go on for one version
        as_root = re.sub(rf"^({searched})\.", "root_push.", today)  # every searched scenario has its keys
        general = re.sub(r"root_push\.(forward|left|backward|right)\.", "root_push.DIRECTION.", as_root)
        assert any(_is_named(name, documented) for name in (today, general)), key


def _is_named(key: str, documented: str) -> bool:
    parts = key.rsplit(".", 1)
    return f"`{key}`" in documented or (f"`{parts[0]}." in documented and f"`.{parts[1]}`" in documented)
