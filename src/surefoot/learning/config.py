"""TrainConfig: the configuration of a training run, and its JSON in a run folder."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NoReturn

from surefoot.checks import check_number, parse_json_table, shortened
from surefoot.errors import UserError
from surefoot.learning.config_check import check_config, check_hyper
from surefoot.physics.engines import DEFAULT_ENGINE, engine_kind
from surefoot.task.environment import EnvConfig, as_tuples
from surefoot.task.random_pushes import DisturbanceConfig
from surefoot.task.reward import Term

HALF_LIFE_GAMMA = 0.95
"""Section III-B of the paper: the weight of a reward halves in 0.5 s, the time in which a balance is lost or won. At
25 Hz that is 13 policy steps, and gamma^13 = 0.5 gives gamma = 0.948, rounded to 0.95."""

PAPER_LAYERS = (100, 50, 25)
"""Hidden layers of the paper's actor and critic."""

DAGGER = "dagger"
"""The algorithm of runs in which a student learns from other policies, see `Distiller`."""

LEARNERS = ("trpo", "ppo", "ddpg", DAGGER)
"""All algorithms that a run may have."""

OLD_KEYS = {"foresight": "privileged_critic"}
OLD_ENV_KEYS = {
    "power_knee": "power_log_scale",
    "travel_weight": "foot_travel_weight",
    "travel_knee": "foot_travel_log_scale",
    "travel_free": "step_penalty_fade",
    "travel_free_s": "step_penalty_waiver_s",
}
OLD_DISTURBANCE_KEYS = {"curriculum": "survival_target"}
"""Keys of run folders of version 0.1 -> today's; to be dropped with version 0.3."""


@dataclass(frozen=True)
class TakeoverConfig:
    """A policy that drives the robots while they are beyond a border (see `TakeoverVectorEnv`). The default is none.

    Attributes:
        policy: name of a shipped policy, or a file.
        beyond, capture_point: the border, see `Teacher`.
    """

    policy: str = ""
    beyond: dict[str, tuple[float, ...]] = field(default_factory=dict)
    capture_point: tuple[float, ...] = ()


@dataclass(frozen=True)
class TrainConfig:
    """One training run.

    Attributes:
        algorithm: "trpo", "ppo" or "ddpg"; or "dagger" for a student that learns from other policies.
        env: the task.
        preset: name of the preset from which this configuration was made.
        seed: seed of all random numbers.
        minutes: time budget, including validation. It is converted into policy steps at the start of the run, see
            `Budget`.
        schedule_minutes: least duration of all schedules. A shorter run is the beginning of a longer one.
        steps: budget in policy steps. With it, the speed is not measured, and `minutes` only sets the share of
            `schedule_minutes` that the run covers.
        num_envs: number of robots in the batch.
        actor: sizes of the policy's hidden layers.
        critic: sizes of the critic's hidden layers.
        past_observations: number of past observations, one per policy step, that the actor is given, see `Memory`.
        past_actions: number of its own past actions that the actor is given.
        hyper: keyword arguments of the algorithm in stable-baselines3, or those of `DistillConfig`.
        final_learning_rate: share of the learning rate that is left at the end. The rate falls linearly.
        log_std: initial logarithm of the Gaussian policy's standard deviation (TRPO, PPO).
        noise: standard deviation of the exploration noise, smallest and largest over the robots (DDPG).
        noise_correlation: correlation of the exploration noise from one policy step to the next (DDPG).
        final_noise: share of the exploration that is left at the end. It falls linearly. For TRPO and PPO it is the
            largest deviation.
        average_steps: number of policy steps over which the actor's weights are averaged. The averaged policy is
            validated and kept, while learning continues with the newest weights. 0 means the newest weights.
        mirror: use the robot's symmetry, by symmetric networks (TRPO, PPO) or mirrored replays (DDPG).
        privileged_critic: give the privileged observation to the critic, but not to the actor; see
            `surefoot.task.privileged`.
        begin_with: the policy (a shipped one's name or a file) or run folder with which a run begins by default.
        takeover: the policy that drives robots beyond a border in place of the learning policy (TRPO, PPO).
    """

    algorithm: str
    env: EnvConfig
    preset: str = ""
    seed: int = 0
    minutes: float = 15.0
    schedule_minutes: float = 0.0
    steps: int | None = None
    num_envs: int = 256
    actor: tuple[int, ...] = PAPER_LAYERS
    critic: tuple[int, ...] = PAPER_LAYERS
    past_observations: int = 0
    past_actions: int = 0
    hyper: dict[str, Any] = field(default_factory=dict)
    final_learning_rate: float = 1.0
    log_std: float = 0.0
    noise: tuple[float, float] = (0.1, 0.1)
    noise_correlation: float = 0.0
    final_noise: float = 1.0
    average_steps: float = 0.0
    mirror: bool = False
    privileged_critic: bool = False
    begin_with: str = ""
    takeover: TakeoverConfig = field(default_factory=TakeoverConfig)

    @classmethod
    def from_values(cls, values: Mapping[str, Any]) -> TrainConfig:
        """Return the configuration of a table of values, such as a preset's.

        Raises:
            TypeError, KeyError: the table has an unknown key, or lacks one.
            UserError: a value has another type or is out of its range, or the algorithm or the engine is unknown.
        """
        check_config(cls, values, "the run")
        check_config(EnvConfig, values["env"], "env")
        check_config(DisturbanceConfig, values["env"].get("disturbance", {}), "env.disturbance")
        takeover = values.get("takeover", {})
        check_config(TakeoverConfig, takeover, "takeover")
        if values["algorithm"] not in LEARNERS:
            raise UserError(f"unknown algorithm '{shortened(values['algorithm'])}'; valid: {', '.join(LEARNERS)}")
        engine_kind(values["env"].get("engine", DEFAULT_ENGINE))
        tables = {"env": EnvConfig.from_values(values["env"]), "takeover": TakeoverConfig(**as_tuples(takeover))}
        config = cls(**as_tuples(dict(values) | dict.fromkeys(tables)) | tables)
        if config.algorithm != DAGGER:
            check_hyper(config.hyper, "hyper")
        if config.takeover.policy and config.algorithm not in ("trpo", "ppo"):
            raise UserError(f"takeover: another policy takes over for trpo and ppo only, not for {config.algorithm}")
        return config

    def to_json(self) -> str:
        """Return the configuration as JSON; of extra reward terms it tells the functions' names only."""
        plain = dataclasses.replace(self, env=dataclasses.replace(self.env, extra_terms={}))
        values = dataclasses.asdict(plain)
        values["env"]["extra_terms"] = {
            name: {"function": term.function.__qualname__, "weight": term.weight, "alpha": term.alpha}
            for name, term in self.env.extra_terms.items()
        }
        return json.dumps(values, indent=2)

    @classmethod
    def from_json(cls, text: str) -> TrainConfig:
        """Return the configuration of a run folder, of this version or of version 0.1.

        Extra reward terms come back without their functions: a run that has some is resumed from Python, where they
        can be given again.

        Raises:
            ValueError, TypeError, KeyError, AttributeError: the text is not what `to_json` writes.
        """
        values = _renamed(parse_json_table(text, "a configuration"), OLD_KEYS, "the run")
        env = _renamed(values["env"], OLD_ENV_KEYS, "env")
        env["disturbance"] = _renamed(env["disturbance"], OLD_DISTURBANCE_KEYS, "env.disturbance")
        env["extra_terms"] = {name: _stored_term(name, term) for name, term in env.get("extra_terms", {}).items()}
        return cls.from_values({**values, "env": env})


def with_budget(config: TrainConfig, minutes: float | None, steps: int | None, seed: int) -> TrainConfig:
    """Return the configuration with another budget, where one is given, and another seed."""
    return dataclasses.replace(config, minutes=minutes or config.minutes, steps=steps or config.steps, seed=seed)


def _renamed(values: Any, names: Mapping[str, str], where: str) -> dict[str, Any]:
    """Return the values of a table under their new names."""
    if not isinstance(values, Mapping):
        raise UserError(f"{where} must be a table, not {shortened(values)}")
    return {names.get(key, key): value for key, value in values.items()}


def _stored_term(name: str, told: Mapping[str, Any]) -> Term:
    """Return an extra reward term as a file holds it: without its function."""
    for key in ("weight", "alpha"):
        if told[key] is not None:
            check_number(f"the {key} of the reward term '{shortened(name)}'", told[key])
    return Term(_not_stored(name), told["weight"], told["alpha"])


def _not_stored(name: str) -> Callable[..., NoReturn]:
    """Return the function of an extra reward term that a file cannot hold."""

    def function(*_: object) -> NoReturn:
        raise UserError(f"the reward term '{name}' was given from Python; resume this run from Python, with the term")

    return function
