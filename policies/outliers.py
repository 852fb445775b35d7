"""Demonstrations that are unlike the others (thesis 5.2.4): which one, and why, from three demonstrations on.

Compared are the order of the primitives, where each one ends in its own frame, how long it takes, and how hard it
presses. What counts as unlike does not depend on the task. A demonstration is judged against the others only: with c the
median of their values x_o and n their number, its value x is unlike theirs if

    |x - c| > sqrt((6 u^2 + (n - 1) (5 m)^2) / (6 + n - 1)) sqrt(1 + 1 / n),

where u is how far a human's variation goes (`USUAL`) and m the others' spread, the median of |x_o - c| scaled to a standard
deviation. With few demonstrations u decides, with many the others' own spread (a moderated deviation, as in Smyth 2004).

A rare but right way of doing a task looks the same as a wrong one: the reasons are for the teacher to judge.
"""

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from lfd_gym.demonstration import NO_LABEL, Demonstration, EntityControl, check_same_environment
from policies.movement_primitives import STEADY_SHARE
from policies.passages import SCATTER
from policies.sequence_graph import Segment, segments

Array = NDArray[np.float64]

FEWEST = 3
"""Of two demonstrations that differ none is the odd one."""
USUAL = {**SCATTER, "duration": np.log(6.0), "force": np.log(2.3)}
"""[m], [rad], [rad], factor, factor: a human's goals; a pause or a slow movement; a firmer press."""
PRIOR_WEIGHT = 6.0
"""So many demonstrations is the knowledge of what is usual worth."""
LEAST_FORCE = 0.1
"""Of what is pressed by less than this [N], as with a sensor that measures nothing, no ratio is taken."""
START = -1
"""What comes before the first primitive."""


@dataclass(frozen=True)
class Outlier:
    """A demonstration that is unlike the others."""

    index: int
    """In the list of demonstrations."""
    reasons: tuple[str, ...]
    """One sentence for each thing that is unlike."""

    def __str__(self) -> str:
        """One line."""
        return f"demonstration {self.index} is unlike the others: {'; '.join(self.reasons)}"


class Trait(NamedTuple):
    """Something that demonstrations are compared by."""

    values: list[Array]
    """Per demonstration (s, d): d numbers, s times."""
    usual: float
    """Deviation that a human's variation stays below."""
    sentence: Callable[[Array, Array], str]
    """What to say of a value (d,) where the others have the median (d,)."""


def find_outliers(demonstrations: Sequence[Demonstration]) -> list[Outlier]:
    """The demonstrations of one task that are unlike the others, in their order; none of fewer than three.

    Only what was measured, the labels and the primitive table are read. Raises DemonstrationError if the demonstrations
    are of several environments.
    """
    check_same_environment(demonstrations)
    if len(demonstrations) < FEWEST:
        return []
    reasons: list[list[str]] = [[] for _ in demonstrations]
    for i, reason in _unusual_orders(demonstrations):
        reasons[i].append(reason)
    for trait in _traits(demonstrations):
        for i, reason in _deviations(trait):
            reasons[i].append(reason)
    return [Outlier(i, tuple(found)) for i, found in enumerate(reasons) if found]


def _unusual_orders(demonstrations: Sequence[Demonstration]) -> Iterator[tuple[int, str]]:
    """Transitions that only one demonstration makes, where all others that were there agree what follows.

    Only to primitives that the others perform, too: one that they never do is another way, of which they say nothing.
    """
    names = {label: f"'{p.name}'" for label, p in enumerate(demonstrations[0].primitives)}
    names[START] = "the start"
    performed = [set(demonstration.labels.tolist()) for demonstration in demonstrations]
    after = [_successors(demonstration) for demonstration in demonstrations]
    for i, own in enumerate(after):
        common = set.intersection(*(labels for j, labels in enumerate(performed) if j != i))
        for label, following in own.items():
            others = [other[label] for j, other in enumerate(after) if j != i and label in other]
            if len(others) < FEWEST - 1 or any(other != others[0] for other in others):
                continue
            for unusual in sorted((following - others[0]) & common):
                known = " or ".join(names[k] for k in sorted(others[0]))
                yield i, f"after {names[label]} comes {names[unusual]}, with the others {known}"


def _successors(demonstration: Demonstration) -> dict[int, set[int]]:
    """Label -> labels that follow it. Where a recording stops says nothing: it stops when the task is solved."""
    order = [START, *(part.label for part in _parts(demonstration))]
    result: dict[int, set[int]] = {}
    for a, b in itertools.pairwise(order):
        result.setdefault(a, set()).add(b)
    return result


def _parts(demonstration: Demonstration) -> list[Segment]:
    return [part for part in segments(demonstration.labels) if part.label != NO_LABEL]


def _deviations(trait: Trait) -> Iterator[tuple[int, str]]:
    """Demonstrations whose farthest value lies beyond the limit, and what to say."""
    for i, own in enumerate(trait.values):
        others = [values for j, values in enumerate(trait.values) if j != i and len(values)]
        if len(own) == 0:
            continue
        median = np.median(np.concatenate(others), axis=0)
        distance = np.linalg.norm(own - median, axis=1)
        scale = np.sqrt(chi2.median(own.shape[1]))
        spread = np.median(np.linalg.norm(np.concatenate(others) - median, axis=1)) / scale
        n = len(others)
        moderated = (PRIOR_WEIGHT * trait.usual**2 + (n - 1) * (5.0 * spread) ** 2) / (PRIOR_WEIGHT + n - 1)
        if distance.max() > np.sqrt(moderated * (1.0 + 1.0 / n)):
            yield i, trait.sentence(own[int(np.argmax(distance))], median)


def _traits(demonstrations: Sequence[Demonstration]) -> Iterator[Trait]:
    """Ends, durations and forces of every primitive; the last one of a recording was cut short and is left out.

    A primitive that presses ends where and when the world yields: of it only the force is compared, the median over a
    demonstration.
    """
    for label, primitive in enumerate(demonstrations[0].primitives):
        own = [[part for part in _parts(d)[:-1] if part.label == label] for d in demonstrations]
        if sum(len(parts) > 0 for parts in own) < FEWEST:
            continue
        pairs = list(zip(demonstrations, own, strict=True))
        if "force" in primitive.position.axes:
            forces = [[_press(d, part, primitive.position) for part in parts] for d, parts in pairs]
            levels = [np.log([[max(np.median(f), LEAST_FORCE)]]) if f else np.empty((0, 1)) for f in forces]
            yield Trait(levels, USUAL["force"], _ratio(primitive.name, "presses with", "N"))
            continue
        seconds = [np.array([part.stop - part.start for part in parts]).reshape(-1, 1) * d.dt for d, parts in pairs]
        yield Trait([np.log(s) for s in seconds], USUAL["duration"], _ratio(primitive.name, "takes", "s"))
        for entity, ends in (("position", _positions), ("orientation", _orientations), ("hand", _hands)):
            control: EntityControl | None = getattr(primitive, entity)
            if control is not None and "position" in control.axes:
                last = [np.array([part.stop for part in parts], dtype=np.int64) for parts in own]
                values = ends(demonstrations, last, control)
                yield Trait(values, USUAL[entity], _end(primitive.name, entity))


def _ratio(name: str, verb: str, unit: str) -> Callable[[Array, Array], str]:
    def sentence(value: Array, median: Array) -> str:
        mine, theirs = np.exp(value[0]), np.exp(median[0])
        return f"'{name}' {verb} {mine:.3g} {unit}, with the others {theirs:.3g} {unit}"

    return sentence


def _end(name: str, entity: str) -> Callable[[Array, Array], str]:
    def sentence(value: Array, median: Array) -> str:
        away = np.linalg.norm(value - median)
        how = f"{100.0 * away:.1f} cm" if entity == "position" else f"{np.degrees(away):.0f} degrees"
        return f"the {entity} of '{name}' ends {how} from where the others end"

    return sentence


def _frames(demonstration: Demonstration, frame: str, steps: NDArray[np.int64]) -> tuple[Array, Rotation]:
    """Positions (s, 3) and orientations of a frame."""
    poses = np.tile([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], (len(steps), 1))
    if frame != "world":
        poses = demonstration.observations[f"frame_{frame}"][steps]
    return poses[:, :3], Rotation.from_quat(poses[:, 3:], scalar_first=True)


def _positions(
    demonstrations: Sequence[Demonstration], last: Sequence[NDArray[np.int64]], control: EntityControl
) -> list[Array]:
    """Tool positions in the frame (s, d) [m] along the controlled axes; all if an angle is controlled, else the radius."""
    cylindrical = control.space == "cylindrical"
    turned = cylindrical and control.axes[1] == "position"
    controlled = [axis == "position" or turned for axis in control.axes]
    values = []
    for demonstration, steps in zip(demonstrations, last, strict=True):
        origin, turn = _frames(demonstration, control.frame, steps)
        tool = demonstration.observations["tool_position"][steps]
        local = turn.inv().apply(tool - origin).reshape(-1, 3)
        if cylindrical and not turned:
            local[:, 0] = np.hypot(local[:, 0], local[:, 1])
        values.append(local[:, controlled])
    return values


def _orientations(
    demonstrations: Sequence[Demonstration], last: Sequence[NDArray[np.int64]], control: EntityControl
) -> list[Array]:
    """Rotation vectors (s, 3) [rad] of the tool in the frame, about the mean orientation of all."""
    turns = []
    for demonstration, steps in zip(demonstrations, last, strict=True):
        tool = Rotation.from_quat(demonstration.observations["tool_quaternion"][steps], scalar_first=True)
        turns.append(_frames(demonstration, control.frame, steps)[1].inv() * tool)
    mean = Rotation.concatenate(turns).mean()
    return [(turn * mean.inv()).as_rotvec().reshape(-1, 3) for turn in turns]


def _hands(
    demonstrations: Sequence[Demonstration], last: Sequence[NDArray[np.int64]], control: EntityControl
) -> list[Array]:
    """Joint angles of the hand (s, d) [rad] that are controlled."""
    controlled = [axis == "position" for axis in control.axes]
    hands = [d.observations["hand_position"][steps] for d, steps in zip(demonstrations, last, strict=True)]
    return [hand[:, controlled] for hand in hands]


def _press(demonstration: Demonstration, part: Segment, control: EntityControl) -> float:
    """Median magnitude of the force along the axes that press, while in contact [N]."""
    steps = np.arange(part.start, part.stop + 1)
    _, turn = _frames(demonstration, control.frame, steps)
    wrench = turn.inv().apply(demonstration.observations["wrench"][steps, :3])
    if control.space == "cartesian":
        wrench = wrench[:, [axis == "force" for axis in control.axes]]
    force = np.linalg.norm(wrench, axis=1)
    return float(np.median(force[force >= STEADY_SHARE * np.quantile(force, 0.9)]))
