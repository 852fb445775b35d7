"""Labels that change too late: who labels by hand does so after having seen the next movement begin.

The end of a movement would then be a place on the way of the next one, and a skill that waits for it would wait for what
only its successor does. So a label that changes in motion counts from where the robot last rested, if that is not long ago.
"""

import dataclasses

import numpy as np

from lfd_gym.demonstration import Demonstration
from policies.passages import MOVING, TOLERANCE
from policies.sequence_graph import segments
from policies.task_data import (
    CONTROLLED,
    ENTITIES,
    Measurement,
    PrimitiveTable,
    deviations,
    relative_quaternion,
    trajectory,
)

LATE = 0.3
"""[s]: so much later than a movement a label may change."""


def on_time(demonstration: Demonstration, measured: Measurement, table: PrimitiveTable) -> Demonstration:
    """The demonstration with labels that change where all that a primitive controls had come to rest.

    A label that changes at rest stays, and one that changes in motion if there was no rest in the last `LATE`: something
    interrupted the movement.
    """
    n, late = max(round(MOVING / demonstration.dt), 1), round(LATE / demonstration.dt)
    labels = demonstration.labels.copy()
    for part in segments(demonstration.labels)[:-1]:
        k, at = part.label, slice(part.start, part.stop + 1)
        mean = relative_quaternion(measured, int(table.orientation_frame[k]), part.stop)
        x = trajectory(Measurement(*(a[at] for a in measured)), table, k, mean)

        def rests(end: int, steps: int, x: np.ndarray = x, k: int = k) -> bool:
            away = deviations(x[max(end - steps, 0) : end + 1], x[end], int(table.space[k])) * (
                table.modes[k] == CONTROLLED
            )
            return all((np.linalg.norm(away[:, own], axis=1) <= TOLERANCE[e]).all() for e, own in ENTITIES.items())

        last = len(x) - 1
        if not rests(last, n):
            end = next((t for t in range(last - 1, max(last - late, 2 * n) - 1, -1) if rests(t, 2 * n)), None)
            if end is not None:
                labels[part.start + end - n : part.stop] = demonstration.labels[part.stop]
    return dataclasses.replace(demonstration, labels=labels)
