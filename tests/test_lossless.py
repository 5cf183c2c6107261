"""Nothing is lost: kills between the files of a run, kills before its first checkpoint, full disks, cut files."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from conftest import full_after, tiny

import surefoot.learning.train as train_module
from surefoot.agents.network import NetworkAgent
from surefoot.cli.train import Train
from surefoot.errors import UserError
from surefoot.evaluation.protocol import PROTOCOL
from surefoot.evaluation.scenarios import DIRECTIONS
from surefoot.learning.curve import read_curve
from surefoot.learning.run_folder import BEST, CURVE, LAST, RunFolder
from surefoot.learning.train import CHECKPOINT_S, Trainer, go_on, train
from surefoot.learning.validation import SCORE_VERSION, Validation
from surefoot.whole_file import sweep, write_whole

pytestmark = pytest.mark.slow
RELIABILITY = Path(__file__).parents[1] / "docs" / "reliability.md"
WRITES = 5
"""Files that a validation writes: the checkpoint, and then the best, the newest and the kept policy and the curve."""


def scored(recovered: float) -> Callable[[NetworkAgent], Validation]:
    """A validation whose score is known: what was learned does not count here, but what is kept of it."""
    none = dict.fromkeys(DIRECTIONS, 0.0)
    found = Validation(
        recovered=recovered, within_limits=recovered, fell=1.0 - recovered, rejected=none,
        rejected_within_limits=none, quiet=0.0, power=float("nan"),
    )  # fmt: skip

    def validate(policy: NetworkAgent) -> Validation:
        return found

    return validate


def keep(trainer: Trainer, recovered: float) -> None:
    """Validate and keep the policy as it is; each time with other weights."""
    trainer.kept.validate = scored(recovered)
    with torch.no_grad():
        next(iter(trainer.model.policy.parameters())).add_(0.01)
    trainer.keep()


def killed_at(write: int, before: bool, work: Callable[[], None]) -> bool:
    """Do some work in a process of its own, which is killed right before or after its `write`-th file is in place."""
    child = os.fork()
    if not child:
        count, whole = 0, Path.replace

        def replace(self: Path, target: Path) -> Path:
            nonlocal count
            count += 1
            if count == write and before:
                os.kill(os.getpid(), signal.SIGKILL)
            done = whole(self, target)
            if count == write:
                os.kill(os.getpid(), signal.SIGKILL)
            return done

        Path.replace = replace  # type: ignore[method-assign]
        with contextlib.suppress(BaseException):
            work()
        os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL


def score_of(file: Path) -> float:
    return NetworkAgent(file.read_bytes(), file.name).contract.training["validation"]["recovered"]


def resumed(path: Path, **changes: object) -> Trainer:
    return Trainer(tiny("ppo", **changes), RunFolder(path), resume=True)


@pytest.mark.parametrize("before", [True, False], ids=["before", "after"])
@pytest.mark.parametrize("write", range(1, WRITES + 1))
def test_a_kill_at_any_write_replaces_no_better_policy_by_a_worse_one(write: int, before: bool, tmp_path: Path) -> None:
    trainer = Trainer(tiny("ppo"), RunFolder.begin(tmp_path / "run", tiny("ppo")))
    keep(trainer, 0.3)
    assert killed_at(write, before, lambda: keep(trainer, 0.9))
    again = resumed(tmp_path / "run")
    # The checkpoint is written first: once it is there, the better policy is, too, whatever else has been written.
    best = 0.3 if write == 1 and before else 0.9
    assert again.kept.best_score == pytest.approx(best)
    for file in (BEST, LAST):
        assert score_of(tmp_path / "run" / file) == best
    keep(again, 0.5)
    assert score_of(tmp_path / "run" / BEST) == max(best, 0.5)
    assert score_of(tmp_path / "run" / LAST) == 0.5
    scores = [row["recovered"] for row in read_curve(tmp_path / "run" / CURVE)]
    assert scores == ([0.3, 0.5] if best == 0.3 else [0.3, 0.9, 0.5])
    assert list((tmp_path / "run").rglob(".*")) == [], "what the kill left is swept up"


def test_a_validation_writes_no_more_files_than_are_tried(tmp_path: Path) -> None:
    trainer = Trainer(tiny("ppo"), RunFolder.begin(tmp_path / "run", tiny("ppo")))
    assert not killed_at(WRITES + 1, True, lambda: keep(trainer, 0.9))
    assert score_of(tmp_path / "run" / BEST) == 0.9


@pytest.mark.parametrize("of_before", [{"protocol": 1}, {"version": 0}, {"validation": "validate_graded"}, None])
def test_a_best_policy_whose_score_counted_something_else_is_validated_again(
    of_before: dict[str, object] | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    trainer = Trainer(tiny("ppo"), RunFolder.begin(tmp_path / "run", tiny("ppo")))
    today = trainer.kept.definition
    assert today == {"validation": "validate", "version": SCORE_VERSION, "protocol": PROTOCOL.version}
    trainer.kept.definition = of_before and {**today, **of_before}  # type: ignore[assignment] # None: of version 0.1
    keep(trainer, 0.9)
    monkeypatch.setattr("surefoot.learning.train.validation_for", lambda config: scored(0.2))
    again = resumed(tmp_path / "run")
    assert again.kept.best_score == 0.2
    assert "best.onnx was validated again" in capsys.readouterr().err
    keep(again, 0.5)
    assert score_of(tmp_path / "run" / BEST) == 0.5, "0.9 of another score is not more than 0.5 of this one"
    assert resumed(tmp_path / "run").kept.best_score == 0.5, "now it is of today"


# Before the first checkpoint.


def begun(folder: Path, what: str) -> None:
    """Leave a folder as a kill before the first checkpoint leaves it."""
    if what == "folder":
        folder.mkdir()
        return
    RunFolder.create(folder, tiny("ppo"))
    if what in ("beginning", "half a configuration"):
        (folder / "config.json").unlink()
    if what == "half a configuration":
        (folder / f".config.json.{a_dead_process()}").write_text('{"algor')
    if what == "events":
        (folder / "events.out.tfevents.1.host.2.3").write_bytes(b"\0")
    if what == "half a checkpoint":
        (folder / f".checkpoint.npz.{a_dead_process()}").write_bytes(b"PK\3\4")


def a_dead_process() -> int:
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


LEFT = ("folder", "beginning", "half a configuration", "configuration", "events", "half a checkpoint")


@pytest.mark.parametrize("what", LEFT)
@pytest.mark.parametrize("command", [train, go_on], ids=["train --run", "reproduce and ablate"])
def test_the_same_command_goes_on_before_the_first_checkpoint(
    what: str, command: Callable[..., Trainer], tmp_path: Path, in_no_time: None
) -> None:
    begun(tmp_path / "run", what)
    done = command(tiny("ppo"), tmp_path / "run")
    assert done.progress.steps >= 512
    assert RunFolder(tmp_path / "run").num_steps() >= 512
    assert list((tmp_path / "run").rglob(".*")) == []


@pytest.mark.parametrize("what", ["configuration", "events", "half a checkpoint"])
def test_a_run_is_resumed_before_its_first_checkpoint(what: str, tmp_path: Path, in_no_time: None) -> None:
    begun(tmp_path / "run", what)
    Train(resume=tmp_path / "run").main()
    assert RunFolder(tmp_path / "run").num_steps() >= 512


def test_another_command_does_not_go_on_with_what_a_kill_left(tmp_path: Path, in_no_time: None) -> None:
    begun(tmp_path / "run", "events")
    with pytest.raises(UserError, match="was begun with other settings; resume it with --resume, or give another"):
        train(tiny("ppo", seed=1), tmp_path / "run")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").write_text("years of work")
    for command in (train, go_on):
        with pytest.raises(UserError, match=r"exists already|which no training wrote"):
            command(tiny("ppo"), tmp_path / "mine")
    assert (tmp_path / "mine" / "thesis.tex").read_text() == "years of work"


@pytest.fixture
def in_no_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Validations take no trials: they are of no account here."""
    monkeypatch.setattr("surefoot.learning.train.validation_for", lambda config: scored(0.5))


# Full disks and cut files.


def test_a_full_disk_is_named_and_leaves_the_curve_and_all_else_as_it_was(tmp_path: Path) -> None:
    trainer = Trainer(tiny("ppo"), RunFolder.begin(tmp_path / "run", tiny("ppo")))
    keep(trainer, 0.3)
    before = {file: file.read_bytes() for file in (tmp_path / "run").rglob("*") if file.is_file()}
    with (
        full_after(10_000),
        pytest.raises(UserError, match=r"cannot write .*checkpoint\.npz: File too large; what was"),
    ):
        keep(trainer, 0.9)
    assert {file: file.read_bytes() for file in (tmp_path / "run").rglob("*") if file.is_file()} == before
    again = resumed(tmp_path / "run")
    keep(again, 0.5)
    assert [row["recovered"] for row in read_curve(tmp_path / "run" / CURVE)] == [0.3, 0.5]


def test_a_file_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    write_whole(tmp_path / "best.onnx", b"old")
    with full_after(100), pytest.raises(UserError, match=r"best\.onnx: File too large; what was there before is kept"):
        write_whole(tmp_path / "best.onnx", bytes(1000))
    assert [file.name for file in tmp_path.iterdir()] == ["best.onnx"]
    assert (tmp_path / "best.onnx").read_bytes() == b"old"
    with pytest.raises(UserError, match=r"cannot write .*nowhere.*: No such file or directory"):
        write_whole(tmp_path / "nowhere" / "best.onnx", b"")
    os.mkfifo(tmp_path / "pipe")
    for place in (tmp_path, tmp_path / "pipe"):
        with pytest.raises(UserError, match="it is no regular file"):
            write_whole(place, b"")
    assert (tmp_path / "pipe").is_fifo()


def test_only_what_dead_processes_left_is_swept_up(tmp_path: Path) -> None:
    dead, alive = a_dead_process(), os.getppid()
    names = [f".config.json.{dead}", f".best.onnx.{dead}", f".config.json.{alive}", ".hidden", f"config.json.{dead}"]
    for name in names:
        (tmp_path / name).write_text("")
    sweep(tmp_path, "config.json")
    assert sorted(file.name for file in tmp_path.iterdir()) == sorted(names[1:])
    sweep(tmp_path)
    assert sorted(file.name for file in tmp_path.iterdir()) == sorted(names[2:])


@pytest.mark.parametrize("cut", [1, 5, 20])
@pytest.mark.parametrize("of_version_01", [False, True])
def test_a_cut_last_row_of_the_curve_is_repaired(cut: int, of_version_01: bool, tmp_path: Path) -> None:
    trainer = Trainer(tiny("ppo"), RunFolder.begin(tmp_path / "run", tiny("ppo")))
    keep(trainer, 0.3)
    keep(trainer, 0.9)
    if of_version_01:  # its checkpoint holds no files, so that the curve is what lies in the folder
        trainer.kept.files, kept = {}, trainer.kept.files
        trainer.checkpoint()
        assert kept
    curve = tmp_path / "run" / CURVE
    curve.write_bytes(curve.read_bytes()[:-cut])
    again = resumed(tmp_path / "run")
    # The new checkpoint knows the row that was cut; the old one goes on with the rows that are whole.
    rows = [0.3] if of_version_01 else [0.3, 0.9]
    assert [row["recovered"] for row in read_curve(curve)] == rows
    keep(again, 0.5)
    assert [row["recovered"] for row in read_curve(curve)] == [*rows, 0.5]


# What a kill costs a run.


def test_a_checkpoint_is_written_whenever_its_time_has_passed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, in_no_time: None
) -> None:
    steps, save = list[int](), Trainer.checkpoint
    monkeypatch.setattr(Trainer, "checkpoint", lambda self: (steps.append(self.progress.steps), save(self)))
    train(tiny("ppo"), tmp_path / "seldom")
    seldom = len(steps)
    monkeypatch.setattr(train_module, "CHECKPOINT_S", 0.0)
    train(tiny("ppo"), tmp_path / "often")
    often = steps[seldom:]
    assert len(often) > seldom
    assert often == sorted(set(often)), "one between any two rollouts"
    assert "since its last checkpoint: 30 s" in RELIABILITY.read_text()
    assert CHECKPOINT_S == 30.0


# The same bits.


@pytest.mark.parametrize("algorithm", ["trpo", "ppo", "ddpg"])
def test_a_run_of_so_many_steps_is_the_same_to_the_last_bit(
    algorithm: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, in_no_time: None
) -> None:
    config = tiny(algorithm, average_steps=100.0)
    first = train(config, tmp_path / "first")
    # The second one meets other conditions: threads, generators that were used, and a clock by which it writes a
    # checkpoint and a line of the log between any two rollouts.
    torch.set_num_threads(2)
    torch.rand(5), np.random.rand(5)  # noqa: NPY002 that is the generator which stable-baselines3 draws from
    monkeypatch.setattr("surefoot.learning.train.CHECKPOINT_S", 0.0)
    monkeypatch.setattr("surefoot.learning.train.LOG_S", 0.0)
    second = train(config, tmp_path / "second")
    weights, same = first.model.policy.state_dict(), second.model.policy.state_dict()
    assert weights.keys() == same.keys()
    assert all(torch.equal(weights[name], same[name]) for name in weights)
    observations = np.random.default_rng(0).standard_normal((20, 47))
    actions = [NetworkAgent(run.policy_bytes(), "run").actions(observations) for run in (first, second)]
    np.testing.assert_array_equal(*actions)
    assert np.abs(actions[0]).max() > 0.01
    rows = [(run.folder.path / CURVE).read_text().partition("\n")[2].split(",", 1)[1] for run in (first, second)]
    assert rows[0] == rows[1], "all columns but the minutes"
    other = train(tiny(algorithm, average_steps=100.0, seed=1), tmp_path / "other")
    assert not torch.equal(*(next(iter(run.model.policy.parameters())) for run in (first, other)))
