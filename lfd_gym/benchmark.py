"""What an environment costs beside the physics inside it, as a ratio that means the same on every machine."""

import statistics
import subprocess
import sys
from itertools import islice
from time import perf_counter
from typing import Any, NamedTuple

import mujoco
import numpy as np

from lfd_gym.registry import make
from lfd_gym.rollout import Policy, rollout
from lfd_gym.seeds import DEVELOPMENT_SEED

STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)


class Benchmark(NamedTuple):
    """Speed of one environment on one core."""

    env_id: str
    step_us: float
    """One `env.step` [µs]."""
    bare_us: float
    """The `mj_step`s inside it alone, from the same states with the same torques [µs]."""
    controller_us: float
    """The controller's ticks inside it [µs]."""
    reset_ms: float
    """One `env.reset` [ms]."""
    start_s: float
    """`import lfd_gym` and `gymnasium.make` in a fresh process, kernel cached [s]."""
    dt: float
    """Control step [s]."""

    @property
    def ratio(self) -> float:
        """Cost of a step over that of its bare physics."""
        return self.step_us / self.bare_us

    @property
    def beyond_us(self) -> float:
        """What a step costs beyond physics and controller: observation, success, info, the checks of `gymnasium.make` [µs]."""
        return self.step_us - self.bare_us - self.controller_us

    @property
    def real_time_factor(self) -> float:
        """Simulated seconds per second."""
        return self.dt / (self.step_us * 1e-6)

    def to_dict(self) -> dict[str, Any]:
        """All figures, derived ones included."""
        derived = {"ratio": self.ratio, "beyond_us": self.beyond_us, "real_time_factor": self.real_time_factor}
        return self._asdict() | derived


def benchmark(
    env_id: str, policy: Policy, seed: int = DEVELOPMENT_SEED, repeats: int = 5, max_steps: int = 1000
) -> Benchmark:
    """Measure one environment while `policy` works in it.

    One episode's actions are recorded and then replayed `repeats` times. After every `env.step` the bare `mj_step`s
    inside it are timed in a second `MjData`, from the same state with the same controls, so that both see the same
    machine at the same time. The median of the replays counts.
    """
    env = make(env_id)
    world: Any = env.unwrapped
    actions = [step.action for step in islice(rollout(env, policy, seed), max_steps)]
    controls = _controls(env, actions, seed)
    replays = [_replay(env, actions, controls, seed) for _ in range(repeats)]
    step_us, bare_us, controller_us = (statistics.median(times) for times in zip(*replays, strict=True))
    resets = [_seconds(env, seed + i) for i in range(20)]
    env.close()
    reset_ms = 1e3 * statistics.median(resets)
    return Benchmark(env_id, step_us, bare_us, controller_us, reset_ms, _start_seconds(env_id), world.dt)


def table(rows: list[Benchmark]) -> str:
    """The measurements as aligned text."""
    lines = [
        f"{'environment':<26}{'step µs':>9}{'bare µs':>9}{'ratio':>7}{'controller µs':>15}{'beyond µs':>11}"
        f"{'x real time':>13}{'reset ms':>10}{'start s':>9}"
    ]
    for row in rows:
        lines.append(
            f"{row.env_id:<26}{row.step_us:>9.1f}{row.bare_us:>9.1f}{row.ratio:>7.2f}"
            f"{row.controller_us:>15.1f}{row.beyond_us:>11.1f}"
            f"{row.real_time_factor:>13.1f}{row.reset_ms:>10.2f}{row.start_s:>9.2f}"
        )
    return "\n".join(lines)


def _replay(env: Any, actions: list[np.ndarray], controls: list[np.ndarray], seed: int) -> tuple[float, float, float]:
    """Mean time [µs] of `env.step`, of the bare physics and of the controller inside it, over one recorded episode."""
    world = env.unwrapped
    model, data = world.model, world.data
    n = round(world.dt / world.physics_dt)
    bare_data, state = mujoco.MjData(model), np.empty(mujoco.mj_stateSize(model, STATE))
    env.reset(seed=seed)
    stepping = bare = 0.0
    for k, action in enumerate(actions):
        mujoco.mj_getState(model, data, state, STATE)
        start = perf_counter()
        env.step(action)
        stepping += perf_counter() - start
        mujoco.mj_setState(model, bare_data, state, STATE)
        for control in controls[n * k : n * (k + 1)]:
            bare_data.ctrl[:] = control
            start = perf_counter()
            mujoco.mj_step(model, bare_data)
            bare += perf_counter() - start
    return 1e6 * stepping / len(actions), 1e6 * bare / len(actions), _controller(env, actions, seed)


def _controller(env: Any, actions: list[np.ndarray], seed: int) -> float:
    """Mean time [µs] of the controller's ticks in a step, replayed once more so that the clock costs the step nothing."""
    robot = env.unwrapped.robot
    tick, ticking = robot.tick, 0.0

    def timed() -> None:
        nonlocal ticking
        start = perf_counter()
        tick()
        ticking += perf_counter() - start

    env.reset(seed=seed)
    robot.tick = timed
    for action in actions:
        env.step(action)
    robot.tick = tick
    return 1e6 * ticking / len(actions)


def _controls(env: Any, actions: list[np.ndarray], seed: int) -> list[np.ndarray]:
    """The controls of every physics step of an episode."""
    robot, data = env.unwrapped.robot, env.unwrapped.data
    tick, controls = robot.tick, []

    def recorded() -> None:
        tick()
        controls.append(data.ctrl.copy())

    env.reset(seed=seed)
    robot.tick = recorded
    for action in actions:
        env.step(action)
    robot.tick = tick
    return controls


def _seconds(env: Any, seed: int) -> float:
    start = perf_counter()
    env.reset(seed=seed)
    return perf_counter() - start


def _start_seconds(env_id: str) -> float:
    """Median of three fresh processes, after one that fills the caches."""
    program = (
        "from time import perf_counter; start = perf_counter(); import gymnasium, lfd_gym; "
        f"gymnasium.make({env_id!r}); print(perf_counter() - start)"
    )
    times = [
        float(subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout)
        for _ in range(4)
    ]
    return statistics.median(times[1:])
