"""Body meshes: the robot's visible shapes as one GLB per body, in the model's own materials."""

from __future__ import annotations

import re

import mujoco
import numpy as np
import trimesh
from PIL import Image
from trimesh.visual.material import PBRMaterial

from surefoot.robots import Robot

FINE, COARSE = 28, 14
"""Segments per turn of the shapes of a few robots and of a crowd; the model's own 40 to 60 are for pictures."""
_VISUAL_GROUP = 2
_METALLIC = 0.6
"""Materials with a larger specular share are metal."""


def visual_model(robot: Robot, *, coarse: bool = False) -> mujoco.MjModel:
    """The model with all that is looked at, in a third of its triangles; `coarse` has a tenth."""
    segments = COARSE if coarse else FINE
    xml = re.sub(
        r'(builtin="(?:supersphere|cone|supertorus)" params=")\d+', rf"\g<1>{segments}", robot.build().to_xml()
    )
    return mujoco.MjModel.from_xml_string(xml)


def body_glbs(model: mujoco.MjModel, opacity: float = 1.0) -> dict[int, bytes]:
    """MuJoCo body id -> its shapes in the body's frame as a binary GLB, for every body that has any."""
    material = _palette(model, opacity)
    glbs = {}
    for body in range(1, model.nbody):
        geoms = [g for g in range(model.ngeom) if model.geom_bodyid[g] == body and model.geom_group[g] == _VISUAL_GROUP]
        if geoms:
            glbs[body] = _glb(model, geoms, material)
    return glbs


def _glb(model: mujoco.MjModel, geoms: list[int], material: PBRMaterial) -> bytes:
    """One mesh with one material, which a browser draws in one go for all robots."""
    shapes = [_placed_shape(model, geom) for geom in geoms]
    first = np.cumsum([0, *(len(shape.vertices) for shape in shapes)])
    whole = trimesh.Trimesh(
        np.concatenate([shape.vertices for shape in shapes]),
        np.concatenate([shape.faces + number for shape, number in zip(shapes, first, strict=False)]),
        vertex_normals=np.concatenate([shape.vertex_normals for shape in shapes]),
        process=False,
    )
    # A material is a column of the palette.
    column = np.concatenate(
        [np.full(len(shape.vertices), model.geom_matid[geom]) for shape, geom in zip(shapes, geoms, strict=True)]
    )
    places = np.stack([(column + 0.5) / model.nmat, np.full(len(column), 0.5)], axis=1)
    whole.visual = trimesh.visual.TextureVisuals(uv=places, material=material)
    data = whole.export(file_type="glb", include_normals=True)
    assert isinstance(data, bytes)
    return data


def _placed_shape(model: mujoco.MjModel, geom: int) -> trimesh.Trimesh:
    shape = _shape(model, geom)
    place = np.eye(4)
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
    place[:3, :3], place[:3, 3] = rotation.reshape(3, 3), model.geom_pos[geom]
    return shape.apply_transform(place)


def _shape(model: mujoco.MjModel, geom: int) -> trimesh.Trimesh:
    size = model.geom_size[geom]
    kind = mujoco.mjtGeom(model.geom_type[geom])
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = model.mesh(model.geom_dataid[geom])
        first, count = int(mesh.vertadr[0]), int(mesh.vertnum[0])
        first_face, num_faces = int(mesh.faceadr[0]), int(mesh.facenum[0])
        vertices = model.mesh_vert[first : first + count]
        faces = model.mesh_face[first_face : first_face + num_faces]
        # Merged vertices give smooth normals.
        shape = trimesh.Trimesh(vertices, faces, process=True)
        shape.merge_vertices()
        return shape
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return _flat_shaded(trimesh.creation.cylinder(size[0], 2.0 * size[1], sections=32))
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return trimesh.creation.capsule(radius=size[0], height=2.0 * size[1], count=(24, 24))
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return _flat_shaded(trimesh.creation.box(extents=2.0 * size))
    ball = trimesh.creation.icosphere(subdivisions=3)
    return ball.apply_scale(size if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID else size[0])


def _flat_shaded(shape: trimesh.Trimesh) -> trimesh.Trimesh:
    """Edges stay sharp; without it normals would be averaged over them."""
    return trimesh.graph.smooth_shade(shape, angle=np.radians(40))


def _palette(model: mujoco.MjModel, opacity: float) -> PBRMaterial:
    """All materials of the model as one: textures with a column for each."""
    color = np.rint(255.0 * model.mat_rgba[None, :, :3]).astype(np.uint8)
    is_metal = (model.mat_specular > _METALLIC) & (model.mat_specular < 1.0)
    roughness = np.rint(255.0 * (1.0 - 0.75 * model.mat_shininess))
    surface = np.stack([np.zeros(model.nmat), roughness, np.where(is_metal, 190.0, 12.0)], axis=-1)
    glow = np.rint(color * model.mat_emission[:, None]).astype(np.uint8)
    return PBRMaterial(
        baseColorFactor=[1.0, 1.0, 1.0, opacity],
        baseColorTexture=Image.fromarray(color),
        metallicRoughnessTexture=Image.fromarray(surface.astype(np.uint8)[None]),
        metallicFactor=1.0,
        roughnessFactor=1.0,
        emissiveTexture=Image.fromarray(glow),
        emissiveFactor=[1.0, 1.0, 1.0],
        alphaMode="OPAQUE" if opacity >= 1.0 else "BLEND",
    )
