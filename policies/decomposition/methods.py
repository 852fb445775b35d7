"""Methods of decomposition by name: ours, the thesis's, and the baselines of 3.5.2.

Every entry is a function of demonstrations that returns a `Decomposition` and reads neither labels nor primitive tables.
"""

from collections.abc import Callable, Sequence

from lfd_gym.demonstration import Demonstration
from lfd_gym.errors import InvalidArgumentError
from policies.decomposition.ar_hmm import decompose_by_ar_hmm
from policies.decomposition.bayesian import decompose
from policies.decomposition.result import Decomposition
from policies.decomposition.segment_hmm import decompose_by_segment_hmm
from policies.decomposition.tp_gmm import decompose_by_tp_gmm

Method = Callable[[Sequence[Demonstration]], Decomposition]


def _end_points(demonstrations: Sequence[Demonstration]) -> Decomposition:
    return decompose_by_segment_hmm(demonstrations, ends_only=True)


METHODS: dict[str, Method] = {
    "bayesian": decompose,
    "directional-hmm": decompose_by_segment_hmm,
    "end-point-hmm": _end_points,
    "tp-gmm": decompose_by_tp_gmm,
    "sticky-ar-hmm": decompose_by_ar_hmm,
}


def method_named(name: str) -> Method:
    """A method; raises InvalidArgumentError for a name that is none."""
    if name not in METHODS:
        raise InvalidArgumentError(f"no method of decomposition '{name}'; methods: {', '.join(METHODS)}")
    return METHODS[name]
