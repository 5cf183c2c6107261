"""The referee: some 500 trials over all scenarios, whose outcomes a change of the code's shape must not change.

``python tests/referee.py`` compares them with the committed outcomes, to the last bit; ``--write`` replaces those.
"""

from __future__ import annotations

import csv
import dataclasses
import json
import sys
from pathlib import Path

import numpy as np

from surefoot.agents.controllers import shipped_controllers
from surefoot.agents.load import load_agent
from surefoot.evaluation.outcome import Outcome
from surefoot.evaluation.scenarios import Line
from surefoot.evaluation.suites import PAPER, ROBUSTNESS
from surefoot.evaluation.trials import Trial, run_list

FILE = Path(__file__).parent / "data" / "referee.csv"
COLUMNS = ("agent", "scenario", "direction", "cell", "seed", "whole", "outcome")
NETWORKS = ("ddpg", "trpo", "ppo", "nominal")
FIRST_SEED = 5_000_000
"""Far from the seeds of evaluation, probes and exams."""
LARGEST = {"impulse": 420.0, "height": 1.2, "tilt": 16.0}
"""Sizes are drawn up to here, about where the shipped policies begin to fail."""
LINES = {line.scenario.name + " " + line.name: line for s in (*PAPER, *ROBUSTNESS) for line in s.lines()}


def trial_of(row: dict[str, str]) -> Trial:
    """The trial that a row names."""
    line, seed = LINES[f"{row['scenario']} {row['direction']}"], int(row["seed"])
    if not line.scenario.search:
        return dataclasses.replace(line.fixed_trials()[0], seed=seed)
    return line.trial(int(row["cell"]), seed, row["whole"] == "1")


def draw() -> list[dict[str, str]]:
    """The rows without their outcomes."""
    rng = np.random.default_rng(16)
    rows = []
    for agent in (*NETWORKS, *shipped_controllers()):
        few = agent not in NETWORKS
        for scenario in (*PAPER, *ROBUSTNESS):
            lines = scenario.lines()
            num_trials = 1 if few or scenario.horizon > 10.0 else 3
            if few and rng.random() < 0.6:
                continue
            rows += [_row(agent, line, rng) for line in rng.choice(np.array(lines, object), num_trials)]
    return rows


def _row(agent: str, line: Line, rng: np.random.Generator) -> dict[str, str]:
    cell = 0
    if line.scenario.search:
        cell = int(rng.integers(1, round(LARGEST[line.scenario.search] / line.grid)))
    seed, whole = FIRST_SEED + int(rng.integers(1_000_000)), int(rng.random() < 0.5)
    values = (agent, line.scenario.name, line.name, cell, seed, whole, "")
    return dict(zip(COLUMNS, map(str, values), strict=True))


def run(rows: list[dict[str, str]]) -> list[Outcome]:
    """The outcomes of the rows' trials, in their order."""
    outcomes: dict[tuple[str, Trial], Outcome] = {}
    for name in dict.fromkeys(row["agent"] for row in rows):
        trials = [trial_of(row) for row in rows if row["agent"] == name]
        for domain in dict.fromkeys(trial.domain for trial in trials):
            mine = [trial for trial in trials if trial.domain == domain]
            found = run_list(load_agent(name), mine, num_slots=32, domain=domain)
            outcomes |= {(name, trial): outcome for trial, outcome in found.items()}
    return [outcomes[row["agent"], trial_of(row)] for row in rows]


def read() -> list[dict[str, str]]:
    """The committed rows."""
    with FILE.open(newline="") as stream:
        return list(csv.DictReader(stream))


def to_text(outcome: Outcome) -> str:
    """An outcome as JSON, every number to the last bit."""
    return json.dumps(dataclasses.asdict(outcome))


def main() -> None:
    """Compare, or write."""
    writing = "--write" in sys.argv
    rows = draw() if writing else read()
    texts = [to_text(outcome) for outcome in run(rows)]
    if writing:
        with FILE.open("w", newline="") as stream:
            writer = csv.DictWriter(stream, COLUMNS, lineterminator="\n")
            writer.writeheader()
            writer.writerows(row | {"outcome": text} for row, text in zip(rows, texts, strict=True))
        print(f"{len(rows)} trials written")
        return
    pairs = [(row, json.loads(row["outcome"]), json.loads(text)) for row, text in zip(rows, texts, strict=True)]
    same_bits = sum(row["outcome"] == text for row, text in zip(rows, texts, strict=True))
    same_verdicts = sum(old["reason"] == new["reason"] for _, old, new in pairs)
    for row, old, new in pairs:
        if old["reason"] != new["reason"]:
            print(row["agent"], row["scenario"], row["direction"], row["cell"], old["reason"], "->", new["reason"])
    print(f"{len(rows)} trials: {same_bits} the same to the last bit, {same_verdicts} with the same verdict")
    sys.exit(same_verdicts < len(rows))


if __name__ == "__main__":
    main()
