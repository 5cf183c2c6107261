"""Benchmarks: the speed of each layer, as ratios measured in one run.

The benchmark runs on shared, noisy machines, where steps per second say little. The ratio of a layer's speed to that of
the layer below it does not depend on other load.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.table import Table

from surefoot.agents.network import NetworkAgent
from surefoot.evaluation.protocol import protocol_for
from surefoot.evaluation.scenarios import Scenario
from surefoot.evaluation.trials import NUM_SLOTS, run_list
from surefoot.physics.mujoco_engine import MujocoEngine
from surefoot.physics.pushes import horizontal_push
from surefoot.physics.signals import LowPass
from surefoot.rates import CONTROL_HZ, TICKS_PER_STEP
from surefoot.robots import Robot, load_robot
from surefoot.task import observation
from surefoot.task.environment import PushRecoveryVectorEnv

if TYPE_CHECKING:
    from surefoot.learning.config import TrainConfig

NUM_ENVS = 256
TARGETS = {
    "bench.env_over_physics": (0.96, "at least"),
    "bench.learning_over_env": (0.80, "at least"),
    "bench.ddpg_over_env": (0.70, "at least"),
    "bench.trials_over_physics": (0.93, "at least"),
    "bench.paper_suite_min": (5.0, "at most"),
    "bench.policy_step_us": (100.0, "at most"),
    "bench.play_headroom_1": (1.0, "at least"),
    "bench.play_headroom_64": (1.0, "at least"),
}


def run_bench(
    seconds: float = 20.0,
    on_stage: Callable[[str], None] = lambda stage: None,
    robot: str = "",
    paper_suite: bool = False,
) -> dict[str, float]:
    """All figures, with documented keys (docs/figures.md).

    Args:
        seconds: for each ratio; a quarter of it for each size of the live page.
        on_stage: told what is measured next.
        robot: name or description of the robot; the shipped policies' without it.
        paper_suite: measure how long the whole suite `paper` takes, too.
    """
    on_stage("environment against bare physics")
    figures = environment_over_physics(seconds, robot=robot)
    on_stage("PPO against its environment")
    figures |= learning_over_environment(seconds, robot)
    on_stage("DDPG against its environment")
    figures |= ddpg_over_environment(seconds, robot)
    on_stage("trials against bare physics")
    figures |= trials_over_physics(seconds, robot)
    on_stage("one policy step")
    figures |= policy_step(robot)
    on_stage("the live page")
    for num_robots in (1, 64):
        figures |= live_page(num_robots, 0.25 * seconds, robot)
    if paper_suite:
        on_stage("the suite paper, which takes some minutes")
        figures |= paper_suite_time()
    return figures


def environment_over_physics(seconds: float, num_envs: int = NUM_ENVS, robot: str = "") -> dict[str, float]:
    """The full environment against `Batch.rollout` on the same states, with the same controls and records.

    Step by step, first the environment, then the bare physics from the state that the environment began with.
    """
    config = _config(robot).env
    env = PushRecoveryVectorEnv(num_envs, config)
    env.reset(seed=0)
    engine, bare = env.loop.engine, PushRecoveryVectorEnv(num_envs, config).loop.engine
    assert isinstance(engine, MujocoEngine)  # its bare physics is what is measured
    assert isinstance(bare, MujocoEngine)
    rng = np.random.default_rng(0)
    spent = {"env": 0.0, "physics": 0.0}
    steps = 0
    began = time.perf_counter()
    while time.perf_counter() - began < seconds:
        actions = 0.2 * rng.standard_normal((num_envs, env.robot.num_joints))
        bare.copy_state(engine)
        spent["env"] += _timed(partial(env.step, actions))
        bare.copy_control(engine)
        spent["physics"] += _timed(bare.advance)
        steps += num_envs
    return {
        "bench.physics_steps_per_s": round(steps * TICKS_PER_STEP / spent["physics"]),
        "bench.env_policy_steps_per_s": round(steps / spent["env"]),
        "bench.env_over_physics": round(spent["physics"] / spent["env"], 4),
    }


def learning_over_environment(seconds: float, robot: str = "") -> dict[str, float]:
    """PPO end to end (collect and update) against the environment alone: the share of its time spent in there."""
    from surefoot.learning.models import make_model
    from surefoot.learning.sb3 import SB3VecEnv

    config = _config(robot)
    env = PushRecoveryVectorEnv(config.num_envs, config.env)
    venv = SB3VecEnv(env, config.privileged_critic)
    model = make_model(config, venv, np.random.default_rng(0), config.hyper["learning_rate"])
    inside = 0.0
    step = env.step

    def timed_step(actions: np.ndarray) -> Any:
        nonlocal inside
        began = time.perf_counter()
        result = step(actions)
        inside += time.perf_counter() - began
        return result

    env.step = timed_step  # type: ignore[method-assign]
    per_iteration = config.num_envs * config.hyper["n_steps"]
    model.learn(per_iteration)  # warm up
    inside, steps, began = 0.0, 0, time.perf_counter()
    while time.perf_counter() - began < seconds:
        model.learn(per_iteration, reset_num_timesteps=False)
        steps += per_iteration
    total = time.perf_counter() - began
    return {
        "bench.learning_policy_steps_per_s": round(steps / total),
        "bench.learning_over_env": round(inside / total, 4),
    }


def ddpg_over_environment(seconds: float, robot: str = "") -> dict[str, float]:
    """DDPG end to end, whose gradient steps are done while the robots move, against its environment alone.

    It learns for as long as a run measures its own speed, and for less if `seconds` are less.
    """
    from surefoot.learning.budget import MEASURED_SHARE, SPEED
    from surefoot.learning.speed import learning_speed

    config = _config(robot, "ddpg")
    hyper = {**config.hyper, "learning_starts": 8 * config.num_envs}
    config = dataclasses.replace(config, hyper=hyper, minutes=seconds / (60.0 * MEASURED_SHARE))
    speed = learning_speed(config, lambda learner: None)[SPEED]
    env = PushRecoveryVectorEnv(config.num_envs, config.env)
    env.reset(seed=0)
    actions = 0.2 * np.random.default_rng(0).standard_normal((config.num_envs, env.robot.num_joints))
    steps, spent, began = 0, 0.0, time.perf_counter()
    while time.perf_counter() - began < 0.25 * seconds:
        spent += _timed(lambda: env.step(actions))
        steps += config.num_envs
    return {"bench.ddpg_policy_steps_per_s": round(speed), "bench.ddpg_over_env": round(speed * spent / steps, 4)}


def trials_over_physics(seconds: float, robot: str = "") -> dict[str, float]:
    """Whole trials of a network against the bare physics inside them, settling included: the share of time in there."""
    inside, num_trials = 0.0, 0

    def timed(physics: Callable[..., Any]) -> Callable[..., Any]:
        def run(*args: Any) -> Any:
            nonlocal inside
            start = time.perf_counter()
            record = physics(*args)
            inside += time.perf_counter() - start
            return record

        return run

    policy = standing_network(robot)
    line = Scenario("root_push", directions=1).lines(protocol_for(policy.robot))[0]
    plain = {name: getattr(MujocoEngine, name) for name in ("advance", "relax")}
    for name, physics in plain.items():
        setattr(MujocoEngine, name, timed(physics))
    began = time.perf_counter()
    try:
        while time.perf_counter() - began < seconds:
            trials = [line.trial(4, seed, full_length=False) for seed in range(num_trials, num_trials + NUM_SLOTS)]
            run_list(policy, trials)
            num_trials += len(trials)
    finally:
        for name, physics in plain.items():
            setattr(MujocoEngine, name, physics)
    total = time.perf_counter() - began
    return {
        "bench.trials_per_s": round(num_trials / total, 1),
        "bench.trials_over_physics": round(inside / total, 4),
    }


def paper_suite_time() -> dict[str, float]:
    """How long the suite `paper` takes for `ppo`, in four directions [min]."""
    from surefoot.agents.load import load_agent
    from surefoot.evaluation.evaluate import evaluate

    policy = load_agent("ppo")
    return {"bench.paper_suite_min": round(_timed(lambda: evaluate(policy, "paper")) / 60.0, 2)}


def policy_step(robot: str = "", repeats: int = 3000) -> dict[str, float]:
    """Median time of one policy step of one robot: low-pass filter and network [us]."""
    policy = standing_network(robot)
    num_observations = len(policy.contract.observations)
    low_pass = LowPass(1, num_observations, CONTROL_HZ)
    signal = np.random.default_rng(0).standard_normal((1, TICKS_PER_STEP, num_observations))
    one = np.array([0])
    times = [_timed(lambda: policy(low_pass([signal]), one)) for _ in range(repeats)]
    return {"bench.policy_step_us": round(1e6 * float(np.median(times)), 1)}


def live_page(num_robots: int, seconds: float, robot: str = "") -> dict[str, float]:
    """Measure the live page without any waiting: simulate, judge, place all bodies, write messages.

    Its headroom is how many times as fast it is as it has to be: frames per second over the 50 (25 for a crowd) of
    real time. What the browser draws is the browser's own affair.
    """
    from surefoot.viewer.page import Page
    from surefoot.viewer.source import PolicySource

    chosen = _robot(robot)
    page = Page(PolicySource("nominal", chosen), num_robots, port=0)
    try:
        page.player.stop()
        page.player.session.push(horizontal_push("root", 0.0, 40.0 * chosen.mass_scale))
        frames, steps, began = 0, 0, time.perf_counter()
        while time.perf_counter() - began < seconds:
            steps += page.player.frame()
            frames += 1
        passed = time.perf_counter() - began
    finally:
        page.close()
    return {
        f"bench.play_physics_steps_per_s_{num_robots}": round(steps * num_robots * TICKS_PER_STEP / passed),
        f"bench.play_frames_per_s_{num_robots}": round(frames / passed),
        f"bench.play_headroom_{num_robots}": round(frames / passed / page.player.frames_per_second, 2),
    }


def _robot(name: str) -> Robot:
    from surefoot.agents.load import usual_robot

    return load_robot(name) if name else usual_robot()


def _config(robot: str, algorithm: str = "ppo") -> TrainConfig:
    """The preset `fast` of an algorithm, scaled to a robot if one is named."""
    from surefoot.learning.preset_file import preset
    from surefoot.learning.robot_scale import for_robot

    config = preset("fast", algorithm)
    return for_robot(config, robot) if robot else config


def standing_network(robot_name: str = "") -> NetworkAgent:
    """A new network of the paper's size that holds the nominal pose: as fast as any trained one."""
    from surefoot.agents.policy_file import network_bytes
    from surefoot.task.contract import Contract

    robot = _robot(robot_name)
    sizes = [len(observation.component_names(robot)), 100, 50, 25, robot.num_joints]
    layers = [(np.zeros((o, i)), np.zeros(o)) for i, o in zip(sizes[:-1], sizes[1:], strict=True)]
    contract = Contract.of(robot, next(iter(robot.poses)), 1.0)
    return NetworkAgent(network_bytes(layers, np.zeros(sizes[0]), np.ones(sizes[0]), False, contract), "standing")


HOW = (
    f"env_over_physics: {NUM_ENVS} robots of the preset fast step in the environment; after each policy step the bare "
    "physics makes the same 20 ticks from the same state with the same controls and records the same. The figure is "
    "its time over the environment's, all steps together."
)
"""How the first ratio is measured."""


def bench_table(figures: dict[str, float], robot: str = "") -> Table:
    """The figures with their targets, for the terminal."""
    title = f"surefoot bench: {_robot(robot).title}"
    table = Table(title=title, title_justify="left", caption=HOW, caption_justify="left")
    for column in ("figure", "value", "target"):
        table.add_column(column, justify="left" if column == "figure" else "right")
    for key, value in figures.items():
        target = "{1} {0:g}".format(*TARGETS[key]) if key in TARGETS else ""
        table.add_row(key, f"{value:g}", target)
    return table


def _timed(function: Callable[[], object]) -> float:
    began = time.perf_counter()
    function()
    return time.perf_counter() - began
