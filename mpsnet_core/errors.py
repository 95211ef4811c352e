"""What goes wrong and is not a fault of the program, and how that is said."""

from collections.abc import Collection, Mapping
from typing import NoReturn, TypeVar

T = TypeVar("T")

# A sentence with two paths in it is about half as long.
LONGEST = 500


class InputError(ValueError):
    """Bad input from outside. The message is one sentence: what is wrong, where, and how to mend it.

    Whatever a file or a path puts into it, it stays one readable line: see :func:`in_one_line`. Its subclasses are for
    callers who go on in one case and not in another.
    """

    def __init__(self, sentence: str = "") -> None:
        super().__init__(in_one_line(sentence))


class FileError(InputError):
    """A file or folder that is missing, cannot be read or cannot be written."""


class FormatError(InputError):
    """A file that can be read, but whose content is damaged, or no such thing as it is read for."""


class GeometryError(InputError):
    """Lights, cameras, meshes, masks or normals that no answer follows from, or that do not belong together."""


class NoObject(GeometryError):
    """A photo in which no object is seen, or a mask that marks none: of a sequence, a frame to leave out."""


class SettingsError(InputError):
    """An option that is unknown or out of its range, or options that contradict one another."""


def check_choice(what: str, value: object, choices: Collection[object]) -> None:
    """Raises SettingsError where `value` is none of `choices`; `what` names it in the sentence."""
    if value not in choices:
        *others, last = map(str, choices)
        known = f"{', '.join(others)} or {last}" if others else last
        raise SettingsError(f"{what} {value!r} is not known; choose {known}")


class Choices(dict[str, T]):
    """What each choice of a setting means. Another than these raises SettingsError, as :func:`check_choice` does."""

    def __init__(self, what: str, meanings: Mapping[str, T]) -> None:
        super().__init__(meanings)
        self.what = what

    def __missing__(self, value: str) -> NoReturn:
        check_choice(self.what, value, self)
        raise KeyError(value)


class Cancelled(Exception):
    """The person asked to stop; nothing half-written is left behind."""


def in_one_line(text: str, longest: int = LONGEST) -> str:
    """`text` as one line that a terminal shows as it is: no control characters, at most `longest` characters.

    Too long a text loses its middle, which is what came out of a file: the beginning says what is wrong, the end how to
    mend it.
    """
    # Cut once before, too: the text may be as long as the file that it is from.
    line = printable(" ".join(_cut(text, 10 * longest).split()))
    return _cut(line, longest)


def printable(text: str) -> str:
    """`text` with what moves a terminal's cursor, changes its colours or the order of letters written as an escape."""
    if text.isprintable():
        return text
    return "".join(sign if sign.isprintable() or sign == "\n" else ascii(sign)[1:-1] for sign in text)


def _cut(text: str, longest: int) -> str:
    if len(text) <= longest:
        return text
    end = longest // 3
    return f"{text[: longest - end - 1]}…{text[-end:]}"
