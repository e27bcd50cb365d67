"""What commands print, and the checks they share."""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import time
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from yarnscale.errors import InputError, InputNotice

if TYPE_CHECKING:
    from yarnscale.homogenize.sample import SamplingProgress
    from yarnscale.motion.run import RunProgress


_given: list[str] = []
"""Notices of the running command about input that is accepted but unlikely."""


def report(options: argparse.Namespace, summary: Mapping[str, object], *lines: str) -> None:
    """Print the results of a command: with ``--json`` a summary as one object, else lines of text."""
    if options.json:
        print(plain_json({**summary, "notices": _given} if _given else summary))
        return
    for line in lines:
        print(line)


def print_status(text: str) -> None:
    """A line on the standard error, which keeps results apart."""
    print(text, file=sys.stderr, flush=True)


def print_notice(text: str) -> None:
    """A line on the standard error that begins with the name of the program."""
    print_status(f"yarnscale: {text}")


def show_notices(notices: Iterable[str]) -> None:
    """Print sentences, and keep them for JSON output."""
    for text in notices:
        _given.append(text)
        print_notice(f"note: {text}")


@contextmanager
def collected() -> Iterator[None]:
    """Print and keep the library's notices while a command runs."""
    _given.clear()
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


def outcome_lines(values: Mapping[str, object], sentences: Sequence[str] = ()) -> list[str]:
    """Numbers of a run, one a line, then sentences on motions that were not carried out."""
    lines = []
    for name, value in values.items():
        if name != "unfulfilled":
            text = f"{value:.6g}" if isinstance(value, float) else "not tested" if value is None else value
            lines.append(f"{name:<18} {text}")
    return [*lines, *sentences]


def plain_json(values: Mapping[str, object], *, indent: int | None = None) -> str:
    """A JSON object; numbers that are not finite become null."""
    return json.dumps(_plain(values), allow_nan=False, indent=indent)


def _plain(value: object) -> object:
    if isinstance(value, Mapping):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if hasattr(value, "tolist"):  # arrays, and numbers from them
        return _plain(value.tolist())  # pyright: ignore[reportAttributeAccessIssue]
    if isinstance(value, (list, tuple)):
        return [_plain(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def writable_file(path: Path | None, *suffixes: str) -> None:
    """Make sure that a file can be written later: its folder exists and takes files, its suffix is known."""
    if path is None:
        return
    if suffixes and path.suffix.lower() not in suffixes:
        raise InputError("unknown file type", where=path, expected=" or ".join(suffixes), found=repr(path.suffix))
    folder = path.parent
    if path.is_dir() or not folder.is_dir() or not os.access(folder, os.W_OK):
        raise InputError("output cannot be written", where=path, expected="a file in a folder that exists")


class ProgressLine:
    """A line on the terminal that is rewritten; on a file, a line now and then."""

    def __init__(self, label: str) -> None:
        self.label, self._last, self._began = label, 0.0, time.monotonic()
        self._done, self._changed = -1, self._began
        self._first: tuple[float, float] | None = None
        self._solve = self._began, math.inf, math.inf
        self._terminal = sys.stderr.isatty()

    def show_step(self, progress: RunProgress) -> None:
        """Show a step of a run; the time left follows from the mean speed since its first step in this process."""
        seconds = time.monotonic() - self._began
        if self._first is None:
            self._first = progress.share, seconds
        share, since = progress.share - self._first[0], seconds - self._first[1]
        left = since / share * (1.0 - progress.share) if share > 0 else float("nan")
        note = f"{progress.iterations} iterations" if progress.iterations else ""
        self.show(round(100 * progress.share), 100, note, left=left)

    def show(self, done: int, total: int, note: str = "", *, left: float | None = None) -> None:
        """Show how far the work is.

        left: seconds left (nan: unknown); None: each part takes as long as those since the line was made. A part
        that has taken longer is assumed to take as long again.
        """
        now = time.monotonic()
        seconds = now - self._began
        if left is None:
            left = seconds / done * (total - done) if done else float("nan")
        if done != self._done:
            self._done, self._changed = done, now
        left = max(left, now - self._changed, 1.0) if math.isfinite(left) else left
        if done < total and now - self._last < (0.1 if self._terminal else 5.0):
            return
        remaining = f", about {left:.0f} s left" if math.isfinite(left) and done < total else ""
        line = f"{self.label}: {done}/{total} in {seconds:.0f} s{remaining}{', ' + note if note else ''}"
        self._print(line, last=done >= total)

    def sampled(self, progress: SamplingProgress) -> None:
        """Show how far a sampling run is."""
        note = f"{progress.converged} converged"
        self.show(progress.done, progress.total, note, left=progress.seconds_left)

    def note(self, text: str) -> None:
        """Show the progress of work of unknown length."""
        now = time.monotonic()
        if now - max(self._last, self._began) >= (0.1 if self._terminal else 5.0):
            self._print(f"{self.label}: {text}, {now - self._began:.0f} s")

    def note_solve(self, iteration: int, residual: float, tolerance: float = 1e-6) -> None:
        """Show an iteration of a solve that ends at a residual; the time left is extrapolated from its decrease."""
        now = time.monotonic()
        if iteration == 0:
            self._solve = now, residual, residual
        began, first, lowest = self._solve
        lowest = min(lowest, residual)
        self._solve = began, first, lowest
        text = f"iteration {iteration}, residual {residual:.1e}"
        if tolerance < lowest < first:
            left = (now - began) * math.log(lowest / tolerance) / math.log(first / lowest)
            text += f", about {left:.0f} s left"
        self.note(text)

    def end(self) -> None:
        """End the line of work of unknown length."""
        if self._terminal and self._last > 0.0:
            print(file=sys.stderr, flush=True)

    def _print(self, line: str, *, last: bool = False) -> None:
        self._last = time.monotonic()
        if self._terminal:
            print(f"\r\033[K{line}", end="\n" if last else "", file=sys.stderr, flush=True)
        else:
            print(line, file=sys.stderr, flush=True)
