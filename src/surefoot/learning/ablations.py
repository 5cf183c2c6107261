"""Ablations: what each difference between the presets `paper` and `fast` gives DDPG, by leaving out one at a time.

Every run has the same number of policy steps, so that its curve does not depend on who else is computing.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from surefoot.learning.config import HALF_LIFE_GAMMA, LAYERS, TrainConfig, preset
from surefoot.learning.curve import read_curve
from surefoot.learning.train import Progress, train
from surefoot.report.table import Table
from surefoot.task.random_pushes import DisturbanceConfig

Change = Callable[[TrainConfig], TrainConfig]

SCHEDULE_STEPS = 1_600_000
"""Policy steps in which the schedules of `fast` run to their end: its 14 minutes at the speed of two cores."""
_NO_LIMIT = 1e6
_LAST_FROM = 0.6


def _run(**changes: object) -> Change:
    return lambda config: dataclasses.replace(config, **changes)  # type: ignore[arg-type]


def _hyper(**changes: object) -> Change:
    return lambda config: dataclasses.replace(config, hyper={**config.hyper, **changes})


def _env(**changes: object) -> Change:
    return lambda config: dataclasses.replace(config, env=dataclasses.replace(config.env, **changes))  # type: ignore[arg-type]


LEFT_OUT: dict[str, Change] = {
    "nothing": _run(),
    "returns-over-3-steps": _hyper(n_steps=1),
    "knee-in-power-price": _env(power_knee=None, power_weight=((0.0, 3e-4), (0.4, 3e-4), (0.8, 2e-3), (1.0, 3e-3))),
    "rising-power-price": _env(power_weight=((0.0, 1e-3),)),
    "correlated-noise": _run(noise_correlation=0.0),
    "foresight": _run(foresight=False),
    "averaged-actor": _run(average_steps=0.0),
    "mirrored-replays": _run(mirror=False),
    "bent-pose": _env(pose="straight"),
    "harder-pushes": _env(disturbance=DisturbanceConfig()),
    "longer-gamma": _hyper(gamma=HALF_LIFE_GAMMA),
    "wide-critic": _run(critic=LAYERS),
    "fading-exploration-and-rate": _run(final_noise=1.0, final_learning_rate=1.0),
}
"""What is left out -> the preset `fast` of DDPG without it."""


def without(name: str, steps: int, seed: int) -> TrainConfig:
    """The preset without one thing, for its first policy steps, however long they take."""
    config = LEFT_OUT[name](preset("fast", "ddpg"))
    schedule = _NO_LIMIT * max(1.0, SCHEDULE_STEPS / steps)
    return dataclasses.replace(config, seed=seed, steps=steps, minutes=_NO_LIMIT, schedule_minutes=schedule)


def ablate(
    name: str, folder: Path, steps: int, seed: int, on_progress: Callable[[Progress], None] | None = None
) -> list[dict[str, float]]:
    """Learn without one thing, unless that has been done before.

    Args:
        name: a key of `LEFT_OUT`.
        folder: a run folder in it is named `name`.
        steps: policy steps of the run.

    Returns:
        The rows of its learning curve.
    """
    run = folder / name
    config = without(name, steps, seed)
    if not (run / "curve.csv").exists() or read_curve(run / "curve.csv")[-1]["steps"] < steps:
        train(config, run, (run / "checkpoint.npz").exists(), on_progress)
    return read_curve(run / "curve.csv")


def ablation_table(curves: Mapping[str, Sequence[Mapping[str, float]]]) -> Table:
    """What came out of the runs, by what was left out: at the end, and over the last part of each."""
    rows = []
    for name, curve in curves.items():
        steps = [row["steps"] for row in curve]
        # Between the probes, which come by the clock: the same run may be probed at other steps.
        late = np.linspace(_LAST_FROM, 1.0, 20) * steps[-1]
        recovered, calm = (np.interp(late, steps, [row[name] for row in curve]) for name in ("recovered", "calm"))
        rows.append((name.replace("-", " "), f"{recovered.mean():.2f}", f"{recovered[-1]:.2f}", f"{calm.mean():.2f}"))
    return Table(
        "Ablations",
        ("left out", "recovered", "at the end", "calm afterwards"),
        rows,
        f"Means from {_LAST_FROM:.0%} of the steps on; pushes of 36 to 540 Ns in 8 directions. One seed.",
    )
