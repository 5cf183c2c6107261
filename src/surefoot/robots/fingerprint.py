"""Fingerprint: twelve hexadecimal digits that name the physical facts of a compiled model."""

from __future__ import annotations

import hashlib

import mujoco
import numpy as np

SIGNIFICANT_DIGITS = 9
"""Numbers are rounded to this many digits, so that another compiler's last bit gives the same fingerprint."""

_OPTIONS = (
    "timestep", "gravity", "integrator", "cone", "jacobian", "solver", "impratio", "iterations", "tolerance",
    "ls_iterations", "ls_tolerance", "noslip_iterations", "noslip_tolerance", "ccd_iterations", "ccd_tolerance",
    "density", "viscosity", "wind", "magnetic", "disableflags", "enableflags",
)  # fmt: skip
_BODIES = ("parentid", "pos", "quat", "mass", "inertia", "ipos", "iquat", "gravcomp")
_JOINTS = ("type", "bodyid", "pos", "axis", "limited", "range", "stiffness", "margin", "solref", "solimp")
_DOFS = ("damping", "armature", "frictionloss", "solref", "solimp")
_ACTUATORS = (
    "trntype", "trnid", "gear", "dyntype", "gaintype", "biastype", "dynprm", "gainprm", "biasprm", "ctrllimited",
    "ctrlrange", "forcelimited", "forcerange", "damping", "armature",
)  # fmt: skip
_GEOMS = (
    "bodyid", "type", "size", "pos", "quat", "contype", "conaffinity", "condim", "friction", "priority", "margin",
    "gap", "solref", "solimp", "solmix",
)  # fmt: skip


def model_fingerprint(model: mujoco.MjModel) -> str:
    """The fingerprint of a model's masses, inertias, joints, motors, collision shapes, contacts and solver options.

    Names, colours, comments, sensors and shapes that collide with nothing do not count, nor does the order in which
    the shapes stand.
    """
    facts = [f"{name} {_text(getattr(model.opt, name))}" for name in _OPTIONS]
    facts += _rows(model, "body", _BODIES)
    facts += _rows(model, "jnt", _JOINTS)
    facts += _rows(model, "dof", _DOFS)
    facts += _rows(model, "actuator", _ACTUATORS)
    facts += sorted(row for geom, row in enumerate(_rows(model, "geom", _GEOMS)) if _collides(model, geom))
    facts += sorted(_mesh(model, geom) for geom in range(model.ngeom) if _is_mesh(model, geom))
    facts += sorted(f"exclude {_text(pair)}" for pair in model.exclude_signature)
    facts.append(f"others {model.neq} {model.ntendon} {model.npair}")
    return hashlib.sha256("\n".join(facts).encode()).hexdigest()[:12]


def _rows(model: mujoco.MjModel, kind: str, names: tuple[str, ...]) -> list[str]:
    """One line of numbers for each element of a kind."""
    columns = [getattr(model, f"{kind}_{name}") for name in names]
    return [f"{kind} " + " ".join(_text(column[i]) for column in columns) for i in range(len(columns[0]))]


def _collides(model: mujoco.MjModel, geom: int) -> bool:
    return bool(model.geom_contype[geom] or model.geom_conaffinity[geom])


def _is_mesh(model: mujoco.MjModel, geom: int) -> bool:
    return _collides(model, geom) and model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH


def _mesh(model: mujoco.MjModel, geom: int) -> str:
    """The vertices of a collision mesh."""
    mesh = int(model.geom_dataid[geom])
    first = int(model.mesh_vertadr[mesh])
    return f"mesh {_text(model.mesh_vert[first : first + int(model.mesh_vertnum[mesh])])}"


def _text(value: object) -> str:
    numbers = np.asarray(value, float).ravel() + 0.0  # never -0.0
    return " ".join(f"{number:.{SIGNIFICANT_DIGITS}g}" for number in numbers)
