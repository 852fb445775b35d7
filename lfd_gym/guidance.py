"""The impedance of an outside hand that guides the arm, as in kinesthetic teaching."""

from typing import NamedTuple


class Impedance(NamedTuple):
    """A human hand on the link above the wrist sensor, as a spring and a damper at the tool point."""

    stiffness: float = 900.0
    """[N/m]"""
    damping: float = 60.0
    """[N s/m]"""
    turn_stiffness: float = 20.0
    """[N m/rad]"""
    turn_damping: float = 1.5
    """[N m s/rad]"""
    brake: float = 110.0
    """Damping along a force that the hand exerts [N s/m]: free, 10 N move the arm at 9 cm/s."""
    strongest: float = 60.0
    """Largest force along an axis [N]."""
