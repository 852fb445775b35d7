"""The command line: bad input is one line on stderr, an exit code, and nothing half written."""

import json
import os
import subprocess
import sys
from pathlib import Path

import h5py
import kinematic_world
import numpy as np
import pytest
import toy

from lfd_gym import cli, cli_names
from lfd_gym.demonstration import load_demonstrations, save_demonstrations
from lfd_gym.errors import InvalidArgumentError
from lfd_gym.paths import check_writable, written_whole
from lfd_gym.recording import record

TEACHERS = {"Point-v0": "toy:PointTeacher"}


@pytest.fixture
def demos(tmp_path: Path) -> Path:
    path = tmp_path / "demos.h5"
    save_demonstrations(path, record(toy.ENV_ID, toy.PointTeacher(), n=1, seed=0).demonstrations)
    return path


@pytest.fixture
def truncated(demos: Path) -> Path:
    demos.write_bytes(demos.read_bytes()[:-1500])
    return demos


@pytest.fixture
def foreign(tmp_path: Path) -> Path:
    path = tmp_path / "foreign.h5"
    with h5py.File(path, "w") as file:
        file["data/demo_0/actions"] = np.zeros((3, 7))
    return path


def refuse(arguments: list[str], capsys: pytest.CaptureFixture[str], folder: Path) -> str:
    """Run a command that must fail; return its one line, having checked that nothing was written."""
    before = sorted(folder.rglob("*"))
    assert cli.main(arguments) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("lfd-gym: ")
    assert err.count("\n") == 1
    assert sorted(folder.rglob("*")) == before
    return err


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["teach", "light-bulp", "--out", "OUT"], "did you mean 'light-bulb'"),
        (["teach", "light-bulb", "--out", "OUT", "--noise", "-1"], "0 (clean)"),
        (["teach", "light-bulb", "--out", "OUT", "--noise", "nan"], "0 (clean)"),
        (["teach", "light-bulb", "--out", "OUT", "--noise", "3000"], "up to 10"),
        (["teach", "light-bulb", "--out", "OUT", "-n", "0"], "1 or more"),
        (["teach", "light-bulb", "--out", "OUT", "--seed", "-1"], "0 or more"),
        (["teach", "light-bulb", "--out", "OUT", "--set", "speed"], "name=value"),
        (["teach", "light-bulb", "--out", "OUT", "--set", "fingertip_fiction=1"], "did you mean 'fingertip_friction'"),
        (["teach", "light-bulb", "--out", "OUT", "--set", "noise=2"], "'noise'"),
        (["teach", "light-bulb", "--out", "DEMOS/demos.h5"], "cannot write"),
        (["learn", "sequence-graf", "DEMOS", "--out", "OUT"], "did you mean 'sequence-graph'"),
        (["learn", "sequence-graph", "OUT/none.h5", "--out", "OUT"], "no such file"),
        (["learn", "sequence-graph", ".", "--out", "OUT"], "it is a folder"),
        (["learn", "sequence-graph", "DEMOS", "--out", "DEMOS"], "it is read here"),
        (["train", "sac-demos", "light-bulb", "--steps", "9", "--demos", "DEMOS", "--out", "DEMOS"], "it is read here"),
        (["finetune", "cma", "DEMOS", "light-bulb", "--episodes", "9", "--out", "DEMOS"], "it is read here"),
        (["evaluate", "DEMOS", "light-bulb", "--json", "DEMOS"], "it is read here"),
        (["evaluate", "random", "light-bulb", "--noise", "1"], "the teacher's"),
        (["render", "OUT/skill.npz", "light-bulb", "--out", "OUT", "--mode", "kinesthetic"], "the teacher's"),
        (["evaluate", "random", "light-bulb", "--set", "perturbation={'slip': 1}"], '{"push_arm": 20}'),
        (["learn", "sequence-graph", "DEMOS", "--out", "OUT", "--set", "grahp=1"], "did you mean 'graph'"),
        (["evaluate", "random", "light-bulp"], "did you mean 'light-bulb'"),
        (["evaluate", "random", "light-bulb", "-n", "0"], "1 or more"),
        (["evaluate", "random", "light-bulb", "--jobs", "0"], "greater than or equal to 1"),
        (["evaluate", "teacher", "light-bulb", "--noise", "-0.5"], "0 (clean)"),
        (["evaluate", "teacher", "whiteboard", "--set", "words=5"], "capital letters"),
        (["evaluate", "OUT/no-skill", "light-bulb"], "no-skill"),
        (["evaluate", "random", "light-bulb", "--json", "DEMOS/report.json"], "cannot write"),
        (["evaluate", "random", "light-bulb", "--set", "name=x"], "'name'"),
        (["render", "random", "light-bulb", "--out", "OUT.jpg"], ".mp4"),
        (["render", "random", "light-bulb", "--out", "OUT.png", "--seed", "-1"], "greater than or equal to 0"),
        (["render", "random", "light-bulb", "--out", "OUT.png", "--set", "render_mode=human"], "render_mode"),
        (["render", "random", "light-bulb", "--out", "OUT.png", "--set", "width=0"], "width"),
        (["render", "random", "light-bulb", "--out", "OUT.mp4", "--at", "3"], "the time of a picture"),
        (["render", "random", "nowhere", "--out", "OUT"], "light-bulb"),
        (["bench", "nowhere"], "light-bulb"),
        (["experiment", "finetuning", "--out", "OUT", "--set", "setups=many"], "must be of type int"),
        (["experiment", "finetuning", "--out", "OUT", "--set", "only=blackboard"], "no row begins with 'blackboard'"),
        (["teach", "light-bulb"], "--out"),
        (["dance"], "'dance'"),
        (["envs", "--loud"], "--loud"),
    ],
)
def test_bad_input_is_refused_in_one_line(arguments, says, capsys, tmp_path, demos) -> None:
    named = [a.replace("OUT", str(tmp_path / "out")).replace("DEMOS", str(demos)) for a in arguments]
    assert says in refuse(named, capsys, tmp_path)


def test_an_opengl_that_does_not_work_is_named_in_one_line() -> None:
    command = [sys.executable, "-m", "lfd_gym.cli", "evaluate", "random", "move-object", "-n", "1"]
    done = subprocess.run(command, env=os.environ | {"MUJOCO_GL": "teapot"}, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "lfd-gym: MuJoCo cannot be imported with MUJOCO_GL=teapot\n"


def test_no_file_takes_the_place_of_a_pipe_or_of_a_link(tmp_path) -> None:
    pipe, file, link = (tmp_path / name for name in ("pipe", "file", "link"))
    os.mkfifo(pipe)
    with pytest.raises(InvalidArgumentError, match="regular file"):
        check_writable(pipe)
    file.write_text("before")
    link.symlink_to(file)
    with written_whole(link) as temporary:
        temporary.write_text("after")
    assert link.is_symlink()
    assert file.read_text() == "after"


@pytest.mark.parametrize(
    ("command", "out"),
    [
        (["teach", toy.ENV_ID, "-n", "1", "--out"], "OUT.h5"),
        (["learn", "replay", "DEMOS", "--out"], "OUT.npz"),
        (["evaluate", "teacher", toy.ENV_ID, "-n", "2", "--json"], "OUT.json"),
    ],
)
def test_a_full_disk_is_one_line_and_leaves_what_was_there(command, out, monkeypatch, capsys, tmp_path) -> None:
    monkeypatch.setattr("scripted_teachers.TEACHERS", TEACHERS)
    save_demonstrations(tmp_path / "demos.h5", [kinematic_world.teach(0)])
    file = tmp_path / out
    arguments = [a.replace("DEMOS", str(tmp_path / "demos.h5")) for a in [*command, str(file)]]
    assert cli.main(arguments) == 0
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    program = (
        f"import resource, sys; sys.path.insert(0, {str(Path(__file__).parent)!r})\n"
        "import scripted_teachers, toy; from lfd_gym import cli\n"
        f"scripted_teachers.TEACHERS = {TEACHERS}\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (256, 256))\n"
        f"sys.exit(cli.main({arguments!r}))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr == f"lfd-gym: cannot write '{file}': File too large\n"
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_a_file_that_was_written_whole_is_as_readable_as_any_other(tmp_path) -> None:
    for mask in (0o022, 0o027):
        before = os.umask(mask)
        try:
            with written_whole(tmp_path / "file"):
                pass
        finally:
            os.umask(before)
        assert (tmp_path / "file").stat().st_mode & 0o777 == 0o666 & ~mask


def test_without_a_command_the_help_is_shown(capsys) -> None:
    assert cli.main([]) == 2
    out, err = capsys.readouterr()
    assert "evaluate" in out
    assert err.startswith("lfd-gym: a command is missing; 'lfd-gym --help'")
    assert err.count("\n") == 1


def test_a_file_that_is_given_twice_is_not_counted_twice(demos: Path, tmp_path: Path, capsys) -> None:
    out = tmp_path / "skill.npz"
    assert (
        cli.main(["learn", "sequence-graph", str(demos), str(demos.parent / "." / demos.name), "--out", str(out)]) == 2
    )
    assert "given twice" in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.parametrize(("command", "name"), [("learn", "moa"), ("train", "sac-demos"), ("finetune", "graph-ppo")])
def test_help_names_what_can_be_chosen_and_shows_an_example(command: str, name: str, capsys) -> None:
    assert cli.main([command, "--help"]) == 0
    out = capsys.readouterr().out
    assert name in out
    assert f"Example: lfd-gym {command}" in out


def test_truncated_and_foreign_demonstrations_are_refused(capsys, tmp_path, truncated, foreign) -> None:
    learn = ["learn", "sequence-graph", "--out", str(tmp_path / "skill")]
    assert "truncated" in refuse([*learn, str(truncated)], capsys, tmp_path)
    assert "schema" in refuse([*learn, str(foreign)], capsys, tmp_path)


def test_values_of_settings_are_json_or_else_text() -> None:
    parsed = cli_names.parse_settings(["a=1", "b=0.5", "c=dense", "d=[1, 2]", "e=true", "f=null", "g=x=y", "h=False"])
    assert parsed == {"a": 1, "b": 0.5, "c": "dense", "d": [1, 2], "e": True, "f": None, "g": "x=y", "h": False}
    for wrong in ("a", "=1", "a b=1"):
        with pytest.raises(InvalidArgumentError, match="name=value"):
            cli_names.parse_settings([wrong])


def test_teach_and_evaluate_write_what_they_say(monkeypatch, capsys, tmp_path) -> None:
    monkeypatch.setattr("scripted_teachers.TEACHERS", TEACHERS)
    out = tmp_path / "new" / "demos.h5"
    assert cli.main(["teach", toy.ENV_ID, "-n", "2", "--seed", "4", "--out", str(out), "--set", "speed=2.0"]) == 0
    demonstrations = load_demonstrations(out)
    assert [demonstration.env_kwargs for demonstration in demonstrations] == [{"speed": 2.0}] * 2
    report = tmp_path / "report.json"
    arguments = [
        "evaluate",
        "teacher",
        toy.ENV_ID,
        "-n",
        "3",
        "--noise",
        "0",
        "--seed",
        "100000",
        "--json",
        str(report),
    ]
    assert cli.main(arguments) == 0
    written = report.read_text()
    assert json.loads(written)["success_rate"] == 1.0
    assert "3 / 3" in capsys.readouterr().out
    assert cli.main([*arguments, "--jobs", "2"]) == 0
    assert report.read_text() == written
    assert sorted(p.name for p in tmp_path.rglob("*")) == ["demos.h5", "new", "report.json"]


def test_an_evaluation_in_which_nothing_ran_does_not_pass(monkeypatch, capsys) -> None:
    class Lost(toy.PointTeacher):
        def act(self, observation: object) -> tuple[np.ndarray, int]:
            raise RuntimeError("lost")

    monkeypatch.setattr("scripted_teachers.TEACHERS", TEACHERS)
    monkeypatch.setattr(toy, "PointTeacher", Lost)
    assert cli.main(["evaluate", "teacher", toy.ENV_ID, "-n", "2"]) == 2
    out, err = capsys.readouterr()
    assert "2 episodes ended in an error" in out
    assert err == "lfd-gym: every episode ended in an error, the first in RuntimeError: lost\n"


def test_a_file_cannot_take_the_place_of_a_folder(monkeypatch, capsys, tmp_path) -> None:
    monkeypatch.setattr("scripted_teachers.TEACHERS", TEACHERS)
    assert "is a folder" in refuse(["teach", toy.ENV_ID, "-n", "1", "--out", str(tmp_path)], capsys, tmp_path)


def test_an_interrupt_exits_with_130(monkeypatch, capsys) -> None:
    def interrupt(*arguments: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("lfd_gym.registry.environment_id", interrupt)
    assert cli.main(["evaluate", "random", "light-bulb"]) == 130
    assert capsys.readouterr().err == "lfd-gym: interrupted\n"


def test_help_needs_nothing_heavy() -> None:
    program = (
        "import sys; from lfd_gym import cli; cli.main(['--help']); "
        "heavy = {'sklearn', 'scipy', 'matplotlib', 'mujoco', 'numba', 'torch', 'h5py'} & set(sys.modules); "
        "print(sorted(heavy), file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert "evaluate" in done.stdout
    assert done.stderr == "[]\n"


def test_no_traceback_reaches_the_user_of_the_installed_command(tmp_path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "lfd_gym.cli", "evaluate", str(tmp_path / "none"), "light-bulb"],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "Traceback" not in done.stderr
