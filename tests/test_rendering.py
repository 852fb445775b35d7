"""Pictures and videos, and what a machine without OpenGL is told."""

import numpy as np
import pytest

from lfd_gym import cli, rendering
from lfd_gym.errors import RenderingUnavailableError
from lfd_gym.registry import make


def pictures(n: int, height: int = 48, width: int = 64):
    for i in range(n):
        yield np.full((height, width, 3), 10 * i, dtype=np.uint8)


@pytest.fixture
def without_opengl(monkeypatch) -> None:
    for name in ("MUJOCO_GL", "DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.setenv(name, "")
    monkeypatch.setattr(rendering, "works", lambda backend: False)


def test_a_video_is_written_whole(tmp_path) -> None:
    assert rendering.write_video(tmp_path / "video.mp4", pictures(7)) == 7
    assert (tmp_path / "video.mp4").read_bytes()[4:8] == b"ftyp"
    assert [path.name for path in tmp_path.iterdir()] == ["video.mp4"]


def test_a_video_that_breaks_off_leaves_nothing(tmp_path) -> None:
    def broken():
        yield from pictures(3)
        raise ValueError("the simulation broke")

    with pytest.raises(ValueError, match="broke"):
        rendering.write_video(tmp_path / "video.mp4", broken())
    with pytest.raises(RenderingUnavailableError, match="wrote nothing"):
        rendering.write_video(tmp_path / "video.mp4", pictures(0))
    assert list(tmp_path.iterdir()) == []


def test_the_users_choice_of_back_end_stands(monkeypatch) -> None:
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    assert rendering.prepare() == "osmesa"


def test_the_first_back_end_that_works_is_taken(without_opengl, monkeypatch) -> None:
    monkeypatch.setattr(rendering, "works", lambda backend: backend == "osmesa")
    monkeypatch.setattr(rendering.importlib, "reload", lambda module: module)
    assert rendering.prepare() == "osmesa"


def test_a_display_that_is_not_there_is_passed_over(without_opengl, monkeypatch) -> None:
    monkeypatch.setenv("DISPLAY", ":99")
    monkeypatch.setattr(rendering.importlib, "reload", lambda module: module)
    for working, chosen in (({"glfw", "egl"}, "glfw"), ({"egl"}, "egl")):
        monkeypatch.setenv("MUJOCO_GL", "")
        monkeypatch.setattr(rendering, "works", working.__contains__)
        assert rendering.prepare() == chosen


def test_without_opengl_the_user_learns_how_to_get_it(without_opengl, capsys, tmp_path) -> None:
    with pytest.raises(RenderingUnavailableError, match="libosmesa6"):
        rendering.prepare()
    assert cli.main(["render", "random", "move-object", "--out", str(tmp_path / "video.mp4")]) == 2
    assert "libosmesa6" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
    assert cli.main(["doctor"]) == 0
    assert "libosmesa6" in capsys.readouterr().out


@pytest.mark.skipif(not any(map(rendering.works, rendering.HEADLESS)), reason="this machine has no OpenGL")
def test_a_short_episode_is_filmed(monkeypatch, tmp_path) -> None:
    frames = rendering.frames
    monkeypatch.setattr(rendering, "frames", lambda *a: (f for f, _ in zip(frames(*a), range(2), strict=False)))
    assert cli.main(["render", "random", "move-object", "--out", str(tmp_path / "film")]) == 0
    assert (tmp_path / "film.mp4").stat().st_size > 1000


def test_a_window_shows_an_episode_no_faster_than_it_happens(monkeypatch) -> None:
    clock, drawn = [100.0], []

    class Window:
        user_scn = None

        def sync(self) -> None:
            drawn.append(clock[0])

    def sleep(seconds: float) -> None:
        clock[0] += seconds

    monkeypatch.setattr(rendering.time, "monotonic", lambda: clock[0])
    monkeypatch.setattr(rendering.time, "sleep", sleep)
    monkeypatch.setattr(rendering, "has_display", lambda: True)
    monkeypatch.setattr("mujoco.viewer.launch_passive", lambda *a, **k: Window())
    env = make("move-object", render_mode="human").unwrapped
    for _ in range(2):
        env.reset(seed=0)
        for _ in range(5):
            clock[0] += 0.001
            env.step(np.zeros(env.action_space.shape))
    shown = np.diff(drawn)
    np.testing.assert_allclose(shown[:5], env.dt)
    np.testing.assert_allclose(shown[6:], env.dt)
    assert shown[5] == 0.0
