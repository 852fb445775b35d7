"""A world without physics for the learner's tests: a tool that follows its goal, and a lid that comes loose by turning.

The lid is turned by the closed hand in strokes; after a hidden angle it is loose, and a hand that pulls upwards rises. The
teacher's goals, pauses and the hidden angle vary. Everything a sequence graph has to cope with, in milliseconds.
"""

from collections.abc import Iterator

import numpy as np

from lfd_gym import quaternion
from lfd_gym.action import ActionLayout
from lfd_gym.demonstration import Demonstration, EntityControl, Primitive

DT = 0.02
DOWN = np.array([0.0, 0.0, 1.0, 0.0])
LAYOUT = ActionLayout(
    workspace_low=np.array([-1.0, -1.0, 0.0]),
    workspace_high=np.array([1.0, 1.0, 1.0]),
    rotation_limit=np.full(3, 2.0),
    force_limit=20.0,
    hand_low=np.zeros(4),
    hand_high=np.full(4, 2.4),
    reference_quaternion=DOWN,
    alpha=20.0,
    beta=5.0,
    speed_limit=0.5,
    turn_limit=2.0,
)
OPEN, CLOSED, STALL = np.zeros(4), np.array([0.0, 2.0, 2.0, 2.0]), np.array([0.0, 1.2, 1.1, 1.3])
STROKE, PULL, LOOSE_RISE = 0.9, 8.0, 0.02
P, H, F = ("position",) * 3, ("hold",) * 3, ("position", "position", "force")
REACH, CLOSE, TWIST, RELEASE, TURN_BACK, CARRY = range(6)


def _row(
    name: str,
    position: tuple[int, str, tuple[str, ...]],
    orientation: tuple[int, tuple[str, ...]],
    hand: tuple[int, str],
) -> Primitive:
    return Primitive(
        name,
        EntityControl(position[0], position[1], "cartesian", position[2]),
        EntityControl(orientation[0], "world", "rotation", orientation[1]),
        EntityControl(hand[0], "world", "joints", (hand[1],) * 4),
    )


PRIMITIVES = (
    _row("reach", (0, "lid", P), (0, P), (0, "position")),
    _row("close", (0, "lid", H), (0, H), (1, "position")),
    _row("twist", (0, "lid", F), (1, P), (1, "position")),
    _row("release", (0, "lid", H), (1, H), (0, "position")),
    _row("turn back", (0, "lid", H), (0, P), (0, "position")),
    _row("carry", (1, "bin", P), (1, H), (1, "hold")),
)


def tool(yaw: float) -> np.ndarray:
    return quaternion.multiply(quaternion.from_rotation_vector(np.array([0.0, 0.0, yaw])), DOWN)


class LidWorld:
    """Observes as an environment does and takes its actions."""

    def reset(self, seed: int) -> dict[str, np.ndarray]:
        rng = np.random.default_rng(seed)
        places = rng.uniform([0.2, -0.4, 0.1], [0.6, 0.4, 0.1]), rng.uniform([-0.6, -0.4, 0.0], [-0.2, 0.4, 0.0])
        self.loose_after = rng.uniform(3.8, 6.5)
        self.lid, self.bin = (
            np.r_[place, quaternion.from_rotation_vector(np.array([0.0, 0.0, rng.uniform(-np.pi, np.pi)]))]
            for place in places
        )
        self.position, self.orientation, self.hand = np.array([0.0, 0.0, 0.4]), tool(0.0), OPEN.copy()
        self.torque, self.wrench, self.turned, self.carried, self.binned = np.zeros(4), np.zeros(6), 0.0, False, False
        return self.observe()

    def observe(self) -> dict[str, np.ndarray]:
        nothing = np.full(3, np.nan)
        return {
            "tool_position": self.position.copy(),
            "tool_quaternion": self.orientation.copy(),
            "reference_position": nothing,
            "hand_position": self.hand.copy(),
            "hand_torque": self.torque.copy(),
            "wrench": self.wrench.copy(),
            "frame_lid": self.lid.copy(),
            "frame_bin": self.bin.copy(),
        }

    def step(self, action: np.ndarray) -> dict[str, np.ndarray]:
        goal = LAYOUT.decode(action)
        near = np.linalg.norm(self.position - self.lid[:3] - [0, 0, 0.05]) < 0.03 and self.turned < self.loose_after
        gripping = (near or self.carried) and self.hand[1] > 1.0
        velocity = 8.0 * (goal.position - self.position)
        velocity *= min(1.0, 0.5 / max(np.linalg.norm(velocity), 1e-9))
        self.wrench[:] = 0.0
        if goal.force[2] > 0:
            velocity[2] = 0.0 if gripping and not self.carried else 0.06
            self.wrench[2] = -goal.force[2] if gripping and not self.carried else 0.0
        turn = quaternion.to_rotation_vector(
            quaternion.multiply(goal.quaternion, quaternion.conjugate(self.orientation))
        )
        turn = 6.0 * turn * min(1.0, 1.5 / max(6.0 * np.linalg.norm(turn), 1e-9)) * DT
        if gripping and not self.carried:
            self.turned += abs(turn[2])
            self.carried = self.turned >= self.loose_after and goal.force[2] > 0
        self.position = self.position + velocity * DT
        self.orientation = quaternion.multiply(quaternion.from_rotation_vector(turn), self.orientation)
        limit = STALL if near or self.carried else np.full(4, 2.4)
        self.hand = np.minimum(self.hand + np.clip(goal.hand - self.hand, -2.4 * DT, 2.4 * DT), limit)
        self.torque = np.where(goal.hand > self.hand + 0.04, 0.8, 0.0)
        if self.carried and self.hand[1] < 0.8:
            self.carried, self.turned = False, np.inf
            self.binned = bool(np.linalg.norm((self.position - self.bin[:3])[:2]) < 0.05)
        return self.observe()


def teach(seed: int, noise: float = 1.0) -> Demonstration:
    """One demonstration."""
    world, rng = LidWorld(), np.random.default_rng([seed, 1])
    seen, labels, actions = [world.reset(seed)], [], []

    def perform(label, position=None, yaw=None, hand=None, force=0.0) -> Iterator[None]:
        goal["position"] = goal["position"] if position is None else position + noise * 0.004 * rng.standard_normal(3)
        goal["yaw"] = goal["yaw"] if yaw is None else yaw + noise * 0.02 * rng.standard_normal()
        goal["hand"] = goal["hand"] if hand is None else hand
        still, pause = 0.0, rng.uniform(0.2, 1.0) if noise else 0.2
        height = world.position[2]
        while still < pause:
            before = world.hand.copy()
            actions.append(LAYOUT.encode(goal["position"], tool(goal["yaw"]), [0, 0, force], goal["hand"]))
            labels.append(label)
            seen.append(world.step(actions[-1]))
            error = np.abs(world.position - goal["position"])[: 2 if force else 3].max()
            angle = 2 * np.arccos(min(1.0, abs(world.orientation @ tool(goal["yaw"]))))
            arrived = error < 0.002 and angle < 0.02 and np.abs(world.hand - before).max() < 1e-3
            still = still + DT if arrived else 0.0
            if force and world.position[2] - height > LOOSE_RISE * (1 + 0.2 * noise * rng.uniform(-1, 1)):
                return True
        return False

    goal = {"position": world.position.copy(), "yaw": 0.0, "hand": OPEN}
    on_lid, over_bin = world.lid[:3] + np.array([0, 0, 0.05]), world.bin[:3] + np.array([0, 0, 0.2])
    perform(REACH, position=on_lid, yaw=-STROKE, hand=OPEN)
    while True:
        perform(CLOSE, hand=CLOSED)
        if perform(TWIST, yaw=STROKE, force=PULL):
            break
        perform(RELEASE, hand=OPEN)
        perform(TURN_BACK, yaw=-STROKE)
    goal["position"] = world.position.copy()
    perform(CARRY, position=over_bin)
    perform(RELEASE, hand=OPEN)
    return Demonstration(
        observations={name: np.array([o[name] for o in seen]) for name in seen[0]},
        actions=np.array(actions),
        rewards=np.zeros(len(actions)),
        labels=np.array(labels),
        primitives=PRIMITIVES,
        dt=DT,
        success=world.binned,
        env_id="test/Lid-v0",
        env_kwargs={},
        seed={"teach": 0, "index": seed, "reset": seed},
        setup={},
        teacher={"name": "lid", "noise": noise, "mode": "commanded"},
        action_layout=LAYOUT.to_dict(),
        states=np.zeros((len(actions) + 1, 1)),
    )


def solve(skill, seed: int, seconds: float = 60.0) -> tuple[bool, list[int]]:
    """Whether a skill solves an episode, and the labels it went through."""
    world, state, visited = LidWorld(), None, []
    observation = world.reset(seed)
    for _ in range(round(seconds / DT)):
        action, state = skill.predict(observation, state)
        label = int(skill.active(state)[0])
        if not visited or visited[-1] != label:
            visited.append(label)
        observation = world.step(action)
        if world.binned:
            return True, visited
    return False, visited
