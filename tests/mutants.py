"""Plant one fault at a time and see that a test turns red: `make mutants`, or `python tests/mutants.py WORD` for some.

Every mutant is one row: what is broken, the file, the text, its replacement, and the tests that must notice. It is
applied to a copy of the tree; the checkout is never touched.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent
COPIED = ("lfd_gym", "policies", "scripted_teachers", "assets", "tests", "pyproject.toml")


class Mutant(NamedTuple):
    """One planted fault."""

    fault: str
    file: str
    old: str
    new: str
    tests: str


MUTANTS = (
    Mutant(
        "seed of the episode ignored",
        "lfd_gym/rollout.py",
        "env.reset(seed=seed,",
        "env.reset(seed=0,",
        "tests/test_evaluation.py",
    ),
    Mutant(
        "every teacher draws the same numbers",
        "lfd_gym/rollout.py",
        "SeedSequence(seed, spawn_key=(2,))",
        "SeedSequence(0, spawn_key=(2,))",
        "tests/test_evaluation.py",
    ),
    Mutant(
        "a new episode keeps the policy's state",
        "lfd_gym/rollout.py",
        "state, episode_start = None, np.ones(1, dtype=bool)",
        "state, episode_start = (np.ones(1),), np.zeros(1, dtype=bool)",
        "tests/test_evaluation.py",
    ),
    Mutant(
        "interval of Wald in place of Wilson",
        "lfd_gym/evaluation.py",
        "centre = (rate + z * z / (2 * n)) / (1 + z * z / n)",
        "centre = rate",
        "tests/test_evaluation.py",
    ),
    Mutant(
        "taught seeds are evaluated",
        "lfd_gym/evaluation.py",
        "    if overlap:",
        "    if False:",
        "tests/test_evaluation.py",
    ),
    Mutant(
        "a subtask counts only if it holds at the end",
        "lfd_gym/evaluation.py",
        "subtasks.get(key, False) or bool(reached)",
        "bool(reached)",
        "tests/test_evaluation.py",
    ),
    Mutant(
        "failed attempts are shown to the learner",
        "lfd_gym/recording.py",
        'if steps[-1].info["is_success"]:',
        "if True:",
        "tests/test_evaluation.py",
    ),
    Mutant(
        "the last observation is forgotten",
        "lfd_gym/recording.py",
        "[steps[-1].next_observation]",
        "[steps[-1].observation]",
        "tests/test_evaluation.py",
    ),
    Mutant(
        "next_obs is obs",
        "lfd_gym/demonstration.py",
        "rows[:-1], rows[1:]",
        "rows[:-1], rows[:-1]",
        "tests/test_demonstration_file.py",
    ),
    Mutant(
        "files are written in place",
        "lfd_gym/paths.py",
        "    temporary = Path(name)",
        "    temporary = path",
        "tests/test_demonstration_file.py",
    ),
    Mutant(
        "a library imports a program",
        "policies/__init__.py",
        "import os\n",
        "import os\nimport lfd_gym.cli\n",
        "tests/test_imports.py",
    ),
    Mutant(
        "repetitions are not folded",
        "policies/sequence_graph.py",
        "fold_repetitions: bool = True",
        "fold_repetitions: bool = False",
        "tests/test_sequence_graph.py",
    ),
    Mutant(
        "the end of a segment counts no more than its start",
        "policies/goals.py",
        "w = np.arange(1, n + 1, dtype=np.float64) ** 2",
        "w = np.ones(n)",
        "tests/test_goals.py",
    ),
    Mutant(
        "the force has the wrong sign",
        "lfd_gym/servo.py",
        "e_f[i] = (magnitude + m.force_integral) * d[i]",
        "e_f[i] = -(magnitude + m.force_integral) * d[i]",
        "tests/test_force_control.py",
    ),
    Mutant(
        "S = I while a force is commanded",
        "lfd_gym/servo.py",
        "selection[i, j] -= d[i] * d[j]",
        "selection[i, j] -= 0.0",
        "tests/test_force_control.py",
    ),
    Mutant(
        "the wrench is what the tool exerts",
        "lfd_gym/sensing.py",
        "wrench[i] = -force - mass * gravity[i]",
        "wrench[i] = force + mass * gravity[i]",
        "tests/test_wam.py",
    ),
    Mutant(
        "two frames swapped",
        "lfd_gym/sensing.py",
        "    for body in frames:",
        "    for body in frames[::-1]:",
        "tests/test_setups.py -k object_of_its_name",
    ),
    Mutant(
        "a hidden quantity in the observation",
        "lfd_gym/envs/manipulation_env.py",
        "        np.maximum(flat, self._low, out=flat)",
        "        flat[0] += 1e-3 * self._hidden.sum()\n        np.maximum(flat, self._low, out=flat)",
        "tests/test_setups.py -k hidden",
    ),
    Mutant(
        "the environment's seed ignored",
        "lfd_gym/envs/manipulation_env.py",
        "super().reset(seed=seed)",
        "super().reset(seed=0)",
        "tests/test_environments.py -k different_seeds",
    ),
    Mutant(
        "the controller's memory is not part of the state",
        "lfd_gym/envs/manipulation_env.py",
        "        self.robot.set_state(robot)\n",
        "",
        "tests/test_environments.py -k restored",
    ),
    Mutant(
        "the noise of goals ignored",
        "scripted_teachers/noise.py",
        "position=position * noise *",
        "position=position * 0.0 *",
        "tests/test_teachers.py -k spreads",
    ),
    Mutant(
        "the thread is left-handed",
        "assets/light_bulb.xml",
        'coef="-.000576147"',
        'coef=".000576147"',
        "tests/test_light_bulb.py",
    ),
    Mutant(
        "no dead zone of the force",
        "lfd_gym/action.py",
        "    if magnitude > DEAD_ZONE:",
        "    if magnitude > 0.0:",
        "tests/test_action.py",
    ),
    Mutant(
        "the learner reads the reference",
        "policies/task_data.py",
        '["tool_position"]',
        '["reference_position"]',
        "tests/test_learners.py -k reads",
    ),
)


def main(words: list[str]) -> int:
    """Run the mutants whose fault contains one of the words, all without words; the number that no test noticed."""
    chosen = [mutant for mutant in MUTANTS if not words or any(word in mutant.fault for word in words)]
    missed = [mutant for mutant in chosen if not found(mutant)]
    print(f"{len(chosen) - len(missed)} of {len(chosen)} mutants found")
    return len(missed)


def found(mutant: Mutant) -> bool:
    """Whether the mutant's tests fail in a copy of the tree that has the fault."""
    with tempfile.TemporaryDirectory() as folder:
        for name in COPIED:
            source, copy = ROOT / name, Path(folder) / name
            if source.is_dir():
                shutil.copytree(source, copy, ignore=shutil.ignore_patterns("__pycache__"))
            else:
                shutil.copy(source, copy)
        path = Path(folder) / mutant.file
        text = path.read_text()
        if text.count(mutant.old) != 1:
            print(f"OUTDATED  {mutant.fault}: its text occurs {text.count(mutant.old)} times in {mutant.file}")
            return False
        path.write_text(text.replace(mutant.old, mutant.new))
        command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *mutant.tests.split()]
        environment = os.environ | {"PYTHONPATH": folder, "PYTHONDONTWRITEBYTECODE": "1"}
        done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    red = done.returncode == 1
    reason = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    print(
        f"{'found' if red else 'MISSED':<10}{mutant.fault}: {reason[0] if reason else done.stdout[-300:]}", flush=True
    )
    return red


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
