"""A teacher performs a task, and what was measured becomes demonstrations."""

from collections.abc import Iterator, Mapping
from itertools import islice
from typing import Any, NamedTuple

import gymnasium
import numpy as np

from lfd_gym.demonstration import Demonstration
from lfd_gym.derived_actions import derive_actions
from lfd_gym.errors import DemonstrationError, InvalidArgumentError
from lfd_gym.evaluation import check_fits, check_numbers
from lfd_gym.json_values import json_values
from lfd_gym.progress import track
from lfd_gym.registry import environment_id, make
from lfd_gym.rollout import Step, TeacherPolicy, as_policy, rollout
from lfd_gym.seeds import TEACHING_SEED
from lfd_gym.versions import versions

ATTEMPTS = 10
"""Attempts per wanted demonstration before a teacher counts as unable."""


class Recording(NamedTuple):
    """What came of teaching."""

    demonstrations: list[Demonstration]
    """The successful ones, in the order of their indices."""
    discarded: list[int]
    """Indices of attempts that did not solve the task and are not shown to a learner."""


def record(
    env_id: str,
    teacher: Any,
    n: int,
    seed: int,
    env_kwargs: Mapping[str, Any] | None = None,
    progress: bool = False,
    repeat: int = 1,
) -> Recording:
    """Let `teacher` demonstrate until `n` attempts succeeded.

    A failed attempt is discarded and the next index is tried, at most 10 n in all. Every setup is demonstrated `repeat`
    times: the objects stand where they stood before, what is hidden varies. Demonstration i depends on (seed, i) alone,
    and on the first one of its setup. Raises InvalidArgumentError for n < 1, a negative seed or an n that is no multiple
    of `repeat` and a teacher of another task, DemonstrationError if the teacher fails too often.
    """
    check_numbers(n=n, seed=seed, repeat=repeat)
    if n % repeat:
        raise InvalidArgumentError(f"{n} demonstrations, {repeat} per setup; n must be a multiple of that")
    policy, written = as_policy(teacher), json_values(env_kwargs or {})
    if not isinstance(policy, TeacherPolicy):
        raise InvalidArgumentError(f"a {type(teacher).__name__} does not teach: it has no `act`")
    env = StateRecorder(make(env_id, **(env_kwargs or {})))
    discarded: list[int] = []
    try:
        check_fits(policy, env)
        attempts = _successes(env, teacher, seed, ATTEMPTS * n, written, discarded, repeat)
        demonstrations = list(track(islice(attempts, n), n, "demonstrations", progress))
    finally:
        env.close()
    if len(demonstrations) < n:
        raise DemonstrationError(
            f"the teacher solved {environment_id(env_id)} in {len(demonstrations)} of {ATTEMPTS * n} attempts; "
            f"{n} demonstrations were asked for: try less noise"
        )
    return Recording(demonstrations, discarded)


class StateRecorder(gymnasium.Wrapper):
    """Keeps the full state of the simulation before each step and after the last one, as `states`."""

    def __init__(self, env: gymnasium.Env) -> None:
        super().__init__(env)
        self.states: list[np.ndarray] = []

    def reset(self, **kwargs: Any) -> tuple[Any, dict[str, Any]]:
        """Reset, and start a new list."""
        result = self.env.reset(**kwargs)
        self.states = [self.unwrapped.get_state()]  # type: ignore[attr-defined]
        return result

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Step, and append the state that was reached."""
        result = self.env.step(action)
        self.states.append(self.unwrapped.get_state())  # type: ignore[attr-defined]
        return result


def reset_seed(seed: int, index: int) -> int:
    """The seed that demonstration `index` is reset with, from SeedSequence(seed, spawn_key=(1, index))."""
    sequence = np.random.SeedSequence(seed, spawn_key=(1, index))
    return TEACHING_SEED + int(sequence.generate_state(1)[0])


def _successes(
    env: StateRecorder,
    teacher: Any,
    seed: int,
    attempts: int,
    env_kwargs: dict[str, Any],
    discarded: list[int],
    repeat: int,
) -> Iterator[Demonstration]:
    setup, shown = None, 0
    for index in range(attempts):
        again = {"setup": setup} if shown % repeat else None
        steps = list(rollout(env, TeacherPolicy(teacher), reset_seed(seed, index), again))
        if steps[-1].info["is_success"]:
            demonstration = _demonstration(env, teacher, steps, {"teach": seed, "index": index}, env_kwargs)
            setup, shown = dict(demonstration.setup), shown + 1
            yield demonstration
        else:
            discarded.append(index)


def _demonstration(
    env: StateRecorder, teacher: Any, steps: list[Step], seed: dict[str, int], env_kwargs: dict[str, Any]
) -> Demonstration:
    world: Any = env.unwrapped
    seen = [step.observation for step in steps] + [steps[-1].next_observation]
    assert env.spec is not None
    mode = str(getattr(teacher, "mode", "commanded"))
    observations = {name: np.stack([observation[name] for observation in seen]) for name in seen[0]}
    actions = np.stack([step.action for step in steps])
    if mode == "kinesthetic":
        actions = derive_actions(observations, actions, world.action_layout, float(world.dt))
    return Demonstration(
        observations=observations,
        actions=actions,
        actions_derived=mode == "kinesthetic",
        rewards=np.array([step.reward for step in steps]),
        labels=np.array([step.state[0][0] for step in steps if step.state is not None]),
        primitives=tuple(teacher.primitives),
        dt=float(world.dt),
        success=bool(steps[-1].info["is_success"]),
        env_id=env.spec.id,
        env_kwargs=env_kwargs,
        seed=seed | {"reset": reset_seed(seed["teach"], seed["index"])},
        setup=world.setup(),
        teacher={
            "name": f"{type(teacher).__module__}:{type(teacher).__name__}",
            "noise": float(getattr(teacher, "noise", 0.0)),
            "mode": mode,
        },
        action_layout=world.action_layout.to_dict(),
        states=np.stack(env.states),
        versions=versions(),
    )
