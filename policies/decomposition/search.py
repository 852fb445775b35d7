"""Deterministic search for the assignment of segments to primitives with the largest J.

1. For every pair of scales all segments complete: agglomeration from singletons by evidence gain, then single reassignments,
   splits and merges until nothing gains.
2. For the best of them coordinate ascent over primitive and kind of every segment, and block moves: two primitives merge, a
   small one dissolves.
3. What was found is polished under the best scales, and the largest J wins.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray

from policies.decomposition.evidence import Evidence, Statistics
from policies.decomposition.objective import Assignment, Objective
from policies.decomposition.observed import Observed
from policies.decomposition.result import COMPLETE

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

SCALES = ((0.2, 0.3, 0.45, 0.65, 0.9, 1.3, 1.8), (0.15,))
"""s_g that are tried, per group, in units."""
N_BEST = 3
"""Candidates of the first stage that the second one improves."""
SMALL = 3
"""A primitive of so many complete segments may dissolve."""
TRIED = 3
"""Most promising changes of a segment that are tried."""
GAIN = 1e-9


def search(observed: Observed, scales: Sequence[Sequence[float]] = SCALES) -> tuple[Assignment, Objective]:
    """The best assignment, and the objective under the scales that it was found with."""
    found = []
    for chosen in product(*scales[: len(observed.groups)]):
        objective = Objective(observed, Evidence(observed, chosen))
        candidate = refined(objective, agglomerate(objective))
        found.append((objective(candidate), candidate, objective))
    found.sort(key=lambda entry: -entry[0])
    improved = []
    for _, candidate, objective in found[:N_BEST]:
        better = ascend(objective, candidate)
        improved.append((objective(better), better, objective))
    best = max(improved, key=lambda entry: entry[0])
    for _, candidate, _ in improved:
        polished = ascend(best[2], candidate)
        value = best[2](polished)
        if value > best[0] + GAIN:
            best = (value, polished, best[2])
    return best[1], best[2]


def agglomerate(objective: Objective) -> Assignment:
    """All segments complete; from singletons the two primitives are merged that gain most, as long as something is gained."""
    evidence = objective.evidence
    n = len(objective.moves)
    z, sets = np.arange(n), evidence.single
    own = evidence.total(sets)
    gain = np.full((n, n), -np.inf)
    for a in range(n - 1):
        gain[a, a + 1 :] = _merge_gains(evidence, sets, own, a, slice(a + 1, n))
    alive = np.ones(n, dtype=bool)
    while gain.max() > GAIN:
        a, b = divmod(int(np.argmax(gain)), n)
        z[z == b] = a
        sets = _with(sets, a, sets.at(a).plus(sets.at(b)))
        own[a] = evidence.total(sets.at([a]))[0]
        alive[b] = False
        gain[b], gain[:, b] = -np.inf, -np.inf
        others = np.flatnonzero(alive & (np.arange(n) != a))
        values = _merge_gains(evidence, sets, own, a, others)
        gain[np.minimum(others, a), np.maximum(others, a)] = values
    return Assignment(_numbered(z), np.full(n, COMPLETE))


def refined(objective: Objective, candidate: Assignment) -> Assignment:
    """Single reassignments, splits and merges of complete segments until nothing gains."""
    return _climb(objective, candidate, False, lambda z: (*_splits(objective, z), *_merges(z)))


def ascend(objective: Objective, candidate: Assignment) -> Assignment:
    """Coordinate ascent over primitives and kinds, and block moves, until nothing gains."""
    return _climb(
        objective, candidate, True, lambda z: (*_merges(z), *_dissolved(objective, z), *_splits(objective, z))
    )


def _climb(
    objective: Objective, candidate: Assignment, kinds: bool, moves: Callable[[Assignment], Iterable[Assignment]]
) -> Assignment:
    """Changes of single segments, of their kinds too if asked for, and then the first block move that gains."""
    value = objective(candidate)
    while True:
        start = value
        for i in range(len(candidate.primitive)):
            candidate, value = _reassigned(objective, candidate, value, i, kinds)
        for proposal in moves(candidate):
            if (new := objective(proposal)) > value + GAIN:
                candidate, value = proposal, new
                break
        if not value > start + GAIN:
            return candidate


def _reassigned(
    objective: Objective, candidate: Assignment, value: float, i: int, kinds: bool
) -> tuple[Assignment, float]:
    """The best of the most promising changes of one segment."""
    z, kind = candidate
    evidence, single = objective.evidence, objective.evidence.single.at([i])
    sets = objective.sets(candidate)
    if kind[i] == COMPLETE:
        without = sets.at([z[i]]).plus(single, -1.0)
        sets = _with(sets, int(z[i]), without.at(0))
    share = objective.observed.log_shares[i, COMPLETE]
    joined = evidence.total(sets.plus(single)) - evidence.total(sets) + share
    options = [(float(gain), k, COMPLETE) for k, gain in enumerate(joined)]
    options.append((float(evidence.total(single)[0] + share), len(joined), COMPLETE))
    if kinds:
        scores = objective.scores(sets, np.array([i]))[0]
        options += [
            (float(scores[k, o]), k, o)
            for k in range(len(joined))
            for o in range(1, scores.shape[1])
            if sets.n[k] > 0.5 and np.isfinite(scores[k, o])
        ]
    options.sort(key=lambda option: -option[0])
    tried = [(k, o) for _, k, o in options if (k, o) != (z[i], kind[i])][: TRIED if kinds else 1]
    for k, o in tried:
        new_z, new_kind = z.copy(), kind.copy()
        new_z[i], new_kind[i] = k, o
        proposal = Assignment(_numbered(new_z), new_kind)
        if (new := objective(proposal)) > value + GAIN:
            candidate, value = proposal, new
    return candidate, value


def _splits(objective: Objective, candidate: Assignment) -> Iterator[Assignment]:
    """Every primitive split in two along its widest direction, by its ends in every space."""
    z, kind = candidate
    ends = objective.observed.ends
    for k in range(int(z.max()) + 1):
        own = np.flatnonzero((z == k) & (kind == COMPLETE))
        if len(own) < 2:
            continue
        for f in range(ends.shape[1]):
            x = ends[own, f] - ends[own, f].mean(axis=0)
            side = x @ np.linalg.svd(x, full_matrices=False)[2][0] > 0.0
            new_z = z.copy()
            new_z[own[side]] = z.max() + 1
            yield Assignment(_numbered(new_z), kind)


def _merges(candidate: Assignment) -> Iterator[Assignment]:
    z, kind = candidate
    for a, b in combinations(range(int(z.max()) + 1), 2):
        yield Assignment(_numbered(np.where(z == b, a, z)), kind)


def _dissolved(objective: Objective, candidate: Assignment) -> Iterator[Assignment]:
    """Small primitives whose segments become what else they may be."""
    z, kind = candidate
    sets = objective.sets(candidate)
    scores = objective.scores(sets, np.arange(len(z)))
    for k in range(int(z.max()) + 1):
        own = np.flatnonzero(z == k)
        if sets.n[k] > SMALL or sets.n[k] == len(objective.moves):
            continue
        new_z, new_kind = z.copy(), kind.copy()
        for i in own:
            options = scores[i].copy()
            options[k] = -np.inf
            best = np.unravel_index(int(np.argmax(options)), options.shape)
            new_z[i], new_kind[i] = best
        if (new_z != k).all():
            yield Assignment(_numbered(new_z), new_kind)


def _merge_gains(evidence: Evidence, sets: Statistics, own: Array, a: int, others: slice | Integers) -> Array:
    return np.asarray(evidence.total(sets.at(others).plus(sets.at([a]))) - own[others] - own[a])


def _with(sets: Statistics, index: int, row: Statistics) -> Statistics:
    """The same sets, one of them replaced."""
    arrays = []
    for name in Statistics._fields:
        array = getattr(sets, name).copy()
        array[index] = getattr(row, name)
        arrays.append(array)
    return Statistics(*arrays)


def _numbered(z: Integers) -> Integers:
    """Primitives numbered in the order of their first segments."""
    _, first, inverse = np.unique(z, return_index=True, return_inverse=True)
    order = np.empty(len(first), dtype=np.int64)
    order[np.argsort(first)] = np.arange(len(first))
    return order[inverse]
