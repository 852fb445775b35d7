"""Demonstrations as what an agent would have seen and decided."""

import warnings
from collections.abc import Sequence
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from numpy.typing import NDArray

from lfd_gym.demonstration import Demonstration, check_measured
from lfd_gym.errors import DemonstrationError
from lfd_gym.view import View

STILL_TOOL, STILL_TURN, STILL_HAND = 1e-3, 2e-3, 2e-2
"""What the tool [m], its quaternion and the hand [rad] move within a decision at most if they pause."""


class Transitions(NamedTuple):
    """N transitions of the RL view."""

    observations: NDArray[np.float32]
    """(N, D)."""
    decisions: NDArray[np.float32]
    """(N, C)."""
    rewards: NDArray[np.float32]
    """(N,) discounted sum over the decisions of a transition."""
    next_observations: NDArray[np.float32]
    """(N, D) after the last of them."""
    ended: NDArray[np.float32]
    """(N,) 1 where nothing follows that would have to be valued."""
    discounts: NDArray[np.float32]
    """(N,) of the value of what follows."""


def view_of(demonstration: Demonstration) -> View:
    """The RL view of the environment that a demonstration was given in."""
    return View.of_class(demonstration.env_id, demonstration.layout, demonstration.dt)


def check_observed(demonstrations: Sequence[Demonstration], view: View) -> None:
    """Raise DemonstrationError where an observation that tells what was seen and decided is missing or not finite.

    Warns of demonstrations by hand, which need not keep within the speed limit of decisions.
    """
    for i, demonstration in enumerate(demonstrations):
        check_measured(f"demonstration {i}", demonstration, (*view.observations, "reference_quaternion"))
    if guided := [str(i) for i, demonstration in enumerate(demonstrations) if demonstration.actions_derived]:
        warnings.warn(
            f"a hand guided the arm in demonstration {', '.join(guided)}: where it was faster than a decision may be, the "
            "decisions that are imitated fall short of what was shown",
            stacklevel=3,
        )


def flat_observations(demonstration: Demonstration, view: View) -> NDArray[np.float32]:
    """What an agent would have seen at every control step, (T + 1, D)."""
    rows = zip(*demonstration.observations.values(), strict=True)
    names = tuple(demonstration.observations)
    return np.stack([view.flatten(dict(zip(names, row, strict=True))) for row in rows])


def decisions(demonstration: Demonstration, view: View) -> NDArray[np.float64]:
    """What it would have decided (T, C): of every step the mean of `View.decision` over the decision that begins there."""
    names = tuple(demonstration.observations)
    rows = zip(demonstration.actions, *(demonstration.observations[name][:-1] for name in names), strict=True)
    single = np.stack([view.decision(action, dict(zip(names, seen, strict=True))) for action, *seen in rows])
    last = np.repeat(single[-1:], view.repeats - 1, axis=0)
    windows = np.lib.stride_tricks.sliding_window_view(np.concatenate([single, last]), view.repeats, axis=0)
    return np.asarray(windows.mean(axis=-1))


def moving(demonstration: Demonstration, view: View) -> NDArray[np.bool_]:
    """Steps (T,) at which the tool or the hand moves while the decision that begins there is held.

    A teacher pauses, and nothing that is observed tells when a pause ends: a policy without memory that clones its pauses
    stays in them.
    """
    seen, last = demonstration.observations, len(demonstration)
    later = np.minimum(np.arange(last) + view.repeats, last)

    def way(name: str) -> NDArray[np.float64]:
        return np.asarray(np.abs(seen[name][later] - seen[name][:-1]).max(axis=1, initial=0.0))

    moved = (way("tool_position") > STILL_TOOL) | (way("tool_quaternion") > STILL_TURN)
    return moved | (way("hand_position") > STILL_HAND if "hand_position" in seen else False)


def transitions(
    demonstrations: Sequence[Demonstration], env: gymnasium.Env, discount: float, reward_scale: float, n_steps: int = 1
) -> Transitions:
    """Transitions of the RL view, paid by how much this environment's reward grew in the states that were demonstrated.

    A demonstration ends when its task is solved; the view's episodes go on. So its last transition ends: to stay there pays
    nothing, see `Growth`. A transition is `n_steps` decisions long, or as many as are left.

    Raises DemonstrationError where control step or states are not those of the environment.
    """
    view, world, parts = View.of(env), env.unwrapped, []
    for i, demonstration in enumerate(demonstrations):
        if demonstration.dt != view.dt or demonstration.states.shape[1:] != world.get_state().shape:  # type: ignore[attr-defined]
            raise DemonstrationError(f"demonstration {i} was not given in this environment: its states do not fit")
        every, last = view.repeats, len(demonstration)
        starts = np.arange(0, last, every)
        ends = np.minimum(starts + every, last)
        seen = flat_observations(demonstration, view)
        reached = _rewards(world, demonstration)
        paid = np.array([reached[a + 1 : b + 1].mean() for a, b in zip(starts, ends, strict=True)])
        paid[-1] = reached[-1]
        rewards = np.diff(paid, prepend=reached[0])
        ended = np.zeros(len(starts))
        ended[-1] = demonstration.success
        shown = decisions(demonstration, view)[starts]
        length = np.minimum(n_steps, len(starts) - np.arange(len(starts)))
        powers = discount ** np.arange(n_steps)
        sums = np.array([rewards[i : i + n] @ powers[:n] for i, n in enumerate(length)])
        final = np.arange(len(starts)) + length - 1
        parts.append((seen[starts], shown, reward_scale * sums, seen[ends[final]], ended[final], discount**length))
    return Transitions(*(np.concatenate(part).astype(np.float32) for part in zip(*parts, strict=True)))


def _rewards(world: Any, demonstration: Demonstration) -> NDArray[np.float64]:
    """Reward (T + 1,) of being in each of the demonstrated states."""
    rewards = np.empty(len(demonstration) + 1)
    for t, state in enumerate(demonstration.states):
        world.set_state(state)
        rewards[t] = world.reward()
    return rewards
