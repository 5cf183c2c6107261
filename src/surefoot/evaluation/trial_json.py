"""Trials and scenarios as JSON text: defaults are left out, so that equal ones always have equal texts."""

from __future__ import annotations

import dataclasses
import json
from typing import Any

from surefoot.checks import check_fields, check_number, parse_json_table, shortened
from surefoot.errors import UserError
from surefoot.evaluation.scenarios import Scenario
from surefoot.evaluation.trials import Trial
from surefoot.physics.pushes import Drop, Push
from surefoot.rates import CONTROL_HZ
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
MAX_HORIZON_S, MAX_PHYSICS_HZ = 3600.0, 100 * CONTROL_HZ
"""Of a trial that is read: what it takes to run it again."""


def trial_to_json(trial: Trial) -> str:
    """A trial as JSON, by which it is found again in a results table."""
    return json.dumps(_unusual(trial), sort_keys=True)


def trial_from_json(text: str) -> Trial:
    """The inverse of `trial_to_json`.

    Raises:
        UserError, TypeError: the text is not that of a trial, or a number of it is out of range.
    """
    values = parse_json_table(text, "a trial")
    values = {_OLD_NAMES.get(name, name): value for name, value in values.items()}
    for name, kind in _PARTS.items():
        if name in values:
            part = values[name]
            if not isinstance(part, dict):
                raise UserError(f"a trial's {name} must be a table, not {shortened(part)}")
            check_fields(kind, part, f"a trial's {name}")
            values[name] = kind(**{key: tuple(v) if isinstance(v, list) else v for key, v in part.items()})
    check_fields(Trial, values, "a trial")
    trial = Trial(**values)
    check_number("a trial's horizon", trial.horizon, 0.0, MAX_HORIZON_S, above=True)
    check_number("a trial's seed", trial.seed, 0, 2**63 - 1)
    check_number("a trial's physics_hz", trial.domain.physics_hz, CONTROL_HZ, MAX_PHYSICS_HZ)
    return trial


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
