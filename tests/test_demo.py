"""The main job, small: from teaching to a report, also where nothing can be rendered."""

import json

import pytest

from lfd_gym import cli, rendering
from lfd_gym.demonstration import load_demonstrations


@pytest.mark.slow
def test_the_demo_writes_a_report_without_opengl(monkeypatch, capsys, tmp_path) -> None:
    for name in ("MUJOCO_GL", "DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.setenv(name, "")
    monkeypatch.setattr(rendering, "works", lambda backend: False)
    monkeypatch.setattr(cli, "EPISODES", 2)
    assert cli.main(["demo", "--env", "move-object", "--out", str(tmp_path / "report"), "--jobs", "1"]) == 0
    assert "no video" in capsys.readouterr().out
    names = {path.name for path in (tmp_path / "report").iterdir()}
    assert names == {"demonstrations.h5", "skill.npz", "report.json", "index.html"}
    page = (tmp_path / "report" / "index.html").read_text()
    assert page.count("data:image/png;base64,") == 4
    assert "libosmesa6" in page
    report = json.loads((tmp_path / "report" / "report.json").read_text())
    assert f"<b>{sum(episode['success'] for episode in report['episodes'])} of 2</b> unseen setups solved" in page
    taught = {
        demonstration.seed["reset"] for demonstration in load_demonstrations(tmp_path / "report/demonstrations.h5")
    }
    assert [episode["seed"] for episode in report["episodes"]] == [2000, 2001]
    assert not taught & {episode["seed"] for episode in report["episodes"]}
    assert all(episode["error"] is None for episode in report["episodes"])
