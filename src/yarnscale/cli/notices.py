"""Notices about input that is accepted but unlikely: on the standard error, and in JSON output."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from yarnscale.errors import InputNotice

given: list[str] = []
"""Notices of the running command."""


def show_notices(notices: Iterable[str]) -> None:
    """Print sentences, and keep them for JSON output."""
    for text in notices:
        given.append(text)
        print(f"yarnscale: note: {text}", file=sys.stderr, flush=True)


@contextmanager
def collected() -> Iterator[None]:
    """Print and keep the library's notices while a command runs."""
    given.clear()
    with warnings.catch_warnings():
        warnings.simplefilter("always", InputNotice)
        others = warnings.showwarning

        def show(message: Warning | str, category: type[Warning], *rest: object, **more: object) -> None:
            if issubclass(category, InputNotice):
                show_notices([str(message)])
            else:
                others(message, category, *rest, **more)  # type: ignore[arg-type]

        warnings.showwarning = show  # type: ignore[assignment]
        yield
