"""Errors that a user's input can cause, worded so that one line is enough to mend it."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager


class InputError(ValueError):
    """Input that yarnscale cannot accept; ``str()`` is one line: where, what, expected, found.

    Parameters
    ----------
    what: the fault, naming the field ("radius must be positive").
    where: file, ``file:line`` or option that holds the fault.
    expected, found: what a right value looks like, and the value met.
    """

    def __init__(self, what: str, *, where: object = None, expected: object = None, found: object = None) -> None:
        self.what, self.where, self.expected, self.found = what, where, expected, found
        parts = [f"{where}: {what}" if where is not None else what]
        if expected is not None:
            parts.append(f"expected {expected}")
        if found is not None:
            parts.append(f"found {found}")
        super().__init__(" ".join("; ".join(parts).split()))

    def at(self, where: object) -> InputError:
        """The same fault at another place."""
        return InputError(self.what, where=where, expected=self.expected, found=self.found)


@contextmanager
def located(where: object) -> Iterator[None]:
    """Faults that name no place get this one; a function finds it from the fault."""
    try:
        yield
    except InputError as error:
        if error.where is not None:
            raise
        raise error.at(where(error) if callable(where) else where) from None


@contextmanager
def system_errors(where: object, what: str = "output cannot be written") -> Iterator[None]:
    """Errors of the operating system, such as a full disk, become InputErrors of a place."""
    try:
        yield
    except InputError:
        raise
    except (OSError, ValueError) as error:
        found = error.strerror if isinstance(error, OSError) and error.strerror else error
        raise InputError(what, where=f"{where!s:.400}", found=found) from None


def positive(what: str, value: float, expected: str = "a positive number") -> float:
    """The value; InputError where it is no finite number above zero."""
    if not (math.isfinite(value) and value > 0):
        raise InputError(what, expected=expected, found=value)
    return value


def not_negative(what: str, value: float, expected: str = "zero or a positive number") -> float:
    """The value; InputError where it is no finite number from zero on."""
    if not (math.isfinite(value) and value >= 0):
        raise InputError(what, expected=expected, found=value)
    return value


def quoted(value: object) -> str:
    """A quotation of a user's value on one line of sixty characters at most."""
    try:
        text = ascii(value)
    except (RecursionError, ValueError):
        text = type(value).__name__
    return text if len(text) <= 60 else text[:57] + "..."


def misspelt(name: object, known: Iterable[str]) -> str:
    """A quotation of a name that is not known, with the known one that is most like it."""
    from difflib import get_close_matches

    near = get_close_matches(str(name).lower(), [*known], 1)
    return quoted(name) + (f", did you mean {near[0]}?" if near else "")


class InputNotice(UserWarning):
    """Input that yarnscale accepts but that is likely not meant; one sentence, with file and sizes."""


def notify(text: str) -> None:
    """Warn of such input; the command line prints it and puts it into JSON output."""
    warnings.warn(text, InputNotice, stacklevel=3)
