"""Executors: results as they come, whoever does the tasks; what goes wrong is one line, and nothing else is lost."""

from __future__ import annotations

import builtins
import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from surefoot.agents.load import load_agent, usual_robot
from surefoot.cores import at_most, num_cores, num_threads
from surefoot.errors import UserError
from surefoot.evaluation.evaluate import evaluate
from surefoot.evaluation.scenarios import Scenario
from surefoot.executors import open_executor
from surefoot.executors.shared_folder import check_shared
from surefoot.version import __version__

TINY = [Scenario("tiny", search="", directions=1, impulse=6.0, trials=1, horizon=0.2, quiet_from=0.0)]
DIES_ONCE = """
import os, pathlib
mark = pathlib.Path("died")
if not mark.exists():
    mark.touch()
    os._exit(1)
"""


@pytest.mark.parametrize("kind", ["local", "processes"])
def test_results_come_with_the_place_of_their_task(kind: str) -> None:
    with open_executor(kind) as executor:
        found = dict(executor.run(math.sqrt, [(4.0,), (9.0,), (16.0,)]))
    assert found == {0: 2.0, 1: 3.0, 2: 4.0}


def test_a_process_that_dies_loses_its_task_alone_which_is_begun_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    # The second process has begun to sleep before the first one dies, and goes on; the third task waits meanwhile.
    tasks = [(DIES_ONCE,), ("import time, pathlib; pathlib.Path(f'{time.monotonic()}.slept').touch(); time.sleep(1)",)]
    with open_executor("processes", workers=2) as executor:
        assert sorted(number for number, _ in executor.run(builtins.exec, tasks)) == [0, 1]
    assert (
        capsys.readouterr().err == "surefoot: task 1 of 2 lost its worker (its process has ended) and is begun again\n"
    )
    assert len(list(tmp_path.glob("*.slept"))) == 1  # begun once


def test_a_task_that_kills_three_workers_is_given_up(capsys: pytest.CaptureFixture[str]) -> None:
    with (
        open_executor("processes", workers=1) as executor,
        pytest.raises(UserError, match=r"task 1 of 1 lost its worker .* for the 3rd time; is there enough memory"),
    ):
        list(executor.run(os._exit, [(1,)]))
    assert capsys.readouterr().err.count("begun again") == 2


def test_an_error_of_a_task_names_the_worker_and_what_came_before_is_kept(tmp_path: Path) -> None:
    with open_executor("processes", workers=1) as executor:
        results = executor.run(os.path.getsize, [(str(tmp_path),), (str(tmp_path / "gone"),)])
        assert next(results) == (0, tmp_path.stat().st_size)
        with pytest.raises(UserError, match=r"^worker \S+: \[Errno 2\] No such file or directory: '.*gone'$"):
            next(results)
        with pytest.raises(UserError, match=r"^worker \S+: it does not see the folder .*gone; give one that all"):
            list(executor.run(check_shared, [(tmp_path / "gone",)]))
        # Only an error of the code shows where it is.
        with pytest.raises(RuntimeError, match=r"(?s)Traceback .*math domain error"):
            list(executor.run(math.sqrt, [(-1.0,)]))
        assert dict(executor.run(math.sqrt, [(4.0,)])) == {0: 2.0}  # its workers are still there


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("raise ModuleNotFoundError(name='surefoot')", f"has no surefoot; install version {__version__} for "),
        ("__path__ = [__file__.removesuffix('/__init__.py')]", f"has surefoot 0.0.7, not {__version__}; install the"),
    ],
)
def test_a_worker_without_the_package_or_with_another_version_says_so(
    code: str, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = tmp_path / "other" / "surefoot"
    other.mkdir(parents=True)
    (other / "__init__.py").write_text(code)
    (other / "version.py").write_text('__version__ = "0.0.7"')
    monkeypatch.syspath_prepend(other.parent)  # which loky hands to its processes
    with open_executor("processes", workers=1) as executor, pytest.raises(UserError) as told:
        list(executor.run(math.sqrt, [(4.0,)]))
    assert str(told.value).startswith("worker ")
    assert message in str(told.value)


def test_a_controller_that_the_worker_cannot_read_is_named(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text("from surefoot.agents.controllers.stand import Stand as Mine\n")
    agent = load_agent(f"{file}:Mine", usual_robot())
    file.unlink()
    with (
        open_executor("processes", workers=1) as executor,
        pytest.raises(UserError, match=rf"^worker \S+: cannot read controller {file}: No such file"),
    ):
        evaluate(agent, TINY, executor=executor)


def test_a_policy_travels_as_its_bytes_so_that_no_worker_needs_to_see_its_file(tmp_path: Path) -> None:
    file = tmp_path / "mine.onnx"
    file.write_bytes(load_agent("ppo").data)
    agent = load_agent(str(file))
    file.unlink()
    with open_executor("processes", workers=1) as executor:
        assert evaluate(agent, TINY, results=tmp_path / "r.sqlite", executor=executor) == []


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"kind": "rey"}, "unknown executor 'rey'; valid: local, processes, ray, dask, slurm"),
        ({"kind": "local", "workers": 2}, "the executor local has no workers, not 2; --executor processes has"),
        ({"kind": "processes", "address": "a:1"}, "the executor processes has no address, not 'a:1'"),
        ({"kind": "slurm", "address": "a:1"}, "the address of the executor slurm is nothing or 'local', not 'a:1'"),
        ({"kind": "ray", "address": "here"}, "the address of a Ray cluster is HOST:PORT, not 'here'"),
        ({"kind": "dask", "address": "tcp://127.0.0.1:1"}, "there is no Dask cluster at tcp://127.0.0.1:1: Connection"),
        ({"kind": "ray", "address": "127.0.0.1:1"}, "there is no Ray cluster at 127.0.0.1:1: Connection refused"),
    ],
)
def test_an_executor_that_there_is_not_is_refused_in_one_line(options: dict, message: str) -> None:
    pytest.importorskip({"kind": "ray", "dask": "distributed", "slurm": "submitit"}.get(options["kind"], "joblib"))
    begun = time.monotonic()
    with pytest.raises(UserError) as told:
        open_executor(**options)
    assert str(told.value).startswith(message)
    assert time.monotonic() - begun < 30.0


def test_a_task_uses_the_cores_that_it_is_given() -> None:
    assert num_threads() == 0  # stands for all
    with at_most(1):
        assert (num_cores(), num_threads()) == (1, 1)
    assert num_cores() == len(os.sched_getaffinity(0))


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["processes", "ray", "dask"])
def test_ctrl_c_ends_everything_in_no_words_and_keeps_the_table(kind: str, tmp_path: Path) -> None:
    pytest.importorskip({"processes": "joblib", "ray": "ray", "dask": "distributed"}[kind])
    psutil = pytest.importorskip("psutil")
    (tmp_path / "s.toml").write_text(
        '[[scenario]]\nname = "quick"\nsearch = ""\ndirections = 1\nimpulse = 6\ntrials = 1\nhorizon = 2\n'
        'quiet_from = 0\n[[scenario]]\nname = "long"\nsearch = ""\ndirections = 1\nimpulse = 6\ntrials = 400\n'
    )
    command = ["evaluate", "nominal", "--suite", "s.toml", "--workers", "1", "--executor"]
    environment = os.environ | {"SUREFOOT_TEST": str(tmp_path)}
    begun = subprocess.Popen(
        [sys.executable, "-m", "surefoot", *command, kind],
        cwd=tmp_path,
        env=environment,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    table = tmp_path / "results.sqlite"
    deadline = time.monotonic() + 240.0
    while not _num_trials(table) and begun.poll() is None and time.monotonic() < deadline:
        time.sleep(0.2)
    os.killpg(begun.pid, signal.SIGINT)  # as a terminal does: to every process of the group
    _, told = begun.communicate(timeout=120)
    assert begun.returncode == 130, told
    assert "Traceback" not in told
    assert _num_trials(table) == 1
    time.sleep(1.0)
    left = [p for p in psutil.process_iter() if _variable(p, "SUREFOOT_TEST") == str(tmp_path)]
    assert left == []


def _num_trials(table: Path) -> int:
    if not table.exists():
        return 0
    import sqlite3

    with sqlite3.connect(f"file:{table}?mode=ro", uri=True) as db:
        try:
            return int(db.execute("SELECT count(*) FROM trials").fetchone()[0])
        except sqlite3.OperationalError:  # not begun yet
            return 0


def _variable(process: object, name: str) -> str | None:
    import psutil

    try:
        return process.environ().get(name) if process.status() != psutil.STATUS_ZOMBIE else None
    except psutil.Error:
        return None
