"""A world without physics for skills that play paths: a pen that follows its attractor, and a board that does not yield."""

import itertools

import numpy as np
from scipy.spatial.transform import Rotation

from lfd_gym.action import ActionLayout
from lfd_gym.demonstration import Demonstration

DT, PRESS = 0.02, 3.0
DOWN = np.array([0.0, 0.0, 1.0, 0.0])
LAYOUT = ActionLayout(
    workspace_low=np.full(3, -1.0),
    workspace_high=np.full(3, 1.0),
    rotation_limit=np.full(3, 2.0),
    force_limit=10.0,
    hand_low=np.empty(0),
    hand_high=np.empty(0),
    reference_quaternion=DOWN,
    alpha=40.0,
    beta=10.0,
    speed_limit=0.5,
    turn_limit=2.0,
)
HOME = np.array([0.0, 0.0, 0.4])
CORNERS = 0.03 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]])


def board_pose(rng):
    """Within 30 cm, tilted and turned."""
    turn = Rotation.from_euler("zx", [rng.uniform(-0.6, 0.6), rng.uniform(0.3, 0.8)])
    return np.r_[rng.uniform(-0.3, 0.3, 2), 0.1, turn.as_quat(scalar_first=True)]


def on_board(pose, points):
    """Points (N, 3) of the board in the world."""
    return pose[:3] + Rotation.from_quat(pose[3:], scalar_first=True).apply(points)


def line(start, end, speed):
    """Points from start to end at a speed [m/s], without the last one."""
    n = max(round(np.linalg.norm(np.subtract(end, start)) / speed / DT), 3)
    return np.linspace(start, end, n, endpoint=False)


def demonstrate(seed):
    """A square drawn on a board: approach, touch, four strokes, withdraw; speed, place and press vary."""
    rng = np.random.default_rng(seed)
    pose, pace = board_pose(rng), rng.uniform(0.8, 1.3)
    square = np.pad(CORNERS + 0.0005 * rng.standard_normal((1, 2)), ((0, 0), (0, 1)))
    over = on_board(pose, square[[0]] + [0, 0, 0.05])[0]
    strokes = [line(a, b, 0.06 * pace) for a, b in itertools.pairwise(square)]
    parts = [line(HOME, over, 0.2 * pace), on_board(pose, line(square[0] + [0, 0, 0.05], square[0], 0.1 * pace))]
    parts += [on_board(pose, np.concatenate(strokes)), line(over, HOME, 0.2 * pace), np.tile(HOME, (5, 1))]
    path = np.concatenate(parts)
    wrench = np.zeros((len(path), 6))
    before = len(parts[0]) + len(parts[1])
    normal = Rotation.from_quat(pose[3:], scalar_first=True).as_matrix()[:, 2]
    velocity = np.gradient(path, axis=0)
    pressed = slice(before, before + len(parts[2]))
    along = velocity[pressed] / np.linalg.norm(velocity[pressed], axis=1, keepdims=True)
    wrench[pressed, :3] = (PRESS + 0.3 * rng.uniform(-1, 1)) * (normal - 0.2 * along)
    return demonstration(seed, path, wrench, pose)


def demonstration(seed, path, wrench, pose):
    """A demonstration of measured rows."""
    n = len(path)
    return Demonstration(
        observations={
            "tool_position": path,
            "tool_quaternion": np.tile(DOWN, (n, 1)),
            "reference_position": np.full((n, 3), np.nan),
            "wrench": wrench,
            "frame_board": np.tile(pose, (n, 1)),
        },
        actions=np.full((n - 1, LAYOUT.size), np.nan),
        rewards=np.zeros(n - 1),
        labels=np.full(n - 1, -1),
        primitives=(),
        dt=DT,
        success=True,
        env_id="test/Board-v0",
        env_kwargs={},
        seed={"teach": 0, "index": seed, "reset": seed},
        setup={},
        teacher={"name": "square", "noise": 1.0, "mode": "commanded"},
        action_layout=LAYOUT.to_dict(),
        states=np.zeros((n, 1)),
    )


class BoardWorld:
    """The tool is its own reference: it follows the attractor's goal, stops at the board, and presses there as told."""

    def __init__(self, pose):
        self.pose = pose
        self.turn = Rotation.from_quat(pose[3:], scalar_first=True)
        self.position, self.velocity, self.wrench, self.ink = HOME.copy(), np.zeros(3), np.zeros(6), []

    def observe(self):
        return {
            "tool_position": self.position.copy(),
            "tool_quaternion": DOWN,
            "wrench": self.wrench.copy(),
            "frame_board": self.pose,
        }

    def step(self, action):
        goal, normal = LAYOUT.decode(action), self.turn.as_matrix()[:, 2]
        for _ in range(10):
            acceleration = LAYOUT.alpha * (LAYOUT.beta * (goal.position - self.position) - self.velocity)
            self.velocity = self.velocity + acceleration * DT / 10
            if goal.force.any():
                out = (self.position - self.pose[:3]) @ normal
                self.velocity += ((-0.03 if out > 0 else 0.0) - self.velocity @ normal) * normal
            self.position = self.position + self.velocity * DT / 10
        depth = (self.position - self.pose[:3]) @ normal
        touches = depth <= 0.0 and bool(goal.force.any())
        self.wrench = np.r_[-(goal.force @ normal) * normal * touches, np.zeros(3)]
        if touches:
            self.ink.append(self.turn.inv().apply(self.position - self.pose[:3])[:2])
        return self.observe()


def draw(skill, pose, seconds=15.0):
    """What the skill leaves on a board, (N, 2), and the world after it."""
    world, state = BoardWorld(pose), None
    observation = world.observe()
    for _ in range(round(seconds / DT)):
        action, state = skill.predict(observation, state)
        observation = world.step(action)
    return np.array(world.ink), world
