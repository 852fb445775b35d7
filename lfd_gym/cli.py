"""`lfd-gym`: demonstrate, learn, evaluate and look, from the command line.

Results go to stdout as a table and to `--json` as data; what goes wrong is one line on stderr with exit code 2. Modules
that take long to import are imported by the command that needs them, so that `--help` answers at once.
"""

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, get_type_hints

import typer

from lfd_gym import cli_names
from lfd_gym.errors import InvalidArgumentError, LfdGymError, UnknownNameError
from lfd_gym.experiments import EXPERIMENTS
from lfd_gym.export import FORMATS
from lfd_gym.paths import check_writable
from lfd_gym.seeds import DEVELOPMENT_SEED
from policies import LEARNERS
from policies.reinforcement import FINETUNERS
from policies.reinforcement.settings import METHODS

EPISODES, QUICK_EPISODES, FIRST_SEED = 24, 5, 2000
"""Unseen setups of the demo, and the seed of the first one."""
PICTURE_TIME = 8.0
"""When `render` takes a picture, if nothing is said [s]."""
INTERRUPTED = 130
"""Exit code of a command that was interrupted from the keyboard."""

app = typer.Typer(
    help="A simulated Barrett WAM learns contact-rich manipulation from a handful of demonstrations.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)

EnvArgument = Annotated[str, typer.Argument(metavar="ENV", help="Task, as 'light-bulb' or as a full id.")]
SkillArgument = Annotated[str, typer.Argument(metavar="SKILL", help="File of a skill, 'teacher' or 'random'.")]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="An argument of the task, learner or experiment (repeatable); an unknown one lists them.",
    ),
]
NoiseOption = Annotated[float, typer.Option(help="Scale of the teacher's noise: 0 clean, 1 a human's.")]
ModeOption = Annotated[str, typer.Option(help="How the teacher shows it: 'commanded' or 'kinesthetic'.")]
TeachersNoiseOption = Annotated[float | None, typer.Option(help="Scale of the teacher's noise, 1 if left out.")]
TeachersModeOption = Annotated[str | None, typer.Option(help="How the teacher shows it, 'commanded' if left out.")]
SeedOption = Annotated[int, typer.Option(min=0, help="Seed of the first episode.")]
JobsOption = Annotated[int, typer.Option(min=1, help="Processes; they change nothing but time.")]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code: 0, 2 for bad input, 130 for an interrupt."""
    try:
        result = app(args=list(sys.argv[1:] if arguments is None else arguments), standalone_mode=False)
        if result == INTERRUPTED:
            raise KeyboardInterrupt
        return result if isinstance(result, int) else 0
    except (KeyboardInterrupt, typer.Abort):
        return _complain("interrupted", INTERRUPTED)
    except LfdGymError as error:
        return _complain(str(error), 2)
    except Exception as error:
        if not hasattr(error, "format_message"):
            raise
        message = error.format_message() or "a command is missing"
        return _complain(f"{message.rstrip('.')}; 'lfd-gym --help' and 'lfd-gym COMMAND --help' say what there is", 2)


@app.command()
def demo(
    out: Annotated[Path, typer.Option(help="Folder of the report.")] = Path("report"),
    env: Annotated[str, typer.Option(help="Task.")] = "light-bulb",
    quick: Annotated[bool, typer.Option("--quick", help="Fewer unseen setups and no video.")] = False,
    seed: Annotated[int, typer.Option(help="Seed of the demonstrations.")] = 0,
    jobs: JobsOption = 2,
) -> None:
    """Teach three times, learn, evaluate on unseen setups, and write a report with a video."""
    from lfd_gym.demonstration import save_demonstrations
    from lfd_gym.evaluation import evaluate as run_evaluation
    from lfd_gym.recording import record
    from lfd_gym.registry import environment_id
    from lfd_gym.report import write_report

    env_id = environment_id(env)
    check_writable(out / "index.html")
    episodes = QUICK_EPISODES if quick else EPISODES
    print(f"1/4  a scripted teacher demonstrates {env_id} three times", flush=True)
    recording = record(env_id, cli_names.teacher(env_id, 1.0), n=3, seed=seed, progress=True)
    save_demonstrations(out / "demonstrations.h5", recording.demonstrations)
    print("2/4  a sequence graph is learned from the demonstrations", flush=True)
    skill = cli_names.learner("sequence-graph", {}).fit(recording.demonstrations).skill_
    skill.save(out / "skill.npz")
    print(f"3/4  the skill is tried on {episodes} setups that it has never seen", flush=True)
    evaluation = run_evaluation(env_id, skill, episodes, FIRST_SEED, jobs=jobs, progress=True)
    print(evaluation.table(), flush=True)
    print("4/4  report" + ("" if quick else " and video"), flush=True)
    notes = write_report(out, recording, skill, evaluation, video=not quick)
    for note in notes:
        print(f"     note: {note}")
    print(f"     {out / 'index.html'}")


@app.command()
def envs() -> None:
    """List the environments."""
    from lfd_gym.registry import ENVIRONMENTS, kebab_case

    print(f"{'name':<16}{'id':<28}{'limit':>7}")
    for env_id, entry in ENVIRONMENTS.items():
        print(f"{kebab_case(env_id):<16}{env_id:<28}{entry.seconds:>5.0f} s")


@app.command(epilog="Example: lfd-gym teach light-bulb -n 3 --seed 0 --noise 1.0 --out demos.h5")
def teach(
    env: EnvArgument,
    out: Annotated[Path, typer.Option(help="HDF5 file to write.")],
    n: Annotated[int, typer.Option("-n", help="Number of demonstrations.")] = 3,
    seed: Annotated[int, typer.Option(help="Seed of the data set.")] = 0,
    noise: NoiseOption = 1.0,
    mode: ModeOption = "commanded",
    repeat: Annotated[int, typer.Option(help="Demonstrations per setup.")] = 1,
    settings: SetOption = None,
) -> None:
    """Let the scripted teacher demonstrate, and keep what was measured."""
    from lfd_gym.demonstration import save_demonstrations
    from lfd_gym.recording import record
    from lfd_gym.registry import environment_id

    env_id, chosen = environment_id(env), cli_names.parse_settings(settings)
    check_writable(out)
    teacher = cli_names.teacher(env_id, noise, mode, chosen)
    demonstrations, discarded = record(env_id, teacher, n=n, seed=seed, env_kwargs=chosen, progress=True, repeat=repeat)
    save_demonstrations(out, demonstrations)
    print(f"{'demonstration':<15}{'seconds':>8}{'primitives':>12}")
    for demonstration in demonstrations:
        used = len(set(demonstration.labels.tolist()) - {-1})
        print(f"{demonstration.seed['index']:<15}{demonstration.duration:>8.1f}{used:>12}")
    if discarded:
        print(f"discarded because the task was not solved: {', '.join(map(str, discarded))}")
    print(f"written to {out}")


@app.command(epilog="Example: lfd-gym learn sequence-graph demos.h5 --out skill.npz --set graph=local")
def learn(
    method: Annotated[str, typer.Argument(metavar="METHOD", help=f"One of {', '.join(LEARNERS)}.")],
    demonstrations: Annotated[list[Path], typer.Argument(metavar="DEMOS...", help="Files of demonstrations.")],
    out: Annotated[Path, typer.Option(help="Skill to write.")],
    settings: SetOption = None,
) -> None:
    """Learn a skill from demonstrations."""
    check_writable(out, *demonstrations)
    if len({path.resolve() for path in demonstrations}) < len(demonstrations):
        raise InvalidArgumentError("a file of demonstrations was given twice")
    chosen = cli_names.parse_settings(settings)
    learner = cli_names.learner(method, chosen)
    from lfd_gym.demonstration import check_same_environment, load_demonstrations

    taught = [demonstration for path in demonstrations for demonstration in load_demonstrations(path)]
    env_id = check_same_environment(taught)
    try:
        skill = learner.fit(taught).skill_
    except (TypeError, ValueError) as error:
        if isinstance(error, LfdGymError) or not chosen:
            raise
        raise InvalidArgumentError(f"method '{method}' cannot learn with {chosen}: {error}") from error
    skill.save(out)
    print(f"{method}: learned {env_id} from {len(taught)} demonstrations, written to {out}")


@app.command(epilog="Example: lfd-gym train sac-demos box-flipping --steps 100000 --demos demos.h5 --out agent.npz")
def train(
    method: Annotated[str, typer.Argument(metavar="METHOD", help=f"One of {', '.join(METHODS)}.")],
    env: EnvArgument,
    steps: Annotated[int, typer.Option(min=1, help="Decisions, ten per simulated second.")],
    out: Annotated[Path, typer.Option(help="Skill to write; its checkpoints and its log lie beside it.")],
    demos: Annotated[list[Path] | None, typer.Option(help="Files of demonstrations (repeatable).")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the training.")] = 0,
    evaluate_every: Annotated[int, typer.Option(min=0, help="Decisions between evaluations; 0 for none.")] = 10_000,
    checkpoint_every: Annotated[int, typer.Option(min=0, help="Decisions between checkpoints; 0 for none.")] = 25_000,
    settings: SetOption = None,
) -> None:
    """Train a reinforcement learning agent; the same command again goes on from the last checkpoint.

    The checkpoints beside --out are pickles, which can run code: go on only with your own.
    """
    from lfd_gym.demonstration import load_demonstrations
    from lfd_gym.registry import environment_id, load

    check_writable(out, *(demos or ()))
    env_id, chosen = environment_id(env), cli_names.parse_settings(settings)
    shown = [demonstration for path in demos or () for demonstration in load_demonstrations(path)]
    schedule = load("policies.reinforcement.training:Schedule")(
        steps, checkpoint_every=checkpoint_every, evaluate_every=evaluate_every, progress=True
    )
    trained = load("policies.reinforcement.training:train")(
        method, env_id, schedule, _beside(out), seed=seed, demonstrations=shown, env_kwargs=chosen
    )
    trained.save(out)
    print(f"{method}: {trained.metadata['decisions']} decisions in {env_id}, written to {out}")


@app.command(epilog="Example: lfd-gym finetune cma skill.npz move-object --episodes 400 --out better.npz")
def finetune(
    method: Annotated[str, typer.Argument(metavar="METHOD", help=f"One of {', '.join(FINETUNERS)}.")],
    skill: Annotated[Path, typer.Argument(metavar="SKILL", help="Skill to start from.")],
    env: EnvArgument,
    episodes: Annotated[int, typer.Option(help="Episodes of practice, about.")],
    out: Annotated[Path, typer.Option(help="Skill to write.")],
    seed: Annotated[int, typer.Option(min=0, help="Seed of the practice.")] = 0,
    jobs: JobsOption = 1,
    settings: SetOption = None,
) -> None:
    """Let a skill practise in an environment; what became of it is kept if it does not do worse.

    The same command again goes on where it stopped.

    The checkpoints beside --out are pickles, which can run code: go on only with your own.
    """
    from lfd_gym.registry import load
    from policies import load_skill

    check_writable(out, skill)
    start, chosen = load_skill(skill), cli_names.parse_settings(settings)
    practised = load("policies.reinforcement.finetuning:finetune")(
        method, start, env, episodes, _beside(out), seed=seed, env_kwargs=chosen, jobs=jobs, progress=True
    )
    practised.save(out)
    facts = practised.metadata["finetuned"]
    before, after = facts["check"]
    result = "kept" if facts["kept"] else "not kept, the skill is the one it started from"
    print(f"{method}: {facts['episodes']} episodes, score {before:.3f} before and {after:.3f} after: {result}")
    print(f"written to {out}")


@app.command(epilog="Example: lfd-gym evaluate skill.npz light-bulb -n 100 --seed 1000 --jobs 2 --json result.json")
def evaluate(
    skill: SkillArgument,
    env: EnvArgument,
    n: Annotated[int, typer.Option("-n", help="Number of episodes.")] = 20,
    seed: SeedOption = DEVELOPMENT_SEED,
    noise: TeachersNoiseOption = None,
    mode: TeachersModeOption = None,
    jobs: JobsOption = 1,
    json_path: Annotated[Path | None, typer.Option("--json", help="File for the report as data.")] = None,
    settings: SetOption = None,
) -> None:
    """Judge a skill, the teacher or random actions on unseen setups."""
    from lfd_gym.evaluation import evaluate as run_evaluation
    from lfd_gym.paths import written_whole
    from lfd_gym.registry import environment_id

    if json_path is not None:
        check_writable(json_path, skill)
    env_id, chosen = environment_id(env), cli_names.parse_settings(settings)
    policy = cli_names.policy(skill, env_id, noise, mode, chosen)
    report = run_evaluation(env_id, policy, n, seed, jobs=jobs, env_kwargs=chosen, progress=True)
    print(report.table())
    if json_path is not None:
        with written_whole(json_path) as temporary:
            temporary.write_text(report.to_json())
    if all(episode.error for episode in report.episodes):
        raise InvalidArgumentError(f"every episode ended in an error, the first in {report.episodes[0].error}")


@app.command(epilog="Example: lfd-gym render skill.npz light-bulb --seed 100003 --out video.mp4")
def render(
    skill: SkillArgument,
    env: EnvArgument,
    out: Annotated[Path, typer.Option(help="Video (.mp4) or picture (.png) to write.")],
    seed: SeedOption = DEVELOPMENT_SEED,
    noise: TeachersNoiseOption = None,
    mode: TeachersModeOption = None,
    at: Annotated[
        float | None,
        typer.Option(min=0.0, help=f"Time of the picture, in seconds; {PICTURE_TIME:g} if left out. At most the end."),
    ] = None,
    settings: SetOption = None,
) -> None:
    """Film one episode, or take a picture in it."""
    from lfd_gym import rendering
    from lfd_gym.evaluation import check_fits
    from lfd_gym.registry import environment_id, make

    env_id, chosen, path = environment_id(env), cli_names.parse_settings(settings), rendering.video_path(out)
    check_writable(path, skill)
    if "render_mode" in chosen:
        raise InvalidArgumentError("'render' decides the render_mode itself; leave it out")
    if at is not None and path.suffix != ".png":
        raise InvalidArgumentError("--at is the time of a picture; 'render' makes one where --out ends in .png")
    policy = cli_names.policy(skill, env_id, noise, mode, chosen)
    rendering.prepare()
    size = {"width": 960, "height": 720} if path.suffix == ".png" else {}
    world = make(env_id, render_mode="rgb_array", **(size | chosen))
    check_fits(policy, world)
    if path.suffix == ".png":
        rendering.write_picture(path, world, policy, seed, PICTURE_TIME if at is None else at)
        print(f"written to {path}")
    else:
        count = rendering.write_video(path, rendering.frames(world, policy, seed))
        seconds, dt = count / rendering.FRAMES_PER_SECOND, world.unwrapped.dt  # type: ignore[attr-defined]
        speed = rendering.steps_per_picture(dt) * dt * rendering.FRAMES_PER_SECOND
        print(f"{seconds:.1f} s at {speed:g} times the speed, written to {path}")
    world.close()


@app.command(epilog="Example: lfd-gym experiment toy --out results/toy")
def experiment(
    name: Annotated[str, typer.Argument(metavar="NAME", help=f"One of {', '.join(EXPERIMENTS)}.")],
    out: Annotated[Path, typer.Option(help="Folder of its rows and its table; finished rows are not made again.")],
    quick: Annotated[bool, typer.Option("--quick", help="A few episodes on development seeds.")] = False,
    jobs: JobsOption = 2,
    settings: SetOption = None,
) -> None:
    """Make the table of an experiment again.

    Checkpoints in its folder are pickles, which can run code: go on only with a folder of your own.
    """
    from lfd_gym.experiments.rows import Rows
    from lfd_gym.paths import written_whole
    from lfd_gym.registry import arguments, look_up

    run, given = look_up(EXPERIMENTS, "experiment", name), cli_names.parse_settings(settings)
    own = [argument for argument in arguments(run) if argument not in ("out", "quick", "jobs")]
    for unknown in [argument for argument in given if argument not in own]:
        raise InvalidArgumentError(f"experiment '{name}': {UnknownNameError('setting', unknown, own)}")
    hints = get_type_hints(run)
    for setting, value in given.items():
        if not isinstance(value, hints[setting]):
            wanted = getattr(hints[setting], "__name__", hints[setting])
            raise InvalidArgumentError(f"--set {setting}={value}: it must be of type {wanted}")
        if isinstance(value, int) and value < 1:
            raise InvalidArgumentError(f"--set {setting}={value}: it must be 1 or more")
    file = Rows(out, quick).folder / "table.md"
    check_writable(file)
    table = run(out, quick, jobs, **given)
    with written_whole(file) as temporary:
        temporary.write_text(table + "\n")
    print(table)


@app.command(epilog="Example: lfd-gym compare --env box-flipping --method moa --method ppo --jobs 2 --out comparison")
def compare(
    out: Annotated[Path, typer.Option(help="Folder of its rows, its table and its curves; finished rows are kept.")],
    env: Annotated[list[str] | None, typer.Option(help="Task (repeatable); the five tasks if left out.")] = None,
    method: Annotated[
        list[str] | None, typer.Option(help="Learner, training method, 'teacher' or 'random' (repeatable).")
    ] = None,
    seeds: Annotated[int, typer.Option(min=1, help="Training seeds: 0, 1, ...")] = 3,
    demos: Annotated[
        int | None, typer.Option(min=1, help="Demonstrations per learner; the task's number if left out.")
    ] = None,
    steps: Annotated[
        int | None, typer.Option(min=1, help="Decisions per training; the task's number if left out.")
    ] = None,
    n: Annotated[int, typer.Option("-n", min=1, help="Setups of the evaluation.")] = 100,
    quick: Annotated[bool, typer.Option("--quick", help="A few decisions and episodes on development seeds.")] = False,
    jobs: JobsOption = 1,
    backend: Annotated[str, typer.Option(help="Of joblib: 'loky', or 'ray' on a cluster.")] = "loky",
    finished: Annotated[bool, typer.Option("--finished", help="Run nothing: the table of the rows there are.")] = False,
) -> None:
    """Compare skills and reinforcement learning on the same setups; the same command again goes on where it stopped.

    Checkpoints in its folder are pickles, which can run code: go on only with a folder of your own.
    """
    from lfd_gym.experiments import comparison
    from lfd_gym.experiments.rows import Rows
    from lfd_gym.paths import written_whole
    from lfd_gym.registry import environment_id

    tasks = [environment_id(name) for name in env or [f"lfd_gym/{task}-v0" for task in comparison.TASKS]]
    asked = comparison.Comparison(tasks, tuple(method or ()), range(seeds), n, demos, steps, backend)
    file = Rows(out, quick).folder / "table.md"
    check_writable(file)
    table = comparison.compare(asked, out, quick, jobs, finished)
    with written_whole(file) as temporary:
        temporary.write_text(table + "\n")
    print(table)


@app.command(epilog="Example: lfd-gym export demos.h5 --to minari --out datasets")
def export(
    demonstrations: Annotated[Path, typer.Argument(metavar="DEMOS", help="HDF5 file of 'lfd-gym teach'.")],
    out: Annotated[Path, typer.Option(help="Folder of data sets; Minari's is MINARI_DATASETS_PATH.")],
    name: Annotated[
        str | None, typer.Option(help="Id of the data set; TASK/FILE, or TASK/FILE-v0, if left out.")
    ] = None,
    to: Annotated[str, typer.Option(help=f"One of {', '.join(FORMATS)}.")] = "minari",
) -> None:
    """Write demonstrations as a data set of another library."""
    from lfd_gym.demonstration import load_demonstrations
    from lfd_gym.registry import kebab_case, load

    if to not in FORMATS:
        raise UnknownNameError("format", to, FORMATS)
    shown, form = load_demonstrations(demonstrations), FORMATS[to]
    chosen = name or form.name.format(task=kebab_case(shown[0].env_id), file=demonstrations.stem)
    folder = load(form.write)(shown, out, chosen)
    print(f"written to {folder}; {form.read.format(name=chosen, folder=folder)} reads it")


@app.command()
def bench(
    env: Annotated[str | None, typer.Argument(metavar="[ENV]", help="One task; all if left out.")] = None,
    json_path: Annotated[Path | None, typer.Option("--json", help="File for the figures as data.")] = None,
) -> None:
    """Measure the speed of the environments against their bare physics."""
    from lfd_gym.benchmark import benchmark, table
    from lfd_gym.paths import written_whole
    from lfd_gym.registry import ENVIRONMENTS, environment_id

    if json_path is not None:
        check_writable(json_path)
    ids = list(ENVIRONMENTS) if env is None else [environment_id(env)]
    rows = [benchmark(env_id, cli_names.policy("teacher", env_id, 1.0)) for env_id in ids]
    print(table(rows))
    if json_path is not None:
        with written_whole(json_path) as temporary:
            temporary.write_text(json.dumps([row.to_dict() for row in rows], indent=2) + "\n")


@app.command()
def doctor() -> None:
    """Say what this machine has, what is missing and how to get it."""
    from lfd_gym.doctor import examine, table

    print(table(examine()))


def _beside(out: Path) -> Path:
    """The folder of the checkpoints of the training that makes a skill."""
    return out.with_name(out.name + ".training")


def _complain(message: str, code: int) -> int:
    print(f"lfd-gym: {' '.join(message.split())}", file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
