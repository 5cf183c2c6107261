"""The URDF of every robot against its compiled model, as PyBullet has read it."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pybullet
import pytest
from scipy.spatial.transform import Rotation

from surefoot.errors import UserError
from surefoot.physics.pybullet_world import BulletWorld
from surefoot.robots import Robot, load_robot
from surefoot.robots.domain import NOMINAL_DOMAIN, DomainParameters
from surefoot.robots.urdf import urdf_of

TIPTOE = str(Path(__file__).parent / "robots" / "tiptoe" / "tiptoe.toml")
SEED = 3
EXACT = {mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_CAPSULE}


class Loaded:
    """A robot in Bullet and in MuJoCo, both in the same random state."""

    def __init__(self, robot: Robot, domain: DomainParameters = NOMINAL_DOMAIN):
        self.robot, self.world, self.model = robot, BulletWorld(robot, domain), robot.model(domain)
        rng, data = np.random.default_rng(SEED), mujoco.MjData(self.model)
        data.qpos[:3], data.qpos[3:7] = [0.3, -0.2, 2.0], Rotation.random(rng=rng).as_quat(scalar_first=True)
        data.qpos[7:] = rng.uniform(robot.joint_lower, robot.joint_upper)
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_comPos(self.model, data)
        self.data = data
        self.world._place(data.qpos)

    @property
    def bodies(self) -> list[tuple[int, int]]:
        """MuJoCo's and Bullet's number of every body but the root."""
        names = self.robot.body_names
        return [(self.model.body(name).id, self.world._links[name]) for name in names if name != self.robot.root]

    def of_link(self, function: str, link: int) -> tuple:
        return getattr(pybullet, function)(self.world._body, link, physicsClientId=self.world._client)


@pytest.fixture(scope="module", params=["valkyrie", "g1", "h1", TIPTOE], ids=["valkyrie", "g1", "h1", "tiptoe"])
def loaded(request: pytest.FixtureRequest) -> Loaded:
    return Loaded(load_robot(request.param))


def test_every_link_is_where_its_body_is_with_all_joints_turned(loaded: Loaded) -> None:
    for body, link in loaded.bodies:
        com, _, _, _, place, turn = loaded.of_link("getLinkState", link)[:6]
        name = loaded.model.body(body).name
        np.testing.assert_allclose(com, loaded.data.xipos[body], atol=1e-6, err_msg=name)
        np.testing.assert_allclose(place, loaded.data.xpos[body], atol=1e-6, err_msg=name)
        expected = loaded.data.xmat[body].reshape(3, 3)
        np.testing.assert_allclose(Rotation.from_quat(turn).as_matrix(), expected, atol=1e-6, err_msg=name)
    root, _ = pybullet.getBasePositionAndOrientation(loaded.world._body, physicsClientId=loaded.world._client)
    np.testing.assert_allclose(root, loaded.data.xipos[1], atol=1e-6)


def test_masses_and_inertias_are_the_models_with_the_rotors_about_the_joint_axes(loaded: Loaded) -> None:
    model, data = loaded.model, loaded.data
    for body, link in [(1, -1), *loaded.bodies]:
        info = loaded.of_link("getDynamicsInfo", link)
        assert info[0] == pytest.approx(model.body_mass[body], rel=1e-6, abs=1e-12)
        turn = _world_axes(loaded, link)
        # In the world: R diag(I) R^T of the body, plus armature * a a^T for each of its joints' axes a.
        own = data.ximat[body].reshape(3, 3)
        expected = own @ np.diag(model.body_inertia[body]) @ own.T
        for joint in np.flatnonzero((model.jnt_bodyid == body) & (model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE)):
            axis = data.xmat[body].reshape(3, 3) @ model.jnt_axis[joint]
            if model.body_jntnum[body] == 1:  # the axes of a body with several joints turn with those behind them
                expected += model.dof_armature[model.jnt_dofadr[joint]] * np.outer(axis, axis)
        if model.body_jntnum[body] <= 1 or body == 1:
            np.testing.assert_allclose(turn @ np.diag(info[2]) @ turn.T, expected, atol=1e-6)


def _world_axes(loaded: Loaded, link: int) -> np.ndarray:
    if link < 0:
        _, turn = pybullet.getBasePositionAndOrientation(loaded.world._body, physicsClientId=loaded.world._client)
    else:
        turn = loaded.of_link("getLinkState", link)[1]
    return Rotation.from_quat(turn).as_matrix()


def test_axes_ranges_and_the_limits_of_the_motors_are_the_robots(loaded: Loaded) -> None:
    robot, model = loaded.robot, loaded.model
    tree = ElementTree.fromstring(urdf_of(model).text)
    joints = {joint.get("name"): joint for joint in tree.iter("joint") if joint.get("type") == "revolute"}
    assert list(joints) == list(robot.joint_names)
    for i, name in enumerate(robot.joint_names):
        axis = np.array(joints[name].find("axis").get("xyz").split(), float)
        np.testing.assert_allclose(axis, model.jnt_axis[model.joint(name).id], atol=1e-6)
        limit = {key: float(value) for key, value in joints[name].find("limit").attrib.items()}
        expected = {
            "lower": robot.joint_lower[i],
            "upper": robot.joint_upper[i],
            "effort": robot.torque_limit[i],
            "velocity": robot.velocity_limit[i],
        }
        assert limit == pytest.approx(expected, rel=1e-6)
        read = loaded.of_link("getJointInfo", loaded.world._joint_numbers[i])
        assert read[8:12] == pytest.approx(list(expected.values()), rel=1e-6)


def test_every_shape_is_as_far_from_the_floor_as_in_mujoco(loaded: Loaded) -> None:
    """2 m above it: the lowest point of each body's shapes, whatever their kinds."""
    model, data, world = loaded.model, loaded.data, loaded.world
    floor = model.geom("floor").id
    distance: dict[int, float] = {}
    for geom in range(model.ngeom):
        if geom != floor and (model.geom_contype[geom] or model.geom_conaffinity[geom]):
            found = mujoco.mj_geomDistance(model, data, floor, geom, 10.0, None)
            body = int(model.geom_bodyid[geom])
            distance[body] = min(found, distance.get(body, np.inf))
    assert len(distance) >= 8
    for body, expected in distance.items():
        link = world._links[model.body(body).name]
        points = pybullet.getClosestPoints(
            world._body, world._floor, 10.0, linkIndexA=link, physicsClientId=world._client
        )
        kinds = {mujoco.mjtGeom(kind) for kind in model.geom_type[model.geom_bodyid == body]}
        margin = 1e-6 if kinds <= EXACT else 0.0011  # Bullet wraps meshes and cylinders in a skin of 1 mm
        assert min(p[8] for p in points) == pytest.approx(expected, abs=margin), model.body(body).name


def test_without_rotors_the_mass_matrix_of_the_joints_is_mujocos(robot: Robot) -> None:
    """Armature is what URDF cannot say: without it, both engines have the same dynamics."""

    def build() -> mujoco.MjSpec:
        spec = robot.build()
        for joint in spec.joints:
            joint.armature = 0.0
        return spec

    bare = Loaded(dataclasses.replace(robot, build=build))
    full = np.zeros((bare.model.nv, bare.model.nv))
    mujoco.mj_makeM(bare.model, bare.data)
    mujoco.mj_fullM(bare.model, bare.data, full)
    angles = bare.data.qpos[7:].tolist()
    found = pybullet.calculateMassMatrix(bare.world._body, angles, physicsClientId=bare.world._client)
    joints = np.array(found)[6:, 6:]
    order = np.argsort(np.argsort(bare.world._joint_numbers))
    np.testing.assert_allclose(joints[np.ix_(order, order)], full[6:, 6:], rtol=1e-6, atol=1e-6)


def test_a_world_with_heavier_bodies_has_a_heavier_urdf(robot: Robot) -> None:
    heavy = Loaded(robot, DomainParameters(mass_scale=1.1))
    masses = [heavy.of_link("getDynamicsInfo", link)[0] for link in range(-1, 11)]
    assert sum(masses) == pytest.approx(1.1 * robot.mass, rel=1e-9)


def test_a_shape_that_urdf_does_not_know_is_named() -> None:
    spec = mujoco.MjSpec()
    body = spec.worldbody.add_body(name="crate")
    body.add_freejoint()
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.1, 0.1, 0.1])
    model = spec.compile()
    assert '<box size="0.2 0.2 0.2" />' in urdf_of(model).text
    model.geom_type[0] = mujoco.mjtGeom.mjGEOM_PLANE
    with pytest.raises(UserError, match=r"^body 'crate' has a shape of the kind plane; valid in URDF: box, sphere, "):
        urdf_of(model)
