"""Robot: the facts of a machine for every other module."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass, field

import mujoco
import numpy as np

from surefoot.errors import UserError
from surefoot.robots.domain import NOMINAL_DOMAIN, DomainParameters
from surefoot.robots.fingerprint import model_fingerprint
from surefoot.robots.geometry import reference_data
from surefoot.robots.model import SOLES, compile_model, foot_friction

FEET = ("left", "right")
"""The order of the feet, wherever there are two of something."""

REFERENCE_MASS = 137.287494
"""Of the paper's robot [kg]: what is given in newtons for it is scaled by the mass for other robots."""
_DIGITS = 9
"""The scale of the mass is rounded to so many digits, so that it is one for the paper's robot."""
REFERENCE_LEG = 0.986129
"""Length of its legs, from the hip's first joint to the sole [m]: what is given in metres is scaled by the legs."""


@dataclass(frozen=True, eq=False)
class Robot:
    """A position-controlled humanoid with two feet, read from its description.

    Arrays over joints are (num_joints,) float64 in the order of the kinematic tree, in rad, Nm, Nm/rad and Nms/rad.

    Attributes:
        name: name by which it is loaded: a shipped robot's name, or the path of its description.
        title: name for readers.
        build: function that makes a new MuJoCo specification of the model, including floor and motors.
        joint_names: controlled joints; every other joint is welded.
        joint_groups: for each joint, the name that it shares with its mirror image.
        joint_lower, joint_upper: joint ranges.
        stiffness, damping: gains of the joint impedance.
        torque_limit, velocity_limit: limits of the motors; the latter in rad/s.
        poses: named nominal poses, (num_joints,) joint angles.
        default_pose: name of the pose that is used by default.
        root: name of the floating body.
        torso: name of the body that is kept upright.
        body_names: all moving bodies, the root first; a wrench's body is an index into them.
        pushable: word -> body that may be pushed under it; "root" is always one of the words.
        feet: bodies of the left and of the right foot.
        sole_half_size: half length (x) and half width (y) of a sole [m].
        leg_length: length from the hip's first joint to the sole [m].
        mass: total mass [kg].
        gravity: gravitational acceleration [m/s^2].
        load_unit: unit of the foot forces in the observation [N].
        mirror_source, mirror_sign: a mirrored vector over the joints is ``mirror_sign * vector[mirror_source]``.
        body_mirror: body -> its mirror image.
        is_symmetric: False if the description waives the mirror, or the model is not its own mirror image.
        held_joints: joint that is not controlled -> angle at which it is welded [rad].
    """

    name: str
    title: str
    build: Callable[[], mujoco.MjSpec] = field(repr=False)
    joint_names: tuple[str, ...]
    joint_groups: tuple[str, ...]
    joint_lower: np.ndarray
    joint_upper: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    torque_limit: np.ndarray
    velocity_limit: np.ndarray
    poses: dict[str, np.ndarray]
    default_pose: str
    root: str
    torso: str
    body_names: tuple[str, ...]
    pushable: dict[str, str]
    feet: tuple[str, str]
    sole_half_size: np.ndarray
    leg_length: float
    mass: float
    gravity: float
    load_unit: float
    mirror_source: np.ndarray
    mirror_sign: np.ndarray
    body_mirror: dict[str, str]
    is_symmetric: bool = True
    held_joints: dict[str, float] = field(default_factory=dict)

    @property
    def num_joints(self) -> int:
        """Number of controlled joints."""
        return len(self.joint_names)

    @functools.cached_property
    def fingerprint(self) -> str:
        """Twelve hexadecimal digits that name the physical facts of the robot; results are kept with it."""
        return model_fingerprint(self.model())

    @functools.cached_property
    def friction(self) -> float:
        """Coefficient of sliding friction between the feet and the floor."""
        return foot_friction(self.model(), self.feet)

    @property
    def weight(self) -> float:
        """Weight [N]; standing still, each foot carries half of it."""
        return self.mass * self.gravity

    @property
    def mass_scale(self) -> float:
        """Mass over that of the paper's robot; forces and, for the same velocity, impulses go with it."""
        return round(self.mass / REFERENCE_MASS, _DIGITS)

    @property
    def length_scale(self) -> float:
        """Length of the legs over that of the paper's robot."""
        return self.leg_length / REFERENCE_LEG

    @property
    def is_of_the_paper(self) -> bool:
        """Does the robot have the size of the paper's, so that its figures can stand beside the paper's?"""
        return self.mass_scale == 1.0 and self.length_scale == 1.0

    @property
    def time_scale(self) -> float:
        """How long a motion of its pendulum takes over that of the paper's robot: the root of the length's scale."""
        return math.sqrt(self.length_scale)

    @property
    def speed_scale(self) -> float:
        """Speed of such a motion over that of the paper's robot: length by time, under the same gravity."""
        return math.sqrt(self.length_scale)

    @property
    def power_scale(self) -> float:
        """Power of such a motion over that of the paper's robot: force times speed."""
        return self.mass_scale * self.speed_scale

    @functools.cached_property
    def breadth_first(self) -> np.ndarray:
        """Places of the joints in the order in which Isaac Lab counts them: all joints nearest to the root first."""
        model = self.model()
        depths = []
        for name in self.joint_names:
            body, depth = int(model.jnt_bodyid[model.joint(name).id]), 0
            while body > 1:
                depth, body = depth + int(model.body_jntnum[body]), int(model.body_parentid[body])
            depths.append(depth)
        return np.argsort(depths, kind="stable")

    @functools.cached_property
    def standing_height(self) -> float:
        """Height of the highest body's frame above the soles, joints at zero [m]: by which pictures are framed."""
        model = self.model()
        data = reference_data(model)
        soles = [data.site(name).xpos[2] for name in SOLES]
        return float(max(data.geom_xpos[1:, 2].max(), data.xpos[:, 2].max()) - min(soles))

    def _lateral_place(self, body: str) -> float:
        model = self.model()
        return float(reference_data(model).xpos[model.body(body).id, 1])

    def model(self, domain: DomainParameters = NOMINAL_DOMAIN, *, visual: bool = False) -> mujoco.MjModel:
        """Compile the model; without `visual`, shapes that are only looked at are left out (same physics, faster)."""
        return compile_model(self.build(), domain, visual=visual)

    def lever_arm(self, pose: np.ndarray, body: str, lever: float) -> float:
        """Height above a body's CoM [m] of a point `lever` above the robot's CoM, in a pose (num_joints,) [rad].

        Raises:
            UserError: the robot has no pushable body of that name.
        """
        model = self.model()
        data = mujoco.MjData(model)
        data.qpos[7:] = pose
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        place = data.xipos[model.body(self.pushed_body(body)).id, 2]
        return float(data.subtree_com[model.body(self.root).id, 2] + lever - place)

    def pose(self, name: str = "") -> np.ndarray:
        """Joint angles (num_joints,) [rad] of a named pose; of the default one without a name.

        Raises:
            UserError: the robot has no pose of that name.
        """
        name = name or self.default_pose
        if name not in self.poses:
            raise UserError(f"unknown pose '{name}' of {self.name}; valid: {', '.join(self.poses)}")
        return self.poses[name]

    @property
    def body_words(self) -> tuple[str, ...]:
        """The words for pushable bodies that people choose from: "root" only if the root has no other word."""
        own = [word for word, body in self.pushable.items() if word != "root" and body == self.root]
        return tuple(word for word in self.pushable if word != "root" or not own)

    def pushed_body(self, word: str) -> str:
        """The body that is pushed under a word.

        Raises:
            UserError: the robot has no such pushable body.
        """
        if word not in self.pushable:
            raise UserError(f"unknown body '{word}' of {self.name}; valid: {', '.join(self.body_words)}")
        return self.pushable[word]

    def body_id(self, word: str) -> int:
        """Index into `body_names` of a pushable body.

        Raises:
            UserError: the robot has no such pushable body.
        """
        return self.body_names.index(self.pushed_body(word))

    def side(self, word: str) -> int:
        """1 for a pushable body on the left, -1 for one on the right, 0 in the middle.

        Raises:
            UserError: the robot has no such pushable body.
        """
        body = self.pushed_body(word)
        if self.body_mirror.get(body, body) == body:
            return 0
        return 1 if self._lateral_place(body) > 0.0 else -1

    def mirror_body(self, word: str) -> str:
        """The pushable body that is the mirror image of a pushable one; itself for a body in the middle.

        Raises:
            UserError: the robot has no such pushable body.
        """
        body = self.pushed_body(word)
        image = self.body_mirror.get(body, body)
        return next((other for other, its in self.pushable.items() if its == image and image != body), word)
