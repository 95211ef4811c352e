"""Errors that are not faults of the program, notes on a result, and how both are worded."""

import re
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Generic, Literal, NoReturn, Self, TypeVar, get_args

T = TypeVar("T")

# How a note judges what it is about: all is well, have a look, or it cannot be used.
NoteLevel = Literal["good", "look", "stop"]
NOTE_LEVELS: tuple[NoteLevel, ...] = get_args(NoteLevel)
_CODE = re.compile(r" \[([a-z]+(?:-[a-z]+)+)\]")
# A template from a file may ask for no others: a wide field takes any amount of memory.
_PLACEHOLDER = re.compile(r"%(?:[+]?(?:\.\d{1,2})?[a-z]|%)")

# Characters of a message: about twice the length of a sentence that names two paths.
LONGEST = 500


class InputError(ValueError):
    """Bad input from outside. The message is one sentence: what is wrong, where, and how to mend it.

    It stays one readable line whatever a file or a path contributes: see :func:`in_one_line`. Subclasses let callers
    recover from one kind of error alone.
    """

    def __init__(self, sentence: str = "") -> None:
        super().__init__(in_one_line(sentence))


class FileError(InputError):
    """A file or folder that is missing, cannot be read or cannot be written."""


class FormatError(InputError):
    """A file that can be read, but whose content is damaged or of the wrong kind."""


class GeometryError(InputError):
    """Lights, cameras, meshes, masks or normals that are degenerate or do not fit together."""


class NoObject(GeometryError):
    """A photo without a visible object, or an empty mask. A sequence skips such a frame."""


class SettingsError(InputError):
    """An option that is unknown or out of range, or options that contradict one another."""


def check_choice(what: str, value: object, choices: Collection[object]) -> None:
    """Raise SettingsError unless `value` is one of `choices`. The message calls it `what`."""
    if value not in choices:
        *others, last = map(str, choices)
        known = f"{', '.join(others)} or {last}" if others else last
        raise SettingsError(f"{what} {value!r} is not known; choose {known}")


class Choices(dict[str, T]):
    """A mapping from each choice of a setting to its meaning. An unknown key raises SettingsError."""

    def __init__(self, what: str, meanings: Mapping[str, T]) -> None:
        super().__init__(meanings)
        self.what = what

    def __missing__(self, value: str) -> NoReturn:
        check_choice(self.what, value, self)
        raise KeyError(value)


class Note(str):
    """A sentence on a result, in one line. It keeps the English template and the values that it was made of.

    So a program can show it in another language, by its level, and link to the entry of its code in the docs. Options
    in a template are written as flags: "--white-light".

    Parameters
    ----------
    template
        The sentence, with a %-placeholder for each value.
    values
        Numbers, texts, or notes that are parts of this one.
    level
        "good", "look" or "stop".
    """

    template: str
    values: tuple[Any, ...]
    level: NoteLevel

    def __new__(cls, template: str, *values: Any, level: NoteLevel = "good") -> Self:
        note = super().__new__(cls, in_one_line(template % values if values else template))
        note.template, note.values, note.level = template, values, level
        return note

    @property
    def code(self) -> str:
        """The anchor of the entry in the docs that explains it; "" if there is none."""
        found = _CODE.search(self)
        return found[1] if found else ""

    def facts(self) -> dict[str, Any]:
        """What is needed to show it elsewhere, as JSON data."""
        values = [
            one.facts() if isinstance(one, Note) else getattr(one, "item", lambda one=one: one)() for one in self.values
        ]
        shown = [one if isinstance(one, int | float | str | dict) else str(one) for one in values]
        return {"level": self.level, "code": self.code, "template": self.template, "values": shown}

    @classmethod
    def from_facts(cls, facts: Any) -> Self:
        """The inverse of :meth:`facts`. Raises FormatError if these are none, as in a file from elsewhere."""
        try:
            values = [cls.from_facts(one) if isinstance(one, dict) else one for one in facts["values"]]
            if facts["level"] in NOTE_LEVELS and "%" not in _PLACEHOLDER.sub("", facts["template"] if values else ""):
                return cls(facts["template"], *values, level=facts["level"])
        except (TypeError, ValueError, KeyError, AttributeError, RecursionError):
            pass
        raise FormatError("this is no note")


class Cancelled(Exception):
    """The user cancelled. No partly written file remains."""


def in_one_line(text: str, longest: int = LONGEST) -> str:
    """`text` as one line that a terminal shows as it is: no control characters, at most `longest` characters.

    A longer text loses its middle, which usually quotes a file: the beginning says what is wrong, the end how to mend
    it.
    """
    # A first cut keeps this fast: the text may be as long as the file that it quotes.
    line = printable(" ".join(_cut(text, 10 * longest).split()))
    return _cut(line, longest)


def printable(text: str) -> str:
    """`text` with escapes in place of characters that control a terminal: its cursor, colours or text direction."""
    if text.isprintable():
        return text
    return "".join(sign if sign.isprintable() or sign == "\n" else ascii(sign)[1:-1] for sign in text)


def _cut(text: str, longest: int) -> str:
    if len(text) <= longest:
        return text
    end = longest // 3
    return f"{text[: longest - end - 1]}…{text[-end:]}"


# --- batches: inputs that are handled one by one, where a bad one does not end the others -----------------------------


# A batch ends if this many inputs fail and none succeeds: then the mask or a setting is wrong, not the inputs.
HOPELESS = 3

Key = TypeVar("Key")


@dataclass
class Batch(Generic[Key]):
    """The inputs of a batch that were tried."""

    succeeded: int = 0
    """Number of inputs that were done, now or by an earlier run."""
    errors: dict[Key, InputError] = field(default_factory=dict)
    """Why the others failed, by their keys."""

    @contextmanager
    def one(self, key: Key) -> Iterator[None]:
        """Try the input `key` in the with block. Its InputError is kept, and the batch goes on.

        Raises SettingsError at once, and the first error if the batch is hopeless.
        """
        try:
            yield
        except SettingsError:
            raise
        except InputError as error:
            self.errors[key] = error
            if len(self.errors) == HOPELESS:
                self.check_any()
        else:
            self.succeeded += 1

    def check_any(self) -> None:
        """Raise the first error if inputs failed and none succeeded."""
        if self.succeeded or not self.errors:
            return
        first, count = next(iter(self.errors.values())), len(self.errors)
        raise type(first)(f"all {count} that were tried failed; the first: {first}" if count > 1 else str(first))

    def failed(self) -> dict[Key, str]:
        """A sentence for each input that failed."""
        return {key: str(error) for key, error in self.errors.items()}
