"""Scenery: the sky, light, floor and colours that a robot's own file does not contain."""

from __future__ import annotations

import mujoco
import numpy as np

from surefoot.robots import Robot
from surefoot.robots.domain import NOMINAL_DOMAIN, DomainParameters
from surefoot.robots.model import FLOOR, compile_model

_UNCOLORED = (0.5, 0.5, 0.5, 1.0)
"""MuJoCo's colour of a geom that has none."""
_SHELL = (0.83, 0.85, 0.88, 1.0)
"""Colour of such a geom."""
_LIGHTS = (
    ((1.2, 0.9, 2.8), (-0.4, -0.3, -1.0), (0.5, 0.49, 0.47), True),
    ((0.0, 0.0, 4.0), (-0.3, 0.8, -0.5), (0.2, 0.21, 0.23), False),
    ((0.0, 0.0, 4.0), (0.8, 0.2, -0.5), (0.24, 0.25, 0.27), False),
)
"""Of each light: position, direction, colour, and whether it casts shadows."""


def drawn_model(robot: Robot, domain: DomainParameters = NOMINAL_DOMAIN) -> mujoco.MjModel:
    """The robot's model with all that is looked at: what its own file brings along, and the rest from here."""
    spec = robot.build()
    if not any(texture.type == mujoco.mjtTexture.mjTEXTURE_SKYBOX for texture in spec.textures):
        _add_sky(spec)
    if not spec.lights:
        _add_lights(spec, robot.root)
    floor = next(geom for geom in spec.geoms if geom.name == FLOOR)
    if not floor.material:
        _add_floor(spec, floor)
    for geom in spec.geoms:
        if not geom.material and np.allclose(geom.rgba, _UNCOLORED):
            geom.rgba = _SHELL
    return compile_model(spec, domain, visual=True)


def _add_sky(spec: mujoco.MjSpec) -> None:
    spec.add_texture(
        name="surefoot_sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[0.74, 0.78, 0.83],
        rgb2=[0.3, 0.36, 0.44],
        width=256,
        height=1536,
    )
    spec.visual.map.haze = 0.5
    spec.visual.rgba.haze = [0.53, 0.58, 0.64, 1.0]


def _add_lights(spec: mujoco.MjSpec, root: str) -> None:
    headlight = spec.visual.headlight
    headlight.ambient, headlight.diffuse, headlight.specular = [0.36, 0.36, 0.38], [0.2] * 3, [0.25] * 3
    spec.visual.quality.shadowsize, spec.visual.quality.offsamples, spec.visual.map.shadowclip = 4096, 8, 10.0
    for place, direction, color, casts_shadow in _LIGHTS:
        spec.body(root).add_light(
            type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
            mode=mujoco.mjtCamLight.mjCAMLIGHT_TRACKCOM,
            pos=place,
            dir=direction,
            diffuse=color,
            castshadow=casts_shadow,
        )


def _add_floor(spec: mujoco.MjSpec, floor: mujoco.MjsGeom) -> None:
    texture = spec.add_texture(
        name="surefoot_floor",
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        mark=mujoco.mjtMark.mjMARK_CROSS,
        rgb1=[0.36, 0.40, 0.45],
        rgb2=[0.42, 0.46, 0.51],
        markrgb=[0.75, 0.78, 0.82],
        width=512,
        height=512,
    )
    material = spec.add_material(name="surefoot_floor", texuniform=True, texrepeat=[2, 2], specular=0.1, shininess=0.1)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = texture.name
    floor.material, floor.rgba = material.name, [1.0, 1.0, 1.0, 1.0]
