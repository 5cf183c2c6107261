"""Valkyrie against the figures of NASA's description, and what of it touches what.

Figures copied from val_description (mass-simulator hands); composite bodies summed from its links by hand or by an
independent forward-kinematics calculation, with the locked joints at their listed angles.
"""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from conftest import posed, step_to

from surefoot.errors import UserError
from surefoot.physics.mujoco_engine import MujocoEngine
from surefoot.rates import TICKS_PER_STEP
from surefoot.robots import Robot, load_robot

LEG = ("hip_roll", "hip_pitch", "knee_pitch", "ankle_pitch", "ankle_roll")
JOINTS = ("torso_pitch", *(f"left_{name}" for name in LEG), *(f"right_{name}" for name in LEG))
RANGES = {
    "torso_pitch": (-0.13, 0.666),
    "left_hip_roll": (-0.467, 0.5515),
    "right_hip_roll": (-0.5515, 0.467),
    "hip_pitch": (-2.42, 1.619),
    "knee_pitch": (-0.083, 2.057),
    "ankle_pitch": (-0.93, 0.65),
    "ankle_roll": (-0.4, 0.4),
}

LEG_MASS = {"hip": 3.665, "thigh": 10.2, "shank": 6.2, "ankle": 0.03, "foot": 2.27 + 0.1}
# 39.47 torso + 0.1 pitch link + 1.05 + 1.4 + 3.89 neck + 1.41984 head + 0.057654 lidar
# + 2 arms of 2.65 + 3.97 + 3.085 + 6.03
TORSO_MASS = 78.857494
TOTAL_MASS = 137.287494


def contacts(model: mujoco.MjModel, data: mujoco.MjData) -> set[tuple[str, str]]:
    return {(model.geom(c.geom1).name, model.geom(c.geom2).name) for c in data.contact}


# The machine as data.


def test_the_whole_robot_weighs_what_its_links_weigh(robot: Robot) -> None:
    legs = 2 * sum(LEG_MASS.values())  # 44.93
    root = 8.22 + 0.5 + 2 * 2.39  # waist yaw link and both hip yaw links are locked to it
    assert root + TORSO_MASS + legs == pytest.approx(TOTAL_MASS, abs=1e-9)
    assert robot.mass == pytest.approx(TOTAL_MASS, abs=1e-6)
    assert robot.gravity == 9.806651
    assert robot.weight == pytest.approx(TOTAL_MASS * 9.806651, abs=1e-4)  # 1346.33 N, 673.2 N a foot


def test_every_body_has_the_mass_of_its_links(robot: Robot) -> None:
    model = robot.model()
    masses = {model.body(i).name: model.body_mass[i] for i in range(1, model.nbody)}
    expected = {"pelvis": 13.5, "torso": TORSO_MASS}
    expected |= {f"{side}_{part}": mass for side in ("left", "right") for part, mass in LEG_MASS.items()}
    assert masses == pytest.approx(expected, abs=1e-6)


def test_the_com_of_the_straight_robot_is_at_the_papers_height(robot: Robot) -> None:
    model = robot.model()
    data = posed(robot, model, height=1.175)
    # 1.175 - 0.1853 - 0.0609 - 0.430959 - 0.40627 - 0.088: the root frame over the soles, hip, thigh, shank, foot.
    assert data.site("left_sole").xpos[2] == pytest.approx(0.003571, abs=1e-6)
    assert data.subtree_com[1][2] == pytest.approx(1.108, abs=5e-4)


@pytest.mark.parametrize(
    ("body", "com", "inertia"),
    [
        ("pelvis", (0.0044654, -0.0021384, -0.0544803), (0.26477037, 0.19340185, 0.15775318)),
        ("torso", (-0.0264063, -0.0010217, 0.2336136), (6.84978740, 3.64731589, 4.41874504)),
        ("left_thigh", (0.016691, 0.192997, -0.454075), (0.24083413, 0.25689705, 0.02327635)),
        ("right_thigh", (0.016691, -0.192997, -0.454075), (0.24083413, 0.25689705, 0.02327635)),
        ("left_shank", (-0.0220708, 0.1394076, -0.866577), (0.08693568, 0.09158407, 0.01401727)),
        ("left_foot", (0.0267828, 0.1426478, -1.1323569), (0.00641532, 0.01799426, 0.02093584)),
        ("right_foot", (0.0267828, -0.1327614, -1.1323569), (0.00641532, 0.01799426, 0.02093584)),
    ],
)
def test_com_and_inertia_of_a_body_are_those_of_its_links(robot: Robot, body: str, com: tuple, inertia: tuple) -> None:
    """Composite figures of the URDF at zero angles: CoM in the root frame [m], diagonal about it [kg m^2]."""
    model = robot.model()
    data = posed(robot, model, height=0.0)
    rotation = data.body(body).ximat.reshape(3, 3)
    turned = rotation @ np.diag(model.body(body).inertia) @ rotation.T
    np.testing.assert_allclose(data.body(body).xipos, com, rtol=0, atol=1e-6)
    np.testing.assert_allclose(np.diag(turned), inertia, rtol=1e-5)


def test_com_and_inertia_of_the_whole_straight_robot_are_the_urdfs(robot: Robot) -> None:
    model = robot.model()
    data = posed(robot, model, height=0.0)
    # Sum over the 31 links of the URDF, root frame, arms and head locked.
    np.testing.assert_allclose(data.subtree_com[1], (-0.0126297, -0.0004727, -0.0672277), rtol=0, atol=2e-6)
    inertia = np.zeros((3, 3))
    for body in range(1, model.nbody):
        rotation = data.ximat[body].reshape(3, 3)
        offset = data.xipos[body] - data.subtree_com[1]
        steiner = model.body_mass[body] * (offset @ offset * np.eye(3) - np.outer(offset, offset))
        inertia += rotation @ np.diag(model.body_inertia[body]) @ rotation.T + steiner
    np.testing.assert_allclose(np.diag(inertia), (32.6548546, 28.3284955, 5.9326800), rtol=1e-5)


def test_joints_come_in_the_order_torso_left_leg_right_leg(robot: Robot) -> None:
    assert robot.joint_names == JOINTS
    assert robot.num_joints == 11
    model = robot.model()
    # The joints stand in the state vector in the same order as in an action.
    assert [model.joint(name).qposadr[0] - 7 for name in JOINTS] == list(range(11))


def test_joint_ranges_are_the_urdfs(robot: Robot) -> None:
    for i, name in enumerate(robot.joint_names):
        expected = RANGES.get(name) or RANGES[robot.joint_groups[robot.joint_names.index(name)]]
        assert (robot.joint_lower[i], robot.joint_upper[i]) == expected, name


def test_the_sole_is_the_box_of_the_urdf(robot: Robot) -> None:
    model = robot.model()
    np.testing.assert_array_equal(robot.sole_half_size, [0.27 / 2, 0.16 / 2])
    for side in ("left", "right"):
        foot, site = model.geom(f"{side}_foot"), model.site(f"{side}_sole")
        np.testing.assert_array_equal(foot.size, [0.27 / 2, 0.16 / 2, 0.064 / 2])
        np.testing.assert_array_equal(foot.pos, [0.045, 0.0, -0.056])
        np.testing.assert_array_equal(site.pos, [0.045, 0.0, -0.088])  # the box's lower face


def test_left_and_right_are_mirror_images(robot: Robot) -> None:
    model = robot.model()
    mirror_y = np.array([1.0, -1.0, 1.0])
    for i in range(model.nbody):
        left = model.body(i)
        if not left.name.startswith("left_"):
            continue
        right = model.body(left.name.replace("left", "right"))
        assert left.mass == right.mass
        np.testing.assert_allclose(left.pos, mirror_y * right.pos, atol=1e-12)
        # NASA's feet (y = 0.00495 m) and shanks (0.0017 m) are the same part on both sides, not mirrored ones.
        np.testing.assert_allclose(left.ipos, mirror_y * right.ipos, atol=2 * 0.005)
        np.testing.assert_allclose(np.sort(left.inertia), np.sort(right.inertia), rtol=1e-6)
    for i in range(model.ngeom):
        left_geom = model.geom(i)
        if left_geom.name.startswith("left_"):
            right_geom = model.geom(left_geom.name.replace("left", "right"))
            np.testing.assert_allclose(left_geom.size, right_geom.size, rtol=1e-12)
            np.testing.assert_allclose(left_geom.pos, mirror_y * right_geom.pos, atol=1e-12)
    left_leg, right_leg = slice(1, 6), slice(6, 11)
    rolls = np.array([name.endswith("roll") for name in LEG])
    upper = np.where(rolls, -robot.joint_lower[right_leg], robot.joint_upper[right_leg])
    lower = np.where(rolls, -robot.joint_upper[right_leg], robot.joint_lower[right_leg])
    np.testing.assert_array_equal(robot.joint_upper[left_leg], upper)
    np.testing.assert_array_equal(robot.joint_lower[left_leg], lower)
    for per_joint in (robot.stiffness, robot.damping, robot.torque_limit, robot.velocity_limit):
        np.testing.assert_array_equal(per_joint[left_leg], per_joint[right_leg])


def test_pushable_bodies_are_the_bodies_they_are_called_after(robot: Robot) -> None:
    legs = {f"{side}_{part}" for side in ("left", "right") for part in ("thigh", "shank")}
    assert set(robot.pushable) == {"root", "pelvis", "torso"} | legs
    for word, body in robot.pushable.items():
        assert body == ("pelvis" if word == "root" else word)
        assert robot.body_names[robot.body_id(word)] == body


def test_visual_shapes_change_neither_masses_nor_a_single_bit_of_the_motion(robot: Robot) -> None:
    plain, visual = robot.model(), robot.model(visual=True)
    assert visual.ngeom > plain.ngeom
    np.testing.assert_array_equal(plain.body_mass, visual.body_mass)
    np.testing.assert_array_equal(plain.body_inertia, visual.body_inertia)
    runs = []
    for model in (plain, visual):
        data = posed(robot, model, height=1.3, left_hip_roll=0.2, right_knee_pitch=0.9)
        data.qvel[:6] = (0.5, -0.3, 0.0, 0.4, -0.6, 0.2)
        for _ in range(400):  # falls, lands, topples
            mujoco.mj_step(model, data)
        assert data.ncon > 0
        runs.append(np.concatenate([data.qpos, data.qvel]))
    np.testing.assert_array_equal(runs[0], runs[1])


# What touches what.


@pytest.mark.parametrize("pose", ["straight", "bent"])
def test_nominal_poses_touch_nothing_of_themselves(robot: Robot, pose: str) -> None:
    model = robot.model()
    data = posed(robot, model, **dict(zip(robot.joint_names, robot.pose(pose), strict=True)))
    assert contacts(model, data) == set()


def test_a_leg_collides_with_the_other_leg(robot: Robot) -> None:
    model = robot.model()
    # 0.2 rad inwards over a leg of 0.99 m moves each sole by 0.2 m; their inner edges are 0.115 m apart.
    data = posed(robot, model, left_hip_roll=-0.2, right_hip_roll=0.2)
    pairs = {("left_thigh", "right_thigh"), ("left_shank", "right_shank"), ("left_foot", "right_foot")}
    assert contacts(model, data) == pairs


def test_a_leg_collides_with_the_body(robot: Robot) -> None:
    model = robot.model()
    # Knees to the chest, and the straight leg's foot to the face.
    for side in ("left", "right"):
        data = posed(robot, model, torso_pitch=0.666, **{f"{side}_hip_pitch": -2.42})
        assert contacts(model, data) == {(f"{side}_thigh", "chest"), ("head", f"{side}_foot")}


def test_legs_driven_into_each_other_stop_at_the_skin(robot: Robot) -> None:
    engine = MujocoEngine(robot, 1, num_threads=1)
    inwards = robot.pose("straight").copy()
    inwards[robot.joint_names.index("left_hip_roll")] = -0.4
    inwards[robot.joint_names.index("right_hip_roll")] = 0.4
    engine.reset(np.array([0]), robot.pose("straight")[None], height=5.0)
    for _ in range(12):
        ticks = step_to(engine, np.tile(inwards, (1, TICKS_PER_STEP, 1)))
    # Freely they would end 0.99 m * sin(0.4) = 0.39 m inwards of their place, 0.27 m past each other. The feet's
    # inner faces may not pass each other by more than 1 cm.
    gap = ticks.sole_position[0, -1, 0] - ticks.sole_position[0, -1, 1]
    assert abs(gap[1]) > 2 * robot.sole_half_size[1] - 0.01
    assert not ticks.foot_contact.any()


def test_thighs_pass_the_root_that_carries_them(robot: Robot) -> None:
    model = robot.model()
    for pitch in np.linspace(-1.6, 1.619, 9):
        data = posed(robot, model, left_hip_pitch=pitch)
        assert not {pair for pair in contacts(model, data) if robot.root in pair}, pitch


def test_sliding_feet_are_braked_by_a_friction_of_one(robot: Robot) -> None:
    engine = MujocoEngine(robot, 2, num_threads=1)
    engine.reset(np.arange(2), np.tile(robot.pose("straight"), (2, 1)))
    _, qvel = engine.state
    qvel[0, 0], qvel[1, 1] = 3.0, -2.0
    ratios = []
    for _ in range(5):
        ticks = step_to(engine, np.tile(robot.pose("straight"), (2, TICKS_PER_STEP, 1)))
        for foot in ("left", "right"):
            force = ticks[f"{foot}_foot_contact"][..., 1:4]
            loaded = force[..., 2] > 50.0
            ratios.append(np.hypot(force[..., 0], force[..., 1])[loaded] / force[..., 2][loaded])
    # Elliptic cone: |tangential| <= mu * normal with mu = 1, and equal to it while a foot slides.
    assert np.concatenate(ratios).max() == pytest.approx(1.0, abs=1e-6)


def test_friction_at_a_tenth_of_its_limit_holds_a_standing_robots_feet(robot: Robot) -> None:
    """Legs that push a little outwards load the soles sideways; feet that creep would be taken for steps."""
    engine = MujocoEngine(robot, 1, num_threads=1)
    pose = robot.pose("straight").copy()
    pose[robot.joint_names.index("left_hip_roll")] = 0.03
    pose[robot.joint_names.index("right_hip_roll")] = -0.03
    engine.reset(np.array([0]), robot.pose("straight")[None])
    targets = np.tile(pose, (1, TICKS_PER_STEP, 1))
    for _ in range(25):
        ticks = step_to(engine, targets)
    place = ticks.sole_position[0, -1, :, :2].copy()
    for _ in range(125):
        ticks = step_to(engine, targets)
    force = ticks["left_foot_contact"][0, -1, 1:4]
    assert 10.0 < np.hypot(force[0], force[1]) < 0.15 * force[2]
    # 5 s: a trial of 10 s must stay well below its threshold for a step, 30 mm.
    shift = float(np.linalg.norm(ticks.sole_position[0, -1, :, :2] - place, axis=-1).max())
    assert shift < 0.001


# Names that users give.


def test_an_unknown_robot_is_answered_with_the_known_ones() -> None:
    with pytest.raises(UserError) as error:
        load_robot("atlas")
    assert str(error.value) == "unknown robot 'atlas'; valid: g1, g1_arms, h1, valkyrie, or a description (.toml)"


def test_an_unknown_pose_is_answered_with_the_known_ones(robot: Robot) -> None:
    with pytest.raises(UserError) as error:
        robot.pose("crouched")
    assert str(error.value) == "unknown pose 'crouched' of valkyrie; valid: straight, bent"


def test_an_unknown_body_is_answered_with_the_known_ones(robot: Robot) -> None:
    with pytest.raises(UserError) as error:
        robot.body_id("head")
    valid = "pelvis, torso, left_thigh, right_thigh, left_shank, right_shank"
    assert str(error.value) == f"unknown body 'head' of valkyrie; valid: {valid}"


def test_poses_stay_within_the_joint_ranges_and_left_equals_right(robot: Robot) -> None:
    np.testing.assert_array_equal(robot.pose("straight"), np.zeros(11))
    bent = robot.pose("bent")
    assert (bent >= robot.joint_lower).all()
    assert (bent <= robot.joint_upper).all()
    np.testing.assert_array_equal(bent[1:6], bent[6:11])
    # The soles stay flat: hip + knee + ankle pitch = -0.19 + 0.5 - 0.31 = 0
    assert bent[2] + bent[3] + bent[4] == pytest.approx(0.0, abs=1e-12)
    assert bent[3] == 0.5


def test_a_joints_group_is_what_its_name_shares_with_its_mirror_image(robot: Robot) -> None:
    one_side = ["hip_roll", "hip_pitch", "knee_pitch", "ankle_pitch", "ankle_roll"]
    assert list(robot.joint_groups) == ["torso_pitch", *one_side, *one_side]
