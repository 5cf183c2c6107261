"""Training record: the origin of a policy, as its policy file records it."""

from __future__ import annotations

import functools
import os
import platform
import subprocess
from pathlib import Path
from typing import Any

from surefoot.learning.config import TrainConfig
from surefoot.learning.schedule import Progress
from surefoot.learning.warm_start import Origin
from surefoot.version import __version__


def training_record(config: TrainConfig, progress: Progress, origin: Origin) -> dict[str, Any]:
    """Return the record of a policy as it is now; steps and minutes count those of what the run began with."""
    record = {
        "algorithm": config.algorithm,
        "preset": config.preset,
        "seed": config.seed,
        "policy_steps": progress.steps + origin.num_steps,
        "minutes": round(progress.seconds / 60.0 + origin.minutes, 2),
        "cores": os.cpu_count(),
        "machine": platform.machine(),
        "surefoot": __version__,
        "commit": _commit(),
    }
    return record | ({"after": origin.record} if origin.record else {})


@functools.cache
def _commit() -> str | None:
    """Return the commit of the checkout that this runs from; None for an installed package."""
    folder = Path(__file__).parent
    command = ["git", "-C", str(folder), "describe", "--always", "--dirty"]
    try:
        told = subprocess.run(command, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return told.stdout.strip()
