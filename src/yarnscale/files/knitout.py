"""`.k` files: knitout, instructions of flat knitting machines, described in docs/reference/draft_format.md.

The instructions are carried out on needles that hold loops or none. A carriage pass is a course; from the first that
knits held loops all across the fabric to the last such course is the fabric, the rest is cast-on and bind-off.
"""

from __future__ import annotations

import math
import os
import re
import string
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

from yarnscale.drawing.chart_error import ChartError
from yarnscale.drawing.library import Structure
from yarnscale.drawing.stitches import LARGEST_CHART
from yarnscale.errors import InputError, notify, quoted
from yarnscale.files.repeats import repeat_of
from yarnscale.files.source_text import read_source
from yarnscale.files.structure_file import StructureFile

LARGEST_NEEDLE, LARGEST_PIECE = 2000, 20_000
"""Largest number of a needle, left or right of 0, and most courses of a file."""
NEEDLE = re.compile(r"([fb])(s?)(-?[0-9]{1,6})")
STITCHES = ("knit", "tuck", "miss")
IGNORED = ("in", "out", "inhook", "outhook", "releasehook", "stitch", "pause", "amiss")
OPCODES = (*STITCHES, "split", "drop", "xfer", "rack", *IGNORED)
TWO_BEDS = {"wale_spacing": 5.0, "course_spacing": 3.5}
"""Size of a stitch of two beds that face each other [r]."""
Needle = tuple[str, int]


@dataclass(frozen=True)
class _Stitch:
    """A stitch on a needle, whose front needle ``wale`` faces it; empty: the needle holds no loop."""

    kind: str
    bed: str
    wale: int
    empty: bool


@dataclass
class _Course:
    """A carriage pass. beds: of the loop that each wale holds before it, "f", "b" or "fb"."""

    line: int
    text: str
    carriers: tuple[str, ...]
    direction: str
    beds: dict[int, str] = field(default_factory=dict)
    stitches: list[_Stitch] = field(default_factory=list)
    fault: str = ""

    @property
    def loops(self) -> list[_Stitch]:
        """Its stitches that make loops."""
        return [stitch for stitch in self.stitches if stitch.kind != "miss"]


@dataclass(frozen=True)
class _Fault:
    """An instruction between two courses that a chart cannot have."""

    line: int
    text: str
    fault: str


@dataclass(frozen=True)
class _Instruction:
    """The words of a line, and the racking of the beds [needles]."""

    line: int
    words: list[str]
    rack: float

    @property
    def text(self) -> str:
        return " ".join(self.words)[:60]


def read_knitout(path: str | os.PathLike[str]) -> StructureFile:
    """One repeat of stitches of a file, without its cast-on and bind-off.

    Carriers are kinds of yarn. Raises InputError with file, line and instruction for what a chart cannot have:
    transfers to other wales, racking, splits, short rows, intarsia.
    """
    path = Path(path)
    instructions = list(_instructions(path))
    body = _body(path, _Machine(instructions).run(path))
    two_beds = any(bed == "fb" for course in body for bed in course.beds.values())
    rows, wales = _rows(body, two_beds)
    looks = [(row, course.carriers) for row, course in zip(rows, body, strict=True)]
    courses = _repeat(path, "courses", looks, margin=len(looks) // 3)
    columns = list(zip(*rows[courses], strict=True))
    part = _repeat(path, "wales", columns, margin=2, largest=LARGEST_CHART // (2 if two_beds else 1))
    looks = [(row[part], course.carriers) for row, course in zip(rows, body, strict=True)]
    courses = _repeat(path, "courses", looks, margin=len(looks) // 3)
    left = len(body) - _covered(looks, courses)
    if left:
        notify(f"{path}: {left} of {len(body)} courses lie outside the repeat and are left off")
    chart = tuple(_text(row[part], two_beds) for row in rows[courses])
    if two_beds and not any({s.bed for s in course.loops} == {"f", "b"} for course in body[courses]):
        where = f"{path}:{body[courses][0].line}"
        raise InputError(
            "front and back are two layers", where=where, expected="a course that knits on both beds"
        )
    sizes: dict = {"name": path.stem, **(TWO_BEDS if two_beds else {})}
    used = sorted({carrier for course in body[courses] for carrier in course.carriers}, key=_natural)
    if len(used) > len(string.ascii_letters):
        raise InputError("too many carriers", where=path, expected="at most 52", found=len(used))
    if len(used) > 1:
        letters = dict(zip(used, string.ascii_uppercase + string.ascii_lowercase, strict=False))
        sizes["yarns"] = ["".join(letters[carrier] for carrier in c.carriers) for c in body[courses]]

    def place(error: InputError) -> str:
        row = error.row if isinstance(error, ChartError) and error.row is not None else 0
        return f"{path}:{body[courses][row].line}"

    size = f"{len(columns[part])} wales × {len(chart)} courses"
    definition = f"One repeat of {path.name}: {size} of {len(wales)} × {len(body)}"
    return StructureFile(path, Structure(definition, chart, sizes=sizes), place)


def _instructions(path: Path) -> Iterator[_Instruction]:
    """The lines with instructions, checked."""
    rack, carriers = 0.0, None
    for number, line in enumerate(read_source(path, other_encodings=True).splitlines(), start=1):
        if line.startswith(";;Carriers:"):
            carriers = line.partition(":")[2].split()
        words = line.split(";", 1)[0].split()
        if not words or words[0].startswith("x-"):
            continue
        where, code = f"{path}:{number}", words[0]
        if code not in OPCODES:
            raise InputError(
                "unknown instruction", where=where, expected=", ".join(OPCODES), found=quoted(code)
            )
        if code == "rack":
            rack = _racking(where, words)
        needles = {"split": 2, "xfer": 2, "drop": 1, "knit": 1, "tuck": 1, "miss": 1}.get(code, 0)
        directed = code in (*STITCHES, "split")
        named = words[1 + directed : 1 + directed + needles]
        if (directed and words[1:2] not in (["+"], ["-"])) or len(named) < needles:
            usual = f"{code}{' +' if directed else ''}{' f1' * (needles > 0)}{' b1' * (needles > 1)}"
            raise InputError(
                "instruction is incomplete",
                where=where,
                expected=f"as in {usual}",
                found=quoted(" ".join(words)),
            )
        for name in named:
            match = NEEDLE.fullmatch(name)
            if match is None or abs(int(match[3])) > LARGEST_NEEDLE:
                expected = f"f or b and a number up to {LARGEST_NEEDLE}"
                raise InputError(f"{code}: no needle", where=where, expected=expected, found=quoted(name))
        for carrier in words[1 + directed + needles :] if directed else ():
            if carriers is not None and carrier not in carriers:
                expected = f"one of ;;Carriers: {' '.join(carriers)}"[:80]
                raise InputError(
                    f"{code}: unknown carrier", where=where, expected=expected, found=quoted(carrier)
                )
        yield _Instruction(number, words, rack)


def _racking(where: str, words: list[str]) -> float:
    try:
        value = float(words[1])
    except (IndexError, ValueError):
        value = math.nan
    if not abs(value) <= LARGEST_NEEDLE:
        raise InputError(
            "rack", where=where, expected="a number of needles", found=quoted(" ".join(words[1:]))
        )
    return value


class _Machine:
    """Two needle beds that carry out the instructions of a file.

    base: the racking at which the file knits, in whole needles; back needle n faces front needle n + base, or is a
    little to the right of it.
    """

    def __init__(self, instructions: list[_Instruction]) -> None:
        self.instructions = instructions
        back = [i for i in instructions if i.words[0] in STITCHES and i.words[2].startswith("b")]
        self.base = Counter(math.floor(i.rack) for i in back).most_common(1)[0][0] if back else 0
        self.held: set[Needle] = set()
        self.events: list[_Course | _Fault] = []
        self.open: _Course | None = None

    def run(self, path: Path) -> list[_Course | _Fault]:
        """Courses, and what lies between them that a chart cannot have."""
        for instruction in self.instructions:
            code = instruction.words[0]
            if code in STITCHES and len(instruction.words) > 3:
                self._stitch(instruction)
            elif code in ("knit", "drop"):
                needle = self._needle(instruction.words[-1])
                if needle in self.held:
                    self._fault(instruction, "drops a loop")
                self.held.discard(needle)
            elif code in ("xfer", "split"):
                self._move(instruction)
            if len(self.events) > LARGEST_PIECE:
                where = f"{path}:{instruction.line}"
                raise InputError("file is too long", where=where, expected=f"at most {LARGEST_PIECE} courses")
        return self.events

    def _needle(self, name: str) -> Needle:
        """Bed and wale; sliders are another bed."""
        match = NEEDLE.fullmatch(name)
        assert match is not None
        return match[1] + match[2], int(match[3]) + (self.base if match[1] == "b" else 0)

    def _fault(self, instruction: _Instruction, fault: str) -> None:
        self.events.append(_Fault(instruction.line, instruction.text, fault))
        self.open = None

    def _stitch(self, instruction: _Instruction) -> None:
        code, direction, name, *carriers = instruction.words
        bed, wale = needle = self._needle(name)
        course = self.open
        if course is None or not self._goes_on(course, direction, tuple(carriers), needle):
            course = _Course(instruction.line, instruction.text, tuple(carriers), direction)
            for side, number in self.held:
                course.beds[number] = "".join(sorted({side, course.beds.get(number, side)}, reverse=True))
            self.events.append(course)
            self.open = course
        stitch = _Stitch(code, bed, wale, needle not in self.held)
        course.stitches.append(stitch)
        if code == "miss":
            return
        self.held.add(needle)
        if stitch.empty:
            course.fault = course.fault or "makes a loop on an empty needle"
        if len(bed) > 1:
            course.fault = course.fault or "uses a slider"
        if bed == "b" and math.floor(instruction.rack) != self.base:
            course.fault = course.fault or f"knits with the beds racked by {instruction.rack:g}"
        if len(carriers) > 2:
            course.fault = course.fault or "has more than two yarns"

    def _goes_on(self, course: _Course, direction: str, carriers: tuple[str, ...], needle: Needle) -> bool:
        """Whether a stitch belongs to the pass: same yarns, and further in the same direction."""
        if (direction, carriers) != (course.direction, course.carriers):
            return False
        last, sign = course.stitches[-1], 1 if direction == "+" else -1
        ahead = sign * (needle[1] - last.wale)
        return ahead > 0 or (ahead == 0 and needle[0] != last.bed)

    def _move(self, instruction: _Instruction) -> None:
        """A transfer: allowed to the empty needle that faces it, so that the loop stays in its wale."""
        words = instruction.words
        if words[0] == "split" and len(words) > 4:
            self._fault(instruction, "splits a loop")
            return
        source, target = (self._needle(name) for name in words[-2:])
        if source not in self.held:
            return
        if {source[0], target[0]} != {"f", "b"}:
            self._fault(instruction, "moves a loop to a slider or along its bed")
        elif source[1] != target[1]:
            self._fault(instruction, "moves a loop to another wale (a cable or lace)")
        elif target in self.held:
            self._fault(instruction, "puts a loop on a needle that holds one")
        self.held.discard(source)
        self.held.add(target)
        self.open = None


def _body(path: Path, events: list[_Course | _Fault]) -> list[_Course]:
    """The courses of the fabric; InputError for what lies among them and is no course all across."""
    courses = [event for event in events if isinstance(event, _Course) and event.loops]
    wales = [stitch.wale for course in courses for stitch in course.loops]
    across = []
    for course in courses:
        short = _short(course, min(wales), max(wales))
        course.fault = course.fault or short
        if not short and any(stitch.kind == "knit" for stitch in course.loops):
            across.append(course)
    good = [course for course in across if not course.fault]
    if not good:
        expected = "a course that knits all across on needles with loops"
        raise InputError("file knits no fabric", where=path, expected=expected)
    body = []
    for event in events[events.index(good[0]) : events.index(across[-1]) + 1]:
        if event.fault:
            what = f"{event.text!r} {event.fault}"
            expected = "between cast-on and bind-off: knit, tuck and miss across the fabric"
            raise InputError(what, where=f"{path}:{event.line}", expected=expected)
        if isinstance(event, _Course) and event.loops:
            body.append(event)
    return body


def _short(course: _Course, first: int, last: int) -> str:
    """The fault of a course that leaves out more needles at an edge than between its stitches."""
    loops = sorted({stitch.wale for stitch in course.loops})
    reached = [stitch.wale for stitch in course.stitches]
    inner = max((b - a for a, b in pairwise(loops)), default=1)
    if max(min(reached) - first, last - max(reached)) > max(inner - 1, 2):
        reach = f"needles {min(reached)} to {max(reached)} of {first} to {last}"
        return f"begins a course of {reach} (short row or intarsia)"
    return ""


def _rows(body: list[_Course], two_beds: bool) -> tuple[list[list[str]], list[int]]:
    """The symbols of every course, of two beds in pairs, and the wales; equal gaps between needles are no wales."""
    used = sorted({stitch.wale for course in body for stitch in course.loops})
    pitch = math.gcd(*(wale - used[0] for wale in used)) or 1
    wales = list(range(used[0], used[-1] + 1, pitch))
    working, rows = set(used), []
    for course in body:
        made = {(stitch.bed, stitch.wale): stitch.kind for stitch in course.loops}
        row = []
        for wale in wales:
            front, back = made.get(("f", wale)), made.get(("b", wale))
            symbols = (
                {"knit": "k", "tuck": "t"}.get(front or "", ""),
                {"knit": "p", "tuck": "t"}.get(back or "", ""),
            )
            if two_beds:
                row.append((symbols[0] or "-") + (symbols[1] or "-"))
            else:
                held = course.beds.get(wale) if wale in working else None
                row.append("".join(symbols) or {"f": "b", "b": "f", None: "-"}[held])
        rows.append(row)
    return rows, wales


def _text(row: list[str], two_beds: bool) -> str:
    """A row of a chart; of two beds as front|back."""
    if not two_beds:
        return "".join(row)
    return "|".join("".join(pair[bed] for pair in row) for bed in (0, 1))


def _repeat(path: Path, what: str, items: list, *, margin: int, largest: int = LARGEST_CHART) -> slice:
    items = [tuple(item) if isinstance(item, list) else item for item in items]
    repeat = repeat_of([str(item) for item in items], largest, margin)
    if repeat is None:
        raise InputError(
            f"the {len(items)} {what} have no repeat", where=path, expected=f"one of at most {largest}"
        )
    return repeat


def _covered(looks: list, repeat: slice) -> int:
    """How many courses the repeat goes on for, before and after itself."""
    period = repeat.stop - repeat.start
    first, last = repeat.start, repeat.stop
    while first > 0 and looks[first - 1] == looks[first - 1 + period]:
        first -= 1
    while last < len(looks) and looks[last] == looks[last - period]:
        last += 1
    return last - first


def _natural(carrier: str) -> tuple[int, str]:
    return (int(carrier) if carrier.isdecimal() and len(carrier) < 9 else 10**9, carrier)
