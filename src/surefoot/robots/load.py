"""Load: the loading of a robot by its name or from a description."""

from __future__ import annotations

import copyreg
import functools
import importlib.resources
from collections.abc import Mapping, Sequence
from pathlib import Path

import mujoco
import numpy as np

from surefoot.errors import UserError, notice
from surefoot.robots.description import Description, lookup, read_description
from surefoot.robots.geometry import Mirror, find_mirror, joint_groups, leg_length
from surefoot.robots.model import (
    CONSTANT_COLUMN,
    DAMPING_COLUMN,
    MAX_VOLTAGE_COLUMN,
    STIFFNESS_COLUMN,
    add_sites,
    compile_model,
    read_spec,
)
from surefoot.robots.robot import Robot

SUFFIX = ".toml"
_LOAD_SHARE = 0.6
"""Share of the weight that is the unit of foot forces where the description gives none."""


def shipped_robots() -> tuple[str, ...]:
    """Names of the robots that come with the package."""
    folder = Path(str(importlib.resources.files("surefoot.robots")))
    return tuple(sorted(file.parent.name for file in folder.glob(f"*/*{SUFFIX}") if file.stem == file.parent.name))


def load_robot(name: str | Path) -> Robot:
    """Read a robot that comes with the package, or one of your own.

    Args:
        name: a shipped robot's name, or the path of a description (.toml).

    Raises:
        UserError: no robot has this name, or its description or model has a fault, which the message names.
    """
    return _load(_file(name), str(name))


# A robot travels by its name: whoever unpickles it reads its description anew.
copyreg.pickle(Robot, lambda robot: (load_robot, (robot.name,)))


def describe(name: str | Path) -> Description:
    """Read the description of a robot by its name or path, as `load_robot` takes it.

    Raises:
        UserError: there is no such robot, or its description is wrong.
    """
    return read_description(_file(name))


def _file(name: str | Path) -> Path:
    if str(name) in shipped_robots():
        folder = Path(str(importlib.resources.files("surefoot.robots")))
        return folder / str(name) / f"{name}{SUFFIX}"
    path = Path(name)
    if path.suffix != SUFFIX:
        raise UserError(f"unknown robot '{name}'; valid: {', '.join(shipped_robots())}, or a description ({SUFFIX})")
    return path.resolve()


@functools.cache
def _load(file: Path, name: str) -> Robot:
    description = read_description(file)
    try:
        spec, held = read_spec(description)
        left, _ = add_sites(spec, description)
        model = compile_model(spec.copy())
    except UserError:
        raise
    except (ValueError, mujoco.FatalError) as error:  # of MuJoCo's compiler, when joints are welded and motors added
        raise UserError(f"{file}: the model cannot be built: {error}") from error
    joint_ids = model.actuator_trnid[:, 0]
    joints = tuple(model.joint(i).name for i in joint_ids)
    _check_ranges(model, joint_ids, file)
    mirror, is_symmetric = _mirror(model, joints, description)
    motor, mass, gravity = model.actuator_gainprm, float(model.body_mass.sum()), float(-model.opt.gravity[2])
    return Robot(
        name=name,
        title=description.title,
        build=spec.copy,
        joint_names=joints,
        joint_groups=joint_groups(joints, mirror.source),
        joint_lower=model.jnt_range[joint_ids, 0].copy(),
        joint_upper=model.jnt_range[joint_ids, 1].copy(),
        stiffness=motor[:, STIFFNESS_COLUMN].copy(),
        damping=motor[:, DAMPING_COLUMN].copy(),
        torque_limit=model.actuator_forcerange[:, 1].copy(),
        velocity_limit=motor[:, MAX_VOLTAGE_COLUMN] / motor[:, CONSTANT_COLUMN],
        poses={pose: _angles(joints, angles) for pose, angles in description.poses.items()},
        default_pose=description.default_pose,
        root=description.root,
        torso=description.torso,
        body_names=tuple(model.body(i).name for i in range(1, model.nbody)),
        pushable={"root": description.root, **description.pushable},
        feet=description.feet,
        sole_half_size=left.half_size,
        leg_length=leg_length(model, description.feet[0], left),
        mass=mass,
        gravity=gravity,
        load_unit=description.load_unit or round(_LOAD_SHARE * mass * gravity, 1),
        mirror_source=mirror.source,
        mirror_sign=mirror.sign,
        body_mirror=mirror.bodies,
        is_symmetric=is_symmetric,
        held_joints=held,
    )


def _mirror(model: mujoco.MjModel, joints: Sequence[str], description: Description) -> tuple[Mirror, bool]:
    """The mirror, and whether there is one; without one, every joint and body is its own image."""
    none = Mirror(np.arange(len(joints)), np.ones(len(joints)), {})
    if description.symmetric is False:
        return none, False
    try:
        return find_mirror(model, joints, str(description.file)), True
    except UserError as error:
        if description.symmetric:
            raise
        notice(f"{error} It learns without a mirror; symmetric = false in its description makes this permanent.")
        return none, False


def _check_ranges(model: mujoco.MjModel, joint_ids: np.ndarray, file: Path) -> None:
    for joint in joint_ids:
        if not model.jnt_limited[joint]:
            name, (low, high) = model.joint(joint).name, model.jnt_range[joint]
            if low > high:
                raise UserError(f"{file}: ranges: the joint '{name}' goes from {low:g} down to {high:g} in the model")
            raise UserError(f"{file}: ranges: the joint '{name}' has no range, neither here nor in the model")


def _angles(joints: Sequence[str], table: Mapping[str, float]) -> np.ndarray:
    return np.array([lookup(table, joint) or 0.0 for joint in joints])
