"""Pictures without a display: which OpenGL this machine has, and videos of what a policy does."""

import importlib
import math
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from lfd_gym.errors import InvalidArgumentError, RenderingUnavailableError
from lfd_gym.paths import written_whole
from lfd_gym.rollout import Policy, rollout

Decorate = Callable[[Any], None]

HEADLESS = ("egl", "osmesa")
"""Back ends that need no display, the faster first."""
FRAMES_PER_SECOND = 25
SPEED_UP = 2
"""Videos play this much faster than the simulation's clock, or as near to it as the control step allows."""
SHADOW_SIZE, SAMPLES = 1024, 0
"""Quality of videos: on a machine without a graphics card, most of the time of a picture goes into these."""
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

    Does nothing if the user set MUJOCO_GL. Otherwise the display, if there is one, EGL and OSMesa are tried, each in a process
    of its own since a failed one cannot be unloaded. Raises RenderingUnavailableError.
    """
    chosen = os.environ.get("MUJOCO_GL")
    if chosen:
        return chosen
    if sys.platform != "linux":
        return "glfw"
    candidates = ("glfw", *HEADLESS) if has_display() else HEADLESS
    backend = next((name for name in candidates if works(name)), None)
    if backend is None:
        raise RenderingUnavailableError(HOW_TO)
    os.environ["MUJOCO_GL"] = backend
    for module in ("mujoco.rendering.classic.gl_context", "mujoco.gl_context"):
        if module in sys.modules:
            importlib.reload(sys.modules[module])
    return backend


def has_display() -> bool:
    """Whether windows can be shown."""
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


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


class OffscreenRenderer:
    """Pictures of a simulation as arrays."""

    def __init__(self, model: Any, data: Any, size: tuple[int, int], camera: str) -> None:
        """Make the OpenGL context; `size` is (height, width) [px] and `camera` one of the model's."""
        import mujoco

        height, width = size
        model.vis.global_.offwidth = max(model.vis.global_.offwidth, width)
        model.vis.global_.offheight = max(model.vis.global_.offheight, height)
        self._data, self._camera = data, camera
        try:
            self._renderer = mujoco.Renderer(model, height, width)
        except (mujoco.FatalError, ImportError, AttributeError, RuntimeError) as error:
            raise RenderingUnavailableError(HOW_TO) from error

    def frame(self, decorate: Decorate) -> np.ndarray:
        """The picture (height, width, 3) uint8 of this moment; `decorate` adds to the scene what is not physical."""
        self._renderer.update_scene(self._data, self._camera)
        decorate(self._renderer.scene)
        return self._renderer.render()

    def close(self) -> None:
        """Free the OpenGL context."""
        self._renderer.close()


class Viewer:
    """A window on a simulation."""

    def __init__(self, model: Any, data: Any) -> None:
        """Open MuJoCo's viewer beside the running program."""
        import mujoco.viewer

        self._data, self._began = data, -math.inf
        self._viewer = mujoco.viewer.launch_passive(model, data, show_left_ui=False, show_right_ui=False)

    def frame(self, decorate: Decorate) -> None:
        """Show this moment, not before its time has come: a second of the simulation lasts a second at least."""
        began = time.monotonic() - float(self._data.time)
        if 0.0 < (ahead := self._began - began) < 1.0:
            time.sleep(ahead)
        else:
            self._began = began
        if self._viewer.user_scn is not None:
            self._viewer.user_scn.ngeom = 0
            decorate(self._viewer.user_scn)
        self._viewer.sync()

    def close(self) -> None:
        """Close the window."""
        self._viewer.close()


def renderer(model: Any, data: Any, mode: str, size: tuple[int, int], camera: str) -> OffscreenRenderer | Viewer:
    """What draws a simulation in Gymnasium's render mode "rgb_array" or "human".

    Raises RenderingUnavailableError where there is no OpenGL, or no display for a window.
    """
    if mode == "human":
        if sys.platform == "linux" and not has_display():
            raise RenderingUnavailableError("no display for render_mode 'human'; render_mode 'rgb_array' needs none")
        return Viewer(model, data)
    prepare()
    return OffscreenRenderer(model, data, size, camera)


def frames(env: Any, policy: Policy, seed: int) -> Iterator[np.ndarray]:
    """Pictures (height, width, 3) uint8 of one episode for a video; `env` renders rgb arrays.

    Raises RenderingUnavailableError where there is no OpenGL.
    """
    prepare()
    quality = env.unwrapped.model.vis.quality
    quality.shadowsize, quality.offsamples = SHADOW_SIZE, SAMPLES
    every = steps_per_picture(env.unwrapped.dt)
    for i, _ in enumerate(rollout(env, policy, seed)):
        if i % every == 0:
            yield env.render()


def steps_per_picture(dt: float) -> int:
    """Control steps of `dt` [s] between two pictures of a video."""
    return max(1, round(SPEED_UP / (FRAMES_PER_SECOND * dt)))


def write_picture(path: str | os.PathLike[str], env: Any, policy: Policy, seed: int, seconds: float) -> None:
    """Write a picture of one episode after so many seconds, or of its end if that comes first."""
    from matplotlib.image import imsave

    for i, _ in enumerate(rollout(env, policy, seed), start=1):
        if i * env.unwrapped.dt >= seconds:
            break
    with written_whole(path) as temporary:
        imsave(temporary, env.render())


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
        if not temporary.stat().st_size:
            raise RenderingUnavailableError(f"ffmpeg wrote nothing of the {count} pictures for '{path}'")
    return count


def video_path(path: Path) -> Path:
    """The path with the extension .mp4 if it has none; InvalidArgumentError for one that is neither .mp4 nor .png."""
    path = path if path.suffix else path.with_suffix(".mp4")
    if path.suffix not in (".mp4", ".png"):
        raise InvalidArgumentError(f"'{path}' is neither a video (.mp4) nor a picture (.png)")
    return path
