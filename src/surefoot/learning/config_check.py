"""Config check: the check of types and ranges in a training run's configuration, before anything is built from it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from surefoot.checks import MAX_SEED, check_fields, check_number, shortened
from surefoot.errors import UserError

_SHARE = (0.0, 1.0)
_POSITIVE = (1e-9, 1e9)
_NOT_NEGATIVE = (0.0, 1e9)
_IMPULSE = (0.0, 1e5)

LIMITS: Mapping[str, tuple[float, float]] = {
    # TrainConfig
    "seed": (0, MAX_SEED),
    "minutes": (1e-6, 1e5),
    "schedule_minutes": (0.0, 1e5),
    "steps": (1, 1e12),
    "num_envs": (1, 16_384),
    "actor": (1, 4096),
    "critic": (1, 4096),
    "past_observations": (0, 250),
    "past_actions": (0, 250),
    "final_learning_rate": _SHARE,
    "log_std": (-20.0, 5.0),
    "noise": (0.0, 100.0),
    "noise_correlation": _SHARE,
    "final_noise": _SHARE,
    "average_steps": (0.0, 1e12),
    # EnvConfig
    "action_scale": (1e-6, 100.0),
    "episode_s": (0.04, 3600.0),
    "joint_noise": (0.0, 10.0),
    "drop_height": (0.0, 100.0),
    "drop_share": _SHARE,
    "drop_lean": (0.0, 10.0),
    "power_log_scale": _POSITIVE,
    "foot_travel_log_scale": _POSITIVE,
    "step_penalty_fade": _IMPULSE,
    "step_penalty_waiver_s": (0.0, 3600.0),
    "foot_shift_limit": (0.0, 100.0),
    "foot_shift_impulse": _IMPULSE,
    "joint_speed_limit": (0.0, 1000.0),
    "noise_share": _SHARE,
    "observation_noise": (0.0, 1000.0),
    "action_noise": (0.0, 1000.0),
    # DisturbanceConfig
    "impulse": _IMPULSE,
    "body_scale": (0.0, 1000.0),
    "sagittal": (0.0, 0.5),
    "first": (0.0, 3600.0),
    "interval": (0.0, 3600.0),
    "duration": (0.002, 60.0),
    "survival_target": _SHARE,
    "max_impulse": _IMPULSE,
    "hard_share": _SHARE,
    "lift": _IMPULSE,
    "lift_share": _SHARE,
    "lift_gap": (0.0, 60.0),
    "small": _IMPULSE,
    "small_share": _SHARE,
    "focus": _SHARE,
}
"""Field -> the smallest and the largest valid number; of a list, those of each of its numbers."""

_RANGES = ("drop_height", "step_penalty_fade", "impulse", "first", "interval", "lift", "small", "noise")
"""Fields that are a range: the first number is not larger than the second one."""
_SCHEDULES = ("power_weight", "foot_travel_weight", "sway_weight", "posture_weight", "speed_end_probability")
"""Fields that are knots of a schedule."""
_NOT_EMPTY = ("actor", "bodies")

HYPER_LIMITS: Mapping[str, tuple[float, float]] = {
    "learning_rate": (1e-12, 10.0),
    "gamma": _SHARE,
    "gae_lambda": _SHARE,
    "tau": _SHARE,
    "target_kl": _POSITIVE,
    "cg_damping": _NOT_NEGATIVE,
    "ent_coef": _NOT_NEGATIVE,
    "clip_range": _POSITIVE,
    "smoothness": _NOT_NEGATIVE,
    "gradient_steps": (-1, 10**5),
    "batch_size": (1, 10**7),
    "buffer_size": (1, 10**8),
    "n_steps": (1, 10**6),
    "n_epochs": (1, 10**4),
    "train_freq": (1, 10**6),
    "learning_starts": (0, 10**12),
    "cg_max_steps": (1, 10**4),
    "n_critic_updates": (1, 10**5),
}
"""The same for arguments of the algorithms; the last ones are whole numbers."""
_WHOLE = tuple(HYPER_LIMITS)[-9:]


def check_config(kind: type, values: Mapping[str, Any], where: str) -> None:
    """Check what is told of a configuration: types, ranges, and what must not be empty or must rise.

    Args:
        kind: the dataclass of the configuration.
        values: by the names of its fields; a missing one is not looked at.
        where: they stand, for the message.

    Raises:
        UserError: a value has another type or is out of its range; the message names it.
    """
    check_fields(kind, values, where)
    for name, value in values.items():
        if name in LIMITS:
            for number in _numbers(value):
                check_number(f"{where}: {name}", number, *LIMITS[name])
        if name in _NOT_EMPTY and not value:
            raise UserError(f"{where}: {name} must not be empty")
        if name in _RANGES and value is not None and value[0] > value[1]:
            raise UserError(f"{where}: {name} must be a range from low to high, not {shortened(value)}")
        if name in _SCHEDULES and value is not None:
            _check_schedule(value, f"{where}: {name}")
    scales, bodies = values.get("body_scale"), values.get("bodies", ("root",))
    if scales is not None and len(scales) != len(bodies):
        raise UserError(f"{where}: body_scale must have {len(bodies)} numbers, one for each of bodies")


def check_hyper(values: Mapping[str, Any], where: str) -> None:
    """Check the arguments of an algorithm of stable-baselines3; whoever makes it names those that it does not have.

    Raises:
        UserError: the learning rate is missing, a value is neither a number, a text nor nothing, or it is out of its
            range.
    """
    if "learning_rate" not in values:
        raise UserError(f"{where}: learning_rate is needed")
    for name, value in values.items():
        if name in HYPER_LIMITS and not (name == "target_kl" and value is None):
            check_number(f"{where}: {name}", value, *HYPER_LIMITS[name], whole=name in _WHOLE)
        elif isinstance(value, list | tuple | Mapping):
            raise UserError(f"{where}: {shortened(name)} must be a number or a text, not {shortened(value)}")


def _check_schedule(knots: Any, where: str) -> None:
    """Check that a schedule has knots whose shares of the training rise from 0 to 1."""
    shares = [share for share, _ in knots]
    for _, value in knots:
        check_number(f"a value of {where}", value, -_POSITIVE[1], _POSITIVE[1])
    if not knots or shares != sorted(shares) or shares[0] < 0.0 or shares[-1] > 1.0:
        raise UserError(f"{where} must be pairs (share of the training, value) in the order of the shares, 0 to 1")


def _numbers(value: Any) -> Iterator[float]:
    """The number or the numbers of a value."""
    if isinstance(value, list | tuple):
        yield from value
    elif value is not None:
        yield value
