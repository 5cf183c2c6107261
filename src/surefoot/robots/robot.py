"""Robot: what every other module knows of a machine, read from its compiled model."""

from __future__ import annotations

import functools
import importlib
import importlib.resources
from dataclasses import dataclass

import mujoco
import numpy as np

from surefoot.errors import UserError
from surefoot.physics.domain import NOMINAL_DOMAIN, DomainParameters

ROBOTS = ("valkyrie",)


FEET = ("left_foot", "right_foot")


FLOOR = "floor"


# Where the compiler puts the parameters of a `dcmotor` in `actuator_gainprm`.
_MOTOR_CONSTANT, _STIFFNESS, _DAMPING, _MAX_VOLTAGE = 1, 4, 6, 7


@dataclass(frozen=True, eq=False)
class Robot:
    """A position-controlled humanoid: joints in the order of its actuators, feet with box soles.

    Arrays over joints are (num_joints,) float64 in the actuators' order, in rad, Nm, Nm/rad and Nms/rad.
    """

    name: str
    xml: str
    """The MJCF text."""
    joint_names: tuple[str, ...]
    joint_lower: np.ndarray
    joint_upper: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    torque_limit: np.ndarray
    velocity_limit: np.ndarray
    poses: dict[str, np.ndarray]
    """Named nominal poses, (num_joints,) joint angles [rad]."""
    root: str
    """The floating body."""
    body_ids: dict[str, int]
    """Pushable bodies by name -> MuJoCo body id."""
    sole_half_size: np.ndarray
    """Half length (x) and half width (y) of a sole [m]."""
    mass: float
    gravity: float
    mirror_source: np.ndarray
    """Joints in the mirror: a mirrored vector over the joints is ``mirror_sign * vector[mirror_source]``."""
    mirror_sign: np.ndarray

    @property
    def num_joints(self) -> int:
        return len(self.joint_names)

    @property
    def weight(self) -> float:
        """Weight [N]; standing still, each foot carries half of it."""
        return self.mass * self.gravity

    def model(self, domain: DomainParameters = NOMINAL_DOMAIN, *, visual: bool = False) -> mujoco.MjModel:
        """Compile the model; without `visual`, shapes that are only looked at are left out (same physics, faster)."""
        spec = mujoco.MjSpec.from_string(self.xml)
        spec.compiler.discardvisual = not visual
        model = spec.compile()
        if domain == NOMINAL_DOMAIN:
            return model
        model.geom_friction[:, 0] *= domain.friction
        model.body_mass *= domain.mass_scale
        model.body_inertia *= domain.mass_scale
        model.actuator_forcerange *= domain.motor_strength
        axis = np.array([np.sin(domain.uphill), -np.cos(domain.uphill), 0.0])
        mujoco.mju_axisAngle2Quat(model.geom_quat[model.geom(FLOOR).id], axis, domain.slope)
        model.opt.timestep = 1.0 / domain.physics_hz
        mujoco.mj_setConst(model, mujoco.MjData(model))
        return model

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
        return float(data.subtree_com[model.body(self.root).id, 2] + lever - data.xipos[self.body_id(body), 2])

    def pose(self, name: str) -> np.ndarray:
        """Joint angles (num_joints,) [rad] of a named pose.

        Raises:
            UserError: the robot has no pose of that name.
        """
        if name not in self.poses:
            raise UserError(f"unknown pose '{name}' of {self.name}; valid: {', '.join(self.poses)}")
        return self.poses[name]

    def body_id(self, name: str) -> int:
        """MuJoCo body id of a pushable body.

        Raises:
            UserError: the robot has no pushable body of that name.
        """
        if name not in self.body_ids:
            raise UserError(f"unknown body '{name}' of {self.name}; valid: {', '.join(self.body_ids)}")
        return self.body_ids[name]


@functools.cache
def load_robot(name: str = "valkyrie") -> Robot:
    """Read a robot by name.

    Raises:
        UserError: no robot of that name is shipped.
    """
    if name not in ROBOTS:
        raise UserError(f"unknown robot '{name}'; valid: {', '.join(ROBOTS)}")
    xml = (importlib.resources.files("surefoot.robots") / name / f"{name}.xml").read_text()
    facts = importlib.import_module(f"surefoot.robots.{name}")
    model = mujoco.MjModel.from_xml_string(xml)
    joint_ids = model.actuator_trnid[:, 0]
    joint_names = tuple(model.joint(i).name for i in joint_ids)
    motor = model.actuator_gainprm
    return Robot(
        name=name,
        xml=xml,
        joint_names=joint_names,
        joint_lower=model.jnt_range[joint_ids, 0].copy(),
        joint_upper=model.jnt_range[joint_ids, 1].copy(),
        stiffness=motor[:, _STIFFNESS].copy(),
        damping=motor[:, _DAMPING].copy(),
        torque_limit=model.actuator_forcerange[:, 1].copy(),
        velocity_limit=motor[:, _MAX_VOLTAGE] / motor[:, _MOTOR_CONSTANT],
        poses={pose: _joint_angles(joint_names, groups) for pose, groups in facts.POSES.items()},
        root=facts.ROOT,
        body_ids={"root": model.body(facts.ROOT).id}
        | {word: model.body(body).id for word, body in facts.PUSHABLE_BODIES.items()},
        sole_half_size=model.geom(FEET[0]).size[:2].copy(),
        mass=float(model.body_mass.sum()),
        gravity=float(-model.opt.gravity[2]),
        mirror_source=np.array([joint_names.index(_other_side(n)) for n in joint_names]),
        mirror_sign=np.array([-1.0 if n.endswith("roll") else 1.0 for n in joint_names]),
    )


def joint_group(joint: str) -> str:
    """The joint's name without its side: ``left_knee_pitch`` -> ``knee_pitch``."""
    return joint.removeprefix("left_").removeprefix("right_")


def _joint_angles(joint_names: tuple[str, ...], groups: dict[str, float]) -> np.ndarray:
    return np.array([groups.get(joint_group(name), 0.0) for name in joint_names])


def _other_side(name: str) -> str:
    return name.replace("left", "?").replace("right", "left").replace("?", "right")
