"""`.wif` files: weaving drafts, Weaving Information File 1.1, described in docs/reference/draft_format.md."""

from __future__ import annotations

import math
import os
import string
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from yarnscale.drawing.chart_error import ChartError
from yarnscale.drawing.library import Structure
from yarnscale.drawing.weave import LARGEST_DRAFT, side_changes
from yarnscale.errors import InputError, notify, quoted
from yarnscale.files.repeats import repeat_of
from yarnscale.files.source_text import read_source
from yarnscale.files.structure_file import StructureFile

LARGEST_WEB = 4096
"""Most ends, picks, shafts or treadles of a file."""
UNITS = {
    "decipoints": 0.0254 / 720, "inches": 0.0254, "inch": 0.0254, "in": 0.0254, "centimeters": 1e-2,
    "centimetres": 1e-2, "cm": 1e-2, "millimeters": 1e-3, "millimetres": 1e-3, "mm": 1e-3,
}  # fmt: skip
"""Units of spacing and thickness [m]; the first, second and fifth are those of the format."""
SPACING, CLOSEST = 3.2, 2.8
"""Distance of neighbouring threads over their mean radius: where a file has no thickness, and where threads that
change sides between the two still have room."""
WARP, WEFT = "WARP", "WEFT"
Array = np.ndarray


@dataclass(frozen=True)
class _Threads:
    """The threads of a warp or weft; spacing and radius [m] are None where the file has none."""

    colour: list[int | None]
    spacing: Array | None
    radius: Array | None

    def part(self, repeat: slice) -> _Threads:
        def cut(values: Array | None) -> Array | None:
            return None if values is None else values[repeat]

        return _Threads(self.colour[repeat], cut(self.spacing), cut(self.radius))

    def looks(self) -> list[tuple]:
        """What tells one thread from another."""
        count = len(self.colour)
        spacing, radius = ([None] * count if v is None else v.tolist() for v in (self.spacing, self.radius))
        return list(zip(self.colour, spacing, radius, strict=True))


def read_wif(path: str | os.PathLike[str]) -> StructureFile:
    """One repeat of the draft of a file: its drawdown, kinds of yarn, spacing and thickness.

    Threads of one colour and thickness are one kind of yarn. Raises InputError with file and line or section.
    """
    path = Path(path)
    wif = _Wif.read(path)
    up = _drawdown(wif)
    warp, weft = _threads(wif, WARP, up.shape[1]), _threads(wif, WEFT, up.shape[0])
    # Hems would hide the repeat of the ends, and ends of borders that of the picks.
    picks = _repeat(path, "picks", up, weft)
    ends = _repeat(path, "ends", up[picks].T, warp)
    picks = _repeat(path, "picks", up[:, ends], weft)
    draft = up[picks, ends].astype(int)
    _check_lifted(wif, draft, picks, ends)
    sizes = {"name": path.stem, **_sizes(path, draft, warp.part(ends), weft.part(picks))}

    def place(error: InputError) -> str:
        if isinstance(error, ChartError) and error.column is not None:
            return wif.place("THREADING", ends.start + error.column + 1)
        if isinstance(error, ChartError) and error.row is not None:
            return wif.place("LIFTPLAN" if wif.has_liftplan else "TREADLING", picks.start + error.row + 1)
        return wif.place(WARP, "spacing")

    size = f"{draft.shape[1]} ends × {draft.shape[0]} picks"
    definition = f"One repeat of {path.name}: {size} of {up.shape[1]} × {up.shape[0]}"
    return StructureFile(path, Structure(definition, draft=draft, sizes=sizes), place)


@dataclass
class _Wif:
    """Sections by name in capitals; of each, keys in small letters with their line and value."""

    path: Path
    sections: dict[str, dict[str, tuple[int, str]]] = field(default_factory=dict)
    lines: dict[str, int] = field(default_factory=dict)

    @classmethod
    def read(cls, path: Path) -> _Wif:
        wif, section = cls(path), ""
        for number, line in enumerate(read_source(path, other_encodings=True).splitlines(), start=1):
            text = line.strip()
            if text.startswith("[") and text.endswith("]"):
                section = text[1:-1].strip().upper()
                if section in wif.lines and section in _READ:
                    what = f"[{section}] stands twice"
                    raise InputError(
                        what, where=f"{path}:{number}", expected=f"only line {wif.lines[section]}"
                    )
                wif.lines[section] = number
                wif.sections[section] = {}
            elif section in _READ and text and not text.startswith(";"):
                key, equals, value = (part.strip() for part in text.partition("="))
                key = key.lower()
                if not equals or not key:
                    expected = "key=value"
                    raise InputError(
                        f"[{section}] line is no setting",
                        where=f"{path}:{number}",
                        expected=expected,
                        found=quoted(text),
                    )
                if key in wif.sections[section]:
                    what = f"[{section}] {quoted(key)} stands twice"
                    expected = f"only line {wif.sections[section][key][0]}"
                    raise InputError(what, where=f"{path}:{number}", expected=expected)
                wif.sections[section][key] = (number, value)
        if "WIF" not in wif.sections:
            raise InputError("file is no weaving draft", where=path, expected="a section [WIF]")
        for name in _READ:
            if wif.text("CONTENTS", name.lower()).lower() in _TRUE and name not in wif.sections:
                raise InputError(
                    f"[{name}] is missing", where=path, expected="the section that [CONTENTS] names"
                )
        return wif

    @property
    def has_liftplan(self) -> bool:
        """Whether shafts are lifted pick by pick and not by treadles."""
        return bool(self.sections.get("LIFTPLAN"))

    def place(self, section: str, key: object) -> str:
        """File and line of a key, of its section without it, or the file alone."""
        line = self.sections.get(section, {}).get(str(key), (self.lines.get(section), ""))[0]
        return str(self.path) if line is None else f"{self.path}:{line}"

    def fault(self, section: str, key: object, *, expected: object, found: object = None) -> InputError:
        where = self.place(section, key)
        return InputError(f"[{section}] {key}", where=where, expected=expected, found=found)

    def text(self, section: str, key: str) -> str:
        """A value, empty where there is none."""
        return self.sections.get(section, {}).get(key, (0, ""))[1]

    def number(self, section: str, key: str) -> float | None:
        """A positive number, None where there is none."""
        text = self.text(section, key)
        if not text:
            return None
        try:
            value = float(text) if text.isascii() and "_" not in text else math.nan
        except ValueError:
            value = math.nan
        if not 0.0 < value < math.inf:
            raise self.fault(section, key, expected="a positive number", found=quoted(text))
        return value

    def count(self, section: str, key: str) -> int | None:
        """A number of threads, shafts or treadles, None where there is none."""
        numbers = self.integers(section, key)
        return numbers[0] if numbers else None

    def integers(self, section: str, key: str) -> list[int]:
        """Whole numbers from 0 to ``LARGEST_WEB``, separated by commas."""
        found = []
        for word in (word.strip() for word in self.text(section, key).split(",")):
            if word and not (
                word.isascii() and word.isdecimal() and len(word) < 10 and int(word) <= LARGEST_WEB
            ):
                expected = f"whole numbers from 0 to {LARGEST_WEB}"
                raise self.fault(section, key, expected=expected, found=quoted(word))
            found += [int(word)] if word else []
        return found

    def keys(self, section: str, largest: int | None) -> list[int]:
        """The numbers of the threads or treadles of a section, at most ``largest``."""
        most = LARGEST_WEB if largest is None else largest
        numbers = []
        for key in self.sections.get(section, {}):
            if not (key.isascii() and key.isdecimal() and len(key) < 10 and 1 <= int(key) <= most):
                raise self.fault(section, key, expected=f"a number from 1 to {most}")
            numbers.append(int(key))
        return numbers

    def table(self, section: str, largest: int | None) -> dict[int, list[int]]:
        """Numbers of shafts or treadles by thread or treadle, without zeros, which stand for none."""
        return {
            key: [number for number in self.integers(section, str(key)) if number]
            for key in self.keys(section, largest)
        }


_READ = (
    "WIF", "CONTENTS", "WEAVING", WARP, WEFT, "THREADING", "TIEUP", "TREADLING", "LIFTPLAN", "WARP COLORS",
    "WEFT COLORS", "WARP SPACING", "WEFT SPACING", "WARP THICKNESS", "WEFT THICKNESS",
)  # fmt: skip
_TRUE, _FALSE = ("true", "on", "yes", "1"), ("false", "off", "no", "0")


def _drawdown(wif: _Wif) -> Array:
    """Whether each end lies over each pick, shape (picks, ends)."""
    ends, picks = wif.count(WARP, "threads"), wif.count(WEFT, "threads")
    threading = wif.table("THREADING", ends)
    if not threading:
        raise InputError("[THREADING] is missing", where=wif.path, expected="end=shaft, a line each")
    lifted = _lifted(wif, picks)
    shafts = wif.count("WEAVING", "shafts") or 0
    raised = {shaft for numbers in lifted.values() for shaft in numbers}
    for end, numbers in threading.items():
        if stray := [shaft for shaft in numbers if shaft > shafts and shaft not in raised]:
            expected = f"a shaft from 1 to {shafts}, or one that is lifted"
            raise wif.fault("THREADING", end, expected=expected, found=stray[0])
    count = max([0, *raised, *(shaft for numbers in threading.values() for shaft in numbers)]) + 1
    on = np.zeros((count, ends or max(threading)), dtype=np.float32)
    lifts = np.zeros((picks or max(lifted), count), dtype=np.float32)
    for end, numbers in threading.items():
        on[numbers, end - 1] = 1.0
    for pick, numbers in lifted.items():
        lifts[pick - 1, numbers] = 1.0
    up = lifts @ on > 0.0
    rising = wif.text("WEAVING", "rising shed").lower()
    if rising not in ("", *_TRUE, *_FALSE):
        raise wif.fault("WEAVING", "rising shed", expected="true or false", found=quoted(rising))
    # Of a sinking shed the tie-up says which shafts go down.
    return ~up if rising in _FALSE else up


def _check_lifted(wif: _Wif, draft: Array, picks: slice, ends: slice) -> None:
    """InputError for an end on no shaft and a pick that lifts none (or all)."""
    for thread in np.flatnonzero(np.ptp(draft, axis=0) == 0):
        end = ends.start + int(thread) + 1
        if not wif.table("THREADING", None).get(end):
            raise wif.fault(
                "THREADING", end, expected="a shaft: an end on none lies on one side of all picks"
            )
    for thread in np.flatnonzero(np.ptp(draft, axis=1) == 0):
        section, pick = "LIFTPLAN" if wif.has_liftplan else "TREADLING", picks.start + int(thread) + 1
        if not wif.table(section, None).get(pick):
            raise wif.fault(section, pick, expected="a shed: a pick without one lies on one side of all ends")


def _lifted(wif: _Wif, picks: int | None) -> dict[int, list[int]]:
    """Shafts that each pick lifts, by the liftplan or by the treadles and their tie-up."""
    if wif.has_liftplan:
        return wif.table("LIFTPLAN", picks)
    treadles = wif.count("WEAVING", "treadles") or 0
    tied, treadling = wif.table("TIEUP", None), wif.table("TREADLING", picks)
    if not tied or not treadling:
        missing = "TREADLING" if tied else "TIEUP"
        expected = "[LIFTPLAN], or [TIEUP] and [TREADLING]"
        raise InputError(f"[{missing}] is missing", where=wif.path, expected=expected)
    for pick, numbers in treadling.items():
        if stray := [treadle for treadle in numbers if treadle > treadles and treadle not in tied]:
            expected = f"a treadle from 1 to {treadles}, or one that is tied up"
            raise wif.fault("TREADLING", pick, expected=expected, found=stray[0])
    return {
        pick: [shaft for treadle in numbers for shaft in tied.get(treadle, ())]
        for pick, numbers in treadling.items()
    }


def _threads(wif: _Wif, system: str, count: int) -> _Threads:
    colours: list[int | None] = [next(iter(wif.integers(system, "color")), None)] * count
    for thread in wif.keys(f"{system} COLORS", count):
        colours[thread - 1] = next(iter(wif.integers(f"{system} COLORS", str(thread))), colours[thread - 1])
    unit_name = wif.text(system, "units").lower()
    unit = UNITS.get(unit_name)
    if unit is None and unit_name:
        raise wif.fault(system, "units", expected=", ".join(UNITS), found=quoted(unit_name))

    def sizes(kind: str) -> Array | None:
        section = f"{system} {kind}".upper()
        default, keys = wif.number(system, kind), wif.keys(section, count)
        if default is None and not keys:
            return None
        if unit is None:
            notify(f"{wif.place(system, kind)}: [{system}] has no units: its {kind} is not used")
            return None
        values = np.full(count, math.nan if default is None else default)
        for thread in keys:
            values[thread - 1] = wif.number(section, str(thread)) or math.nan
        if np.isnan(values).any():
            thread = int(np.flatnonzero(np.isnan(values))[0]) + 1
            raise wif.fault(section, thread, expected=f"a size, or {kind} of all threads in [{system}]")
        return values * unit

    thickness = sizes("thickness")
    return _Threads(colours, sizes("spacing"), None if thickness is None else 0.5 * thickness)


def _repeat(path: Path, system: str, rows: Array, threads: _Threads) -> slice:
    looks = [
        (row.tobytes(), look) for row, look in zip(np.ascontiguousarray(rows), threads.looks(), strict=True)
    ]
    # A web that can be drawn whole is left whole; larger ones may have hems and selvedges.
    margin = 0 if len(looks) <= LARGEST_DRAFT else len(looks) // 6
    repeat = repeat_of(looks, LARGEST_DRAFT, margin)
    if repeat is None:
        expected = f"one of at most {LARGEST_DRAFT}, in crossings, colours, spacing and thickness"
        raise InputError(f"the {len(looks)} {system} have no repeat", where=path, expected=expected)
    return repeat


def _sizes(path: Path, draft: Array, warp: _Threads, weft: _Threads) -> dict:
    """Parameters of `weave`: radii [m], kinds of yarn, and spacings in radii."""
    pairs = ((warp, weft), (weft, warp))
    high, thick = (_radii(own, other) for own, other in pairs)
    gaps = []
    for own, radius in ((warp, high), (weft, thick)):
        spacing = SPACING * radius if own.spacing is None else own.spacing
        gaps.append(0.5 * (spacing + np.roll(spacing, -1)))
    room = min(_room(gaps[0], high, thick, draft), _room(gaps[1], thick, high, draft.T))
    if room < 1.0:
        share = room * CLOSEST / SPACING
        if warp.radius is not None or weft.radius is not None:
            notify(
                f"{path}: threads of {2e3 * max(high.max(), thick.max()):.3g} mm have no room at this spacing: "
                f"all are drawn {share:.2f} times as thick"
            )
        high, thick = high * share, thick * share
    keys = [
        list(zip(own.colour, radius.tolist(), strict=True)) for own, radius in ((warp, high), (weft, thick))
    ]
    kinds = sorted({*keys[0], *keys[1]}, key=lambda kind: (kind[0] or 0, kind[1]))
    letters = dict(zip(kinds, string.ascii_uppercase + string.ascii_lowercase, strict=False))
    if len(kinds) > len(letters):
        expected = f"at most {len(letters)} colours and thicknesses in a repeat"
        raise InputError("too many kinds of yarn", where=path, expected=expected, found=len(kinds))
    radius = float(max(high.max(), thick.max()))
    sizes: dict = {
        "radius": radius,
        "warp_spacing": _shortened(gaps[0] / radius, high, thick),
        "weft_spacing": _shortened(gaps[1] / radius, high, thick),
    }
    if len(kinds) > 1:
        sizes["warp_yarns"], sizes["weft_yarns"] = ([letters[key] for key in own] for own in keys)
    if any(kind[1] != radius for kind in kinds):
        sizes["yarn_radius"] = {letters[kind]: kind[1] for kind in kinds}
    return sizes


def _radii(own: _Threads, other: _Threads) -> Array:
    """Radius of each thread [m]: half its thickness, else by the spacing, the other threads, or 1 mm."""
    if own.radius is not None:
        return own.radius
    radius = 1e-3
    if own.spacing is not None:
        radius = own.spacing.mean() / SPACING
    elif other.radius is not None:
        radius = other.radius.mean()
    elif other.spacing is not None:
        radius = other.spacing.mean() / SPACING
    return np.full(len(own.colour), radius)


def _room(gaps: Array, own: Array, others: Array, table: Array) -> float:
    """Smallest share that neighbouring threads have of the distance that they need."""
    mean = 0.5 * (own + np.roll(own, -1))
    needs = np.where(side_changes(table), 0.5 * CLOSEST * (mean + others[:, None]), 2.0 * mean)
    return float((gaps / needs.max(axis=0)).min())


def _shortened(gaps: Array, *radii: Array) -> float | list[float]:
    """One number for equal distances of equal threads."""
    alike = np.ptp(gaps) < 1e-9 and np.ptp(np.concatenate(radii)) == 0.0
    return float(gaps[0]) if alike else gaps.tolist()
