"""Metadata: what mjlab, Isaac Lab's exporters and unitree_rl_lab write about a policy, read into an `Interface`.

mjlab and whole_body_tracking (Isaac Lab) write it into the ONNX file: lists as numbers or names with commas between
them. unitree_rl_lab writes a `deploy.yaml` beside it.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from surefoot.agents.foreign.interface import Interface, Term
from surefoot.agents.foreign.network import Network
from surefoot.checks import check_number, read_text, shortened
from surefoot.errors import UserError
from surefoot.robots import Robot

NEEDED = ("joint_names", "joint_stiffness", "joint_damping", "default_joint_pos", "action_scale", "observation_names")
"""Keys of the metadata without which a policy cannot be driven."""
_NO_VELOCITY_COMMANDS = "motion"
"""The command of policies that follow a recorded motion, which nobody here can give them."""
_USUAL_RATE_HZ = 50
"""The rate of all these projects' locomotion tasks; their metadata does not name it."""
_DEPLOY = "deploy.yaml"
_MAX_HISTORY = 1000
"""Control steps of the past: 20 s at the usual rate."""


def read_interface(network: Network, robot: Robot) -> Interface:
    """Read what is known of a network: its metadata, or the `deploy.yaml` that belongs to it.

    Args:
        network: the ONNX file.
        robot: the robot that it is to drive; a `deploy.yaml` counts joints in this robot's order.

    Raises:
        UserError: a key is missing or wrong; the message names file and key.
    """
    deploy = _deploy_file(network.file)
    if any(key in network.metadata for key in NEEDED):
        return _whole(lambda: _from_metadata(network.metadata, str(network.file)), str(network.file))
    if deploy:
        return _whole(lambda: _from_deploy(_read_yaml(deploy), str(deploy), robot), str(deploy))
    raise UserError(
        f"{network.file}: no policy of surefoot's, and it does not say how it is driven: its metadata has none of "
        f"{', '.join(NEEDED)}, and there is no {_DEPLOY} beside it (surefoot docs foreign-policies)"
    )


def _whole(read: Callable[[], Interface], source: str) -> Interface:
    """Return what is read, with one line for whatever stands in the place of a table, a list or a number."""
    try:
        return read()
    except UserError:
        raise
    except (TypeError, ValueError, AttributeError, KeyError, IndexError, OverflowError, RecursionError) as error:
        raise UserError(f"{source} does not say how the policy is driven: {type(error).__name__}: {error}") from error


def _from_metadata(values: Mapping[str, str], source: str) -> Interface:
    missing = [key for key in NEEDED if key not in values]
    if missing:
        raise UserError(f"{source}: the metadata's key '{missing[0]}' is needed; it has {', '.join(values)}")
    names = _names(values["observation_names"])
    commands = _names(values.get("command_names", ""))
    if "command" in names and _NO_VELOCITY_COMMANDS in commands:
        raise UserError(f"{source}: command_names: the policy follows a recorded motion; surefoot has none to give it")
    joints = _names(values["joint_names"])
    return Interface(
        source=source,
        joints=tuple(joints),
        stiffness=_numbers(values, "joint_stiffness", source),
        damping=_numbers(values, "joint_damping", source),
        default_pose=_numbers(values, "default_joint_pos", source),
        action_scale=_numbers(values, "action_scale", source),
        terms=_terms(names, values, source),
        rate_hz=_rate(values["step_dt"], source) if "step_dt" in values else _USUAL_RATE_HZ,
    )


def _terms(names: Sequence[str], values: Mapping[str, str], source: str) -> tuple[Term, ...]:
    """The observations, with the scales, clips and histories that newer versions of mjlab write."""
    columns = {}
    if "observation_history_lengths" in values:  # the key of whole_body_tracking
        values = {"observation_terms_history_length": values["observation_history_lengths"], **values}
    for key in ("scale", "clip", "history_length", "flatten_history_dim"):
        full = f"observation_terms_{key}"
        parts = values[full].split(",") if full in values else [""] * len(names)
        if len(parts) != len(names):
            raise UserError(f"{source}: {full} must be {len(names)} values, one for each observation, not {len(parts)}")
        columns[key] = parts
    terms = []
    for place, name in enumerate(names):
        scale, clip, history, flat = (columns[key][place] for key in columns)
        length = _history(history or 0, f"{source}: observation_terms_history_length")
        if length > 1 and flat == "False":
            raise UserError(f"{source}: observation_terms_flatten_history_dim: {name} is a matrix; vectors are known")
        scales = tuple(_number(part, f"{source}: observation_terms_scale") for part in (scale or "1").split(";"))
        limits = [_number(part, f"{source}: observation_terms_clip") for part in (clip or "-inf;inf").split(";")]
        if len(limits) != 2:
            raise UserError(f"{source}: observation_terms_clip: {name} must have two limits, not {len(limits)}")
        terms.append(Term(name, scales, (limits[0], limits[1]), max(length, 1)))
    return tuple(terms)


def _deploy_file(network: Path) -> Path | None:
    """The file in `../params`, as unitree_rl_lab puts it, or beside the network."""
    places = (network.parent.parent / "params" / _DEPLOY, network.parent / _DEPLOY)
    return next((place for place in places if place.is_file()), None)


def _read_yaml(file: Path) -> dict[str, Any]:
    try:
        import yaml
    except ImportError as error:
        raise UserError(f"reading {file} needs PyYAML: pip install 'surefoot[foreign]'") from error

    class Loader(yaml.SafeLoader):  # type: ignore[misc]
        """Builds numbers, texts, lists and tables only; Python objects, which the exporter leaves behind, are None."""

    Loader.add_multi_constructor("tag:yaml.org,2002:python/", lambda loader, suffix, node: None)
    try:
        values = yaml.load(read_text(file, "description of a policy"), Loader)
    except UserError:
        raise
    except (ValueError, RecursionError, yaml.YAMLError) as error:
        raise UserError(f"cannot read {file}: {' '.join(str(error).split())}") from error
    if not isinstance(values, dict):
        raise UserError(f"{file}: must be a table of keys and values")
    return values


def _from_deploy(values: dict[str, Any], source: str, robot: Robot) -> Interface:
    """Joints are counted in the order of Unitree's SDK, which is that of the kinematic tree."""
    needed = ("joint_ids_map", "step_dt", "stiffness", "damping", "default_joint_pos", "actions", "observations")
    missing = [key for key in needed if key not in values]
    if missing:
        raise UserError(f"{source}: key '{missing[0]}' is needed")
    order = values["joint_ids_map"]
    if sorted(order) != list(range(robot.num_joints)):
        raise UserError(
            f"{source}: joint_ids_map must name each of the {robot.num_joints} joints of {robot.name} once, as "
            f"0 to {robot.num_joints - 1}; it is for another robot, or for other joints of it"
        )
    actions = _only(values["actions"], "JointPositionAction", f"{source}: actions")
    clip = actions.get("clip") or (-np.inf, np.inf)
    default_pose = _listed(values, "default_joint_pos", source)
    if actions.get("offset") is not None and not np.array_equal(_listed(actions, "offset", source), default_pose):
        raise UserError(f"{source}: actions: JointPositionAction: offset must be the default_joint_pos")
    return Interface(
        source=source,
        joints=tuple(robot.joint_names[place] for place in order),
        stiffness=_listed(values, "stiffness", source)[order],  # gains are in the SDK's order
        damping=_listed(values, "damping", source)[order],
        default_pose=default_pose,
        action_scale=_listed(actions, "scale", f"{source}: actions: JointPositionAction"),
        terms=tuple(_deploy_term(name, term, source) for name, term in values["observations"].items()),
        rate_hz=_rate(values["step_dt"], source),
        action_clip=(np.min(clip), np.max(clip)),
        files=(source,),
    )


def _deploy_term(name: str, values: dict[str, Any], source: str) -> Term:
    where = f"{source}: observations: {name}"
    scale = values.get("scale")
    clip = values.get("clip") or (-np.inf, np.inf)
    return Term(
        name,
        1.0 if scale is None else tuple(np.atleast_1d(_listed(values, "scale", where)).tolist()),
        (float(clip[0]), float(clip[1])),
        max(_history(values.get("history_length") or 1, f"{where}: history_length"), 1),
        (values.get("params") or {}).get("period"),
    )


def _only(table: dict[str, Any], key: str, where: str) -> dict[str, Any]:
    if list(table) != [key]:
        raise UserError(f"{where}: only {key} is known, not {', '.join(table)}")
    return table[key] or {}


def _listed(values: Mapping[str, Any], key: str, source: str) -> np.ndarray:
    try:
        return np.asarray(values[key], float)
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise UserError(f"{source}: {key} must be a list of numbers") from error


def _names(text: str) -> list[str]:
    return [part.strip() for part in _parts(text)]


def _numbers(values: Mapping[str, str], key: str, source: str) -> np.ndarray:
    return np.array([_number(part, f"{source}: {key}") for part in _parts(values[key])])


def _parts(text: str) -> list[str]:
    """The entries of a list that is written as JSON or with commas."""
    if text.startswith("["):
        try:
            return [str(entry) for entry in json.loads(text)]
        except ValueError:
            text = text.strip("[]").replace("'", "")  # Python's own way to write a list
    return text.split(",") if text else []


def _number(text: Any, where: str) -> float:
    try:
        return float(text)
    except (TypeError, ValueError, OverflowError) as error:
        raise UserError(f"{where}: '{shortened(text)}' is not a number") from error


def _history(text: Any, where: str) -> int:
    return int(check_number(where, _number(text, where), 0, _MAX_HISTORY, whole=True))


def _rate(step_dt: Any, source: str) -> int:
    seconds = check_number(f"{source}: step_dt", _number(step_dt, f"{source}: step_dt"), 1e-4, 10.0)
    return round(1.0 / seconds)
