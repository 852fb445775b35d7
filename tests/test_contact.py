"""When a commanded force takes over from position, and when it lets go: the state machine alone."""

import numpy as np
import pytest

from lfd_gym.contact import APPROACH, CONTACT, CONTACT_FRACTION, CONTACT_TIME, FREE, TURN_LIMIT, advance

DT = 0.002
DOWN = np.array([0.0, 0.0, -8.0])


class Machine:
    """The state machine with its memory."""

    def __init__(self, mode: int = FREE, direction: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> None:
        self.mode, self.timer, self.direction = mode, 0.0, np.array(direction, dtype=float)

    def feel(self, force: np.ndarray, pressed: float, ticks: int = 1, inertial: float = 0.0) -> int:
        for _ in range(ticks):
            self.mode, self.timer = advance(self.mode, self.timer, self.direction, force, pressed, inertial, DT)
        return self.mode


def turned(degrees: float) -> np.ndarray:
    a = np.radians(degrees)
    return 8.0 * np.array([np.sin(a), 0.0, -np.cos(a)])


def test_without_a_force_the_tool_is_free() -> None:
    assert Machine().feel(np.zeros(3), 50.0, 100) == FREE


def test_a_force_begins_with_an_approach_along_its_direction() -> None:
    machine = Machine()
    assert machine.feel(DOWN, 0.0, 1000) == APPROACH
    np.testing.assert_allclose(machine.direction, [0, 0, -1])


def test_contact_needs_a_quarter_of_the_force_for_20_ms() -> None:
    assert (CONTACT_FRACTION, CONTACT_TIME) == (0.25, 0.02)
    machine = Machine()
    machine.feel(DOWN, 0.0)
    assert machine.feel(DOWN, 1.9, 1000) == APPROACH
    assert machine.feel(DOWN, 2.1, 9) == APPROACH
    assert machine.feel(DOWN, 2.1, 1) == CONTACT


def test_a_bump_shorter_than_20_ms_starts_the_count_again() -> None:
    machine = Machine()
    machine.feel(DOWN, 0.0)
    for _ in range(5):
        assert machine.feel(DOWN, 5.0, 9) == APPROACH
        assert machine.feel(DOWN, 0.0, 1) == APPROACH


def test_what_accelerates_the_tool_is_no_contact() -> None:
    machine = Machine()
    machine.feel(DOWN, 0.0)
    assert machine.feel(DOWN, 5.0, 100, inertial=4.0) == APPROACH
    assert machine.feel(DOWN, 5.0, 10, inertial=2.0) == CONTACT


def test_a_pull_is_no_contact() -> None:
    machine = Machine()
    machine.feel(DOWN, 0.0)
    assert machine.feel(DOWN, -20.0, 100) == APPROACH


def test_contact_lasts_while_the_tool_lifts_off() -> None:
    assert Machine(CONTACT, (0, 0, -1)).feel(DOWN, 0.0, 1000) == CONTACT


def test_contact_ends_when_the_command_vanishes() -> None:
    assert Machine(CONTACT, (0, 0, -1)).feel(np.zeros(3), 8.0) == FREE


@pytest.mark.parametrize(("degrees", "mode"), [(29.0, CONTACT), (31.0, APPROACH), (180.0, APPROACH)])
def test_a_force_that_turns_by_more_than_30_degrees_in_one_step_is_a_new_approach(degrees: float, mode: int) -> None:
    assert np.degrees(TURN_LIMIT) == pytest.approx(30.0)
    machine = Machine(CONTACT, (0, 0, -1))
    assert machine.feel(turned(degrees), 8.0) == mode
    np.testing.assert_allclose(machine.direction, turned(degrees) / 8.0)


def test_a_force_may_turn_all_the_way_round_slowly() -> None:
    machine = Machine(CONTACT, (0, 0, -1))
    for degrees in np.linspace(0.0, 360.0, 40):
        assert machine.feel(turned(degrees), 8.0) == CONTACT


def test_a_turn_during_the_approach_starts_the_count_again() -> None:
    machine = Machine()
    machine.feel(DOWN, 0.0)
    machine.feel(DOWN, 5.0, 9)
    assert machine.feel(turned(40.0), 5.0) == APPROACH
    assert machine.feel(turned(40.0), 5.0, 9) == APPROACH
    assert machine.feel(turned(40.0), 5.0) == CONTACT


def test_the_strength_may_change_during_contact() -> None:
    machine = Machine(CONTACT, (0, 0, -1))
    assert machine.feel(0.1 * DOWN, 8.0) == CONTACT
    assert machine.feel(3.0 * DOWN, 0.8) == CONTACT
