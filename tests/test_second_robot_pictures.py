"""The second robot in pictures and on the live page: no materials, no sky, an STL mesh, a third of a man's height."""

from __future__ import annotations

import io

import numpy as np
import pytest
import trimesh
from conftest import TIPTOE

from surefoot.agents.nominal import NominalAgent
from surefoot.errors import UserError
from surefoot.evaluation.trials import Trial
from surefoot.physics.pushes import Push
from surefoot.rendering.framing import visible_geoms
from surefoot.rendering.opengl import gl_backend
from surefoot.rendering.recording import record
from surefoot.rendering.renderer import Renderer
from surefoot.rendering.scenery import drawn_model
from surefoot.rendering.words import pushable_words
from surefoot.robots import Robot, load_robot
from surefoot.viewer.body_meshes import body_glbs


@pytest.fixture(scope="module")
def tiptoe() -> Robot:
    return load_robot(TIPTOE)


def test_it_fills_the_picture_as_a_large_robot_does(tiptoe: Robot) -> None:
    try:
        gl_backend()
    except UserError as error:
        pytest.skip(str(error))
    moment = record(NominalAgent(tiptoe), Trial(Push(impulse=0.36), seed=1, full_length=False)).at(-0.2)
    with Renderer(tiptoe, 240, 320) as renderer:
        picture = renderer.draw(moment).astype(int)
    bright = np.argwhere((picture.min(axis=2) > 165) & (np.ptp(picture, axis=2) < 25))
    height, width = np.ptp(bright, axis=0)
    assert 0.5 * 320 < height < 0.95 * 320
    assert width < 0.6 * 240
    assert picture[:20].min() > 60, "a sky, and no black"


def test_its_shapes_reach_the_browser_as_large_as_they_are(tiptoe: Robot) -> None:
    model = drawn_model(tiptoe)
    glbs = body_glbs(tiptoe)
    assert set(glbs) == set((model.geom_bodyid[visible_geoms(model)] - 1).tolist())
    shank = tiptoe.body_names.index("shank_l")
    scene = trimesh.load(io.BytesIO(glbs[shank]), file_type="glb")
    geoms = [geom for geom in visible_geoms(model).tolist() if model.geom_bodyid[geom] == 1 + shank]
    reach = max(float(model.geom_rbound[geom] + np.linalg.norm(model.geom_pos[geom])) for geom in geoms)
    assert 0.05 < float(np.abs(scene.bounds).max()) <= reach + 1e-6


def test_its_pushable_bodies_are_offered_by_its_own_words(tiptoe: Robot) -> None:
    assert list(pushable_words(tiptoe).items()) == [
        ("base", "root"), ("trunk", "trunk"), ("left shank", "left_shank"), ("right shank", "right_shank"),
    ]  # fmt: skip
