"""Whiteboard: an alphabet of strokes, ink as a physical law, and words that a pen writes on boards."""

import pickle
import string

import numpy as np
import pytest

from lfd_gym import alphabet, ink, quaternion
from lfd_gym.envs.whiteboard import INK_FORCE, WhiteboardEnv
from lfd_gym.errors import InvalidArgumentError, InvalidSetupError
from lfd_gym.registry import make
from lfd_gym.rollout import TeacherPolicy, rollout
from scripted_teachers.whiteboard import WhiteboardTeacher

SEED = 100700
LINE = [np.array([[-0.05, 0.0], [0.05, 0.0]])]


@pytest.fixture(scope="module")
def env():
    """One environment for all tests."""
    return WhiteboardEnv()


def over(env, board, x, y, z, force=0.0):
    """The action that brings the pen to a place on a board [m] and presses there [N]."""
    pose = env.data.mocap_pos[board], env.data.mocap_quat[board]
    out = quaternion.to_matrix(pose[1])[:, 2]
    place = pose[0] + quaternion.rotate(pose[1], np.array([x, y, z]))
    return env.layout.encode(place, env.layout.reference_quaternion, -force * out)


def draw(env, force, control_steps=60):
    """Press on a clean first board and draw a line of 4 cm; the inked points of that board."""
    env.reset(seed=SEED)
    for _ in range(80):
        env.step(over(env, 0, -0.02, 0.0, 0.012))
    for _ in range(40):
        env.step(over(env, 0, -0.02, 0.0, 0.005, force))
    for s in np.linspace(0.0, 1.0, control_steps):
        env.step(over(env, 0, -0.02 + 0.04 * s, 0.0, 0.005, force))
    return env.boards[0].points()


@pytest.fixture
def board():
    """A clean board on which a line is wanted."""
    return ink.Ink(LINE, np.zeros(ink.WORDS))


@pytest.mark.parametrize("letter", string.ascii_uppercase)
def test_letters_fill_their_box(letter):
    points = np.concatenate(alphabet.strokes(letter))
    assert np.ptp(points[:, 1]) == pytest.approx(alphabet.HEIGHT)
    assert np.abs(points).max(axis=0)[0] <= alphabet.ASPECT * alphabet.HEIGHT / 2 + 1e-9
    assert np.abs(points).max(axis=0)[1] == pytest.approx(alphabet.HEIGHT / 2)


def test_no_letter_passes_for_another():
    memory = np.zeros(ink.WORDS)
    boards = {letter: ink.Ink(alphabet.strokes(letter), memory) for letter in string.ascii_uppercase}
    for letter in boards:
        memory[:] = 0.0
        for stroke in alphabet.strokes(letter):
            for point in alphabet.sample(stroke, 0.0005):
                boards[letter].mark(*point)
        tallies = {other: board.tally() for other, board in boards.items()}
        assert [name for name, t in tallies.items() if t.coverage >= 0.9 and t.precision >= 0.9] == [letter]


def test_a_word_is_its_letters_side_by_side_and_long_words_fit():
    assert len(alphabet.strokes("AB")) == len(alphabet.strokes("A")) + len(alphabet.strokes("B"))
    widest = np.concatenate(alphabet.strokes("W" * alphabet.MAX_LETTERS))
    assert np.ptp(widest[:, 0]) <= alphabet.MAX_WIDTH + 1e-9 < 2 * ink.HALF_SIZE[0]


@pytest.mark.parametrize("word", ["", "ias", "IAS ", "ABCDEFG", "Ä", 3])
def test_impossible_words_say_what_is_possible(word):
    with pytest.raises(InvalidArgumentError, match="capital letters"):
        alphabet.strokes(word)


@pytest.mark.parametrize("words", ["lower case!", "IAS", ("IAS",), ("IAS", "hri"), 5])
def test_environment_refuses_impossible_words(words):
    with pytest.raises(InvalidArgumentError, match="capital letters"):
        make("whiteboard", words=words)
    with pytest.raises(InvalidArgumentError, match="capital letters"):
        WhiteboardTeacher(words=words)


@pytest.mark.parametrize(
    ("tip", "distance"),
    [((0.0, 0.0, 0.05), 0.05), ((0.0, 0.0, -0.02), -0.02), ((0.03, 0.0, 0.0), 0.03), ((0.03, 0.04, 0.12), 0.13)],
)
def test_a_pen_beside_a_board_is_as_far_as_its_nearest_point(tip, distance):
    beyond = np.array(tip) + np.array([*(np.sign(tip[:2]) * ink.HALF_SIZE), 0.0])
    origins = np.array([[0.0, 0.0, 0.0], [5.0, 0.0, 0.0]])
    assert ink.clearance(beyond, origins, np.tile(np.eye(3).ravel(), (2, 1))) == pytest.approx(distance)


def test_samples_are_on_the_stroke_and_evenly_spaced():
    points = alphabet.sample(np.array([[0.0, 0.0], [0.03, 0.0], [0.03, 0.04]]), 0.001)
    assert np.allclose(points[[0, -1]], [[0.0, 0.0], [0.03, 0.04]])
    assert np.all((points[:, 1] == 0.0) | np.isclose(points[:, 0], 0.03))
    assert len(points) == 71


def test_nothing_written_covers_nothing(board):
    assert board.tally()[:1] == (0,)
    assert board.tally().coverage == board.tally().precision == 0.0


def test_half_a_line_covers_half_within_the_tolerance(board):
    for x in np.arange(-0.05, 0.0, 0.0005):
        board.mark(x, 0.0)
    assert board.tally().coverage == pytest.approx(0.5 + ink.TOLERANCE / 0.1, abs=0.02)
    assert board.tally().precision == 1.0


@pytest.mark.parametrize(("offset", "counts"), [(0.0025, True), (0.006, False)])
def test_ink_counts_within_four_millimetres(board, offset, counts):
    for x in np.arange(-0.05, 0.05, 0.0005):
        board.mark(x, offset)
    assert (board.tally().coverage == 1.0) == counts
    assert (board.tally().precision == 1.0) == counts


def test_a_tally_is_of_the_ink_that_is_there_and_not_of_what_was_there_before():
    strokes = [np.array([[-0.05, y], [end, y]]) for y, end in ((0.0, 0.03), (0.03, -0.01))]
    one, other = (ink.Ink(strokes, np.zeros(ink.WORDS)) for _ in range(2))
    for board, lengths in ((one, (0.03, 0.01)), (other, (0.01, 0.03))):
        for (begin, _), length in zip(strokes, lengths, strict=True):
            for x in np.arange(begin[0], begin[0] + length, 0.0005):
                board.mark(x, begin[1])
    assert one.tally()[:4] == other.tally()[:4]
    assert one.tally().faintest > other.tally().faintest
    one.memory[:] = other.memory
    assert one.tally() == other.tally()


def test_strays_cost_precision_and_dwelling_costs_nothing(board):
    for x in np.arange(-0.0499, 0.05, 0.0005):
        board.mark(x, 0.0)
        board.mark(x, 0.0)
    clean = board.tally()
    for x in np.arange(-0.0499, 0.05, 0.0005):
        board.mark(x, 0.05)
    assert clean.precision == 1.0
    assert board.tally().precision == pytest.approx(0.5)
    assert board.tally().coverage == clean.coverage


def test_beside_the_board_nothing_is_left(board):
    for x, y in ((0.111, 0.0), (-0.111, 0.0), (0.0, 0.071), (0.0, -0.071)):
        board.mark(x, y)
    assert not board.memory.any()


def test_points_are_where_the_board_was_touched(board):
    touched = np.random.default_rng(0).uniform(-0.069, 0.069, (200, 2))
    for x, y in touched:
        board.mark(x, y)
    away = np.abs(board.points()[:, None] - touched).max(axis=2)
    assert away.min(axis=0).max() <= ink.CELL / 2 + 1e-9
    assert away.min(axis=1).max() <= ink.CELL / 2 + 1e-9


def test_a_firm_pen_draws_the_line_that_it_moves_along(env):
    points = draw(env, force=2.5)
    assert np.abs(points[:, 1]).max() < ink.TOLERANCE
    assert points[:, 0].min() == pytest.approx(-0.02, abs=0.003)
    assert points[:, 0].max() == pytest.approx(0.02, abs=0.008)
    assert len(points) >= 0.032 / ink.CELL


def test_a_pen_that_hovers_or_touches_too_softly_leaves_no_ink(env):
    assert len(draw(env, force=0.0)) == 0
    assert len(draw(env, force=0.4 * INK_FORCE)) <= 2


def test_ink_does_not_depend_on_the_control_rate():
    slow = WhiteboardEnv(control_hz=25)
    slow.reset(seed=SEED)
    fast = WhiteboardEnv(control_hz=50)
    fast.reset(seed=SEED)
    for e, repeat in ((slow, 1), (fast, 2)):
        for place, n in (((-0.02, 0.0, 0.012, 0.0), 40), ((-0.02, 0.0, 0.005, 2.5), 20), ((0.02, 0.0, 0.005, 2.5), 10)):
            for _ in range(n * repeat):
                e.step(over(e, 0, *place))
    assert slow._hidden.any()
    assert np.array_equal(slow._hidden, fast._hidden)


def test_the_teacher_writes_both_words_and_the_ink_is_part_of_the_state(env):
    states, infos, progress = [], [], []
    policy = TeacherPolicy(WhiteboardTeacher(noise=1.0))
    for step in rollout(env, policy, SEED):
        states.append(env.get_state())
        infos.append(step.info)
        progress.append(env.progress())
    assert infos[-1]["is_success"]
    assert np.max(np.maximum.accumulate(progress) - progress) < 0.02
    assert [info["subtask/word_1"] for info in infos].index(True) < [i["subtask/word_2"] for i in infos].index(True)
    other = WhiteboardEnv()
    other.reset(seed=1 + SEED)
    half = len(states) // 2
    for k in (half, -1, 0):
        other.set_state(states[k])
        assert np.array_equal(other.get_state(), states[k])
        assert other._info(other.succeeded())["coverage"] == infos[k]["coverage"]
        assert other._info(other.succeeded())["precision"] == infos[k]["precision"]


def test_a_reset_wipes_the_boards(env):
    draw(env, force=2.5)
    _, info = env.reset(seed=SEED)
    assert info["coverage"] == info["precision"] == 0.0
    assert not env._hidden.any()


def test_a_copy_is_asked_for_the_same_words():
    original = WhiteboardEnv(words=("AB", "C"), control_hz=25.0)
    twin = pickle.loads(pickle.dumps(original))
    assert (twin.words, twin.dt) == (("AB", "C"), 0.04)


def test_every_single_stroke_has_to_be_there(env):
    strokes = [(board, stroke) for board, word in enumerate(alphabet.two_words(env.words)) for stroke in word]
    elsewhere_enough = []
    for missing in range(-1, len(strokes)):
        env.reset(seed=SEED)
        for i, (board, stroke) in enumerate(strokes):
            for point in alphabet.sample(stroke, ink.SPACING) if i != missing else ():
                env.boards[board].mark(*point)
        env.after_physics()
        assert env.succeeded() == (missing < 0)
        elsewhere_enough.append(min(env.measures().values()) >= 0.9)
    assert sum(elsewhere_enough) > 3


def test_a_long_word_does_not_make_up_for_one_that_is_not_there():
    env = WhiteboardEnv(words=("BBBB", "I"))
    env.reset(seed=SEED)
    words = alphabet.two_words(env.words)
    wanted = [np.concatenate([alphabet.sample(stroke, ink.SPACING) for stroke in word]) for word in words]
    for x, y in wanted[0]:
        env.boards[0].mark(x, y)
    env.after_physics()
    assert env.measures()["coverage"] > 0.9
    assert env.subtask_flags() == (True, False, True)
    assert not env.succeeded()
    for x, y in wanted[1]:
        env.boards[1].mark(x, y)
    env.after_physics()
    assert env.succeeded()


@pytest.mark.parametrize("words", [("MA", "XYZ"), ("ROBOTS", "Q")])
def test_other_words_can_be_written(words):
    env = WhiteboardEnv(words=words)
    *_, last = rollout(env, TeacherPolicy(WhiteboardTeacher(noise=0.0, words=words)), SEED)
    assert last.info["is_success"]


@pytest.mark.parametrize(
    ("setup", "what"),
    [
        ({"board_1": {"position": [0.6, -0.2]}}, "out of reach"),
        ({"board_2": {"tilt": 1.2}}, "tilt of 'board_2'"),
        ({"board_1": {"yaw": -1.0}}, "yaw of 'board_1'"),
    ],
)
def test_impossible_setups_say_what_is_possible(env, setup, what):
    with pytest.raises(InvalidSetupError, match=what):
        env.reset(seed=SEED, options={"setup": setup})


def test_a_board_stands_where_the_setup_says_and_faces_the_robot(env):
    pose = {"position": [0.6, 0.2], "yaw": 0.0, "tilt": np.radians(40.0)}
    observation, _ = env.reset(options={"setup": {"board_1": pose}})
    axes = quaternion.to_matrix(observation["frame_board_1"][3:])
    assert observation["frame_board_1"][:2] == pytest.approx([0.6, 0.2])
    assert axes[:, 0] == pytest.approx([0.0, -1.0, 0.0], abs=1e-9)
    assert axes[:, 2] == pytest.approx([-np.sin(pose["tilt"]), 0.0, np.cos(pose["tilt"])], abs=1e-9)
