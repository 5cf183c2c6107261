"""Ablations: the effect of each difference between the presets `paper` and `fast` on DDPG, left out one at a time.

Every run has the same number of policy steps, so that its curve does not depend on the load of the machine.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

from surefoot.executors.shared_folder import check_shared
from surefoot.learning.config import HALF_LIFE_GAMMA, PAPER_LAYERS, TrainConfig
from surefoot.learning.curve import read_curve
from surefoot.learning.preset_file import preset
from surefoot.learning.train import OnProgress, go_on
from surefoot.task.random_pushes import DisturbanceConfig

Change = Callable[[TrainConfig], TrainConfig]

SCHEDULE_STEPS = 1_600_000
"""Policy steps in which the schedules of `fast` run to their end: its 14 minutes at the speed of two cores."""


def _run(**changes: object) -> Change:
    return lambda config: dataclasses.replace(config, **changes)  # type: ignore[arg-type]


def _hyper(**changes: object) -> Change:
    return lambda config: dataclasses.replace(config, hyper={**config.hyper, **changes})


def _env(**changes: object) -> Change:
    return lambda config: dataclasses.replace(config, env=dataclasses.replace(config.env, **changes))  # type: ignore[arg-type]


LEFT_OUT: dict[str, Change] = {
    "nothing": _run(),
    "returns-over-3-steps": _hyper(n_steps=1),
    "power-log-scale": _env(power_log_scale=None, power_weight=((0.0, 3e-4), (0.4, 3e-4), (0.8, 2e-3), (1.0, 3e-3))),
    "rising-power-penalty": _env(power_weight=((0.0, 1e-3),)),
    "correlated-noise": _run(noise_correlation=0.0),
    "privileged-critic": _run(privileged_critic=False),
    "averaged-actor": _run(average_steps=0.0),
    "mirrored-replays": _run(mirror=False),
    "bent-pose": _env(pose="straight"),
    "harder-pushes": _env(disturbance=DisturbanceConfig()),
    "longer-gamma": _hyper(gamma=HALF_LIFE_GAMMA),
    "wide-critic": _run(critic=PAPER_LAYERS),
    "fading-exploration-and-rate": _run(final_noise=1.0, final_learning_rate=1.0),
}
"""Part that is left out -> the preset `fast` of DDPG without it."""

OLD_NAMES = {
    "knee-in-power-price": "power-log-scale",
    "rising-power-price": "rising-power-penalty",
    "foresight": "privileged-critic",
}
"""Names of version 0.1 -> today's; to be dropped with version 0.3."""


def without(name: str, steps: int, seed: int) -> TrainConfig:
    """Return the preset without one thing, for its first policy steps, however long they take."""
    config = LEFT_OUT[name](preset("fast", "ddpg"))
    minutes = config.schedule_minutes * steps / SCHEDULE_STEPS
    return dataclasses.replace(config, seed=seed, steps=steps, minutes=minutes)


def ablate(
    name: str, folder: Path, steps: int, seed: int, on_progress: OnProgress | None = None
) -> list[dict[str, float]]:
    """Learn without one thing, unless that has been done before.

    Args:
        name: a key of `LEFT_OUT`.
        folder: that is there already; a run folder in it is named `name`.
        steps: policy steps of the run.
        seed: of everything random.
        on_progress: called a few times a second.

    Returns:
        The rows of its learning curve.
    """
    check_shared(folder)
    run = folder / name
    go_on(without(name, steps, seed), run, on_progress)
    return read_curve(run / "curve.csv")
