"""Labels that change too late: who labels by hand does so after having seen the next movement begin.

The end of a movement would then be a place on the way of the next one, and a skill that waits for it would wait for what
only its successor does. So a label that changes in motion counts from where the robot last rested, if that is not long ago.
"""

import dataclasses

from lfd_gym.demonstration import Demonstration
from policies.passages import MOVING, away
from policies.sequence_graph import segments
from policies.task_data import Measurement, PrimitiveTable, deviations, relative_quaternion, trajectory

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
        end = _rest(measured, table, part.label, range(part.start, part.stop + 1), n, late)
        if end is not None:
            labels[end - n : part.stop] = demonstration.labels[part.stop]
    return dataclasses.replace(demonstration, labels=labels)


def _rest(measured: Measurement, table: PrimitiveTable, k: int, steps: range, n: int, late: int) -> int | None:
    """The last of the steps of a segment of primitive k at which it had rested for 2 n, of those that are `late` at most; None
    where it rests for n at its end, or never."""
    mean = relative_quaternion(measured, int(table.orientation_frame[k]), steps[-1])
    x = trajectory(Measurement(*(a[steps.start : steps.stop] for a in measured)), table, k, mean)

    def rests(t: int, long: int) -> bool:
        there = deviations(x[max(t - long, 0) : t + 1], x[t], int(table.space[k]))
        return not away(there, table.modes[k]).any()

    last = len(x) - 1
    if rests(last, n):
        return None
    found = (t for t in range(last - 1, max(last - late, 2 * n) - 1, -1) if rests(t, 2 * n))
    return next((steps[t] for t in found), None)
