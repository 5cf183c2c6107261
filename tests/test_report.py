"""The report: its tables are those of the results, and the page works in a browser, alone and on a phone."""

from __future__ import annotations

import dataclasses
import html.parser
import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from surefoot.agents.load import usual_robot
from surefoot.agents.network import NetworkAgent
from surefoot.agents.nominal import NominalAgent
from surefoot.agents.policy_file import network_bytes
from surefoot.errors import UserError
from surefoot.evaluation.outcome import Outcome
from surefoot.evaluation.replay import differences
from surefoot.evaluation.results import Results
from surefoot.evaluation.scenarios import Scenario
from surefoot.evaluation.suites import PAPER, SINGLE
from surefoot.evaluation.threshold_search import Threshold, wilson_interval
from surefoot.evaluation.trials import run_list
from surefoot.rates import CONTROL_DT
from surefoot.report.evaluations import LARGEST, SHANK, read_evaluations
from surefoot.report.page import Report, make_report
from surefoot.report.paper_tables import published_table, table_1, table_2, table_3, table_4
from surefoot.report.table import Table
from surefoot.report.threshold_tables import direction_table, scenario_table
from surefoot.report.traces import Trace, run_traces
from surefoot.robots import Robot
from surefoot.task.agent import Agent
from surefoot.task.contract import Contract

pytestmark = pytest.mark.slow

CHROMIUM = next(
    (path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), None
)
CURVE = [{"minutes": m, "steps": 1e5 * m, "recovered": m / 10.0} for m in (1.0, 4.0, 9.0)]
SIZES = {"root_push": 48.0, "root_push_no_step": 42.0, "shank_push": 60.0, "noise_both": 24.0}
SEARCHED = [scenario for scenario in PAPER if scenario.name in SIZES]
FIXED = [dataclasses.replace(scenario, trials=1) for scenario in SINGLE.values()]


@pytest.fixture(scope="module")
def outcomes() -> dict[str, Outcome]:
    """The real ones of the trials that the report draws, of the nominal pose."""
    trials = {scenario.name: scenario.lines()[0].fixed_trials()[0] for scenario in FIXED}
    for scenario in SEARCHED:
        trials[scenario.name] = scenario.lines()[0].trial(round(SIZES[scenario.name] / 6.0), 0, full_length=True)
    found = run_list(NominalAgent(usual_robot()), trials.values())
    return {name: found[trial] for name, trial in trials.items()}


@pytest.fixture(scope="module")
def learned(robot: Robot) -> NetworkAgent:
    """A network that asks for the nominal pose, with a name that would break a careless page."""
    contract = Contract.of(robot, "bent", 0.6, {"algorithm": "trpo", "preset": "fast", "seed": 0, "policy_steps": 2048,
                                                "minutes": 0.1})  # fmt: skip
    data = network_bytes([(np.zeros((11, 47)), np.zeros(11))], np.zeros(47), np.ones(47), False, contract)
    return NetworkAgent(data, "trpo <b>&0")


def fill(path: Path, policy: Agent, outcomes: dict[str, Outcome], size_factor: float = 1.0) -> Path:
    """A results table as an evaluation leaves it, but for trials that only cost time."""
    with Results(path) as results:
        store = results.trials_of(policy)
        thresholds = []
        for scenario in SEARCHED:
            for line in scenario.lines():
                size = size_factor * SIZES[scenario.name]
                cell = round(size / line.grid)
                store.put(line.trial(cell, 0, full_length=True), outcomes[scenario.name], scenario.name)
                for sampled in range(1, cell + 4):
                    for seed in range(8):
                        end = dataclasses.replace(outcomes["root_push"], recovered=sampled <= cell + seed % 3)
                        store.put(line.trial(sampled, seed, full_length=False), end, scenario.name)
                thresholds.append(Threshold(line, size, 1, 1, *wilson_interval(1, 1), "share"))
        for scenario in FIXED:
            store.put(scenario.lines()[0].fixed_trials()[0], outcomes[scenario.name], scenario.name)
        results.add_thresholds(policy, thresholds)
        results.add_scenarios(policy, [*SEARCHED, *FIXED], wall_s=90.0)
    return path


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory, outcomes: dict[str, Outcome]) -> Path:
    return fill(tmp_path_factory.mktemp("results") / "nominal.sqlite", NominalAgent(usual_robot()), outcomes)


@pytest.fixture(scope="module")
def report(table: Path, outcomes: dict[str, Outcome], learned: NetworkAgent) -> Report:
    other = fill(table.with_name("learned.sqlite"), learned, outcomes, size_factor=2.0)
    return make_report([table, other], {"trpo": [CURVE, CURVE], "ppo": [CURVE]})


@pytest.fixture(scope="module")
def page(report: Report) -> str:
    return report.html()


class _Reader(html.parser.HTMLParser):
    """Tables of a page, title -> rows of texts, and everything that it could load."""

    def __init__(self, text: str):
        super().__init__()
        self.tables: dict[str, list[list[str]]] = {}
        self.loads: list[str] = []
        self.svg_count = 0
        self._rows: list[list[str]] | None = None
        self._title: str | None = None
        self._in: str = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        names = ("src", "href", "xlink:href", "srcset", "poster", "data", "action")
        self.loads += [value or "" for name, value in attributes if name in names]
        self.svg_count += tag == "svg"
        if tag == "figcaption":
            self._title, self._in = "", "title"
        elif tag == "table":
            self._rows = self.tables.setdefault(str(self._title), [])
        elif tag == "tr" and self._rows is not None:
            self._rows.append([])
        elif tag in ("td", "th") and self._rows is not None:
            self._rows[-1].append("")
            self._in = "cell"

    def handle_endtag(self, tag: str) -> None:
        if tag in ("figcaption", "td", "th"):
            self._in = ""
        elif tag == "table":
            self._rows = None

    def handle_data(self, data: str) -> None:
        if self._in == "title":
            self._title = f"{self._title}{data}"
        elif self._in == "cell" and self._rows is not None:
            self._rows[-1][-1] += data


def texts(table: Table) -> list[list[str]]:
    return [[c or "\u00a0" for c in table.columns], *([row[0].strip(), *row[1:]] for row in table.rows)]


def test_the_pages_tables_are_those_of_the_tables_module(report: Report, page: str, robot: Robot) -> None:
    found = _Reader(page).tables
    evaluations = {e.name: e for e in report.evaluations}
    main = {name: e.thresholds for name, e in evaluations.items()}
    nominal = evaluations["nominal-bent"]
    expected = [
        table_1(main, robot),
        table_4(main, robot),
        published_table(),
        direction_table(nominal.name, nominal.thresholds, robot, np.array(nominal.contract.nominal_pose)),
        scenario_table(nominal.name, nominal.thresholds, robot),
    ]
    for one in expected:
        assert found[one.title] == texts(one), one.title
    # Both policies have these, under one title each; the learned one is better and comes first.
    for one in (table_2(nominal.fixed), table_3(nominal.thresholds, robot, nominal.steps)):
        assert found[one.title][-len(one.rows) :] == texts(one)[1:], one.title
    assert found["Share kept of the rejected impulse"][1:] == [["noise both", "50%", "50%"]]


def test_the_headline_is_the_best_policys_worse_sides(page: str) -> None:
    words = " ".join(re.sub(r"<[^>]*>", "", page.split("<h1>")[1].split("<nav")[0]).split())
    assert words.startswith("How hard a push? trpo &lt;b&gt;&amp;0 gets back to standing after pushes at Valkyrie")
    assert "up to 96 Ns forward and backward and 96 Ns to the sides" in words
    assert "report 240 and 78 Ns" in words


def test_the_page_names_one_bound_and_says_the_definition_as_it_is(page: str, robot: Robot) -> None:
    """The policies begin in the bent pose: 53 Ns forward, 59 backward, 90 to the sides."""
    tables = _Reader(page).tables
    bound = tables["Table I: largest rejected impulse [Ns]"][-1]
    assert bound[:5] == ["no-step bound", "53", "90", "59", "90"]
    of_one = next(rows for title, rows in tables.items() if title.startswith("Rejected impulse at the pelvis"))
    assert [row[-1] for row in of_one[1:]] == ["53", "90", "59", "90"]
    assert "equation (6)" not in page.replace("equation (6) of the paper", "")
    assert "no smaller push gives way" not in " ".join(page.split())
    assert "and at least 90 % of those with weaker pushes" in " ".join(page.split())


def test_the_page_loads_nothing_and_is_small(page: str) -> None:
    reader = _Reader(page)
    assert reader.loads
    assert not [link for link in reader.loads if not link.startswith(("#", "data:"))]
    assert not re.findall(r"url\((?!#)|@import|fetch\(|XMLHttpRequest|import\(", page)
    assert len(page.encode()) < 5e6


def test_every_figure_has_its_numbers_behind_it(report: Report, page: str) -> None:
    slugs = [figure.slug for section in report.sections for figure in section.figures if section.name == "nominal-bent"]
    assert slugs[:5] == ["success", "strategies", "footprints", "motion", "support-foot"]
    assert [figure.slug for figure in report.comparison_figures] == ["table-1", "directions", "learning"]
    assert report.comparison_figures[-1].caption.startswith(
        "Share of 120 held-out pushes"
    )  # 8 directions x 15 impulses
    figures = [*report.comparison_figures, *(f for section in report.sections for f in section.figures)]
    for figure in figures:
        assert figure.csv_uri in page
        assert len({len(row) for row in figure.rows}) == 1
    success = next(f for section in report.sections for f in section.figures if f.slug == "success")
    assert success.rows[1:3] == [["forward", 6.0, 8, 8], ["forward", 12.0, 8, 8]]


def test_what_cannot_be_drawn_is_left_out_with_a_note(report: Report) -> None:
    (section,) = [s for s in report.sections if s.name == "trpo <b>&0"]
    assert [figure.slug for figure in section.figures] == ["success", "strategies"]
    assert section.notes[0].startswith("No figures of single trials: no policy 'trpo <b>&0' of digest")


def test_the_drawn_trials_are_the_stored_ones(table: Path) -> None:
    (evaluation,) = read_evaluations([table])
    assert set(evaluation.cases) == {*SINGLE, LARGEST, SHANK}
    traces = run_traces(
        NominalAgent(usual_robot()), {name: evaluation.cases[name].trial for name in ("lateral_78", "sagittal_240")}
    )
    for name, trace in traces.items():
        assert differences(evaluation.cases[name].outcome, trace.outcome) == []
        assert len(trace.strategies.steps) == trace.outcome.steps
    check_beginning(traces["lateral_78"])


def check_beginning(trace: Trace) -> None:
    """650 N on 137.29 kg are 0.0095 m/s in a tick of 2 ms; a robot that only stands gets no tenth of that."""
    gain = np.diff(trace.ticks.com_velocity[0, :, 1])
    assert gain[trace.begin] == pytest.approx(650.0 / 137.29 * CONTROL_DT, rel=0.3)
    assert np.flatnonzero(gain > 0.004)[0] == trace.begin


def test_the_markdown_has_the_same_tables(report: Report) -> None:
    text = report.markdown()
    for one in report.comparison:
        assert f"## {one.title}\n\n{one.markdown()}" in text


def test_a_missing_file_and_an_empty_one_are_named(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"there is no results table .*none\.sqlite; surefoot evaluate"):
        make_report([tmp_path / "none.sqlite"], {})
    Results(tmp_path / "empty.sqlite").close()
    with pytest.raises(UserError, match=r"no finished evaluation in .*empty\.sqlite"):
        make_report([tmp_path / "empty.sqlite"], {})


def test_the_same_evaluation_twice_is_refused(table: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy.sqlite"
    copy.write_bytes(table.read_bytes())
    with pytest.raises(UserError, match=r"nominal-bent \(digest .*\) is in two of the results tables"):
        read_evaluations([table, copy])


def test_results_of_one_fixed_scenario_make_a_page(tmp_path: Path, outcomes: dict[str, Outcome]) -> None:
    policy, scenario = NominalAgent(usual_robot()), Scenario("mine", search="", directions=1, trials=1)
    with Results(tmp_path / "r.sqlite") as results:
        store = results.trials_of(policy)
        store.put(scenario.lines()[0].fixed_trials()[0], outcomes["lateral_78"], "mine")
        results.add_scenarios(policy, [scenario], 1.0)
    text = make_report([tmp_path / "r.sqlite"], {}).html()
    assert _Reader(text).tables["Use of the joints' limits"][1][:3] == ["mine", "1", "1"]


# In a browser. The page is put into a frame of a phone's width, whose inside a page around it may look at.

HARNESS = """<!doctype html><pre id="found"></pre><iframe id="phone" width="390" height="800"></iframe><script>
const watch = "<script>window.problems = []; console.error = (...words) => problems.push(words.join(' '));" +
  "addEventListener('error', (event) => problems.push(event.message || 'load failed'), true);<\\/script>";
const phone = document.getElementById("phone");
const rowsOf = (table) => [...table.tBodies[0].rows].map((row) => [...row.cells].map((c) => c.textContent.trim()));
phone.addEventListener("load", () => {
  const inner = phone.contentWindow, page = phone.contentDocument, found = {};
  found.width = page.documentElement.scrollWidth;
  const wide = [...page.querySelectorAll("body *")].filter((e) => e.getBoundingClientRect().right > 391);
  found.overflowing = wide.filter((e) => !e.closest(".scroll")).map((e) => e.outerHTML.slice(0, 80));
  found.sorts = [...page.querySelectorAll("figure.table")].map((figure) => {
    const table = figure.querySelector("table"), title = figure.querySelector("figcaption").textContent;
    const columns = [...table.tHead.rows[0].cells].map((head) => [0, 1, 2].map(() => {
      head.firstElementChild.click();
      return {sorted: head.getAttribute("aria-sort"), rows: rowsOf(table)};
    }));
    return {title, original: rowsOf(table), columns};
  });
  found.resources = inner.performance.getEntriesByType("resource").map((entry) => entry.name.slice(0, 100));
  found.problems = inner.problems;
  document.getElementById("found").textContent = JSON.stringify(found);
});
phone.srcdoc = PAGE.replace("<head>", "<head>" + watch);
</script>"""
FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-component-update",
    "--disable-background-networking", "--disable-sync", "--hide-scrollbars", "--virtual-time-budget=10000",
    "--dump-dom",
)  # fmt: skip


@pytest.fixture(scope="module")
def browsed(page: str, tmp_path_factory: pytest.TempPathFactory) -> dict:
    """What a browser finds in the page at the width of a phone."""
    if CHROMIUM is None:
        pytest.skip("no chromium on this machine")
    folder = tmp_path_factory.mktemp("browser")
    text = json.dumps(page).replace("</", "<\\/")
    (folder / "harness.html").write_text(HARNESS.replace("PAGE", text, 1))
    command = [CHROMIUM, *FLAGS, f"--user-data-dir={folder / 'profile'}", (folder / "harness.html").as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    found = re.search(r'<pre id="found">(.*?)</pre>', done.stdout, re.DOTALL)
    assert found is not None
    assert found[1], done.stderr[-500:]
    return json.loads(html.unescape(found[1]))


def test_in_a_browser_nothing_goes_wrong_and_nothing_is_loaded(browsed: dict) -> None:
    assert browsed["problems"] == []
    assert [name for name in browsed["resources"] if not name.startswith("data:")] == []


def test_on_a_phone_nothing_overflows(browsed: dict) -> None:
    assert browsed["width"] == 390
    assert browsed["overflowing"] == []


def test_a_click_sorts_a_column_and_a_third_restores_the_order(browsed: dict) -> None:
    (table_4,) = [sort for sort in browsed["sorts"] if sort["title"].startswith("Table IV")]
    down, up, restored = table_4["columns"][3]  # [Ns]
    impulses = [float(row[3]) for row in down["rows"]]
    assert (down["sorted"], up["sorted"], restored["sorted"]) == ("descending", "ascending", None)
    assert impulses == sorted(impulses, reverse=True)
    assert len(set(impulses)) > 5
    assert [float(row[3]) for row in up["rows"]] == sorted(impulses)
    assert table_4["columns"][0][0]["rows"][0][0].startswith("A Wieber")
    assert restored["rows"] == table_4["original"]


def test_sorting_by_any_column_loses_no_row_and_keeps_the_papers_below_ours(browsed: dict) -> None:
    assert len(browsed["sorts"]) > 15
    for sort in browsed["sorts"]:
        for clicks in sort["columns"]:
            assert all(sorted(click["rows"]) == sorted(sort["original"]) for click in clicks), sort["title"]
            assert clicks[2]["rows"] == sort["original"]
    peaks = [sort for sort in browsed["sorts"] if sort["title"].startswith("Table V")]
    assert peaks
    for sort in peaks:
        below = {tuple(row): tuple(sort["original"][i]) for i, row in enumerate(sort["original"][1:])}
        for click in (click for clicks in sort["columns"] for click in clicks):
            for above, row in zip(click["rows"], click["rows"][1:], strict=False):
                assert row[0] != "paper" or below[tuple(row)] == tuple(above)
