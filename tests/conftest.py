"""What several test files need: the robot, one at rest, altered ticks, policies that move, and made-up outcomes."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import resource
from collections.abc import Callable, Iterator
from pathlib import Path

# As surefoot.learning does: before any test file loads torch, whose waiting threads would starve the other workers.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")


import mujoco
import numpy as np
import pytest

from surefoot.agents.nominal import NominalAgent
from surefoot.evaluation.outcome import Outcome
from surefoot.evaluation.trials import Trial, run_list
from surefoot.learning.config import TrainConfig
from surefoot.learning.preset_file import preset
from surefoot.physics.mujoco_engine import MujocoEngine
from surefoot.physics.pushes import Push, Pushes
from surefoot.physics.step_record import StepRecord
from surefoot.rates import TICKS_PER_STEP
from surefoot.robots import Robot, load_robot
from surefoot.task.agent import Agent, Command
from surefoot.task.control_loop import ControlLoop
from surefoot.task.environment import EnvConfig, PushRecoveryVectorEnv
from surefoot.task.random_pushes import DisturbanceConfig
from surefoot.task.reward import RewardContext

TOTAL_MASS = 137.287494
"""Of NASA's description [kg]."""
PUSH = np.array([300.0, -150.0, 80.0])
"""The force of `plain_steps` [N]."""
NUM_BODIES = 13
"""Of the model, the world among them."""

TIPTOE = Path(__file__).parent / "robots" / "tiptoe" / "tiptoe.toml"
"""The second robot: a small biped outside the package."""

Motion = Callable[[np.ndarray], dict[str, np.ndarray]]


def an_outcome(**changes: object) -> Outcome:
    """An outcome of a trial that recovered at its horizon, but for what is changed; six joint groups."""
    values = {
        "recovered": True, "reason": "recovered", "seconds": 10.0, "foot_shift": 0.0, "com_speed": 0.01,
        "root_tilt": 0.1, "ankle": False, "hip": False, "foot_tilt": False, "steps": 0, "quiet_drift": 0.001,
        "quiet_power": 2.0, "quiet_steps": 0.0, "torque_ratio": 0.5, "speed_ratio": 0.25, "sustained_speed_ratio": 0.2,
        "torque_peaks": (10.0,) * 6, "speed_peaks": (1.0,) * 6, "saturated_s": (0.0,) * 6,
    }  # fmt: skip
    return Outcome(**(values | changes))


def pushed(
    impulse: float, seed: int, direction: tuple = (1.0, 0.0, 0.0), full_length: bool = True, **push: object
) -> Trial:
    return Trial(Push(direction=direction, impulse=impulse, **push), seed, full_length)


class Broken(NominalAgent):
    """Answers the same numbers for the joint targets of some robots, or raises an error."""

    def __init__(self, robot: Robot, target: float = np.nan, who: int | None = None, error: Exception | None = None):
        super().__init__(robot, "straight")
        self.target, self.who, self.error = target, who, error

    def __call__(self, inputs: np.ndarray, ids: np.ndarray) -> Command:
        command = super().__call__(inputs, ids)
        sick = ids == (ids if self.who is None else self.who)
        if self.error and sick.any():
            raise self.error
        command.joint_target[sick] = self.target
        return command


class MovingPolicy(NominalAgent):
    """Moves joints by a function of the time [s] since each robot's own start; the other joints hold the pose."""

    def __init__(self, robot: Robot, motion: Motion, pose: str = "bent"):
        super().__init__(robot, pose)
        self.motion = motion
        self.steps = np.zeros(64, np.int64)

    def reset(self, ids: np.ndarray) -> None:
        self.steps[ids] = 0

    def __call__(self, inputs: np.ndarray, ids: np.ndarray) -> Command:
        command = super().__call__(inputs, ids)
        for joint, angle in self.motion(self.steps[ids] * 0.04).items():
            command.joint_target[:, self.robot.joint_names.index(joint)] += angle
        self.steps[ids] += 1
        return command


def tiny(algorithm: str, **changes) -> TrainConfig:
    """A training run of seconds: few robots, small batches."""
    config = preset("fast", algorithm)
    hyper = dict(config.hyper)
    if algorithm == "ddpg":
        hyper |= {"learning_starts": 64, "batch_size": 32, "gradient_steps": 1, "buffer_size": 5_000}
    else:
        hyper |= {"n_steps": 8, "batch_size": 64}
    return dataclasses.replace(config, hyper=hyper, num_envs=8, steps=512, minutes=5.0, **changes)


def write_wrench(pushes: Pushes, wrench: np.ndarray, tick: np.ndarray) -> None:
    """The next policy step's forces in place of the last one's."""
    wrench[:] = 0.0
    pushes.write(wrench, tick)


def squat(amplitude: float) -> Motion:
    """Knees bend up and down once a second, hips and ankles keep torso and soles level."""

    def motion(time: np.ndarray) -> dict[str, np.ndarray]:
        knee = amplitude * np.sin(2 * np.pi * time)
        shares = {"knee_pitch": 1.0, "hip_pitch": -0.45, "ankle_pitch": -0.55}
        return {f"{side}_{joint}": share * knee for side in ("left", "right") for joint, share in shares.items()}

    return motion


def lean(angle: float) -> Motion:
    """The torso leans forward within a second and stays there."""
    return lambda time: {"torso_pitch": angle * np.minimum(time, 1.0)}


class Trace:
    """What one slot did: (num_ticks, ...) per quantity; to be given to `run_trials` as `on_step`."""

    def __init__(self, *quantities: str):
        self.steps: dict[str, list[np.ndarray]] = {quantity: [] for quantity in quantities}

    def __call__(self, running: np.ndarray, ticks: StepRecord) -> None:
        for quantity, steps in self.steps.items():
            steps.append(getattr(ticks, quantity)[0].copy())

    def __getitem__(self, quantity: str) -> np.ndarray:
        return np.concatenate(self.steps[quantity])


def run_one(policy: NominalAgent, trial: Trial, *quantities: str) -> tuple[Outcome, Trace]:
    trace = Trace(*quantities)
    outcomes = run_list(policy, [trial], num_slots=1, num_threads=1, on_step=trace)
    return outcomes[trial], trace


def driven_loop(agent: Agent, num_robots: int = 1) -> ControlLoop:
    """A loop whose robots stand in the agent's nominal pose and are driven by it."""
    loop = ControlLoop(agent.robot, num_robots, np.array(agent.contract.nominal_pose), num_threads=1)
    loop.prepare(agent)
    loop.reset(np.arange(num_robots), np.tile(loop.nominal, (num_robots, 1)))
    return loop


def everyone(engine: MujocoEngine) -> np.ndarray:
    return np.arange(engine.num_robots)


def stand(robot: Robot, num_robots: int, num_threads: int = 1, pose: str = "bent", **where: object) -> MujocoEngine:
    engine = MujocoEngine(robot, num_robots, num_threads)
    engine.reset(everyone(engine), np.tile(robot.pose(pose), (num_robots, 1)), **where)
    return engine


def step_to(engine: MujocoEngine, targets: np.ndarray, ids: np.ndarray | None = None) -> StepRecord:
    """One policy step of robots `ids` (n,), all without it, under joint targets (n, TICKS_PER_STEP, num_joints)."""
    engine.joint_targets[slice(None) if ids is None else ids] = targets
    return engine.step(ids)


def hold(robot: Robot, num_robots: int, pose: str = "bent") -> np.ndarray:
    return np.tile(robot.pose(pose), (num_robots, TICKS_PER_STEP, 1))


def plain_steps(
    robot: Robot, targets: np.ndarray, push: np.ndarray
) -> tuple[mujoco.MjModel, mujoco.MjData, StepRecord]:
    """The bent robot from 1 cm above the floor in a loop of mj_step, `push` on its torso: (num_ticks, ...) of one."""
    engine = stand(robot, 1, height=0.01)
    model = engine.model
    data = mujoco.MjData(model)
    data.qpos[:] = engine.state[0][0]
    mujoco.mj_forward(model, data)
    record = np.zeros((1, len(targets), model.nsensordata))
    for tick, target in enumerate(targets):
        data.ctrl[:] = target
        data.xfrc_applied[1 + robot.body_id("torso"), :3] = push
        mujoco.mj_step(model, data)
        record[0, tick] = data.sensordata
    return model, data, StepRecord(robot, record)


def posed(robot: Robot, model: mujoco.MjModel, height: float = 5.0, **joints: float) -> mujoco.MjData:
    """The root at `height`, upright, joints at 0 but for the named ones."""
    data = mujoco.MjData(model)
    data.qpos[2] = height
    for name, angle in joints.items():
        data.qpos[7 + robot.joint_names.index(name)] = angle
    mujoco.mj_forward(model, data)
    return data


@pytest.fixture(scope="session")
def robot() -> Robot:
    return load_robot("valkyrie")


@pytest.fixture(scope="session")
def standing(robot: Robot) -> StepRecord:
    """The last policy step of a robot that has stood in its straight pose for 2 s; (1, 20) ticks, not to be changed."""
    engine = MujocoEngine(robot, 1, num_threads=1)
    pose = robot.pose("straight")[None]
    engine.reset(np.array([0]), pose)
    targets = np.tile(pose[:, None], (1, TICKS_PER_STEP, 1))
    for _ in range(50):
        ticks = step_to(engine, targets)
    return ticks.copy()


@pytest.fixture(scope="session")
def altered(robot: Robot) -> Callable[..., StepRecord]:
    """StepRecord in which the named quantities have other values: `altered(ticks, com_velocity=(0, 0, 1))`.

    A single joint's are named by it: `left_knee_pitch_torque`.
    """
    joints = {
        f"{name}_{what}": (f"joint_{what}", column)
        for column, name in enumerate(robot.joint_names)
        for what in ("position", "velocity", "torque")
    }

    def alter(ticks: StepRecord, **values: object) -> StepRecord:
        changed = ticks.copy()
        for quantity, value in values.items():
            if quantity in joints:
                block, column = joints[quantity]
                changed[block][..., column : column + 1] = value
            else:
                changed[quantity][...] = value
        return changed

    return alter


@pytest.fixture
def in_scratch_folder(tmp_path, monkeypatch) -> None:
    """MuJoCo writes MUJOCO_LOG.TXT into the working folder when a robot diverges."""
    monkeypatch.chdir(tmp_path)


NO_PUSH = DisturbanceConfig(impulse=(0.0, 0.0))


def make_env(num_envs: int, num_threads: int = 1, **config: object) -> PushRecoveryVectorEnv:
    return PushRecoveryVectorEnv(num_envs, EnvConfig(**{"robot": "valkyrie", **config}), num_threads)


class Memory(dict):
    """A store in memory that knows which scenario asked."""

    def __init__(self) -> None:
        self.scenarios: dict[Trial, str] = {}

    def put(self, trial: Trial, outcome: Outcome, scenario: str) -> None:
        self[trial] = outcome
        self.scenarios[trial] = scenario


WEIGHT = 137.287494 * 9.806651  # 1346.33 N

LEFT_SOLE, RIGHT_SOLE = (0.0, 0.14, 0.0), (0.0, -0.14, 0.0)
HEIGHT = 1.1


@pytest.fixture(scope="module")
def perfect(standing: StepRecord, altered: Callable[..., StepRecord]) -> StepRecord:
    """Standing perfectly still at the origin, weight on both feet, CoM 1.1 m over their middle."""
    upright = (0.0, 0.0, 1.0)
    return altered(
        standing,
        com_position=(0.0, 0.0, HEIGHT),
        com_velocity=0.0,
        root_up=upright,
        torso_up=upright,
        left_sole_position=LEFT_SOLE,
        right_sole_position=RIGHT_SOLE,
        left_foot_contact=contact(standing, 0.5 * WEIGHT, LEFT_SOLE),
        right_foot_contact=contact(standing, 0.5 * WEIGHT, RIGHT_SOLE),
        ground_contact=8.0,
        joint_velocity=0.0,
        joint_torque=0.0,
    )


def contact(ticks: StepRecord, force: float, point: tuple[float, float, float]) -> np.ndarray:
    """A foot's contact sensor: found, force (3), torque (3), point (3), and what follows."""
    values = np.zeros(ticks["left_foot_contact"].shape[-1])
    values[0], values[3], values[7:10] = 4.0 * (force > 0), force, point
    return values


def context(**weights: float) -> RewardContext:
    return RewardContext(HEIGHT, penalty_weights=weights)


def still(ticks: StepRecord) -> StepRecord:
    """The first tick, for a whole policy step."""
    return StepRecord.join([ticks.ticks(slice(0, 1))] * TICKS_PER_STEP)


@contextlib.contextmanager
def full_after(num_bytes: int) -> Iterator[None]:
    """No file may grow beyond some bytes, as on a disk that is full."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (num_bytes, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def random_targets(robot: Robot, num_robots: int, seed: int = 0) -> np.ndarray:
    noise = np.random.default_rng(seed).uniform(-0.3, 0.3, (num_robots, TICKS_PER_STEP, robot.num_joints))
    return np.clip(robot.pose("bent") + noise, robot.joint_lower, robot.joint_upper)
