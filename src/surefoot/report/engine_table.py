"""Engine table: the share of a policy's thresholds and recovered trials that another engine keeps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from surefoot.evaluation.outcome import Outcome
from surefoot.evaluation.scenarios import limited_name
from surefoot.evaluation.setup import Measured
from surefoot.evaluation.threshold_search import Threshold, wilson_interval
from surefoot.evaluation.trials import Trial
from surefoot.physics.engines import DEFAULT_ENGINE
from surefoot.report.evaluations import Evaluation
from surefoot.report.table import Table
from surefoot.report.thresholds import by_scenario, scenario_words

LOW = 0.8
"""A threshold of which another engine keeps a smaller share is named below the table."""

_NOTE = (
    "Kept: ratio of the threshold in the other engine to that in MuJoCo. Both: of the trials that ran in both engines,"
    " those that recover in both, with their Wilson 95 % interval. For a threshold these are the full-length trials at"
    " MuJoCo's threshold."
)


def engine_table(evaluations: Sequence[Evaluation]) -> Table:
    """A row for each threshold and fixed scenario that was measured in MuJoCo and in another engine."""
    rows, low = [], []
    for first, second in _pairs(evaluations):
        for ours, theirs in _thresholds(first, second):
            kept = f"{theirs.size / ours.size:.2f}" if ours.size else ""
            words = f"{scenario_words(ours.line.scenario.name, first.robot)}, {ours.line.name}"
            at = _full_length(ours, first)
            rows.append([second.name, words, f"{ours.size:g}", f"{theirs.size:g}", kept, *_both(at, second)])
            if theirs.size < LOW * ours.size:
                low.append(f"{second.name}, {words} ({kept})")
        for name in (name for name in first.fixed if name in second.fixed):
            words = scenario_words(name, first.robot)
            rows.append([second.name, words, "", "", "", *_both(first.fixed[name], second)])
        rows.append([second.name, "every trial in both", "", "", "", *_both(first.outcomes, second)])
    below = f" Kept to less than {LOW:g}: {'; '.join(low)}." if low else ""
    columns = ["policy", "scenario", "MuJoCo", "other", "kept", "both", "MuJoCo only", "other only", "Wilson 95 %"]
    return Table("In another engine", columns, rows, _NOTE + below)


def kept_table(policies: Mapping[Measured, Sequence[Threshold]]) -> Table:
    """The rejected impulses at the root that other engines keep, two rows for each policy and engine."""
    pairs = []
    for measured, thresholds in policies.items():
        if measured.engine == DEFAULT_ENGINE:
            continue
        here = measured._replace(engine=DEFAULT_ENGINE)
        ours, theirs = by_scenario(policies.get(here, [])), by_scenario(thresholds)
        for words, scenario in (("any", "root_push"), ("within limits", limited_name("root_push"))):
            if scenario in ours and scenario in theirs:
                pairs.append(([measured.name, measured.engine, words], ours[scenario], theirs[scenario]))
    directions = list(dict.fromkeys(direction for _, ours, _ in pairs for direction in ours))
    rows = [[*words, *(_ratio(ours.get(d), theirs.get(d)) for d in directions)] for words, ours, theirs in pairs]
    note = "Each cell is the rejected impulse in the other engine over the one in MuJoCo [Ns], and their ratio."
    return Table("Kept in another engine", ["policy", "engine", "joint speeds", *directions], rows, note)


def _ratio(ours: Threshold | None, theirs: Threshold | None) -> str:
    if ours is None or theirs is None:
        return ""
    return f"{theirs.size:g} / {ours.size:g}" + (f" = {theirs.size / ours.size:.2f}" if ours.size else "")


def _pairs(evaluations: Sequence[Evaluation]) -> Iterator[tuple[Evaluation, Evaluation]]:
    """Evaluations of the same agent and robot in the default engine and in another one."""
    for second in evaluations:
        if second.key.setup.engine_word == DEFAULT_ENGINE:
            continue
        for first in evaluations:
            one, other = first.key.setup, second.key.setup
            same = first.key.agent == second.key.agent and one.robot_fingerprint == other.robot_fingerprint
            if same and one.protocol == other.protocol and one.engine_word == DEFAULT_ENGINE:
                yield first, second


def _thresholds(first: Evaluation, second: Evaluation) -> Iterator[tuple[Threshold, Threshold]]:
    others = by_scenario(second.thresholds)
    for ours in first.thresholds:
        theirs = others.get(ours.line.scenario.name, {}).get(ours.line.name)
        if theirs:
            yield ours, theirs


def _full_length(threshold: Threshold, evaluation: Evaluation) -> dict[Trial, Outcome]:
    """The full-length trials at a threshold, by trial."""
    trials = threshold.full_length_trials()
    return {trial: evaluation.outcomes[trial] for trial in trials if trial in evaluation.outcomes}


def _both(outcomes: Mapping[Trial, Outcome], other: Evaluation) -> list[str]:
    """How many of some trials recovered in both engines and in one only, of those that ran in both."""
    pairs = [(o.recovered, other.outcomes[trial].recovered) for trial, o in outcomes.items() if trial in other.outcomes]
    if not pairs:
        return ["", "", "", ""]
    both = pairs.count((True, True))
    low, high = wilson_interval(both, len(pairs))
    only = (str(pairs.count((True, False))), str(pairs.count((False, True))))
    return [f"{both}/{len(pairs)}", *only, f"{low:.2f} to {high:.2f}"]
