"""Choosing policies: validation, the selection among several, and what each part of a preset gives."""

from __future__ import annotations

import dataclasses
import importlib.resources
from pathlib import Path
from unittest import mock

import numpy as np
import pytest
from conftest import full_after

from surefoot.agents.load import load_policy
from surefoot.agents.network import NetworkAgent
from surefoot.agents.nominal import NominalAgent
from surefoot.agents.policy_file import network_bytes
from surefoot.cli.train import Select
from surefoot.errors import UserError
from surefoot.evaluation.trials import run_list
from surefoot.learning.ablations import LEFT_OUT, ablate, without
from surefoot.learning.models import make_model
from surefoot.learning.sb3 import SB3VecEnv
from surefoot.learning.selection import best_candidate, files, means, shipped_bytes, validate_candidate
from surefoot.learning.standing import CELLS, GradedValidation
from surefoot.learning.suite_validation import UP_TO, validate_suite
from surefoot.learning.validation import (
    FIRST_SEED,
    NUM_DIRECTIONS,
    NUM_IMPULSES,
    QUIET_CELL,
    QUIET_DRIFT,
    QUIET_POWER,
    SCORE_VERSION,
    SPACING,
    Validation,
    validate,
)
from surefoot.report.ablations import ablation_table
from surefoot.robots import load_robot
from surefoot.task.contract import Contract
from surefoot.task.environment import PushRecoveryVectorEnv

pytestmark = pytest.mark.slow


def test_a_validation_uses_trials_that_the_evaluation_never_sees() -> None:
    with mock.patch("surefoot.learning.validation.run_list", wraps=run_list) as runner:
        found = validate(NominalAgent(load_robot("valkyrie"), "bent"))
    # An evaluation's seeds count from 0, up to the 40 full-length trials and the trials of a fixed scenario.
    assert min(trial.seed for trial in runner.call_args.args[1]) > 10_000
    # Held by its impedance alone the robot rejects small pushes and no large ones.
    assert 0.05 < found.recovered < 0.4
    assert 0.05 < found.within_limits <= found.recovered
    assert all(found.rejected_within_limits[name] <= impulse for name, impulse in found.rejected.items())
    assert set(found.rejected) >= {"forward", "left", "backward", "right", "45"}


def test_a_score_adds_shares_and_impulses_without_a_hole() -> None:
    impulses = {"forward": 54.0, "left": 162.0, "backward": 270.0, "right": 54.0}
    found = Validation(
        recovered=0.9, within_limits=0.5, fell=0.1, rejected=impulses, rejected_within_limits=impulses, quiet=0.25,
        power=1.0, largest=540.0,
    )  # fmt: skip
    # 0.5 + (54 + 135) / 540 + 0.25; whoever changes this, or the trials below, raises SCORE_VERSION.
    assert (found.score, SCORE_VERSION) == (pytest.approx(1.1), 1)
    numbers = NUM_DIRECTIONS, SPACING, NUM_IMPULSES, QUIET_CELL, QUIET_POWER, QUIET_DRIFT, FIRST_SEED
    assert numbers == (8, 6, 15, 17, 20.0, 0.01, 1_000_000)
    graded = GradedValidation(**vars(found), held=0.5)
    assert (graded.score, CELLS[0], CELLS[-1]) == (pytest.approx(2.1), 5, 18)


def test_validations_of_other_rounds_use_other_trials_and_some_other_directions() -> None:
    policy = NominalAgent(load_robot("valkyrie"), "bent")
    seeds: list[set[int]] = []
    directions: list[set[float]] = []
    for number in (0, 1, 2):
        with mock.patch("surefoot.learning.validation.run_list", wraps=run_list) as runner:
            validate(policy, round=number)
        trials = runner.call_args.args[1]
        seeds.append({trial.seed for trial in trials})
        angles = np.degrees([np.arctan2(trial.push.direction[1], trial.push.direction[0]) for trial in trials])
        directions.append(set(np.round(angles % 360.0, 3)))
    assert [len(each) for each in seeds] == [128, 128, 128]
    assert len(set.union(*seeds)) == 3 * 128
    assert directions == [{45.0 * k for k in range(8)}] * 2 + [{45.0 * k + 22.5 for k in range(8)}]


def test_a_suite_validation_tells_by_scenario_how_much_of_the_way_to_the_target_holds() -> None:
    policy = NominalAgent(load_robot("valkyrie"), "bent")
    with mock.patch("surefoot.learning.suite_validation.run_list", wraps=run_list) as runner:
        shares = validate_suite(policy)
    trials = runner.call_args.args[1]
    # Six sizes each: 16 directions of the root, 4 of nine other scenarios, one height.
    assert len(trials) == 6 * (16 + 9 * 4 + 1)
    assert {trial.seed for trial in trials}.isdisjoint(range(1000))
    assert list(shares) == list(UP_TO)
    # The nominal pose rejects 48 Ns of the 450 in the worst direction and 84 Ns in others: none or one of six sizes
    # holds, and without a step one to five of six up to 90 Ns, but nothing of the 500 Ns upwards.
    assert 1 / 24 < shares["root_push"] < 1 / 3
    assert 1 / 2 < shares["root_push_no_step"] < 1.0
    assert shares["combined"] < 0.3


def test_the_better_policy_is_selected_and_carries_what_was_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("ddpg", "ppo"):
        policy = importlib.resources.files("surefoot.agents") / "shipped" / f"{name}.onnx"
        (tmp_path / f"{name}.onnx").write_bytes(policy.read_bytes())
    candidates = [validate_candidate(file, 1) for file in files([tmp_path / "ddpg.onnx", tmp_path / "ppo.onnx"])]
    best = best_candidate(candidates)
    chosen = NetworkAgent(shipped_bytes(best), "chosen")
    (validation,) = best.validations
    within = round(validation.within_limits, 4)
    record = {"recovered": round(best.recovered, 4), "within_limits": within, "calm": best.quiet}
    assert chosen.contract.training["selection"] == [record]
    observation = np.zeros((1, 47))
    np.testing.assert_array_equal(chosen.actions(observation), load_policy(best.file).actions(observation))
    with pytest.raises(UserError, match=r"no policies in .*nowhere"):
        files([tmp_path / "nowhere"])
    # The command, with what has just been found: it writes the better one, and nothing on a full disk.
    found = {candidate.file: candidate for candidate in candidates}
    monkeypatch.setattr("surefoot.learning.selection.validate_candidate", lambda file, *_: found[file])
    command = Select(tuple(found), out=tmp_path / "chosen.onnx", rounds=1)
    command.main()
    assert command.out.read_bytes() == shipped_bytes(best)
    command.out.write_bytes(b"an older one")
    with full_after(20_000), pytest.raises(UserError, match=r"cannot write .*chosen\.onnx: File too large"):
        command.main()
    assert command.out.read_bytes() == b"an older one"


def test_means_are_of_the_policies_that_a_run_kept_within_some_minutes(tmp_path: Path) -> None:
    robot = load_robot("valkyrie")
    contract = Contract.of(robot, "bent", 0.8, {"algorithm": "ddpg"})
    (tmp_path / "kept").mkdir()
    for k in range(5):  # minutes 0.5, 2.5, ..., 8.5: a network that always says k
        layers = [(np.zeros((robot.num_joints, 47)), np.full(robot.num_joints, float(k)))]
        data = network_bytes(layers, np.zeros(47), np.ones(47), squash=False, contract=contract)
        (tmp_path / "kept" / f"{2 * k + 0.5:06.1f}.onnx").write_bytes(data)
    found = means(tmp_path, 4.0)
    # Windows from 0, 2, 4 and 6 minutes on, two policies in each: 0 and 1, 1 and 2, 2 and 3, 3 and 4.
    assert [file.name for file in found] == [f"mean-{k}-to-{k + 4}.onnx" for k in (0, 2, 4, 6)]
    said = [load_policy(file).actions(np.zeros((1, 47)))[0, 0] for file in found]
    assert said == [0.5, 1.5, 2.5, 3.5]
    assert load_policy(found[1]).contract.training == {"algorithm": "ddpg", "mean_of": 2, "mean_from_minute": 2.0}
    assert means(tmp_path / "nothing", 4.0) == []


def test_every_ablation_leaves_out_one_thing_and_can_be_made() -> None:
    whole = without("nothing", 1000, seed=0)
    for name in LEFT_OUT:
        config = without(name, 1000, seed=0)
        assert (config == whole) == (name == "nothing")
        few = dataclasses.replace(config, num_envs=2)
        make_model(
            few, SB3VecEnv(PushRecoveryVectorEnv(2, few.env), few.privileged_critic), np.random.default_rng(0), 1e-3
        )


def test_an_ablation_that_is_done_is_not_done_again(tmp_path: Path) -> None:
    curve = ablate("averaged-actor", tmp_path, steps=7_000, seed=0)
    assert curve[-1]["steps"] >= 7_000
    before = (tmp_path / "averaged-actor" / "last.onnx").stat().st_mtime_ns
    assert len(ablate("averaged-actor", tmp_path, steps=7_000, seed=0)) == len(curve)
    assert (tmp_path / "averaged-actor" / "last.onnx").stat().st_mtime_ns == before
    assert ablation_table({"averaged-actor": curve}).rows[0][0] == "averaged actor"
