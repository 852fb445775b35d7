"""The one loop that steps environments; recording and evaluation both consume it."""

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple, Protocol

import gymnasium
import numpy as np

from lfd_gym.errors import InvalidArgumentError

Observation = Mapping[str, np.ndarray]


class Policy(Protocol):
    """What the loop steps: Stable-Baselines3's predictor protocol, spoken by teachers, skills and agents alike.

    A policy may also have `begin_episode(env, seed)`, called after each reset, if it draws random numbers or needs to
    know the environment's spaces; a skill needs neither.
    """

    def predict(
        self,
        observation: Any,
        state: tuple[np.ndarray, ...] | None = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, tuple[np.ndarray, ...] | None]:
        """The action for one observation, and the policy's state after it."""
        ...


class Step(NamedTuple):
    """One control step of one episode."""

    observation: Observation
    """What the policy saw."""
    action: np.ndarray
    """(A,) what it did."""
    state: tuple[np.ndarray, ...] | None
    """The policy's state after deciding."""
    reward: float
    next_observation: Observation
    terminated: bool
    truncated: bool
    info: dict[str, Any]


def rollout(env: gymnasium.Env, policy: Policy, seed: int, options: Mapping[str, Any] | None = None) -> Iterator[Step]:
    """Reset with `seed` and `options` and yield one Step after another until the episode ends."""
    observation, _ = env.reset(seed=seed, options=None if options is None else dict(options))
    begin_episode = getattr(policy, "begin_episode", None)
    if begin_episode is not None:
        begin_episode(env, seed)
    state, episode_start = None, np.ones(1, dtype=bool)
    ended = False
    while not ended:
        action, state = policy.predict(observation, state=state, episode_start=episode_start, deterministic=True)
        following, reward, terminated, truncated, info = env.step(action)
        yield Step(observation, action, state, float(reward), following, terminated, truncated, info)
        observation, episode_start = following, np.zeros(1, dtype=bool)
        ended = terminated or truncated


class TeacherPolicy:
    """A scripted teacher as a policy; its state is one array, the label (1,) of the primitive it performs.

    The teacher's random numbers come from SeedSequence(seed of the episode, spawn_key=(2,)), a stream that the
    environment does not draw from. A kinesthetic teacher guides the arm with its hand beside the action.
    """

    def __init__(self, teacher: Any) -> None:
        """Wrap a teacher, anything with `reset(rng, layout, dt)` and `act(observation) -> (action, label)`."""
        self.teacher = teacher

    def __getstate__(self) -> dict[str, Any]:
        """Without the world of the episode that is going on."""
        return {"teacher": self.teacher}

    def begin_episode(self, env: gymnasium.Env, seed: int) -> None:
        """Start the teacher over with the random numbers of this episode."""
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(2,)))
        world: Any = env.unwrapped
        self._world = world
        self.teacher.reset(rng, world.action_layout, world.dt)

    def predict(
        self,
        observation: Observation,
        state: tuple[np.ndarray, ...] | None = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
        """The teacher's action, and its label as state."""
        action, label = self.teacher.act(observation)
        if getattr(self.teacher, "guidance", None) is not None:
            self._world.set_guidance(self.teacher.guidance)
        return action, (np.array([label]),)


def as_policy(policy: Any) -> Policy:
    """The policy itself, or a teacher as one. Raises InvalidArgumentError for what neither predicts nor teaches."""
    given = policy.__name__ if isinstance(policy, type) else type(policy).__name__
    if isinstance(policy, type):
        raise InvalidArgumentError(f"the class {given} was given; one of its objects is needed, such as {given}()")
    if hasattr(policy, "predict"):
        return policy
    if hasattr(policy, "act"):
        return TeacherPolicy(policy)
    learner = "; of a learner, what it has learned is: `skill_`, after `fit`" if hasattr(policy, "fit") else ""
    raise InvalidArgumentError(f"a {given} is no policy, since it has no `predict`{learner}")


class RandomPolicy:
    """Uniform random actions: the floor of every comparison."""

    def begin_episode(self, env: gymnasium.Env, seed: int) -> None:
        """Draw this episode's actions from its own stream."""
        self.space = env.action_space
        self.rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(3,)))

    def predict(
        self,
        observation: Observation,
        state: tuple[np.ndarray, ...] | None = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, None]:
        """An action drawn uniformly from the box of actions."""
        low, high = self.space.low, self.space.high  # type: ignore[attr-defined]
        return self.rng.uniform(low, high).astype(self.space.dtype), None
