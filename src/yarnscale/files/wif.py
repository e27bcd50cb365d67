"""`.wif` files: weaving drafts, Weaving Information File 1.1, described in docs/reference/draft_format.md."""

from __future__ import annotations

import math
import os
import string
from pathlib import Path

import numpy as np

from yarnscale.arrays import Array, Flags
from yarnscale.drawing.chart_error import ChartError
from yarnscale.drawing.library import Structure
from yarnscale.drawing.weave import LARGEST_DRAFT, side_changes
from yarnscale.errors import InputError, notify, quoted
from yarnscale.files.source_text import finite_number, read_source
from yarnscale.files.structure_file import StructureFile, one_repeat, repeat_of
from yarnscale.kinematics import INCH

LARGEST_WEB = 4096
"""Most ends, picks, shafts or treadles of a file."""
UNITS = {
    "decipoints": INCH / 720, "inches": INCH, "inch": INCH, "in": INCH, "centimeters": 1e-2,
    "centimetres": 1e-2, "cm": 1e-2, "millimeters": 1e-3, "millimetres": 1e-3, "mm": 1e-3,
}  # fmt: skip
"""Units of spacing and thickness [m]; the first, second and fifth are those of the format."""
SPACING, CLOSEST = 3.2, 2.8
"""Distance of neighbouring threads over their mean radius: where a file has no thickness, and where threads that
change sides between the two still have room."""
WARP, WEFT = "WARP", "WEFT"
_READ = (
    "WIF", "CONTENTS", "WEAVING", WARP, WEFT, "THREADING", "TIEUP", "TREADLING", "LIFTPLAN",
    *(f"{system} {what}" for system in (WARP, WEFT) for what in ("COLORS", "SPACING", "THICKNESS")),
)  # fmt: skip
_TRUE, _FALSE = ("true", "on", "yes", "1"), ("false", "off", "no", "0")


def read_wif(path: str | os.PathLike[str]) -> StructureFile:
    """One repeat of the draft of a file: its drawdown, kinds of yarn, spacing and thickness.

    Threads of one colour and thickness are one kind of yarn. Raises InputError with file and line or section.
    """
    path = Path(path)
    wif = _Wif(path)
    up = _drawdown(wif)
    warp, weft = _threads(wif, WARP, up.shape[1]), _threads(wif, WEFT, up.shape[0])

    # Hems would hide the repeat of the ends.
    rough = repeat_of(*_looks(up, weft)) or (slice(None), 0)
    ends = one_repeat(path, "ends", *_looks(up[rough[0]].T, warp))
    picks = one_repeat(path, "picks", *_looks(up[:, ends], weft))
    draft = up[picks, ends].astype(int)
    lifts = "LIFTPLAN" if wif.sections.get("LIFTPLAN") else "TREADLING"
    for section, axis, first in (("THREADING", 0, ends.start), (lifts, 1, picks.start)):
        for thread in np.flatnonzero(np.ptp(draft, axis=axis) == 0) + first + 1:
            if not any(wif.integers(section, str(thread))):
                raise wif.fault(section, thread, expected="a shaft or treadle, or it is not woven in")

    def place(error: InputError) -> str:
        if isinstance(error, ChartError) and error.column is not None:
            return wif.place("THREADING", ends.start + error.column + 1)
        if isinstance(error, ChartError) and error.row is not None:
            return wif.place(lifts, picks.start + error.row + 1)
        return wif.place(WARP, "spacing")

    size = f"{draft.shape[1]} ends × {draft.shape[0]} picks of {up.shape[1]} × {up.shape[0]}"
    sizes = {"name": path.stem, **_sizes(path, draft, warp[ends], weft[picks])}
    structure = Structure(f"One repeat of {path.name}: {size}", draft=draft, sizes=sizes)
    return StructureFile(path, structure, place)


def _looks(rows: Flags, threads: Array) -> tuple[list[bytes], int, int]:
    """What tells threads apart, the largest repeat, and how many threads at either edge may lie outside of it."""
    looks = [row.tobytes() + thread.tobytes() for row, thread in zip(rows, threads, strict=True)]
    # A web that can be drawn whole is left whole; larger ones may have hems and selvedges.
    return looks, LARGEST_DRAFT, 0 if len(looks) <= LARGEST_DRAFT else len(looks) // 6


class _Wif:
    """Sections by name in capitals; of each, keys in small letters with their line and value."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.sections: dict[str, dict[str, tuple[int, str]]] = {}
        self.lines: dict[str, int] = {}
        section = ""
        for number, line in enumerate(read_source(path, other_encodings=True).splitlines(), start=1):
            where, text = f"{path}:{number}", line.split(";", 1)[0].strip()
            key, equals, value = (part.strip() for part in text.partition("="))
            if text.startswith("[") and text.endswith("]"):
                section, key = text[1:-1].strip().upper(), ""
                if section in _READ and section in self.lines:
                    raise InputError(f"[{section}] occurs twice", where=where, expected="every section once")
                self.lines[section], self.sections[section] = number, {}
            elif section in _READ and text:
                if not equals or key.lower() in self.sections[section]:
                    fault = "occurs twice" if equals else "is no setting"
                    expected = "key=value, every key once"
                    raise InputError(f"[{section}] {quoted(text)} {fault}", where=where, expected=expected)
                if len(self.sections[section]) == LARGEST_WEB:
                    raise InputError(
                        f"[{section}] is too long", where=where, expected=f"at most {LARGEST_WEB} settings"
                    )
                self.sections[section][key.lower()] = (number, value)
        if "WIF" not in self.sections:
            raise InputError("file is no weaving draft", where=path, expected="a section [WIF]")
        for name in _READ:
            if self.text("CONTENTS", name.lower()).lower() in _TRUE and name not in self.sections:
                raise InputError(f"[{name}] is missing", where=path, expected="what [CONTENTS] names")

    def place(self, section: str, key: object) -> str:
        """File and line of a key, of its section without it, or the file alone."""
        line = self.sections.get(section, {}).get(str(key), (self.lines.get(section), ""))[0]
        return str(self.path) if line is None else f"{self.path}:{line}"

    def fault(self, section: str, key: object, *, expected: object) -> InputError:
        """The error of a key, ready to raise."""
        found = quoted(self.text(section, str(key))) if self.text(section, str(key)) else None
        what, where = f"[{section}] {key!s:.40}", self.place(section, key)
        return InputError(what, where=where, expected=expected, found=found)

    def text(self, section: str, key: str) -> str:
        """A value, empty where there is none."""
        return self.sections.get(section, {}).get(key, (0, ""))[1]

    def number(self, section: str, key: str) -> float:
        """A positive number, nan where there is none."""
        value = finite_number(text := self.text(section, key))
        if text and not value > 0.0:
            raise self.fault(section, key, expected="a positive number")
        return value

    def integers(self, section: str, key: str) -> list[int]:
        """Whole numbers from 0 to ``LARGEST_WEB``, separated by commas."""
        words = [word.strip() for word in self.text(section, key).split(",")]
        numbers = [_whole(word) for word in words if word]
        if not all(0 <= number <= LARGEST_WEB for number in numbers):
            raise self.fault(section, key, expected=f"whole numbers from 0 to {LARGEST_WEB}")
        return numbers

    def count(self, section: str, key: str) -> int:
        """The first whole number, 0 where there is none."""
        return next(iter(self.integers(section, key)), 0)

    def keys(self, section: str, largest: int) -> list[int]:
        """The numbers of the threads or treadles of a section, from 1 to ``largest`` (0: any)."""
        most = largest or LARGEST_WEB
        for key in self.sections.get(section, {}):
            if not 1 <= _whole(key) <= most:
                raise self.fault(section, key, expected=f"a number from 1 to {most}")
        return [int(key) for key in self.sections.get(section, {})]

    def table(self, section: str, largest: int) -> dict[int, list[int]]:
        """Numbers of shafts or treadles by thread or treadle, without zeros, which stand for none."""
        return {n: [s for s in self.integers(section, str(n)) if s] for n in self.keys(section, largest)}


def _whole(word: str) -> int:
    """A whole number, -1 for any other text."""
    return int(word) if word.isascii() and word.isdecimal() and len(word) < 10 else -1


def _drawdown(wif: _Wif) -> Flags:
    """Whether each end lies over each pick, shape (picks, ends)."""
    ends, picks = wif.count(WARP, "threads"), wif.count(WEFT, "threads")
    threading = wif.table("THREADING", ends)
    lifted = wif.table("LIFTPLAN", picks)
    for name in ("THREADING", *(() if lifted else ("TIEUP", "TREADLING"))):
        if not wif.sections.get(name):
            expected = "[THREADING], and [LIFTPLAN] or [TIEUP] and [TREADLING]"
            raise InputError(f"[{name}] is missing or empty", where=wif.path, expected=expected)
    if not lifted:
        tied, treadling = wif.table("TIEUP", 0), wif.table("TREADLING", picks)
        _check_numbers(wif, "TREADLING", treadling, wif.count("WEAVING", "treadles"), set(tied))
        lifted = {pick: [s for t in numbers for s in tied.get(t, ())] for pick, numbers in treadling.items()}
    raised = {shaft for numbers in lifted.values() for shaft in numbers}
    _check_numbers(wif, "THREADING", threading, wif.count("WEAVING", "shafts"), raised)
    shafts = max({0}.union(raised, *threading.values())) + 1
    on = np.zeros((shafts, ends or max(threading)), dtype=np.float32)
    lifts = np.zeros((picks or max(lifted), shafts), dtype=np.float32)
    for end, numbers in threading.items():
        on[numbers, end - 1] = 1.0
    for pick, numbers in lifted.items():
        lifts[pick - 1, numbers] = 1.0
    up = lifts @ on > 0.0
    rising = wif.text("WEAVING", "rising shed").lower()
    if rising not in ("", *_TRUE, *_FALSE):
        raise wif.fault("WEAVING", "rising shed", expected="true or false")
    # Of a sinking shed the tie-up says which shafts go down.
    return ~up if rising in _FALSE else up


def _check_numbers(wif: _Wif, section: str, table: dict[int, list[int]], most: int, used: set[int]) -> None:
    """InputError for a shaft or treadle beyond the count of the file that does nothing."""
    for thread, numbers in table.items():
        if any(number > most and number not in used for number in numbers):
            raise wif.fault(section, thread, expected=f"numbers from 0 to {most}, or others in use")


def _threads(wif: _Wif, system: str, count: int) -> Array:
    """Colour (0: none), spacing and thickness [m] (nan: none) of each thread, shape (count, 3)."""
    unit = UNITS.get(wif.text(system, "units").lower(), 0.0)
    threads = np.empty((count, 3))
    for column, name, value in ((0, "color", wif.count), (1, "spacing", wif.number), (2, "thickness", wif.number)):
        section = f"{system} {name}{'s' * (column == 0)}".upper()
        threads[:, column] = value(system, name)
        for thread in wif.keys(section, count):
            threads[thread - 1, column] = value(section, str(thread))
        none = np.isnan(threads[:, column])
        if none.any() and not none.all():
            expected = f"a size, or {name} of all threads in [{system}]"
            raise wif.fault(section, int(np.argmax(none)) + 1, expected=expected)
        if column and not none.all() and not unit:
            raise wif.fault(system, "units", expected=f"one of {', '.join(UNITS)}")
    return threads * [1.0, unit or 1.0, unit or 1.0]


def _sizes(path: Path, draft: Array, warp: Array, weft: Array) -> dict:
    """Parameters of `weave`: radii [m], kinds of yarn, and spacings in radii."""
    high, thick = _radii(warp, weft), _radii(weft, warp)
    gaps = []
    for threads, radii in ((warp, high), (weft, thick)):
        spacing = np.where(np.isnan(threads[:, 1]), SPACING * radii, threads[:, 1])
        gaps.append(0.5 * (spacing + np.roll(spacing, -1)))
    room = min(_room(gaps[0], high, thick, draft), _room(gaps[1], thick, high, draft.T))
    if room < 1.0:
        share = room * CLOSEST / SPACING
        if not np.isnan([*warp[:, 2], *weft[:, 2]]).all():
            room_for = f"no room for {2e3 * max(high.max(), thick.max()):.3g} mm at this spacing"
            notify(f"{path}: {room_for}: threads are drawn {share:.2f} times as thick")
        high, thick = high * share, thick * share
    radius = float(max(high.max(), thick.max()))
    keys = [list(zip(threads[:, 0], radii, strict=True)) for threads, radii in ((warp, high), (weft, thick))]
    kinds = sorted({*keys[0], *keys[1]})
    letters = dict(zip(kinds, string.ascii_uppercase + string.ascii_lowercase, strict=False))
    if len(kinds) > len(letters):
        expected = f"at most {len(letters)} colours and thicknesses in a repeat"
        raise InputError("too many kinds of yarn", where=path, expected=expected, found=len(kinds))
    equal = all(kind[1] == radius for kind in kinds)
    sizes: dict = {"radius": radius}
    for system, own, distances in zip(("warp", "weft"), keys, gaps, strict=True):
        single = equal and np.ptp(distances) < 1e-9 * radius
        sizes[f"{system}_spacing"] = float(distances[0]) / radius if single else (distances / radius).tolist()
        if len(kinds) > 1:
            sizes[f"{system}_yarns"] = [letters[key] for key in own]
    return sizes if equal else {**sizes, "yarn_radius": {letters[kind]: float(kind[1]) for kind in kinds}}


def _radii(own: Array, other: Array) -> Array:
    """Radius of each thread [m]: half its thickness, else by the spacing, the other threads, or 1 mm."""
    if not np.isnan(own[:, 2]).any():
        return 0.5 * own[:, 2]
    guesses = (own[:, 1].mean() / SPACING, 0.5 * other[:, 2].mean(), other[:, 1].mean() / SPACING, 1e-3)
    return np.full(len(own), next(guess for guess in guesses if not math.isnan(guess)))


def _room(gaps: Array, own: Array, others: Array, table: Array) -> float:
    """Smallest share that neighbouring threads have of the distance that they need."""
    mean = 0.5 * (own + np.roll(own, -1))
    needs = np.where(side_changes(table), 0.5 * CLOSEST * (mean + others[:, None]), 2.0 * mean)
    return float((gaps / needs.max(axis=0)).min())
