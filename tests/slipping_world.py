"""A world without physics in which two kinds of blocks are grasped, each in its own way, and may slip out of the hand.

A flat block is approached from above, a tall one lower down; both are gripped and lifted. Whether a grasp holds shows in the
block's frame alone.
"""

from collections.abc import Sequence

import numpy as np
from kinematic_world import DOWN, DT, LAYOUT

from lfd_gym.demonstration import Demonstration, EntityControl, Primitive

BEGIN, ABOVE, BESIDE, CLOSE, LIFT = range(5)
OPEN, GRIP = np.zeros(4), np.array([0.0, 1.2, 1.2, 1.2])
SLIPPED = 0.02
"""A block that is left behind by so much [m] is given up."""


def _row(name: str, position: tuple[int, str, str], hand: tuple[int, str]) -> Primitive:
    return Primitive(
        name,
        EntityControl(position[0], position[1], "cartesian", (position[2],) * 3),
        EntityControl(0, "world", "rotation", ("hold",) * 3),
        EntityControl(hand[0], "world", "joints", (hand[1],) * 4),
    )


PRIMITIVES = (
    _row("begin", (0, "world", "position"), (0, "position")),
    _row("from above", (1, "block", "position"), (0, "position")),
    _row("from beside", (2, "block", "position"), (0, "position")),
    _row("close", (2, "block", "hold"), (1, "position")),
    _row("lift", (3, "world", "position"), (1, "hold")),
)


class BlockWorld:
    """Observes as an environment does and takes its actions; the grasps of `slips`, counted from 0, do not hold."""

    def __init__(self, seed: int, tall: bool, slips: Sequence[int] = ()) -> None:
        self.rng = np.random.default_rng(seed)
        self.block = np.r_[self.rng.uniform([0.2, -0.4], [0.6, 0.4]), 0.05, 1.0, 0.0, 0.0, 0.0]
        self.position, self.hand, self.held = np.array([0.0, 0.0, 0.4]), OPEN.copy(), False
        self.tall, self.slips, self.grasps = tall, slips, 0

    def observe(self) -> dict[str, np.ndarray]:
        return {
            "tool_position": self.position.copy(),
            "tool_quaternion": DOWN.copy(),
            "hand_position": self.hand.copy(),
            "hand_torque": 0.8 * (self.hand > 1.0),
            "wrench": np.zeros(6),
            "frame_block": self.block.copy(),
            "block": np.array([0.2 if self.tall else 0.1]),
        }

    def step(self, action: np.ndarray) -> dict[str, np.ndarray]:
        goal = LAYOUT.decode(action)
        velocity = 8.0 * (goal.position - self.position)
        velocity *= min(1.0, 0.5 / max(np.linalg.norm(velocity), 1e-9))
        self.position = self.position + velocity * DT
        if self.held and self.position[2] < 0.2 and (self.grasps - 1) in self.slips:
            self.held = self.position[2] < 0.1
        if self.held:
            self.block[:3] += velocity * DT
        self.hand = np.clip(self.hand + np.clip(goal.hand - self.hand, -2.4 * DT, 2.4 * DT), 0.0, 1.2)
        closed = self.hand[1] > 1.0
        if closed and not self.held and np.linalg.norm(self.position - self.block[:3]) < 0.06 and not self.was_closed:
            self.held, self.grasps = True, self.grasps + 1
        if not closed:
            self.held = False
        if not self.held:
            self.block[2] = 0.05
        self.was_closed = closed
        return self.observe()

    was_closed = False


def teach(seed: int, tall: bool, slips: Sequence[int] = ()) -> Demonstration:
    """One demonstration, which starts over where the block slips."""
    world = BlockWorld(seed, tall, slips)
    seen, labels, actions = [world.observe()], [], []
    goal, hand = world.position.copy(), OPEN

    def perform(label: int, position: np.ndarray | None = None, closes: np.ndarray | None = None) -> bool:
        nonlocal goal, hand
        goal = goal if position is None else position + 0.002 * world.rng.standard_normal(3)
        hand = hand if closes is None else closes
        still, pause = 0.0, world.rng.uniform(0.2, 0.8)
        held = world.block[:3] - world.position
        while still < pause:
            before = world.hand.copy()
            actions.append(LAYOUT.encode(goal, DOWN, np.zeros(3), hand))
            labels.append(label)
            seen.append(world.step(actions[-1]))
            if label == LIFT and np.linalg.norm(world.block[:3] - world.position - held) > SLIPPED:
                return False
            rests = np.linalg.norm(world.position - goal) < 0.002 and np.abs(world.hand - before).max() < 1e-3
            still = still + DT if rests else 0.0
        return True

    lifted = False
    while not lifted:
        perform(BEGIN, np.array([0.0, 0.0, 0.4]), OPEN)
        offset = np.array([0.0, 0.03, 0.0]) if tall else np.array([0.0, 0.0, 0.03])
        perform(BESIDE if tall else ABOVE, world.block[:3] + offset)
        perform(CLOSE, closes=GRIP)
        lifted = perform(LIFT, np.array([0.4, 0.0, 0.4]))
    return Demonstration(
        observations={name: np.array([o[name] for o in seen]) for name in seen[0]},
        actions=np.array(actions),
        rewards=np.zeros(len(actions)),
        labels=np.array(labels),
        primitives=PRIMITIVES,
        dt=DT,
        success=True,
        env_id="test/Block-v0",
        env_kwargs={},
        seed={"teach": 0, "index": seed, "reset": seed},
        setup={},
        teacher={"name": "block", "noise": 1.0, "mode": "commanded"},
        action_layout=LAYOUT.to_dict(),
        states=np.zeros((len(actions) + 1, 1)),
    )


def solve(skill, seed: int, tall: bool, slips: Sequence[int] = (), seconds: float = 40.0) -> tuple[bool, list[int]]:
    """Whether a skill lifts the block, and the labels it went through."""
    world, state, visited = BlockWorld(seed, tall, slips), None, []
    observation = world.observe()
    for _ in range(round(seconds / DT)):
        action, state = skill.predict(observation, state)
        label = int(skill.active(state)[0])
        if not visited or visited[-1] != label:
            visited.append(label)
        observation = world.step(action)
        if world.held and world.position[2] > 0.35:
            return True, visited
    return False, visited
