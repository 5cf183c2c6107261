"""Extras: the extra of an installation that provides a missing package."""

from __future__ import annotations

MODULES = {
    "torch": "learn",
    "stable_baselines3": "learn",
    "sb3_contrib": "learn",
    "tensorboard": "learn",
    "gymnasium": "learn",
    "wandb": "wandb",
    "viser": "viewer",
    "trimesh": "viewer",
    "websockets": "viewer",
    "msgspec": "viewer",
    "jinja2": "report",
    "pyarrow": "report",
    "matplotlib": "video",
    "PIL": "video",
    "OpenGL": "video",
    "imageio": "video",
    "imageio_ffmpeg": "video",
    "daqp": "controllers",
    "yaml": "foreign",
    "pybullet": "pybullet",
    "joblib": "processes",
    "ray": "ray",
    "distributed": "dask",
    "dask": "dask",
    "submitit": "slurm",
    "playwright": "dev",
}
"""Module -> the extra that brings it."""

_WIDER = {"video": ("report", "viewer"), "report": ("viewer",)}
"""Extra -> those that bring all of its packages that they have in common, too."""


def advice(module: str | None, wanted: str = "") -> str | None:
    """Return a line on a module that is missing, with the command that brings it.

    Args:
        module: that could not be imported.
        wanted: the extra of what was asked for, which is named instead of the module's own if it brings the module.

    Returns:
        The line; None for a module that no extra brings.
    """
    name = (module or "").partition(".")[0]
    if name not in MODULES:
        return None
    extra = MODULES[name]
    if wanted in _WIDER.get(extra, ()):
        extra = wanted
    return f"this needs {name}: pip install 'surefoot[{extra}]'"
