"""Errors that a user's input can cause, worded so that one line is enough to mend it."""

from __future__ import annotations

import warnings


class InputError(ValueError):
    """Input that yarnscale cannot accept; ``str()`` is one line: where, what, expected, found.

    Parameters
    ----------
    what: the fault, naming the field ("radius must be positive").
    where: file, ``file:line`` or option that holds the fault.
    expected, found: what a right value looks like, and the value met.
    """

    def __init__(
        self,
        what: str,
        *,
        where: object = None,
        expected: object = None,
        found: object = None,
    ) -> None:
        self.what, self.where, self.expected, self.found = what, where, expected, found
        parts = [f"{where}: {what}" if where is not None else what]
        if expected is not None:
            parts.append(f"expected {expected}")
        if found is not None:
            parts.append(f"found {found}")
        super().__init__(" ".join("; ".join(parts).split()))


class InputNotice(UserWarning):
    """Input that yarnscale accepts but that is likely not meant; one sentence, with file and sizes."""


def notify(text: str) -> None:
    """Warn of such input; the command line prints it and puts it into JSON output."""
    warnings.warn(text, InputNotice, stacklevel=3)
