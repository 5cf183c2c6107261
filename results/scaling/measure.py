"""What workers cost, for docs/scaling.md; on a quiet machine.

python results/scaling/measure.py overhead     a small suite by this process and by 2 Ray workers, in turns
python results/scaling/measure.py messages     a rollout's way from a Ray worker to the learner
python results/scaling/measure.py workers      policy steps per second of one training with 1, 2 and 4 Ray workers
python results/scaling/measure.py tables AGENT the suite paper of an agent by every executor, and what the tables share
"""

from __future__ import annotations

import dataclasses
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from surefoot.agents.load import load_agent
from surefoot.evaluation.evaluate import evaluate
from surefoot.evaluation.results import Results
from surefoot.evaluation.scenarios import Scenario
from surefoot.executors import Executor, open_executor

ROUNDS = 5
SUITE = [
    Scenario("root_push", directions=4),
    Scenario("held", search="", impulse=60.0, directions=4, trials=8),
]
MESSAGES = {"ppo, 32 steps of 256 robots": 32 * 256 * 70, "ddpg, 8 steps of 128 robots": 8 * 128 * 140, "nothing": 1}
"""float32 numbers of a rollout of all workers together."""


def seconds(call: Callable[..., object], *args: object, **kwargs: object) -> float:
    """How long a call takes [s]."""
    began = time.perf_counter()
    call(*args, **kwargs)
    return time.perf_counter() - began


def overhead() -> None:
    """Print how much longer 2 Ray workers take for a suite than this process."""
    agent = load_agent("nominal")
    with open_executor("ray", workers=2) as workers:
        evaluate(agent, SUITE[1:], executor=workers)  # they load what they need
        for number in range(ROUNDS):
            local = seconds(evaluate, agent, SUITE, executor=Executor())
            shared = seconds(evaluate, agent, SUITE, executor=workers)
            print(f"round {number + 1}: local {local:.1f} s, 2 Ray workers {shared:.1f} s, ratio {shared / local:.2f}")


def messages() -> None:
    """Print how long a Ray worker's answers of the size of a rollout take to arrive."""
    import ray

    from surefoot.executors.on_ray import connect

    connect("", 2)
    answer = ray.remote(num_cpus=1)(lambda size: np.ones(size, np.float32))
    ray.get(answer.remote(1))
    for words, size in MESSAGES.items():
        took = sorted(1e3 * seconds(lambda size: ray.get(answer.remote(size)), size) for _ in range(40))
        print(f"{words}: {4e-6 * size:.2f} MB, {took[0]:.1f} ms at best, {statistics.median(took):.1f} ms median")
    ray.shutdown()


def workers() -> None:
    """Print the policy steps per second of a training by this process and by so many workers."""
    from surefoot.learning.preset_file import preset
    from surefoot.learning.ray_crew import RayCrew
    from surefoot.learning.train import train

    for algorithm, steps in (("ppo", 5 * 8192), ("ddpg", 40 * 1024)):
        config = dataclasses.replace(preset("fast", algorithm), steps=steps)
        with tempfile.TemporaryDirectory() as folder:
            took = seconds(train, config, Path(folder) / "alone")
            print(f"{algorithm}, this process: {steps / took:.0f} policy steps per second, validation included")
            for count in (1, 2, 4):
                with RayCrew("", count) as crew:
                    took = seconds(train, config, Path(folder) / f"{count}", crew=crew)
                print(f"{algorithm}, {count} workers: {steps / took:.0f}")


def tables(name: str) -> None:
    """Print how long each executor takes for an agent's suite `paper`, and whether it finds what this process finds."""
    agent, thresholds, outcomes = load_agent(name), {}, {}
    with tempfile.TemporaryDirectory() as folder:
        for kind in ("local", "processes", "ray", "dask"):
            path = Path(folder) / f"{kind}.sqlite"
            with open_executor(kind, workers=0 if kind == "local" else 2) as executor:
                took = seconds(evaluate, agent, "paper", results=path, executor=executor)
            with Results(path) as results:
                found = results.thresholds_of(agent.name)
                thresholds[kind] = {(t.line.scenario.name, t.line.name): t for t in found}
                outcomes[kind] = results.trials_of(agent).known
            shared = outcomes[kind].keys() & outcomes["local"].keys()
            differ = sum(outcomes[kind][trial] != outcomes["local"][trial] for trial in shared)
            same = thresholds[kind] == thresholds["local"]
            print(
                f"{kind}: {took:.0f} s, {len(found)} thresholds, {'the same' if same else 'OTHERS'},"
                f" {len(outcomes[kind])} trials, {len(shared)} of them in both, {differ} with another outcome"
            )


if __name__ == "__main__":
    {"overhead": overhead, "messages": messages, "workers": workers, "tables": tables}[sys.argv[1]](*sys.argv[2:])
