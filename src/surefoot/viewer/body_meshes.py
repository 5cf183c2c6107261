"""Body meshes: the robot's visible shapes as one GLB per body, in the model's own materials."""

from __future__ import annotations

import re

import mujoco
import numpy as np
import trimesh
from trimesh.visual.material import PBRMaterial

from surefoot.robot import Robot

COARSE = 16
"""Segments per turn of the shapes of a crowd; a few robots have the model's own 40 to 60."""
_VISUAL_GROUP = 2
_METALLIC = 0.6
"""Materials with a larger specular share are metal."""


def visual_model(robot: Robot, *, coarse: bool = False) -> mujoco.MjModel:
    """The model with all that is looked at; `coarse` has about a tenth of the triangles."""
    spec_xml = robot.xml
    if coarse:
        spec_xml = re.sub(r'(builtin="(?:supersphere|cone|supertorus)" params=")\d+', rf"\g<1>{COARSE}", spec_xml)
    return mujoco.MjModel.from_xml_string(spec_xml)


def body_glbs(model: mujoco.MjModel, opacity: float = 1.0) -> dict[int, bytes]:
    """MuJoCo body id -> its shapes in the body's frame as a binary GLB, for every body that has any."""
    glbs = {}
    for body in range(1, model.nbody):
        geoms = [g for g in range(model.ngeom) if model.geom_bodyid[g] == body and model.geom_group[g] == _VISUAL_GROUP]
        if geoms:
            glbs[body] = _glb(model, geoms, opacity)
    return glbs


def _glb(model: mujoco.MjModel, geoms: list[int], opacity: float) -> bytes:
    """One mesh per material: a browser draws each of them in one go for all robots."""
    by_material: dict[int, list[trimesh.Trimesh]] = {}
    for geom in geoms:
        by_material.setdefault(int(model.geom_matid[geom]), []).append(_placed_shape(model, geom))
    scene = trimesh.Scene()
    for material, shapes in by_material.items():
        vertices, faces, normals, first = [], [], [], 0
        for shape in shapes:
            vertices.append(shape.vertices)
            faces.append(shape.faces + first)
            normals.append(shape.vertex_normals)
            first += len(shape.vertices)
        whole = trimesh.Trimesh(
            np.concatenate(vertices), np.concatenate(faces), vertex_normals=np.concatenate(normals), process=False
        )
        whole.visual = trimesh.visual.TextureVisuals(material=_material(model, material, opacity))
        scene.add_geometry(whole)
    return scene.export(file_type="glb", include_normals=True)


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


def _material(model: mujoco.MjModel, material: int, opacity: float) -> PBRMaterial:
    rgba = model.mat_rgba[material].copy() if material >= 0 else np.array([0.7, 0.7, 0.7, 1.0])
    specular = float(model.mat_specular[material]) if material >= 0 else 0.3
    shininess = float(model.mat_shininess[material]) if material >= 0 else 0.3
    emission = float(model.mat_emission[material]) if material >= 0 else 0.0
    # glTF colours are linear, MuJoCo's are as seen.
    linear = np.append(rgba[:3] ** 2.2, opacity)
    return PBRMaterial(
        baseColorFactor=linear,
        metallicFactor=0.75 if _METALLIC < specular < 1.0 else 0.05,
        roughnessFactor=1.0 - 0.75 * shininess,
        emissiveFactor=emission * linear[:3],
        alphaMode="OPAQUE" if opacity >= 1.0 else "BLEND",
    )
