"""Formats: for each a whole file, a way to damage it, and what surefoot does with it when a user names it."""

from __future__ import annotations

import dataclasses
import functools
import io
import json
import random
import shutil
import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fuzzing import policy_formats as policies
from fuzzing.mutations import NUMBERS, TEXTS, damage_database, damaged_bytes, damaged_text, damaged_value
from surefoot.agents.load import usual_robot
from surefoot.agents.nominal import NominalAgent
from surefoot.cli.commands import COMMANDS
from surefoot.cli.options import check_options
from surefoot.evaluation.outcome import Outcome
from surefoot.evaluation.results import Results, open_results
from surefoot.evaluation.results_export import read_thresholds
from surefoot.evaluation.scenario_file import suite
from surefoot.evaluation.scenarios import Scenario
from surefoot.evaluation.threshold_search import Threshold
from surefoot.learning.config import TrainConfig
from surefoot.learning.curve import read_curves
from surefoot.learning.preset_file import preset
from surefoot.learning.run_folder import RunFolder
from surefoot.learning.stages import read_stages
from surefoot.report.evaluations import read_evaluations
from surefoot.report.paper_tables import table_1
from surefoot.report.threshold_tables import seeds_table, worst_table
from surefoot.robots.load import _load

HERE = Path(__file__).parents[1]
PRESETS = HERE.parent / "src" / "surefoot" / "learning" / "presets"
SUITES = HERE.parent / "src" / "surefoot" / "evaluation" / "suites"
TIPTOE = HERE / "robots" / "tiptoe"


class Format(NamedTuple):
    """A format that is fuzzed.

    Attributes:
        share: of all cases, in parts.
        attempt: makes the damaged file of a generator in a folder and lets surefoot read it. It returns if the file was
            accepted, and raises what surefoot raises.
    """

    share: int
    attempt: Callable[[random.Random, Path], None]


@functools.cache
def a_table() -> bytes:
    """A results table with some of everything."""
    with tempfile.TemporaryDirectory() as folder:
        agent, path = NominalAgent(usual_robot()), Path(folder) / "r.sqlite"
        fixed = Scenario("fixed", search="", directions=2, impulse=12.0, trials=2)
        searched = Scenario("root_push")
        with Results(path) as results:
            store = results.trials_of(agent)
            trials = [trial for line in fixed.lines() for trial in line.fixed_trials()]
            trials += [line.trial(7, seed, full_length=True) for line in searched.lines() for seed in range(3)]
            for trial in trials:
                store.put(trial, an_outcome(), "fixed")
            found = [Threshold(line, 42.0, 40, 39, 0.87, 0.99, "share") for line in searched.lines()]
            results.add_thresholds(agent, found)
            results.add_scenarios(agent, [fixed, searched], 1.0)
            results.export("thresholds", Path(folder) / "t.csv")
        return path.read_bytes()


def an_outcome() -> Outcome:
    values: dict[str, Any] = {
        "bool": False,
        "str": "recovered",
        "float": 0.5,
        "int": 1,
        "tuple[float, ...]": (1.0,) * 6,
    }
    return Outcome(**{field.name: values[str(field.type)] for field in dataclasses.fields(Outcome)})


def results_table(rng: random.Random, folder: Path) -> None:
    file = folder / "r.sqlite"
    file.write_bytes(a_table())
    damage_database(rng, file)
    with open_results(file) as results:
        results.row(1)
        results.trials_of(NominalAgent(usual_robot())).put(Scenario("a").lines()[0].trial(1, 0, False), an_outcome())
    read_evaluations([file])


@functools.cache
def a_csv() -> str:
    return "".join((HERE.parent / "results" / "thresholds.csv").read_text().splitlines(keepends=True)[:12])


def thresholds_csv(rng: random.Random, folder: Path) -> None:
    (folder / "t.csv").write_text(damaged_text(rng, a_csv()), newline="")
    policies = read_thresholds(folder / "t.csv")
    table_1(policies, usual_robot()).markdown()
    worst_table(policies, usual_robot()).markdown()
    seeds_table((name.rsplit("-", 1)[0], found) for name, found in policies.items()).markdown()


def curve_csv(rng: random.Random, folder: Path) -> None:
    text = (HERE.parent / "results" / "curves" / "ppo-0.csv").read_text()
    (folder / "ppo-0.csv").write_text(damaged_text(rng, text), newline="")
    for runs in read_curves(folder).values():
        for run in runs:
            [(row["minutes"], int(row["steps"]), row["recovered"]) for row in run]


def scenario_toml(rng: random.Random, folder: Path) -> None:
    text = rng.choice(sorted(SUITES.glob("*.toml"))).read_text()
    blocks = text.split("[[scenario]]")
    some = [blocks[0], *rng.sample(blocks[1:], min(3, len(blocks) - 1))]
    (folder / "s.toml").write_text(damaged_text(rng, "[[scenario]]".join(some)))
    for scenario in suite(str(folder / "s.toml"), usual_robot()):
        for line in scenario.lines():
            line.trial(1, 0, True) if scenario.search else line.fixed_trials()


def robot_toml(rng: random.Random, folder: Path) -> None:
    for name in ("tiptoe.xml", "shank.stl"):
        shutil.copy(TIPTOE / name, folder)
    file = folder / f"tiptoe{rng.randrange(10**9)}.toml"
    file.write_text(damaged_text(rng, (TIPTOE / "tiptoe.toml").read_text()))
    _load.__wrapped__(file, str(file))  # without the cache, which would hold every robot


def robot_xml(rng: random.Random, folder: Path) -> None:
    shutil.copy(TIPTOE / "shank.stl", folder)
    (folder / "tiptoe.xml").write_text(damaged_text(rng, (TIPTOE / "tiptoe.xml").read_text()))
    file = folder / f"tiptoe{rng.randrange(10**9)}.toml"
    shutil.copy(TIPTOE / "tiptoe.toml", file)
    _load.__wrapped__(file, str(file))  # without the cache, which would hold every robot


def preset_toml(rng: random.Random, folder: Path) -> None:
    text = (PRESETS / "fast.toml").read_text()
    (folder / "mine.toml").write_text(damaged_text(rng, text))
    preset(str(folder / "mine.toml"), rng.choice(("trpo", "ppo", "ddpg")))


@functools.cache
def a_config(algorithm: str) -> str:
    return preset("fast", algorithm).to_json()


def config_json(rng: random.Random, folder: Path) -> None:
    values = json.loads(a_config(rng.choice(("trpo", "ppo", "ddpg"))))
    text = json.dumps(damaged_value(rng, values))
    (folder / "config.json").write_text(damaged_text(rng, text) if rng.random() < 0.2 else text)
    config = RunFolder(folder).config()
    assert isinstance(config, TrainConfig)
    config.to_json()


def stages_json(rng: random.Random, folder: Path) -> None:
    values = {name: json.loads(a_config("ppo")) for name in ("pushes", "standing")}
    text = json.dumps(damaged_value(rng, values))
    (folder / "stages.json").write_text(damaged_text(rng, text) if rng.random() < 0.2 else text)
    for stage in read_stages(folder):
        stage.folder.relative_to(folder)


@functools.cache
def a_checkpoint() -> bytes:
    with tempfile.TemporaryDirectory() as name:
        folder = RunFolder(name)
        state = {"steps": 512, "seconds": 3.5, "best_score": 0.5, "inherited": {"policy_steps": 3}, "list": [1, 2]}
        weights = {"policy": {"w": np.ones((4, 3), np.float32), "b": np.zeros(4, np.float32)}}
        files = {
            "best.onnx": b"best",
            "last.onnx": b"last",
            "curve.csv": b"minutes,steps\n1,2\n",
            "kept/0001.0.onnx": b"x",
        }
        folder.save_checkpoint(weights, state, files)
        return (Path(name) / "checkpoint.npz").read_bytes()


def checkpoint_npz(rng: random.Random, folder: Path) -> None:
    data = a_checkpoint()
    data = damaged_bytes(rng, data) if rng.random() < 0.5 else _rewritten(rng, data)
    (folder / "checkpoint.npz").write_bytes(data)
    run = RunFolder(folder)
    run.load_checkpoint()
    run.num_steps()
    run.restore_files()


class Bomb:
    """It would run a command when it is unpickled."""

    def __reduce__(self) -> tuple[Any, tuple[str]]:
        return exec, ("import os; os.system('true')",)


def _rewritten(rng: random.Random, data: bytes) -> bytes:
    """The archive with another member: a pickle, a huge array, another name, other JSON."""
    with np.load(io.BytesIO(data)) as arrays:
        found: dict[str, Any] = {name: arrays[name] for name in arrays.files}
    name = rng.choice(list(found))
    kind = rng.randrange(6)
    if kind == 0:
        found[name] = np.array([Bomb()], dtype=object)
    elif kind == 1:
        found[name] = rng.choice((np.zeros(0), np.array(3), np.full(10, np.nan), np.array("x" * 5000)))
    elif kind == 2:
        found["__file__/" + rng.choice(("../x", "/tmp/x", "kept/../../x", "config.json", "", "a" * 300))] = np.zeros(3)
    elif kind == 3:
        del found[name]
    else:
        skeleton = json.loads(str(found["__json__"]))
        found["__json__"] = np.array(json.dumps(damaged_value(rng, skeleton)))
    buffer = io.BytesIO()
    (np.savez_compressed if rng.random() < 0.2 else np.savez)(buffer, **found)
    if kind == 5:
        with zipfile.ZipFile(buffer, "a") as archive:
            archive.writestr(rng.choice(("../x.npy", "x.npy", name + ".npy")), rng.randbytes(50))
    return buffer.getvalue()


def beginning_json(rng: random.Random, folder: Path) -> None:
    from surefoot.learning.budget import budget_for

    values = {"start": "", "policy_steps_per_s": 1900.0, "measuring_s": 8.0}
    (folder / "beginning.json").write_text(json.dumps(damaged_value(rng, values)))
    budget_for(preset("fast", "ppo"), RunFolder(folder))


def command_line(rng: random.Random, folder: Path) -> None:
    """A command with odd options: what its own place of checks says of them."""
    import tyro

    name = rng.choice(list(COMMANDS))
    fields = list(dataclasses.fields(COMMANDS[name]))
    arguments = [name]
    needed = [field for field in fields if field.default is dataclasses.MISSING]
    arguments += [rng.choice(("1", "x", *TEXTS[:4])) for _ in needed]
    for field in rng.sample(fields, min(3, len(fields))):
        value = rng.choice((*NUMBERS, *TEXTS))
        arguments.append(f"--{field.name.replace('_', '-')}={value}")
    try:
        command = tyro.extras.subcommand_cli_from_dict(COMMANDS, args=arguments, console_outputs=False)
    except SystemExit:
        return
    check_options(command)


def config_json_run(rng: random.Random, folder: Path) -> None:
    """What a run that is resumed makes of an edited configuration: robots and networks."""
    from surefoot.learning.learner import Learner

    values = json.loads(a_config(rng.choice(("trpo", "ppo", "ddpg"))))
    values |= {"num_envs": 4}
    values["hyper"] |= {"n_steps": 3, "batch_size": 12} | (
        {"buffer_size": 100} if "buffer_size" in values["hyper"] else {}
    )
    (folder / "config.json").write_text(json.dumps(damaged_value(rng, values)))
    config = RunFolder(folder).config()
    few = dataclasses.replace(config, num_envs=min(config.num_envs, 64))  # more robots only take longer
    learner = Learner(few, lambda _: few.hyper["learning_rate"])
    learner.venv.reset()
    learner.venv.step(np.zeros((few.num_envs, learner.env.robot.num_joints)))
    learner.venv.close()


FORMATS = {
    "policy.onnx, bytes": Format(12, policies.policy_bytes),
    "policy.onnx, contract": Format(12, policies.policy_contract),
    "foreign.onnx, bytes": Format(6, policies.foreign_bytes),
    "foreign.onnx, metadata": Format(6, policies.foreign_metadata),
    "deploy.yaml": Format(3, policies.deploy_yaml),
    "results.sqlite": Format(8, results_table),
    "thresholds.csv": Format(8, thresholds_csv),
    "curve.csv": Format(8, curve_csv),
    "scenarios.toml": Format(12, scenario_toml),
    "robot.toml": Format(4, robot_toml),
    "robot.xml": Format(3, robot_xml),
    "preset.toml": Format(8, preset_toml),
    "config.json": Format(12, config_json),
    "config.json, run": Format(1, config_json_run),
    "stages.json": Format(4, stages_json),
    "beginning.json": Format(2, beginning_json),
    "checkpoint.npz": Format(8, checkpoint_npz),
    "command line": Format(2, command_line),
}
