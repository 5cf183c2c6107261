"""Settings: every field of a training's configuration as an option, such as ``--env.power-weight 0 1e-3 1 5e-3``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import tyro

from surefoot.errors import UserError

if TYPE_CHECKING:
    from surefoot.learning.config import TrainConfig

_ABOUT = (
    "Settings of a training run. Each can be given after the other options of `surefoot train`. A schedule is a list"
    " of pairs: share of the training done, value."
)


def with_settings(config: TrainConfig, words: Sequence[str]) -> TrainConfig:
    """Return a configuration with the fields that a command line sets.

    Args:
        config: that of the preset.
        words: of the command line: ``--env.disturbance.impulse 40 200 --hyper.gamma 0.98``.

    Raises:
        UserError: the configuration has no such field.
    """
    if not words:
        return config
    found, unknown = tyro.cli(
        type(config), default=config, args=list(words), prog="surefoot train", return_unknown_args=True
    )
    if unknown:
        raise UserError(unknown_option(unknown[0], setting_names(config)))
    return found


def print_settings(config: TrainConfig) -> None:
    """Print every field with its meaning and its value in this preset."""
    parser = tyro.extras.get_parser(type(config), default=config, prog="surefoot train", description=_ABOUT)
    print(parser.format_help())  # type: ignore[no-untyped-call] # tyro's


def setting_names(config: TrainConfig) -> list[str]:
    """Return the options that set the fields of a configuration."""
    names = []

    def add(prefix: str, value: object) -> None:
        fields = value.items() if isinstance(value, dict) else vars(value).items()
        for name, each in fields:
            option = f"{prefix}{name.replace('_', '-')}"
            if hasattr(each, "__dataclass_fields__") or (isinstance(each, dict) and each):
                add(f"{option}.", each)
            else:
                names.append(option)

    add("--", config)
    return names


def unknown_option(option: str, valid: Sequence[str]) -> str:
    """Return the message on an option that there is not."""
    import difflib

    close = difflib.get_close_matches(option, valid, n=1)
    if not option.startswith("-"):
        return f"unexpected argument '{option}'"
    return f"unknown option '{option}'" + (
        f"; did you mean '{close[0]}'?" if close else "; --help lists the valid ones"
    )
