"""Step timing: the time of a controller's control steps, measured in its trials and in a trial alone."""

from __future__ import annotations

from surefoot.agents.controllers.controller import ControllerAgent
from surefoot.agents.controllers.step_times import Timing
from surefoot.evaluation.trials import Trial, run_list
from surefoot.physics.pushes import Push

ALONE = Trial(Push(impulse=60.0), seed=0)
"""The trial in which a controller is timed with a single robot, as on the real one."""


def measure(agent: ControllerAgent) -> Timing:
    """The times of all trials so far, and of one more with a single robot."""
    batch = agent.times
    failures = ", ".join(f"{count} x {words}" for words, count in agent.failures.most_common())
    single = agent.anew()
    run_list(single, [ALONE], num_slots=1, num_threads=1)
    alone = single.times
    return Timing(
        agent.rate_hz, batch.num_steps, batch.num_missed, batch.quantile(0.5), batch.quantile(0.99),
        alone.num_steps, alone.num_missed, alone.quantile(0.5), alone.quantile(0.99), failures,
    )  # fmt: skip
