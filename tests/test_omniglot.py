"""Reading strokes in the layout of the Omniglot data set, from a file written here."""

import zipfile

import numpy as np
import pytest

from lfd_gym.errors import DemonstrationError, UnknownNameError
from lfd_gym.omniglot import Drawing, read_drawings, single_strokes

LINE = "START\n0,-10,0\n10,-10,500\n20,-10,1000\nBREAK\n"
BOW = "START\n0.0,-20.5,0\n0,-20.5,40\n30,-40,400\n60,-20,800\nBREAK\n"
FILES = {
    "strokes/Latin/character02/0002_02.txt": BOW,
    "strokes/Latin/character01/0001_01.txt": LINE,
    "strokes/Latin/character01/0001_02.txt": LINE + BOW,
    "strokes/Latin/character01/0001_03.txt": "START\n5,-5,0\n5,-5,90\nBREAK\n",
    "strokes/Latin/character02/0002_01.txt": BOW.replace("30,-40", "30,-80"),
    "strokes/Greek/character01/0009_01.txt": LINE,
}


@pytest.fixture
def archive(tmp_path):
    path = tmp_path / "strokes.zip"
    with zipfile.ZipFile(path, "w") as file:
        for name, text in FILES.items():
            file.writestr(name, text)
    return path


def test_an_alphabet_is_read_in_order(archive):
    drawings = read_drawings(archive, "Latin")
    assert [(d.character, d.drawer, len(d.strokes)) for d in drawings] == [
        ("character01", 1, 1),
        ("character01", 2, 2),
        ("character01", 3, 1),
        ("character02", 1, 1),
        ("character02", 2, 1),
    ]
    np.testing.assert_allclose(drawings[0].strokes[0], [[0, -10, 0], [10, -10, 0.5], [20, -10, 1.0]])
    assert len(read_drawings(archive, "Greek")) == 1


def test_other_files_of_a_folder_are_passed_over(archive, tmp_path):
    with zipfile.ZipFile(archive) as file:
        file.extractall(tmp_path / "unpacked")
    (tmp_path / "unpacked" / "notes.txt").write_text("not a drawing")
    assert len(read_drawings(tmp_path / "unpacked", "Latin")) == 5
    assert len(read_drawings(tmp_path / "unpacked" / "strokes" / "Latin", "Latin")) == 5


def test_a_folder_is_read_like_the_file(archive, tmp_path):
    with zipfile.ZipFile(archive) as file:
        file.extractall(tmp_path / "unpacked")
    for here, there in zip(read_drawings(archive, "Latin"), read_drawings(tmp_path / "unpacked", "Latin"), strict=True):
        assert here[:3] == there[:3]
        for a, b in zip(here.strokes, there.strokes, strict=True):
            np.testing.assert_array_equal(a, b)


def test_single_strokes_are_preprocessed_as_in_the_thesis(archive):
    found = single_strokes(read_drawings(archive, "Latin"), 50)
    assert {name: len(drawn) for name, drawn in found.items()} == {"character01": 1, "character02": 2}
    for drawn in found.values():
        for points in drawn:
            assert points.shape == (50, 2)
            np.testing.assert_allclose(points.mean(axis=0), 0.0, atol=1e-12)
    spreads = [np.sqrt((points**2).sum(axis=1).mean()) for points in found["character02"]]
    assert spreads[0] == pytest.approx(spreads[1])
    np.testing.assert_allclose(np.diff(found["character01"][0][:, 0]), 20.0 / 49.0)  # equal times, equal steps


def test_a_drawing_without_time_is_left_out():
    good = np.array([[0.0, 0.0, 0.0], [5.0, 3.0, 100.0]])
    drawings = [
        Drawing("Latin", "character01", name, (stroke,)) for name, stroke in (("a", good), ("b", good * (1, 1, 0)))
    ]
    assert len(single_strokes(drawings, 10)["character01"]) == 1


def test_a_clock_that_goes_backwards_stands():
    strokes = [np.array([[0.0, 0.0, 0.0], [5.0, 3.0, 0.1], [7.0, 3.0, time], [9.0, 0.0, 0.2]]) for time in (0.1, 0.05)]
    drawings = [Drawing("Latin", "character01", i, (stroke,)) for i, stroke in enumerate(strokes)]
    one, other = single_strokes(drawings, 10)["character01"]
    np.testing.assert_array_equal(one, other)


def test_an_alphabet_that_is_not_there(archive):
    with pytest.raises(UnknownNameError, match="no alphabet 'Latn' .did you mean 'Latin'.*Greek, Latin"):
        read_drawings(archive, "Latn")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("START\n1,2\nBREAK\n", "has a line '1,2'; expected x,y,milliseconds"),
        ("START\n1,2,x\nBREAK\n", "has a line '1,2,x'"),
        ("START\n1,nan,2\nBREAK\n", "has a line '1,nan,2'"),
        ("START\nBREAK\n", "has no stroke"),
    ],
)
def test_damaged_drawings_are_refused(tmp_path, text, message):
    path = tmp_path / "Latin" / "character01" / "0001_01.txt"
    path.parent.mkdir(parents=True)
    path.write_text(text)
    with pytest.raises(DemonstrationError, match=message):
        read_drawings(tmp_path, "Latin")


def test_files_that_hold_no_drawings(tmp_path):
    with pytest.raises(DemonstrationError, match="there is no file .*download"):
        read_drawings(tmp_path / "none.zip", "Latin")
    with pytest.raises(DemonstrationError, match="holds no drawings .*download"):
        read_drawings(tmp_path, "Latin")
    (tmp_path / "bad.zip").write_bytes(b"no zip")
    with pytest.raises(DemonstrationError, match="holds what cannot be read; download"):
        read_drawings(tmp_path / "bad.zip", "Latin")


def test_a_zip_file_with_a_bit_that_has_flipped(tmp_path):
    with zipfile.ZipFile(tmp_path / "strokes.zip", "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("Latin/character01/0001_01.txt", LINE * 9)
    whole = (tmp_path / "strokes.zip").read_bytes()
    start = whole.index(b".txt") + len(".txt")
    refused = 0
    for i in range(start, start + 40):
        (tmp_path / "bad.zip").write_bytes(whole[:i] + bytes([whole[i] ^ 0x10]) + whole[i + 1 :])
        try:
            read_drawings(tmp_path / "bad.zip", "Latin")
        except DemonstrationError:
            refused += 1
    assert refused > 20
