"""Model: a robot's compiled MJCF file, with the floor, the motors and the soles that its description adds."""

from __future__ import annotations

import mujoco
import numpy as np

from surefoot.errors import UserError
from surefoot.rates import CONTROL_DT
from surefoot.robots.description import Description, Motor, lookup
from surefoot.robots.domain import NOMINAL_DOMAIN, DomainParameters
from surefoot.robots.geometry import Sole, find_sole

FLOOR = "floor"
"""Name of the floor's geom in every model."""
SOLES = ("left_sole", "right_sole")
"""Names of the sites at the centres of the soles: left, right."""
TORSO = "torso_point"
"""Name of the site that stands for the torso's position."""
STIFFNESS_COLUMN, DAMPING_COLUMN = 4, 6
CONSTANT_COLUMN, MAX_VOLTAGE_COLUMN = 1, 7
"""Where the compiler puts a motor's gains, and its constant and largest voltage, in `actuator_gainprm`."""
_PLACES = ("body_pos", "body_quat", "body_mass", "body_inertia", "jnt_pos", "jnt_axis", "jnt_range", "geom_pos",
           "geom_quat", "geom_size")  # fmt: skip
"""Arrays of a model that must be finite, in MuJoCo's words."""
_VOLTAGE = 48.0
"""MuJoCo's motor model wants one; only ratios of it count."""
STALL = 10.0
"""Stall torque over the torque limit: the full torque lasts up to 90 % of the speed limit and is gone at the limit."""


def read_spec(description: Description) -> tuple[mujoco.MjSpec, dict[str, float]]:
    """The MJCF file with the joints that are held welded, and nothing of its own that the description replaces.

    Returns:
        The model, and the held joints with their angles [rad].

    Raises:
        UserError: the file is no model, or lacks what the description names.
    """
    try:
        spec = mujoco.MjSpec.from_file(str(description.model))
        model = spec.compile()
    except (ValueError, OSError) as error:
        reason = " ".join(str(error).split())
        raise UserError(f"{description.file}: cannot read the model {description.model}: {reason}") from error
    for name in _PLACES:
        if not np.isfinite(getattr(model, name)).all():
            raise UserError(f"{description.file}: the model {description.model} has a {name} that is not finite")
    _check_names(spec, description)
    own_motors = {a.target: _own_motor(a) for a in spec.actuators} if description.own_actuators else {}
    for element in (*spec.sensors, *spec.keys, *spec.actuators):
        spec.delete(element)
    _check_root(spec, description)
    held = _weld_held_joints(spec, description)
    _set_ranges(spec, description)
    _set_floor(spec, description)
    _set_contacts(spec, description)
    _add_motors(spec, description, own_motors)
    spec.option.timestep = CONTROL_DT
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    return spec, held


def add_sites(spec: mujoco.MjSpec, description: Description) -> tuple[Sole, Sole]:
    """Mark the centres of the soles and the torso's point; returns the soles, left and right."""
    model = spec.compile()
    soles = tuple(find_sole(model, foot, str(description.file)) for foot in description.feet)
    for name, foot, sole in zip(SOLES, description.feet, soles, strict=True):
        site = spec.body(foot).add_site(name=name, pos=sole.center, group=4)
        site.quat = sole.quaternion
    if description.torso_site:
        site = spec.site(description.torso_site)
        site.name = TORSO
    else:
        x, _, z = model.body(description.torso).ipos
        spec.body(description.torso).add_site(name=TORSO, pos=[x, 0.0, z], group=4)
    return soles[0], soles[1]


def compile_model(
    spec: mujoco.MjSpec, domain: DomainParameters = NOMINAL_DOMAIN, *, visual: bool = False
) -> mujoco.MjModel:
    """Compile a model; without `visual`, shapes that are only looked at are left out (the same physics, but faster)."""
    spec.compiler.discardvisual = not visual
    model = spec.compile()
    if domain == NOMINAL_DOMAIN:
        return model
    if domain.friction is not None:
        model.geom_friction[:, 0] = domain.friction
    model.body_mass *= domain.mass_scale
    model.body_inertia *= domain.mass_scale
    model.actuator_forcerange *= domain.motor_strength
    axis = np.array([np.sin(domain.uphill), -np.cos(domain.uphill), 0.0])
    mujoco.mju_axisAngle2Quat(model.geom_quat[model.geom(FLOOR).id], axis, domain.slope)
    model.opt.timestep = 1.0 / domain.physics_hz
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def foot_friction(model: mujoco.MjModel, feet: tuple[str, str]) -> float:
    """Coefficient of sliding friction between the feet and the floor, the smallest one of the feet's shapes.

    Of two shapes, MuJoCo takes the friction of the one with the higher priority, else the larger one.
    """
    floor, found = model.geom(FLOOR).id, []
    bodies = [model.body(foot).id for foot in feet]
    for geom in range(model.ngeom):
        if model.geom_bodyid[geom] in bodies and (model.geom_contype[geom] or model.geom_conaffinity[geom]):
            pair = max((model.geom_priority[each], model.geom_friction[each, 0]) for each in (geom, floor))
            found.append(float(pair[1]))
    return min(found)


def controlled_joints(spec: mujoco.MjSpec, description: Description) -> list[mujoco.MjsJoint]:
    """The joints that have a motor, in the order of the kinematic tree."""
    return [joint for joint in _hinges(spec) if description.motor(joint.name) is not None]


def _hinges(spec: mujoco.MjSpec) -> list[mujoco.MjsJoint]:
    return [joint for joint in spec.joints if joint.type == mujoco.mjtJoint.mjJNT_HINGE]


def _check_names(spec: mujoco.MjSpec, description: Description) -> None:
    bodies = [body.name for body in spec.bodies if body.name != "world"]
    named = {"root": description.root, "torso": description.torso}
    named |= {"left foot": description.feet[0], "right foot": description.feet[1]} | dict(description.pushable)
    for what, body in named.items():
        if body not in bodies:
            raise UserError(f"{description.file}: {what}: there is no body '{body}'; valid: {', '.join(bodies)}")
    if description.torso_site and description.torso_site not in [site.name for site in spec.sites]:
        raise UserError(f"{description.file}: torso: there is no site '{description.torso_site}' in the model")
    joints = [joint.name for joint in _hinges(spec)]
    if not all(joint.name and joint.parent.name for joint in _hinges(spec)):
        raise UserError(f"{description.file}: a hinge of the model, or the body that it turns, has no name")
    tables = {"motors": description.motors, "held": description.held, "ranges": description.ranges}
    tables |= {f"pose {name}": pose for name, pose in description.poses.items()}
    for where, table in tables.items():
        for pattern in table:
            if not any(lookup({pattern: True}, joint) for joint in joints):
                raise UserError(
                    f"{description.file}: {where}: there is no joint '{pattern}'; valid: {', '.join(joints)}"
                )


def _check_root(spec: mujoco.MjSpec, description: Description) -> None:
    """The root floats: it has a free joint, which is added if the file has none."""
    root = spec.body(description.root)
    if root.parent.name != "world":
        raise UserError(
            f"{description.file}: root: the body '{root.name}' hangs on '{root.parent.name}' and cannot float; "
            f"name the outermost body"
        )
    kinds = [joint.type for joint in root.joints]
    if not kinds:
        root.add_freejoint()
    elif kinds != [mujoco.mjtJoint.mjJNT_FREE]:
        raise UserError(f"{description.file}: root: the body '{description.root}' must have a free joint and no other")
    if len([joint for joint in spec.joints if joint.type == mujoco.mjtJoint.mjJNT_FREE]) > 1:
        raise UserError(f"{description.file}: root: only '{description.root}' may have a free joint")


def _weld_held_joints(spec: mujoco.MjSpec, description: Description) -> dict[str, float]:
    """Turn the body of every joint that has no motor by the joint's angle, and remove the joint; the angles."""
    free = [
        joint for joint in spec.joints if joint.type not in (mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_HINGE)
    ]
    if free:
        raise UserError(f"{description.file}: joint '{free[0].name}' is neither a hinge nor the root's free joint")
    names = [joint.name for joint in _hinges(spec) if description.motor(joint.name) is None]
    held = {name: lookup(description.held, name) or 0.0 for name in names}
    model = spec.compile()
    for name, angle in held.items():
        joint = spec.joint(name)
        body = joint.parent
        turn, before, after = np.zeros(4), model.body(body.name).quat.copy(), np.zeros(4)
        mujoco.mju_axisAngle2Quat(turn, model.joint(name).axis, angle)
        mujoco.mju_mulQuat(after, before, turn)
        anchor = model.joint(name).pos
        shift = _rotate(before, anchor) - _rotate(after, anchor)
        if angle:
            body.pos, body.quat = model.body(body.name).pos + shift, after
            body.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
        spec.delete(joint)
    _drop_dangling(spec, names)
    return held


def _drop_dangling(spec: mujoco.MjSpec, joints: list[str]) -> None:
    """Remove what refers to joints that are no more."""
    for equality in spec.equalities:
        if {equality.name1, equality.name2} & set(joints):
            spec.delete(equality)


def _set_ranges(spec: mujoco.MjSpec, description: Description) -> None:
    """Give controlled joints the ranges of the description; the file's own are in its own unit."""
    for joint in controlled_joints(spec, description):
        found = lookup(description.ranges, joint.name)
        if found:
            joint.limited = mujoco.mjtLimited.mjLIMITED_TRUE
            joint.range = np.degrees(found) if spec.compiler.degree else found


def _set_floor(spec: mujoco.MjSpec, description: Description) -> None:
    planes = [geom for geom in spec.worldbody.geoms if geom.type == mujoco.mjtGeom.mjGEOM_PLANE]
    if description.own_floor:
        own = [geom for geom in spec.worldbody.geoms if geom.name == description.own_floor]
        if not own:
            raise UserError(f"{description.file}: own_floor: there is no geom '{description.own_floor}' in the world")
        own[0].name = FLOOR
        return
    for plane in planes:
        spec.delete(plane)
    floor = spec.worldbody.add_geom(
        name=FLOOR,
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[0.0, 0.0, 1.0],
        condim=3,
        contype=1,
        conaffinity=1,
        friction=[description.floor.friction, 0.005, 0.0001],
        solref=description.floor.solref,
    )
    if FLOOR in [material.name for material in spec.materials]:
        floor.material = FLOOR
    else:
        floor.rgba = [0.4, 0.44, 0.49, 1.0]


def _set_contacts(spec: mujoco.MjSpec, description: Description) -> None:
    """Friction as the description says, and with contacts of the legs only: each leg touches the other and the floor.

    The floor has the bit 1, the left leg 2 and the right leg none; the right leg asks for 1 and 2, all else for 1.
    """
    if description.cone:
        spec.option.cone = getattr(mujoco.mjtCone, f"mjCONE_{description.cone.upper()}")
    if description.impratio is not None:
        spec.option.impratio = description.impratio
    if description.collision_group is not None:
        _let_collide(spec, description, description.collision_group)
    if description.contacts != "legs":
        return
    left, right = (leg_bodies(spec, description, foot) for foot in description.feet)
    for body in spec.bodies:
        for geom in body.geoms:
            if geom.name == FLOOR or not (geom.contype or geom.conaffinity):
                continue
            geom.contype = 2 if body.name in left else 0
            geom.conaffinity = 3 if body.name in right else 1


def _let_collide(spec: mujoco.MjSpec, description: Description, group: int) -> None:
    """Let the shapes of a group touch, those that the file takes out of all contacts."""
    geoms = [geom for geom in spec.geoms if geom.name != FLOOR]
    chosen = [geom for geom in geoms if geom.group == group]
    if not chosen:
        valid = ", ".join(str(group) for group in sorted({geom.group for geom in geoms}))
        raise UserError(f"{description.file}: collision_group: no shape is in the group {group}; valid: {valid}")
    for geom in chosen:
        if not (geom.contype or geom.conaffinity):
            geom.contype = geom.conaffinity = 1


def leg_bodies(spec: mujoco.MjSpec, description: Description, foot: str) -> set[str]:
    """The bodies from a foot up to the first one that it shares with the other foot, which is left out."""
    chains = [_chain(spec, name, description.root) for name in description.feet]
    return set(_chain(spec, foot, description.root)) - (set(chains[0]) & set(chains[1]))


def _chain(spec: mujoco.MjSpec, foot: str, root: str) -> list[str]:
    """A foot and the bodies that carry it, up to the root."""
    body, names = spec.body(foot), []
    while body.name not in ("world", root):
        names.append(body.name)
        body = body.parent
    return names


def _own_motor(actuator: mujoco.MjsActuator) -> Motor:
    """Return a position actuator's values in the MJCF file: kp, kd and the force range."""
    torque = float(actuator.forcerange[1]) or None
    return Motor(float(actuator.gainprm[0]), float(-actuator.biasprm[2]), torque)


def _add_motors(spec: mujoco.MjSpec, description: Description, own: dict[str, Motor]) -> None:
    joints = controlled_joints(spec, description)
    if not joints:
        raise UserError(f"{description.file}: motors: no joint of the model is controlled")
    for joint in joints:
        motor, default = description.motor(joint.name) or Motor(), own.get(joint.name, Motor())
        values = {}
        for key in ("stiffness", "damping", "torque", "speed"):
            value = getattr(motor, key)
            values[key] = getattr(default, key) if value is None else value
            if values[key] is None:
                raise UserError(f"{description.file}: motor {joint.name}: key '{key}' is needed")
        if motor.armature is not None:
            joint.armature = motor.armature
        _add_motor(spec, joint.name, **values)


def _add_motor(spec: mujoco.MjSpec, joint: str, stiffness: float, damping: float, torque: float, speed: float) -> None:
    """The impedance law with its torque limit, and with full torque up to 90 % of the speed limit and none at it."""
    actuator = spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    actuator.set_to_dcmotor(
        motorconst=[0.0, 0.0],
        resistance=0.0,
        nominal=[_VOLTAGE, STALL * torque, speed],
        saturation=[torque, 0.0, 0.0],
        controller=[stiffness, 0.0, damping, 0.0, 0.0, _VOLTAGE],
        ctrlspec=int(mujoco.mjtCtrlInput.mjINPUT_POS),
    )


def _rotate(quaternion: np.ndarray, vector: np.ndarray) -> np.ndarray:
    turned = np.zeros(3)
    mujoco.mju_rotVecQuat(turned, vector, quaternion)
    return turned
