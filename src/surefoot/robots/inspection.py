"""Inspection: the facts of a robot in a pose that need no simulation, for `surefoot robot check`."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import mujoco
import numpy as np

from surefoot.robots.description import Description
from surefoot.robots.model import FLOOR, SOLES, add_sites, compile_model, read_spec
from surefoot.robots.robot import Robot

_ALONG = 0.9
"""A joint pitches if its axis has more than this along y."""
_TOUCHES = -1e-4
"""Shapes that are nearer than this are in each other [m]; those that just touch are not."""


@dataclass(frozen=True, eq=False)
class PoseFacts:
    """A robot in a pose, with its root upright and its soles on the floor, before any weight rests on them.

    Attributes:
        com: from the middle between the soles, (3,) [m].
        sole_tilt: of the left and right sole from flat, (2,) [rad].
        sole_step: height of the left sole above the right one [m].
        support_half: half length and half width of the rectangle about both soles, (2,) [m].
        inertia: that each motor feels while the robot is free in space, (num_joints,) [kg m^2].
        ankles: index of the last joint that pitches in the left and the right leg; None without one.
        touching: pairs of bodies that are in each other, the floor among them.
        root_height: of the root's frame above the floor [m].
    """

    com: np.ndarray
    sole_tilt: np.ndarray
    sole_step: float
    support_half: np.ndarray
    inertia: np.ndarray
    ankles: tuple[int | None, int | None]
    touching: tuple[tuple[str, str], ...]
    root_height: float


def inspect_pose(robot: Robot, pose: np.ndarray) -> PoseFacts:
    """Tell how a robot stands in a pose (num_joints,) [rad]."""
    model = robot.model()
    data = mujoco.MjData(model)
    data.qpos[3], data.qpos[4:7], data.qpos[7:] = 1.0, 0.0, pose
    mujoco.mj_kinematics(model, data)
    data.qpos[2] -= min(data.site(name).xpos[2] for name in SOLES)
    mujoco.mj_forward(model, data)
    soles = np.array([data.site(name).xpos.copy() for name in SOLES])
    upright = np.array([data.site(name).xmat[8] for name in SOLES])
    return PoseFacts(
        com=data.subtree_com[model.body(robot.root).id] - soles.mean(axis=0),
        sole_tilt=np.arccos(np.clip(upright, -1.0, 1.0)),
        sole_step=float(soles[0, 2] - soles[1, 2]),
        support_half=robot.sole_half_size + 0.5 * np.abs(soles[0, :2] - soles[1, :2]),
        inertia=_inertia(model, data),
        ankles=tuple(_ankle(model, data, foot) for foot in robot.feet),  # type: ignore[arg-type]
        touching=_touching(model, data, robot),
        root_height=float(data.qpos[2]),
    )


def _inertia(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """One over the diagonal of the inverse mass matrix, (num_joints,)."""
    inverse = np.zeros((model.nv, model.nv))
    mujoco.mj_solveM(model, data, inverse, np.eye(model.nv))
    return 1.0 / np.diag(inverse)[6:]


def _ankle(model: mujoco.MjModel, data: mujoco.MjData, foot: str) -> int | None:
    body = model.body(foot).id
    while body > 1:
        first, num = model.body_jntadr[body], model.body_jntnum[body]
        for joint in range(first + num - 1, first - 1, -1):
            if abs(data.xaxis[joint, 1]) > _ALONG:
                return int(joint) - 1  # the root's free joint comes first
        body = model.body_parentid[body]
    return None


def _touching(model: mujoco.MjModel, data: mujoco.MjData, robot: Robot) -> tuple[tuple[str, str], ...]:
    """Pairs of bodies that are in each other, without the feet on the floor."""
    found = set()
    for contact in data.contact:
        if contact.dist < _TOUCHES:
            geoms = [model.geom(geom) for geom in contact.geom]
            names = [FLOOR if geom.name == FLOOR else model.body(geom.bodyid[0]).name for geom in geoms]
            if FLOOR not in names or not set(names) & set(robot.feet):
                found.add((names[0], names[1]))
    return tuple(sorted(found))


def delivered_and_trimmed(description: Description) -> tuple[mujoco.MjModel, mujoco.MjModel]:
    """Compile the model with all shapes and contacts of its file, and with those of the legs and the floor only."""
    models = []
    for contacts in ("file", "legs"):
        changed = dataclasses.replace(description, contacts=contacts)
        spec, _ = read_spec(changed)
        add_sites(spec, changed)
        models.append(compile_model(spec, visual=contacts == "file"))
    return models[0], models[1]
