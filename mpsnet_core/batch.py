"""Batches: inputs that are handled one by one, where a bad one does not end the others."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from mpsnet_core.errors import InputError, SettingsError

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
