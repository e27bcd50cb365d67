"""Structures as files from which they can be woven, knitted or drawn again: WIF drafts, knitout, charts."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from yarnscale.drawing.library import Structure
from yarnscale.drawing.stitches import SIGNS, StitchChart
from yarnscale.errors import InputError, located
from yarnscale.files.atomic import write_text
from yarnscale.files.chart import NUMBERS
from yarnscale.yarn.pattern import YarnPattern

COLOURS = ("200,120,60", "60,100,170", "90,150,80", "170,70,110", "110,90,150", "220,190,80")
"""Colours of the kinds of yarn of a draft, red, green, blue."""
LEAST_WALES, LEAST_COURSES = 12, 8
"""Size of a knitted piece, and at least two repeats of it."""


def write_structure(structure: Structure, pattern: YarnPattern, path: str | os.PathLike[str]) -> None:
    """Write the structure that a pattern was drawn from, in the format of the suffix: `.wif`, `.k` or `.chart`.

    Raises InputError for a knit as a draft, a weave as knitout, and stitches that need a transfer to another wale.
    """
    suffix = Path(path).suffix.lower()
    if suffix != ".chart" and structure.woven != (suffix == ".wif"):
        expected, found = ("a weave", "a knit") if suffix == ".wif" else ("a knit", "a weave")
        raise InputError(f"structure of a {suffix} file", where=path, expected=expected, found=found)
    with located(path):
        text = WRITERS[suffix](structure, pattern)
    write_text(path, text)


def chart_text(structure: Structure, pattern: YarnPattern) -> str:
    """A chart file with the sizes of the drawing, for yarn of the pattern's radius."""
    sizes: dict[str, Any] = dict(structure.sizes)
    kind = "weave" if structure.woven else "knit"
    rows = list(structure.chart)
    if structure.draft is not None:
        rows = ["".join("x" if over else "." for over in row) for row in structure.draft]
    yarns = list(sizes.get("weft_yarns" if structure.woven else "yarns") or "a" * len(rows))
    letters = {*"".join(yarns), *sizes.get("warp_yarns", "a" if structure.woven else "")}
    radius, others = sizes.get("radius", 1e-3), dict(sizes.get("yarn_radius", {}))
    scale = 1e3 * pattern.radius / max(others.get(letter, radius) for letter in letters)
    lines = [f"kind = {kind}", f"name = {' '.join(pattern.name.split())}", f"radius = {scale * radius:.12g} mm"]
    lines += [f"radius_{letter} = {scale * other:.12g} mm" for letter, other in others.items()]
    for key in NUMBERS[kind]:
        if key in sizes:
            lines.append(f"{key} = {' '.join(f'{value:.12g}' for value in np.atleast_1d(sizes[key]))}")
    if "warp_yarns" in sizes:
        lines.append(f"warp_yarns = {''.join(sizes['warp_yarns'])}")
    if len(letters) > 1:
        rows = [f"{row} : {yarn}" for row, yarn in zip(rows, yarns, strict=True)]
    return "\n".join([*lines, "rows:", *rows[::-1], ""])


def wif_text(structure: Structure, pattern: YarnPattern) -> str:
    """A draft of one repeat: every different end is a shaft, every different pick a treadle.

    Colours are kinds of yarn. Spacing and thickness are those of the pattern, which may be at rest.
    """
    assert structure.draft is not None
    draft = np.asarray(structure.draft)
    shafts = _numbers([tuple(end) for end in draft.T.tolist()])
    treadles = _numbers([tuple(pick) for pick in draft.tolist()])
    picks, ends = draft.shape
    colours = np.zeros(picks + ends, int) if pattern.yarn_material is None else pattern.yarn_material
    radii = np.full(picks + ends, pattern.radius) if pattern.yarn_radius is None else pattern.yarn_radius
    tied = {
        treadles[pick]: ",".join(str(shaft) for end, shaft in shafts.items() if end[row])
        for row, pick in enumerate(map(tuple, draft.tolist()))
    }
    sections: dict[str, dict] = {
        "TEXT": {"Title": " ".join(pattern.name.split())},
        "WEAVING": {"Shafts": len(shafts), "Treadles": len(treadles), "Rising Shed": "true"},
        "THREADING": _numbered(shafts[tuple(end)] for end in draft.T.tolist()),
        "TIEUP": dict(sorted(tied.items())),
        "TREADLING": _numbered(treadles[tuple(pick)] for pick in draft.tolist()),
        "COLOR PALETTE": {"Range": "0,255", "Entries": colours.max() + 1},
        "COLOR TABLE": _numbered(COLOURS[kind % len(COLOURS)] for kind in range(colours.max() + 1)),
    }
    for system, axis, own in (("WARP", 0, slice(picks, None)), ("WEFT", 1, slice(picks))):
        gaps = structure.sizes.get(f"{system.lower()}_spacing")
        spacings = _spacings(gaps, radii[own], pattern.period[axis])
        values = {"Spacing": 100 * spacings, "Thickness": 200 * radii[own], "Color": colours[own] + 1}
        first = {key: _decimal(value[0]) for key, value in values.items()}
        sections[system] = {"Threads": len(spacings), "Units": "centimeters", **first}
        for key, value in values.items():
            if (value != value[0]).any():
                name = f"{system} {key.upper()}{'S' if key == 'Color' else ''}"
                sections[name] = _numbered(map(_decimal, value))
    head = {
        "WIF": {
            "Version": "1.1", "Date": "April 20, 1997", "Developers": "wif@mhsoft.com", "Source Program": "yarnscale",
        },
        "CONTENTS": dict.fromkeys(sections, "true"),
    }  # fmt: skip
    return "\n".join(
        "\n".join([f"[{name}]", *(f"{key}={value}" for key, value in entries.items()), ""])
        for name, entries in {**head, **sections}.items()
    )


def _numbers(threads: list[tuple[int, ...]]) -> dict[tuple[int, ...], int]:
    """Numbers from 1 of threads that differ, in the order in which they come."""
    return {thread: number for number, thread in enumerate(dict.fromkeys(threads), start=1)}


def _numbered(values: Iterable[object]) -> dict[int, object]:
    return dict(enumerate(values, start=1))


def _decimal(value: float) -> str:
    return f"{value:.12g}"


def _spacings(gaps: object, radii: np.ndarray, length: float) -> np.ndarray:
    """Width of each thread's place [m]; neighbours are half the sum of theirs apart. Equal gaps: as its radius."""
    widths = radii
    if isinstance(gaps, Sequence):
        halves = 0.5 * np.eye(len(radii))
        widths = np.linalg.lstsq(halves + np.roll(halves, 1, axis=1), np.asarray(gaps, dtype=float))[0]
        widths = np.maximum(widths, 0.01 * widths.mean())
    return widths * length / widths.sum()


def knitout_text(structure: Structure, pattern: YarnPattern) -> str:
    """A piece of some repeats, cast on by tucks on every other needle and dropped at the end; carriers are kinds."""
    chart = StitchChart.read(structure.chart)
    yarns: Any = structure.sizes.get("yarns", ["a"] * chart.courses)
    return _Piece(chart, list(yarns)).text(pattern.name)


class _Piece:
    """Writes the instructions of a chart; ``beds``: where the loop of each column hangs."""

    def __init__(self, chart: StitchChart, yarns: list[str]) -> None:
        self.chart, self.yarns = chart, yarns
        wales = chart.wales // chart.beds
        self.repeats = max(2, -(-LEAST_WALES // wales)), max(2, -(-LEAST_COURSES // chart.courses))
        self.columns = [c for c in range(chart.wales * self.repeats[0]) if not chart.empty[c % chart.wales]]
        self.beds = {c: self._bed(0, c, chart.rows[0][c % chart.wales]) for c in self.columns}
        self.carriers = {letter: str(n) for n, letter in enumerate(sorted(set("".join(yarns))), start=1)}
        self.right = dict.fromkeys(self.carriers, True)
        self.used, self.lines = set[str](), list[str]()

    def text(self, name: str) -> str:
        header = [";!knitout-2", f";;Carriers: {' '.join(self.carriers.values())}", f"; {' '.join(name.split())}"]
        pairs = [row[n : n + 2] for row in self.chart.rows for n in range(0, len(row), 2)]
        if self.chart.beds == 2 and any(not set(pair) & set("bf-") for pair in pairs):
            self.lines.append("rack 0.25")
        for row in range(self.chart.courses * self.repeats[1]):
            self._course(row % self.chart.courses)
        self.lines += [f"outhook {carrier}" for carrier in sorted(self.used)]
        self.lines += [f"drop {self._needle(column)}" for column in self.columns]
        return "\n".join([*header, *self.lines, ""])

    def _bed(self, row: int, column: int, symbol: str) -> str:
        """The bed on which a stitch is made, or from which a float is passed on the right side of its loop."""
        chart, column = self.chart, column % self.chart.wales
        if chart.beds == 2:
            bed = "fb"[column % 2]
            if symbol not in ("kt-b" if bed == "f" else "pt-f"):
                what = f"chart {chart.place(row, column)} needs a transfer to the other bed"
                raise InputError(what, expected="k, t, - on the front, p, t, - on the back bed", found=symbol)
            return bed
        if symbol in "kb":
            return "f"
        if symbol in "pf":
            return "b"
        back = chart.held(row, column)[0]
        return "f" if SIGNS[chart.rows[(row - back) % chart.courses][column]] > 0 else "b"

    def _needle(self, column: int) -> str:
        return f"{self.beds[column]}{column // self.chart.beds}"

    def _course(self, row: int) -> None:
        symbols = {column: self.chart.rows[row][column % self.chart.wales] for column in self.columns}
        for column, symbol in symbols.items():
            bed = self.beds[column] if symbol == "t" else self._bed(row, column, symbol)
            if bed != self.beds[column]:
                before = self._needle(column)
                self.beds[column] = bed
                self.lines.append(f"xfer {before} {self._needle(column)}")
        letters = self.yarns[row]
        names = " ".join(self.carriers[letter] for letter in letters)
        fresh = [name for name in names.split() if name not in self.used]
        self.lines += [f"inhook {' '.join(fresh)}"] if fresh else []
        if not self.used:
            # The inserting hook waits at the right edge: the first tuck is there.
            self._pass(letters, names, {c: "tuck" for c in self.columns[::-2]})
            self._pass(letters, names, {c: "tuck" for c in self.columns[-2::-2]})
        made = {c: "tuck" if symbol == "t" else "knit" for c, symbol in symbols.items() if symbol in "kpt"}
        self._pass(letters, names, made)
        self.lines += [f"releasehook {' '.join(fresh)}"] if fresh else []
        self.used.update(fresh)

    def _pass(self, letters: str, names: str, made: dict[int, str]) -> None:
        """Stitches from the side at which the carriers are to the other, with misses up to both edges."""
        right, way, back = self.right[letters[0]], *("-+" if self.right[letters[0]] else "+-")
        start = self._needle(self.columns[-1 if right else 0])
        others = [letter for letter in letters if self.right[letter] != right]
        self.lines += [f"miss {back} {start} {self.carriers[letter]}" for letter in others]
        edges = {self.columns[0], self.columns[-1]}
        for column in sorted({*made, *edges}, reverse=right):
            code = made.get(column, "miss")
            self.lines.append(f"{code} {way} {self._needle(column)} {names}")
        self.right.update(dict.fromkeys(letters, not right))


WRITERS: dict[str, Callable[[Structure, YarnPattern], str]] = {
    ".wif": wif_text, ".k": knitout_text, ".chart": chart_text,
}  # fmt: skip
