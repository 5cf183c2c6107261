"""Clusters that the test begins itself on this machine: the same tables to the last bit, and a node that is killed."""

from __future__ import annotations

import builtins
import logging
import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from surefoot.agents.load import usual_robot
from surefoot.agents.nominal import NominalAgent
from surefoot.errors import UserError
from surefoot.evaluation.evaluate import OnProgress, evaluate
from surefoot.evaluation.scenarios import Scenario
from surefoot.executors import Executor, open_executor

pytestmark = pytest.mark.slow

SCENARIOS = [
    Scenario("weak", directions=("forward",), motor_strength=0.05),  # falls at once: a search of 37 short trials
    Scenario("quick", search="", directions=4, impulse=12.0, trials=1, horizon=0.5, quiet_from=0.0),
]


def evaluated(path: Path, executor: Executor, watch: OnProgress | None = None) -> dict[str, list[tuple[Any, ...]]]:
    """What a results table holds after an evaluation, without the order of its rows and the time that it took."""
    evaluate(NominalAgent(usual_robot(), "bent"), SCENARIOS, results=path, on_progress=watch, executor=executor)
    return content(path)


def content(path: Path) -> dict[str, list[tuple[Any, ...]]]:
    found = {}
    with sqlite3.connect(path) as db:
        for table in ("policies", "trials", "scenarios", "thresholds"):
            names = [row[1] for row in db.execute(f"PRAGMA table_info({table})") if row[1] not in ("id", "wall_s")]
            found[table] = sorted(db.execute(f"SELECT {', '.join(names)} FROM {table}"), key=repr)
    return found


@pytest.fixture(scope="module")
def on_one_core(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[tuple[Any, ...]]]:
    with open_executor("processes", workers=1) as executor:
        return evaluated(tmp_path_factory.mktemp("one") / "r.sqlite", executor)


@pytest.fixture
def nodes(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """A Ray cluster of two nodes with one core each, on a disk that counts as full."""
    pytest.importorskip("ray", reason="needs the extra ray")
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    from ray.cluster_utils import Cluster

    node = {"num_cpus": 1, "object_store_memory": 80_000_000, "include_dashboard": False}
    config = {"local_fs_capacity_threshold": 0.01}
    cluster = Cluster(initialize_head=True, head_node_args={"_system_config": config, **node})
    cluster.add_node(**node)
    yield cluster
    cluster.shutdown()


def test_this_process_finds_the_same_and_keeps_the_same_outcomes(
    on_one_core: dict[str, list[tuple[Any, ...]]], tmp_path: Path
) -> None:
    local = evaluated(tmp_path / "r.sqlite", Executor())
    assert [local[table] for table in ("policies", "scenarios", "thresholds")] == [
        on_one_core[table] for table in ("policies", "scenarios", "thresholds")
    ]
    # A batch of all lines runs more trials ahead of need; those that both ran are the same to the last bit. Which of
    # two scenarios with the same trials asked first, in column 5, is chance.
    ours, theirs = ({row[:5] + row[6:] for row in table["trials"]} for table in (local, on_one_core))
    assert theirs < ours


def test_a_ray_node_that_is_killed_loses_its_line_alone_and_the_table_is_the_same(
    on_one_core: dict[str, list[tuple[Any, ...]]], nodes: Any, tmp_path: Path
) -> None:
    _, second = nodes.list_all_nodes()
    killed: list[int] = []

    def kill(num_trials: int, num_lines: int, reached: object) -> None:
        if not killed:
            nodes.remove_node(second, allow_graceful=False)
            killed.append(num_lines)

    with open_executor("ray", nodes.address) as executor:
        assert evaluated(tmp_path / "r.sqlite", executor, kill) == on_one_core
        assert killed[0] < 6  # there were lines left: 2 of the search, 4 of the other scenario
        # The store of the node that is left: an answer of 60 MB, which nobody keeps there, leaves no room for another.
        import ray

        kept = [ray.put(np.zeros(60_000_000, np.uint8))]
        with pytest.raises(
            UserError, match=r"the Ray cluster's object store is full .*; free some of it, or enlarge it"
        ):
            list(executor.run(builtins.len, [(bytes(60_000_000),)] * 3))
        del kept


def test_dask_workers_fill_the_same_table_also_when_one_is_killed(
    on_one_core: dict[str, list[tuple[Any, ...]]], tmp_path: Path
) -> None:
    distributed = pytest.importorskip("distributed", reason="needs the extra dask")
    import os
    import signal

    options = {"host": "127.0.0.1", "dashboard_address": None, "silence_logs": logging.CRITICAL}
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, **options) as cluster:
        victim = next(iter(cluster.workers.values())).pid

        def kill(num_trials: int, num_lines: int, reached: object) -> None:
            nonlocal victim
            if victim:
                os.kill(victim, signal.SIGKILL)
                victim = 0

        with open_executor("dask", cluster.scheduler_address) as executor:
            assert evaluated(tmp_path / "r.sqlite", executor, kill) == on_one_core
        assert victim == 0


def test_an_evaluation_that_was_killed_goes_on_from_its_table(
    on_one_core: dict[str, list[tuple[Any, ...]]], tmp_path: Path
) -> None:
    table, told = tmp_path / "r.sqlite", list[int]()

    def stop(num_trials: int, num_lines: int, reached: object) -> None:
        told.append(num_trials)
        if len(told) == 2:
            raise KeyboardInterrupt

    with open_executor("processes", workers=1) as executor, pytest.raises(KeyboardInterrupt):
        evaluated(table, executor, stop)
    before = len(content(table)["trials"])
    assert before == told[1]
    told.clear()
    with open_executor("processes", workers=1) as executor:
        assert evaluated(table, executor, lambda num_trials, *_: told.append(num_trials)) == on_one_core
    assert before + told[-1] == len(on_one_core["trials"])  # none was run again


def test_slurm_jobs_are_tasks_which_are_tried_out_on_this_machine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("submitit", reason="needs the extra slurm")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UserError, match="this machine cannot give Slurm jobs: Could not detect"):
        open_executor("slurm")
    with open_executor("slurm", "local", workers=2) as executor:
        assert dict(executor.run(abs, [(-1,), (-2,)])) == {0: 1, 1: 2}
        with pytest.raises(UserError, match="No such file or directory"):
            list(executor.run(builtins.open, [("gone",)]))
