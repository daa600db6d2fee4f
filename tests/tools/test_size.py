"""What counts as size."""

import pytest

from tools.size import Size, above, room_of, size_of


@pytest.mark.parametrize(
    ("source", "size"),
    [
        ("", Size(0, 0, 0)),
        ('"""Says what it is."""\n\n# why\n', Size(0, 0, 0)),
        ("def f(x):  # of a number\n    '''Docstring.'''\n    return (\n        x\n    )\n", Size(10, 0, 0)),
        ('TEXT = "counts"\n"""A docstring of it."""\n', Size(3, 0, 0)),
        ("A, B = 1, -2.5\nON = True\nSUM = A + 1\ndef f():\n    c = 3\n", Size(24, 3, 0)),
        ("class C:\n    x: int = 1\n    y: float\n", Size(11, 1, 0)),
        ("@njit(cache=True)\ndef f(): pass\n@property\ndef g(): pass\n", Size(21, 0, 1)),
    ],
)
def test_size(source, size):
    assert size_of(source) == size


def test_rooms_are_the_folders_of_the_package_its_own_modules_and_the_other_folders():
    paths = ("zeromethod/loop/step.py", "zeromethod/clock.py", "tests/loop/test_state.py", "tools/size.py")
    assert [room_of(path) for path in paths] == ["zeromethod/loop", "zeromethod/*.py", "tests", "tools"]


def test_a_room_above_its_ceiling_and_one_without_are_named_with_their_sizes():
    rooms = {"tests": Size(1000), "tools": Size(1501), "examples": Size(1)}
    lines = above(rooms, {"tests": 1000, "tools": 1500})
    assert [line.split(": ", 3)[1:3] for line in lines] == [
        ["tools", "1,501 tokens"],
        ["examples", "1 tokens"],
    ]
