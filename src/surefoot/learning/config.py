"""What a training run is told: named presets, from `paper` to `complete`, for each algorithm."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass, field
from typing import Any

from surefoot.errors import UserError
from surefoot.task.environment import EnvConfig
from surefoot.task.random_pushes import DisturbanceConfig

HALF_LIFE_GAMMA = 0.95
"""Section III-B of the paper: a reward is to count half after 0.5 s, the time in which a balance is lost or won. At
25 Hz that is 13 policy steps, and gamma^13 = 0.5 gives gamma = 0.948, rounded to 0.95."""

LAYERS = (100, 50, 25)
"""Hidden layers of the paper's actor and critic."""


@dataclass(frozen=True)
class TrainConfig:
    """One training run.

    Attributes:
        algorithm: "trpo", "ppo" or "ddpg".
        preset: name of the preset that this began as.
        seed: of everything random.
        minutes: wall-clock budget, evaluation included.
        schedule_minutes: all that changes in the course of a run takes at least so long: a shorter run is the
            beginning of a longer one.
        steps: budget in policy steps; the run ends with the first budget that is used up.
        num_envs: robots in the batch.
        actor, critic: hidden layers.
        hyper: keyword arguments of the algorithm in stable-baselines3.
        final_learning_rate: share of the learning rate left at the end; it falls linearly.
        log_std: initial logarithm of the Gaussian policy's standard deviation (TRPO, PPO).
        noise: standard deviation of the calmest and the boldest robot's exploration (DDPG).
        noise_correlation: of the exploration from one policy step to the next (DDPG).
        final_noise: share of the exploration left at the end; it falls linearly (TRPO, PPO: the largest deviation).
        average_steps: policy steps over which the actor's weights are averaged to give the policy that is probed and
            kept; 0 for the newest weights. Learning goes on from the newest ones.
        mirror: make use of the robot's symmetry: symmetric networks (TRPO, PPO) or mirrored replays (DDPG).
        foresight: the critic, and it alone, knows the next push, and what is charged; see `surefoot.foresight`.
        env: the task.
    """

    algorithm: str = "trpo"
    preset: str = "fast"
    seed: int = 0
    minutes: float = 15.0
    schedule_minutes: float = 0.0
    steps: int | None = None
    num_envs: int = 256
    actor: tuple[int, ...] = LAYERS
    critic: tuple[int, ...] = LAYERS
    hyper: dict[str, Any] = field(default_factory=dict)
    final_learning_rate: float = 1.0
    log_std: float = 0.0
    noise: tuple[float, float] = (0.1, 0.1)
    noise_correlation: float = 0.0
    final_noise: float = 1.0
    average_steps: float = 0.0
    mirror: bool = False
    foresight: bool = False
    env: EnvConfig = field(default_factory=EnvConfig)

    def to_json(self) -> str:
        return json.dumps(dataclasses.asdict(self), indent=2)

    @classmethod
    def from_json(cls, text: str) -> TrainConfig:
        """Raises ValueError, TypeError or KeyError for anything that `to_json` does not write."""
        values = _tuples(json.loads(text))
        env = values.pop("env")
        disturbance = DisturbanceConfig(**env.pop("disturbance"))
        return cls(**values, env=EnvConfig(**env, disturbance=disturbance))


# Supplementary material of the paper; 256 robots x 16 steps are its 4096 time steps per batch.
_PAPER_ON_POLICY = {
    "n_steps": 16,
    "batch_size": 256,
    "learning_rate": 3e-4,
    "gamma": HALF_LIFE_GAMMA,
    "gae_lambda": 0.95,
}
_PAPER = {
    "trpo": TrainConfig(
        algorithm="trpo",
        preset="paper",
        hyper={
            **_PAPER_ON_POLICY,
            "target_kl": 0.01,
            "cg_max_steps": 10,
            "cg_damping": 0.1,
            "n_critic_updates": 10,
        },
    ),
    "ppo": TrainConfig(
        algorithm="ppo",
        preset="paper",
        hyper={**_PAPER_ON_POLICY, "n_epochs": 10, "clip_range": 0.2, "ent_coef": 0.0},
    ),
    # The paper gives no hyperparameters for DDPG: those of Lillicrap et al. 2016, where SB3 has them.
    "ddpg": TrainConfig(
        algorithm="ddpg",
        preset="paper",
        num_envs=128,
        hyper={
            "learning_rate": 1e-3,
            "batch_size": 256,
            "buffer_size": 1_000_000,
            "learning_starts": 10_000,
            "tau": 0.001,
            "gamma": HALF_LIFE_GAMMA,
            "train_freq": 1,
            "gradient_steps": 8,
        },
    ),
}

# What differs from the paper, and why, is in docs/training.md.
_FAST_ENV = EnvConfig(
    pose="bent",
    action_scale=0.6,
    power_weight=((0.0, 1e-3), (0.35, 1e-3), (0.7, 6e-3), (1.0, 8e-3)),
    power_knee=50.0,
    disturbance=DisturbanceConfig(impulse=(30.0, 300.0), first=(0.4, 3.4), interval=(2.4, 6.0)),
)
_FAST_ON_POLICY_ENV = dataclasses.replace(
    _FAST_ENV,
    disturbance=DisturbanceConfig(impulse=(40.0, 240.0), first=(0.2, 2.4), interval=(2.4, 4.4), curriculum=0.6),
)
_FAST_ON_POLICY = {"n_steps": 32, "gamma": 0.97, "gae_lambda": 0.95}
_FAST = {
    "trpo": TrainConfig(
        algorithm="trpo",
        critic=(256, 256),
        hyper={
            **_FAST_ON_POLICY,
            "batch_size": 1024,
            "learning_rate": 1e-3,
            "target_kl": 0.02,
            "cg_max_steps": 6,
            "n_critic_updates": 4,
        },
        log_std=-0.8,
        average_steps=100_000.0,
        mirror=True,
        foresight=True,
        env=_FAST_ON_POLICY_ENV,
    ),
    "ppo": TrainConfig(
        algorithm="ppo",
        critic=(256, 256),
        hyper={**_FAST_ON_POLICY, "batch_size": 2048, "n_epochs": 8, "learning_rate": 5e-4, "ent_coef": 0.0},
        log_std=-0.8,
        average_steps=100_000.0,
        mirror=True,
        foresight=True,
        env=_FAST_ON_POLICY_ENV,
    ),
    "ddpg": TrainConfig(
        algorithm="ddpg",
        minutes=14.0,
        schedule_minutes=14.0,
        num_envs=128,
        critic=(256, 256),
        hyper={
            "learning_rate": 1e-3,
            "batch_size": 256,
            "buffer_size": 600_000,
            "learning_starts": 6_000,
            "tau": 0.005,
            "gamma": 0.97,
            "n_steps": 3,
            "train_freq": 1,
            "gradient_steps": 8,
        },
        final_learning_rate=0.1,
        noise=(0.02, 0.25),
        noise_correlation=0.85,
        final_noise=0.4,
        average_steps=40_000.0,
        mirror=True,
        foresight=True,
        env=_FAST_ENV,
    ),
}
# For half an hour: larger pushes, on every body, and drops.
_WIDE_ENV = dataclasses.replace(
    _FAST_ENV,
    action_scale=0.8,
    drop_height=(0.1, 1.6),
    drop_share=0.1,
    disturbance=dataclasses.replace(
        _FAST_ENV.disturbance,
        bodies=("root",) * 4 + ("torso", "left_thigh", "right_thigh", "left_shank", "right_shank"),
        impulse=(30.0, 420.0),
        first=(0.2, 3.4),
    ),
)
_WIDE = {
    name: dataclasses.replace(config, preset="wide", minutes=34.0, schedule_minutes=34.0, env=_WIDE_ENV)
    for name, config in _FAST.items()
}
# After `wide`: time to stand, and moving costs more.
_STEADY_ENV = dataclasses.replace(
    _WIDE_ENV,
    power_weight=((0.0, 1.2e-2),),
    disturbance=dataclasses.replace(_WIDE_ENV.disturbance, interval=(2.4, 9.0)),
)
# After `fast`: also larger pushes, and more where it falls.
_STEADY_ON_POLICY_ENV = dataclasses.replace(
    _FAST_ON_POLICY_ENV,
    travel_free=(60.0, 120.0),
    travel_free_s=6.0,
    disturbance=dataclasses.replace(
        _FAST_ON_POLICY_ENV.disturbance, impulse=(40.0, 400.0), interval=(2.4, 6.0), focus=0.4
    ),
)
_STEADY = {
    "trpo": dataclasses.replace(
        _FAST["trpo"],
        preset="steady",
        minutes=60.0,
        schedule_minutes=60.0,
        hyper={**_FAST["trpo"].hyper, "learning_rate": 5e-4},
        log_std=-1.5,
        final_noise=0.4,
        average_steps=700_000.0,
        env=dataclasses.replace(
            _STEADY_ON_POLICY_ENV,
            power_weight=((0.0, 8e-3), (0.3, 1.2e-2)),
            posture_weight=((0.0, 0.0), (0.2, 2.0)),
        ),
    ),
    "ppo": dataclasses.replace(
        _FAST["ppo"],
        preset="steady",
        minutes=60.0,
        schedule_minutes=60.0,
        hyper={**_FAST["ppo"].hyper, "learning_rate": 4e-4},
        final_learning_rate=0.25,
        log_std=-1.4,
        final_noise=0.45,
        average_steps=500_000.0,
        env=dataclasses.replace(
            _STEADY_ON_POLICY_ENV,
            power_weight=((0.0, 2e-3), (0.6, 1e-2)),
            posture_weight=((0.0, 0.0), (0.2, 0.0), (0.6, 2.0)),
        ),
    ),
    "ddpg": dataclasses.replace(
        _WIDE["ddpg"],
        preset="steady",
        minutes=9.0,
        schedule_minutes=9.0,
        env=_STEADY_ENV,
        hyper={**_WIDE["ddpg"].hyper, "learning_rate": 2.8e-4, "smoothness": 0.05},
        final_learning_rate=0.36,
        noise=(0.009, 0.11),
        final_noise=0.7,
        average_steps=200_000.0,
    ),
}
# After `steady`: everything else that a robot may meet, and no motion where none is needed.
_COMPLETE_ENV = dataclasses.replace(
    _STEADY_ENV,
    drop_share=0.15,
    drop_lean=0.45,
    travel_weight=((0.0, 3.0),),
    sway_weight=((0.0, 2.0),),
    posture_weight=((0.0, 4.0),),
    travel_free=(60.0, 120.0),
    travel_free_s=6.0,
    noise_share=0.1,
    action_noise=0.1,
    disturbance=dataclasses.replace(
        _STEADY_ENV.disturbance,
        bodies=("root",) * 4 + ("torso",) * 3 + ("left_thigh", "right_thigh") * 2 + ("left_shank", "right_shank"),
        impulse=(30.0, 450.0),
        small=(6.0, 100.0),
        small_share=0.25,
        focus=0.5,
        lift=(200.0, 600.0),
        lift_share=0.15,
    ),
)
_COMPLETE = {
    "ddpg": dataclasses.replace(
        _STEADY["ddpg"],
        preset="complete",
        minutes=64.0,
        schedule_minutes=64.0,
        env=_COMPLETE_ENV,
        hyper={
            **_STEADY["ddpg"].hyper,
            "batch_size": 384,
            "buffer_size": 1_000_000,
            "learning_starts": 10_000,
            "learning_rate": 3e-4,
        },
        final_learning_rate=0.2,
        noise=(0.01, 0.15),
        final_noise=0.6,
        average_steps=800_000.0,
    ),
    # Pushes at the root alone: drops and other bodies cost PPO recoveries.
    "ppo": dataclasses.replace(
        _STEADY["ppo"],
        preset="complete",
        minutes=75.0,
        schedule_minutes=75.0,
        hyper={**_STEADY["ppo"].hyper, "learning_rate": 3e-4},
        final_learning_rate=0.4,
        log_std=-1.75,
        final_noise=0.75,
        env=dataclasses.replace(
            _STEADY["ppo"].env,
            power_weight=((0.0, 1e-2),),
            posture_weight=((0.0, 2.0),),
            disturbance=dataclasses.replace(_STEADY["ppo"].env.disturbance, impulse=(40.0, 440.0), focus=0.5),
        ),
    ),
}
PRESETS = {"paper": _PAPER, "fast": _FAST, "wide": _WIDE, "steady": _STEADY, "complete": _COMPLETE}


def preset(name: str, algorithm: str) -> TrainConfig:
    """The named preset for an algorithm.

    Raises:
        UserError: there is no such preset or algorithm.
    """
    if name not in PRESETS:
        raise UserError(f"unknown preset '{name}'; valid: {', '.join(PRESETS)}")
    if algorithm not in PRESETS[name]:
        raise UserError(f"unknown algorithm '{algorithm}'; valid: {', '.join(PRESETS[name])}")
    return PRESETS[name][algorithm]


def _tuples(value: Any) -> Any:
    """JSON's lists as tuples, all the way down."""
    if isinstance(value, list):
        return tuple(_tuples(item) for item in value)
    if isinstance(value, dict):
        return {key: _tuples(item) for key, item in value.items()}
    return value
