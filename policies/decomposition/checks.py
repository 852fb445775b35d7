"""What demonstrations need so that movements can be told apart, and what to do where they lack it."""

import warnings
from collections.abc import Sequence

import numpy as np

from lfd_gym.demonstration import Demonstration
from lfd_gym.errors import DemonstrationError
from policies.decomposition.segmentation import CONTACT_LOST, SHORTEST_REST, motions, signals

DETOUR, LONG = 2.5, 0.5
"""A motion with a path longer than the latter [m], and so many times as long as the way between its ends, hides several."""
FREE_SHARE = 0.05
"""The tool is free at least during this share of a demonstration."""


class DecompositionWarning(UserWarning):
    """Demonstrations that can be decomposed, but not well."""


def check_demonstrations(demonstrations: Sequence[Demonstration]) -> None:
    """Raise DemonstrationError for what cannot be decomposed; warn of what will not be decomposed well."""
    if "wrench" not in demonstrations[0].observations:
        _warn("there is no observation 'wrench': contacts are not seen and no force is learned; record the wrench")
    for i, demonstration in enumerate(demonstrations):
        name, dt = f"demonstration {i}", float(demonstration.dt)
        observed = signals(demonstration, "position")
        force = float(np.quantile(np.linalg.norm(observed.force, axis=1), FREE_SHARE))
        if force > CONTACT_LOST:
            raise DemonstrationError(
                f"the force of {name} never falls below {force:.1f} N, so that no contact begins or ends; "
                "zero the force sensor before each demonstration, and begin it free of contact"
            )
        if not any(
            motions(signals(demonstration, entity), entity, dt) for entity in ("position", "orientation", "hand")
        ):
            raise DemonstrationError(f"nothing moves in {name}; show the task again with the robot moving")
        for start, stop in motions(observed, "position", dt):
            path = observed.values[start:stop]
            length = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
            if length > LONG and length > DETOUR * float(np.linalg.norm(path[-1] - path[0])):
                _warn(
                    f"{name} goes on for {(stop - start) * dt:.1f} s and {length:.2f} m without a pause, "
                    f"from {start * dt:.1f} s on; pause for {SHORTEST_REST} s or longer where a movement ends"
                )


def _warn(message: str) -> None:
    warnings.warn(message, DecompositionWarning, stacklevel=5)
