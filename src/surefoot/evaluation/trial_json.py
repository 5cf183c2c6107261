"""Trials and scenarios as JSON text: what is as usual is left out, so that the same one always has the same text."""

from __future__ import annotations

import dataclasses
import json
from typing import Any

from surefoot.evaluation.scenarios import Scenario
from surefoot.evaluation.trials import Trial
from surefoot.physics.pushes import Drop, Push
from surefoot.robots.domain import DomainParameters
from surefoot.task.imperfections import Imperfections

_PARTS: dict[str, Any] = {
    "push": Push,
    "preceding": Push,
    "drop": Drop,
    "imperfections": Imperfections,
    "domain": DomainParameters,
}
_OLD_NAMES = {"world": "domain", "whole": "full_length", "first": "preceding", "calm_from": "quiet_from"}
"""Names of fields until version 0.1, and what they are called now."""
_NO_DEFAULT = object()


def trial_to_json(trial: Trial) -> str:
    """A trial as JSON, by which it is found again in a results table."""
    return json.dumps(_unusual(trial), sort_keys=True)


def trial_from_json(text: str) -> Trial:
    """The inverse of `trial_to_json`."""
    values = json.loads(text)
    values = {_OLD_NAMES.get(name, name): value for name, value in values.items()}
    for name, kind in _PARTS.items():
        if name in values:
            part = values[name]
            values[name] = kind(**{key: tuple(v) if isinstance(v, list) else v for key, v in part.items()})
    return Trial(**values)


def scenario_to_json(scenario: Scenario) -> str:
    """A scenario as JSON; `scenarios.from_json` reads it."""
    return json.dumps(_unusual(scenario), sort_keys=True)


def _unusual(value: Any) -> dict[str, Any]:
    """The fields of a dataclass that differ from their defaults, all the way down."""
    found = {}
    for field in dataclasses.fields(value):
        content = getattr(value, field.name)
        if content != (_NO_DEFAULT if field.default is dataclasses.MISSING else field.default):
            found[field.name] = _unusual(content) if dataclasses.is_dataclass(content) else content
    return found
