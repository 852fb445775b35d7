"""Pictures without a display: which OpenGL this machine has, and videos of what a policy does."""

import importlib
import os
import subprocess
import sys
from collections.abc import Iterable, Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from lfd_gym.errors import RenderingUnavailableError
from lfd_gym.paths import written_whole
from lfd_gym.rollout import Policy, rollout

HEADLESS = ("egl", "osmesa")
"""Back ends that need no display, the faster first."""
FRAMES_PER_SECOND = 25
PROBE = """
import mujoco
renderer = mujoco.Renderer(mujoco.MjModel.from_xml_string("<mujoco/>"), 16, 16)
renderer.render()
print("rendered", flush=True)
renderer.close()
"""
HOW_TO = (
    "no OpenGL to render with; on Debian or Ubuntu 'apt-get install libegl1 libgl1-mesa-dri' or 'apt-get install "
    "libosmesa6' gives one without a display (set MUJOCO_GL=egl, osmesa or glfw to choose yourself)"
)


def prepare() -> str:
    """Choose an OpenGL back end for MuJoCo, before or after it was imported, and return its name.

    Does nothing if there is a display or if the user set MUJOCO_GL. Otherwise EGL and then OSMesa are tried, each in a
    process of its own since a failed one cannot be unloaded. Raises RenderingUnavailableError.
    """
    chosen = os.environ.get("MUJOCO_GL")
    if chosen:
        return chosen
    if sys.platform != "linux" or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        return "glfw"
    backend = next((name for name in HEADLESS if works(name)), None)
    if backend is None:
        raise RenderingUnavailableError(HOW_TO)
    os.environ["MUJOCO_GL"] = backend
    for module in ("mujoco.rendering.classic.gl_context", "mujoco.gl_context"):
        if module in sys.modules:
            importlib.reload(sys.modules[module])
    return backend


@lru_cache
def works(backend: str) -> bool:
    """Whether MuJoCo can make an OpenGL context with this back end, tried in another process."""
    environment = os.environ | {"MUJOCO_GL": backend}
    environment.pop("PYOPENGL_PLATFORM", None)
    try:
        probe = subprocess.run([sys.executable, "-c", PROBE], env=environment, capture_output=True, timeout=60)
    except subprocess.TimeoutExpired:
        return False
    return b"rendered" in probe.stdout


def frames(env: Any, policy: Policy, seed: int) -> Iterator[np.ndarray]:
    """Pictures (height, width, 3) uint8 of one episode, 25 per simulated second; `env` renders rgb arrays.

    Raises RenderingUnavailableError where there is no OpenGL.
    """
    prepare()
    every = max(1, round(1.0 / (FRAMES_PER_SECOND * env.unwrapped.dt)))
    for i, _ in enumerate(rollout(env, policy, seed)):
        if i % every == 0:
            yield env.render()


def write_video(path: str | os.PathLike[str], pictures: Iterable[np.ndarray]) -> int:
    """Write pictures as one H.264 video, whole or not at all; returns how many there were."""
    import imageio_ffmpeg

    count, writer = 0, None
    with written_whole(path) as temporary:
        try:
            for picture in pictures:
                if writer is None:
                    writer = imageio_ffmpeg.write_frames(
                        str(temporary),
                        (picture.shape[1], picture.shape[0]),
                        fps=FRAMES_PER_SECOND,
                        macro_block_size=2,
                        quality=7,
                        ffmpeg_log_level="error",
                    )
                    writer.send(None)
                writer.send(np.ascontiguousarray(picture))
                count += 1
        finally:
            if writer is not None:
                writer.close()
    return count


def video_path(path: Path) -> Path:
    """The path with the extension .mp4 if it has none."""
    return path if path.suffix else path.with_suffix(".mp4")
