"""The state of a NumPy generator as an array of floats, so that it can be stored beside the physics."""

import numpy as np
from numpy.typing import NDArray

from lfd_gym.errors import InvalidArgumentError

_SHIFTS = (0, 32, 64, 96)


def pack(rng: np.random.Generator) -> NDArray[np.float64]:
    """The PCG64 state as 32-bit pieces (10,), each exact in a float64."""
    state = rng.bit_generator.state
    pieces = [(state["state"][key] >> shift) & 0xFFFFFFFF for key in ("state", "inc") for shift in _SHIFTS]
    return np.array([*pieces, state["has_uint32"], state["uinteger"]], dtype=np.float64)


def unpack(rng: np.random.Generator, numbers: NDArray[np.float64]) -> None:
    """Put a generator into the state that `pack` returned; InvalidArgumentError for numbers that it never returns."""
    if not ((numbers >= 0) & (numbers < 2.0**32) & (numbers == np.floor(numbers))).all():
        raise InvalidArgumentError(f"state of a random generator {numbers.tolist()}; expected integers of 32 bits")
    pieces = [int(number) for number in numbers]
    state = dict(rng.bit_generator.state)
    state["state"] = {
        key: sum(piece << shift for piece, shift in zip(pieces[i : i + 4], _SHIFTS, strict=True))
        for key, i in (("state", 0), ("inc", 4))
    }
    state["has_uint32"], state["uinteger"] = pieces[8], pieces[9]
    rng.bit_generator.state = state
