"""Every error says what happened, why probably, and what to do; and the drawn tree is the real one."""

from __future__ import annotations

import pickle
import re

import pytest

from drivers import errors
from drivers.errors import DriverError


def subclasses(cls: type[DriverError]) -> list[type[DriverError]]:
    return [cls, *(leaf for child in cls.__subclasses__() for leaf in subclasses(child))]


def drawn_tree() -> dict[str, str]:
    """Child to parent, read from the drawing in the module's docstring."""
    assert errors.__doc__
    parents: list[tuple[int, str]] = [(-1, "")]
    tree = {}
    for line in re.findall(r"^    [│ ├└─]*[A-Z]\w+.*$", errors.__doc__, re.MULTILINE):
        match = re.search(r"[A-Z]\w+", line)
        assert match
        while parents[-1][0] >= match.start():
            parents.pop()
        tree[match.group()] = parents[-1][1]
        parents.append((match.start(), match.group()))
    return tree


def test_the_drawing_is_the_class_tree() -> None:
    real = {
        cls.__name__: cls.__mro__[1].__name__ for cls in subclasses(DriverError) if cls is not DriverError
    }
    drawn = {child: parent for child, parent in drawn_tree().items() if child != "DriverError"}
    assert drawn == real


@pytest.mark.parametrize(
    "cls", [c for c in subclasses(DriverError) if not c.__subclasses__() or c is errors.ObjectRefused]
)
def test_every_error_says_what_why_and_what_to_do(cls: type[DriverError]) -> None:
    text = str(cls("X1 (node 5): it happened"))
    assert text.startswith("X1 (node 5): it happened. Likely cause: ")
    assert "What to do: " in text
    assert cls.cause != DriverError.cause
    assert cls.remedy != DriverError.remedy


@pytest.mark.parametrize("cls", subclasses(DriverError))
def test_errors_travel_between_processes(cls: type[DriverError]) -> None:
    again = pickle.loads(pickle.dumps(cls("it happened")))
    assert type(again) is cls
    assert str(again) == str(cls("it happened"))


def test_a_fault_keeps_its_code_between_processes() -> None:
    again = pickle.loads(pickle.dumps(errors.DriveFault("X1 reports 0x8611", 0x8611, 0x20)))
    assert (again.code, again.register) == (0x8611, 0x20)
