"""OpenGL: the choice of a working way to draw without a window on this machine."""

from __future__ import annotations

import functools
import os
import platform
import subprocess
import sys

from surefoot.errors import UserError


@functools.cache
def gl_backend() -> str:
    """The OpenGL that draws without a window: MUJOCO_GL if it is set, else the first that works.

    Raises:
        UserError: none works.
    """
    wanted = os.environ.get("MUJOCO_GL", "").lower().strip()
    usual = {"Linux": ("egl", "osmesa", "glfw"), "Darwin": ("cgl", "glfw")}.get(platform.system(), ("glfw",))
    # Tried in another process: a backend that fails leaves PyOpenGL unfit for the next one.
    attempt = (
        "import mujoco; from mujoco.{} import GLContext; context = GLContext(8, 8); context.make_current();"
        "mujoco.MjrContext(mujoco.MjModel.from_xml_string('<mujoco/>'), 100)"
    )
    candidates = (wanted,) if wanted in usual else usual
    for backend in candidates:
        command = [sys.executable, "-c", attempt.format(backend)]
        if subprocess.run(command, capture_output=True, check=False).returncode == 0:
            return backend
    tried = f"MUJOCO_GL={wanted}" if wanted in usual else ", ".join(candidates)
    raise UserError(f"no OpenGL to draw with ({tried}); try: apt install libegl1 libgl1 (or libosmesa6)")
