"""What the constructor of an environment takes."""

import numpy as np

from lfd_gym import wam
from lfd_gym.errors import InvalidArgumentError, is_number

PHYSICS_HZ = 500
REWARD_TYPES = ("sparse", "dense")
RENDER_MODES = ("rgb_array", "human")


def check(
    reward_type: str,
    control_hz: float,
    terminate_on_success: bool,
    fingertip_friction: float | None,
    render_mode: str | None,
    size: tuple[int, int],
) -> None:
    """Raise InvalidArgumentError, with what is possible, for the first argument that lies outside; `size` in pixels."""
    if reward_type not in REWARD_TYPES:
        raise InvalidArgumentError(f"reward_type '{reward_type}'; possible: {', '.join(REWARD_TYPES)}")
    if not is_number(control_hz) or not control_hz >= 1 or PHYSICS_HZ % control_hz:
        raise InvalidArgumentError(
            f"control_hz {control_hz!r} does not divide {PHYSICS_HZ}; for example 50, 25 or 10 do"
        )
    if not isinstance(terminate_on_success, bool | np.bool_):
        raise InvalidArgumentError(f"terminate_on_success {terminate_on_success!r}; possible: true, false")
    most = wam.MAX_FINGERTIP_FRICTION
    if fingertip_friction is not None and not (is_number(fingertip_friction) and 0.0 < fingertip_friction <= most):
        raise InvalidArgumentError(f"fingertip_friction {fingertip_friction!r}; possible: above 0, up to {most}")
    if render_mode not in (None, *RENDER_MODES):
        raise InvalidArgumentError(f"render_mode '{render_mode}'; possible: {', '.join(RENDER_MODES)}")
    for name, pixels in zip(("width", "height"), size, strict=True):
        if not isinstance(pixels, int | np.integer) or pixels < 1:
            raise InvalidArgumentError(f"{name} {pixels!r}; it must be a whole number of pixels, 1 or more")
