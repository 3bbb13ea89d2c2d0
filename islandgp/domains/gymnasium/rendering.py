"""Finds an OpenGL backend of MuJoCo that works on this machine, in a child process."""

from __future__ import annotations

import os
import subprocess
import sys
from functools import cache
from importlib.util import find_spec
from typing import Any, Final

BACKENDS: Final = ("egl", "osmesa", "glfw") if sys.platform == "linux" else ("glfw",)
PATIENCE: Final = 60.0  # time limit for a backend, s

RENDER: Final = """
from gymnasium.envs.mujoco.mujoco_rendering import OffScreenViewer
from mujoco import MjData, MjModel

model = MjModel.from_xml_string("<mujoco/>")
OffScreenViewer(model, MjData(model), 64, 64).render("rgb_array")
"""


def is_mujoco(env: Any) -> bool:
    """True for an environment of Gymnasium's MuJoCo family."""
    return hasattr(env.unwrapped, "mujoco_renderer")


def without_shadows(env: Any) -> Any:
    """The environment without shadows, with which a CPU renders ten times as fast."""
    quality = env.unwrapped.model.vis.quality
    quality.shadowsize = quality.offsamples = 0
    return env


def import_fault(message: str) -> str:
    """The reason why MuJoCo cannot be imported; "" for other errors.

    Args:
        message: of the error with which `gymnasium.make` failed.
    """
    if "gymnasium[mujoco]" in message:
        return "it needs the package mujoco; install it with pip install 'islandgp[mujoco]'"
    backend = os.environ.get("MUJOCO_GL")
    if backend and find_spec("mujoco") and "mujoco" not in sys.modules:
        return f"MuJoCo has no backend MUJOCO_GL={backend} here; unset it, or install its library"
    return ""


@cache
def choose_backend() -> bool:
    """Set `MUJOCO_GL` to the first backend that renders a frame; False if none does.

    If `MUJOCO_GL` is set, only this backend is tried. Each is tried in a child process, because
    MuJoCo may abort the rendering process without a display.
    """
    configured = os.environ.get("MUJOCO_GL")
    backend = next(
        (each for each in ((configured,) if configured else BACKENDS) if _renders(each)), ""
    )
    if backend:
        os.environ["MUJOCO_GL"] = backend
    return bool(backend)


def _renders(name: str) -> bool:
    """True if a frame is rendered with a backend."""
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-c", RENDER],
            env={**os.environ, "MUJOCO_GL": name},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            check=False,
            timeout=PATIENCE,
        )
    except (OSError, subprocess.TimeoutExpired):
        return False
    return done.returncode == 0
