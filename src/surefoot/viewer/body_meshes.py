"""Body meshes: the robot's visible shapes, with one GLB file per body in the model's own colours."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import trimesh
from PIL import Image
from trimesh import visual

from surefoot.rendering.framing import scale_of, visible_geoms
from surefoot.rendering.scenery import drawn_model
from surefoot.robots import Robot

# trimesh has no types for looks.
_Material: Any = visual.material.PBRMaterial
_Texture: Any = visual.TextureVisuals

FINE, COARSE = 0.013, 0.04
"""Smallest details of the shapes of a few robots and of a crowd [m], for a robot of `framing.REFERENCE_HEIGHT`."""
_METALLIC = 0.6
"""Materials with a larger specular share are metal."""
_PLAIN = (0.0, 0.5, 0.4)
"""Emission, specular share and shininess of a geom that has a colour but no material."""


@functools.cache
def body_glbs(robot: Robot, *, coarse: bool = False, opacity: float = 1.0) -> dict[int, bytes]:
    """The shapes of every body that has visible ones: index into `Robot.body_names` -> a binary GLB in its frame.

    Args:
        robot: robot with these bodies.
        coarse: fewer triangles, for a crowd.
        opacity: 1 hides what is inside.
    """
    model = drawn_model(robot)
    geoms = visible_geoms(model)
    palette = _Palette.of(model, geoms)
    material = palette.material(opacity)
    detail = scale_of(robot) * (COARSE if coarse else FINE)
    return {
        body - 1: _glb(model, geoms[model.geom_bodyid[geoms] == body].tolist(), palette, material, detail)
        for body in np.unique(model.geom_bodyid[geoms]).tolist()
    }


@dataclass(frozen=True)
class _Palette:
    """The looks of all geoms as columns of one texture, so that a body is drawn in one go.

    Attributes:
        column: of each visible geom.
        looks: red, green, blue, emission, specular share and shininess (num_columns, 6), 0 to 1.
    """

    column: dict[int, int]
    looks: np.ndarray

    @classmethod
    def of(cls, model: mujoco.MjModel, geoms: np.ndarray) -> _Palette:
        looks = np.array([_look(model, geom) for geom in geoms.tolist()])
        different, column = np.unique(looks, axis=0, return_inverse=True)
        return cls(dict(zip(geoms.tolist(), column.ravel().tolist(), strict=True)), different)

    def place(self, geom: int) -> np.ndarray:
        """Where the geom's look is in the texture (2,)."""
        return np.array([(self.column[geom] + 0.5) / len(self.looks), 0.5])

    def material(self, opacity: float) -> Any:
        """All looks as one material; trimesh has no types for it."""
        color = np.rint(255.0 * self.looks[None, :, :3]).astype(np.uint8)
        emission, specular, shininess = self.looks[:, 3:].T
        is_metal = (specular > _METALLIC) & (specular < 1.0)
        roughness = np.rint(255.0 * (1.0 - 0.75 * shininess))
        surface = np.stack([np.zeros(len(self.looks)), roughness, np.where(is_metal, 190.0, 12.0)], axis=-1)
        glow = np.rint(color * emission[:, None]).astype(np.uint8)
        return _Material(
            baseColorFactor=[1.0, 1.0, 1.0, opacity],
            baseColorTexture=Image.fromarray(color),
            metallicRoughnessTexture=Image.fromarray(surface.astype(np.uint8)[None]),
            metallicFactor=1.0,
            roughnessFactor=1.0,
            emissiveTexture=Image.fromarray(glow),
            emissiveFactor=[1.0, 1.0, 1.0],
            alphaMode="OPAQUE" if opacity >= 1.0 else "BLEND",
        )


def _look(model: mujoco.MjModel, geom: int) -> list[float]:
    """Red, green, blue, emission, specular share and shininess: the material's, else the geom's own colour."""
    material = model.geom_matid[geom]
    if material < 0:
        return [*model.geom_rgba[geom, :3].tolist(), *_PLAIN]
    light = (model.mat_emission[material], model.mat_specular[material], model.mat_shininess[material])
    return [*model.mat_rgba[material, :3].tolist(), *map(float, light)]


def _glb(model: mujoco.MjModel, geoms: list[int], palette: _Palette, material: Any, detail: float) -> bytes:
    """One mesh with one material, which a browser draws in one go for all robots."""
    shapes = [_placed_shape(model, geom, detail) for geom in geoms]
    first = np.cumsum([0, *(len(shape.vertices) for shape in shapes)])
    whole = trimesh.Trimesh(
        np.concatenate([shape.vertices for shape in shapes]),
        np.concatenate([shape.faces + number for shape, number in zip(shapes, first, strict=False)]),
        vertex_normals=np.concatenate([shape.vertex_normals for shape in shapes]),
        process=False,
    )
    places = [np.tile(palette.place(geom), (len(s.vertices), 1)) for s, geom in zip(shapes, geoms, strict=True)]
    whole.visual = _Texture(uv=np.concatenate(places), material=material)
    data = whole.export(file_type="glb", include_normals=True)
    assert isinstance(data, bytes)
    return data


def _placed_shape(model: mujoco.MjModel, geom: int, detail: float) -> trimesh.Trimesh:
    """A geom's shape in its body's frame."""
    shape = _shape(model, geom, detail)
    place = np.eye(4)
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
    place[:3, :3], place[:3, 3] = rotation.reshape(3, 3), model.geom_pos[geom]
    shape.apply_transform(place)
    return shape


def _shape(model: mujoco.MjModel, geom: int, detail: float) -> trimesh.Trimesh:
    """A geom's shape in its own frame."""
    size = model.geom_size[geom]
    kind = mujoco.mjtGeom(model.geom_type[geom])
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        return _mesh(model, int(model.geom_dataid[geom]), detail)
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return _flat_shaded(trimesh.creation.cylinder(size[0], 2.0 * size[1], sections=32))
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        capsule: trimesh.Trimesh = trimesh.creation.capsule(radius=size[0], height=2.0 * size[1], count=(24, 24))
        return capsule
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return _flat_shaded(trimesh.creation.box(extents=2.0 * size))
    ball = trimesh.creation.icosphere(subdivisions=3)
    ball.apply_scale(size if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID else size[0])
    return ball


def _mesh(model: mujoco.MjModel, number: int, detail: float) -> trimesh.Trimesh:
    """A mesh of the model without details smaller than `detail` [m]."""
    first, first_face = model.mesh_vertadr[number], model.mesh_faceadr[number]
    vertices = model.mesh_vert[first : first + model.mesh_vertnum[number]]
    faces = model.mesh_face[first_face : first_face + model.mesh_facenum[number]]
    whole = trimesh.Trimesh(vertices, faces, process=True)
    whole.merge_vertices()
    return _simplified(_flat_shaded(whole), detail)


def _simplified(shape: trimesh.Trimesh, detail: float) -> trimesh.Trimesh:
    """One vertex for all of a cube of this size that look the same way; the triangles between them keep their shading.

    Vertices stay on the surface, so that one shape close over another one goes on hiding it.
    """
    normals = shape.vertex_normals
    cubes = np.column_stack([np.floor(shape.vertices / detail), np.rint(normals)])
    _, cube = np.unique(cubes, axis=0, return_inverse=True)
    cube = cube.ravel()
    count = np.bincount(cube)[:, None]
    middle = np.stack([np.bincount(cube, axis) for axis in shape.vertices.T], axis=1) / count
    distance = np.linalg.norm(shape.vertices - middle[cube], axis=1)
    order = np.lexsort((distance, cube))
    kept = order[np.searchsorted(cube[order], np.arange(len(count)))]
    faces = cube[shape.faces]
    is_face = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    return trimesh.Trimesh(shape.vertices[kept], faces[is_face], vertex_normals=normals[kept], process=False)


def _flat_shaded(shape: trimesh.Trimesh) -> trimesh.Trimesh:
    """The same shape with sharp edges; without it normals would be averaged over them."""
    shaded: trimesh.Trimesh = trimesh.graph.smooth_shade(shape, angle=np.radians(40))
    return shaded
