"""`.k` files: knitout, instructions of flat knitting machines, described in docs/reference/draft_format.md.

The instructions are carried out on needles that hold loops or none. A carriage pass is a course; from the first that
knits held loops all across the fabric to the last one all across is the fabric, the rest is cast-on and bind-off.
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
from yarnscale.errors import InputError, quoted
from yarnscale.files.source_text import read_source
from yarnscale.files.structure_file import StructureFile, one_repeat

LARGEST_PIECE, LONGEST_FILE = 20_000, 1_000_000
"""Most courses and most instructions of a file; needles have numbers from -1999 to 1999."""
EDGE = 2
"""Wales at either edge that need not belong to the repeat, and that a course may leave out."""
TWO_BEDS = {"wale_spacing": 5.0, "course_spacing": 3.5}
"""Size of a stitch of two beds that face each other [r]."""
_BEDS = {"f": 1, "b": 2, "fs": 4, "bs": 8}
"""Front, back and their sliders; sums stand for several."""
_SYMBOLS = {("f", "knit"): "k", ("b", "knit"): "p", ("f", "tuck"): "t", ("b", "tuck"): "t"}
_WAY, _NEEDLE, _CARRIERS = r" (?P<way>[+-])", r" ([fb]s?)(-?[01]?\d{1,3})", r"(?P<carriers>( \S+)*)"
_STITCHES = ("knit", "tuck", "miss")
_FORMS = {
    **{code: (_WAY + _NEEDLE + _CARRIERS, f"{code} + f1 1") for code in _STITCHES},
    "split": (_WAY + 2 * _NEEDLE + _CARRIERS, "split + f1 b1 1"),
    "xfer": (2 * _NEEDLE, "xfer f1 b1"),
    "drop": (_NEEDLE, "drop f1"),
    "rack": (r" (?P<rack>[+-]?(\d{1,3}(\.\d*)?|\.\d+))", "rack 1"),
    **dict.fromkeys(["in", "out", "inhook", "outhook", "releasehook", "stitch", "pause", "amiss"], (".*", "")),
}
"""Parameters of each instruction, and an example."""


@dataclass(frozen=True, slots=True)
class _Instruction:
    """A line; needles: bed and number. rack: of the beds when it is carried out [needles]."""

    line: int
    text: str
    code: str
    way: str
    needles: list[tuple[str, int]]
    carriers: tuple[str, ...]
    rack: float


@dataclass
class _Course:
    """A carriage pass, or without stitches an instruction between two that a chart cannot have.

    stitches: bed, wale and kind. held: the beds on which each wale holds loops before it, from wale ``first`` on.
    fault: why it cannot be within the fabric. moved: a transfer since the last course.
    """

    start: _Instruction
    fault: str = ""
    held: bytes = b""
    first: int = 0
    moved: _Instruction | None = None
    stitches: list[tuple[str, int, str]] = field(default_factory=list)

    @property
    def loops(self) -> dict[tuple[str, int], str]:
        """Kind of the stitches that make loops, by bed and wale."""
        return {(bed, wale): kind for bed, wale, kind in self.stitches if kind != "miss"}


def read_knitout(path: str | os.PathLike[str]) -> StructureFile:
    """One repeat of stitches of a file, without its cast-on and bind-off; carriers are kinds of yarn.

    Raises InputError with file, line and instruction for what a chart cannot have: transfers to other wales, racking,
    splits, short rows, intarsia.
    """
    path = Path(path)
    body = _fabric(path, _carried_out(path, list(_instructions(path))))
    beds = 2 if any(held & 3 == 3 for course in body for held in set(course.held)) else 1
    for course in body[1:] if beds == 2 else ():
        if course.moved:
            where, expected = f"{path}:{course.moved.line}", "none where facing needles both hold loops"
            raise InputError(f"{course.moved.text!r} transfers", where=where, expected=expected)
    rows = _rows(body, beds)
    carriers = [course.start.carriers for course in body]
    # Selvedges would hide a shorter repeat.
    inner = slice(EDGE * beds, -EDGE * beds) if len(rows[0]) > 4 * EDGE * beds else slice(None)
    looks = [(row[inner], names) for row, names in zip(rows, carriers, strict=True)]
    courses = one_repeat(path, "courses", looks, LARGEST_CHART, len(rows) // 3)
    columns = list(zip(*(row[bed::beds] for row in rows[courses] for bed in range(beds)), strict=True))
    wales = one_repeat(path, "wales", columns, LARGEST_CHART // beds, EDGE)
    chart = tuple("|".join(row[bed::beds][wales] for bed in range(beds)) for row in rows[courses])
    sizes: dict = {"name": path.stem, **(TWO_BEDS if beds == 2 else {})}
    both = all(any(held & bit for course in body for held in set(course.held)) for bit in (1, 2))
    if both and not any(course.moved or len({bed for bed, _ in course.loops}) > 1 for course in body[courses]):
        where, expected = f"{path}:{body[courses][0].start.line}", "a course that knits on both beds"
        raise InputError("front and back are two layers", where=where, expected=expected)
    used = sorted({name for names in carriers[courses] for name in names}, key=lambda name: (len(name), name))
    if len(used) > 1:
        letters = dict(zip(used, string.ascii_uppercase + string.ascii_lowercase, strict=False))
        sizes["yarns"] = ["".join(letters.get(name, "?") for name in names) for names in carriers[courses]]

    def place(error: InputError) -> str:
        row = error.row if isinstance(error, ChartError) and error.row is not None else 0
        return f"{path}:{body[courses][row].start.line}"

    size = f"{len(columns[wales])} wales × {len(chart)} courses of {len(columns)} × {len(rows)}"
    return StructureFile(path, Structure(f"One repeat of {path.name}: {size}", chart, sizes=sizes), place)


def _instructions(path: Path) -> Iterator[_Instruction]:
    """The lines with instructions, checked."""
    rack, known, count = 0.0, None, 0
    for number, line in enumerate(read_source(path, other_encodings=True).splitlines(), start=1):
        if line.startswith(";;Carriers:"):
            known = line.partition(":")[2].split()
        code, *words = line.split(";", 1)[0].split() or [""]
        if not code or code.startswith("x-"):
            continue
        where, text, count = f"{path}:{number}", " ".join([code, *words]), count + 1
        if count > LONGEST_FILE:
            raise InputError("file is too long", where=where, expected=f"at most {LONGEST_FILE} instructions")
        if code not in _FORMS:
            expected = ", ".join(_FORMS)
            raise InputError("unknown instruction", where=where, expected=expected, found=quoted(code))
        form, example = _FORMS[code]
        match = re.fullmatch(code + form, text, re.ASCII)
        if match is None:
            raise InputError("bad instruction", where=where, expected=f"as in {example}", found=quoted(text))
        named = match.groupdict()
        rack = float(named.get("rack", rack))
        listed = named.get("carriers", "")
        carriers = tuple(listed.split())
        if known is not None and (unknown := [name for name in carriers if name not in known]):
            expected = f"one of ;;Carriers: {' '.join(known)}"[:80]
            raise InputError("unknown carrier", where=where, expected=expected, found=quoted(unknown[0]))
        needles = [(bed, int(place)) for bed, place in re.findall(_NEEDLE, text.removesuffix(listed))]
        yield _Instruction(number, text[:60], code, named.get("way", ""), needles, carriers, rack)


def _carried_out(path: Path, instructions: list[_Instruction]) -> list[_Course]:
    """Courses, and what lies between them that a chart cannot have.

    Most of a file is knitted at one racking R: back needle n faces front needle n + R, or is a little to its right.
    """
    back = [math.floor(i.rack) for i in instructions if i.code in _STITCHES and i.needles[0][0] == "b"]
    base = Counter(back).most_common(1)[0][0] if back else 0
    used = [place + base * bed.startswith("b") for i in instructions for bed, place in i.needles]
    first = min(used, default=0)
    held = bytearray(max(used, default=0) - first + 1)
    courses: list[_Course] = []
    going_on, moved = False, None
    for step in instructions:
        needles = [(bed, place + base * bed.startswith("b")) for bed, place in step.needles]
        full = [bool(held[wale - first] & _BEDS[bed]) for bed, wale in needles]
        if step.code in _STITCHES and step.carriers:
            if not (going_on and _goes_on(courses[-1], step, *needles[0])):
                courses.append(_Course(step, "", bytes(held), first, moved))
            course, going_on, moved = courses[-1], True, None
            course.stitches.append((*needles[0], step.code))
            if step.code != "miss":
                course.fault = course.fault or _stitch_fault(step, base, full[0])
                held[needles[0][1] - first] |= _BEDS[needles[0][0]]
        elif step.code in ("knit", "drop", "xfer", "split") and full[0]:
            going_on = False
            if fault := _transfer_fault(step, needles, full[-1]) if len(needles) > 1 else "drops a loop":
                courses.append(_Course(step, fault))
            held[needles[0][1] - first] &= ~_BEDS[needles[0][0]]
            for bed, wale in needles[1:]:
                held[wale - first] |= _BEDS[bed]
                moved = step
        if len(courses) > LARGEST_PIECE:
            expected = f"at most {LARGEST_PIECE} courses"
            raise InputError("file is too long", where=f"{path}:{step.line}", expected=expected)
    return courses


def _goes_on(course: _Course, step: _Instruction, bed: str, wale: int) -> bool:
    """Whether a stitch belongs to a pass: same yarns, and further in the same direction."""
    last_bed, last, _ = course.stitches[-1]
    ahead = (wale - last) * (1 if step.way == "+" else -1)
    same = (step.way, step.carriers) == (course.start.way, course.start.carriers)
    return same and (ahead > 0 or (ahead == 0 and bed != last_bed))


def _stitch_fault(step: _Instruction, base: int, held: bool) -> str:
    bed = step.needles[0][0]
    if len(bed) > 1:
        return "uses a slider"
    if bed == "b" and math.floor(step.rack) != base:
        return f"knits with the beds racked by {step.rack:g}"
    if len(step.carriers) > 2:
        return "has more than two yarns"
    return "" if held else "makes a loop on an empty needle"


def _transfer_fault(step: _Instruction, needles: list[tuple[str, int]], full: bool) -> str:
    """A loop may move to the empty needle that faces its own, so that it stays in its wale."""
    (bed, wale), (other, target) = needles
    if step.carriers:
        return "splits a loop"
    if {bed, other} != {"f", "b"}:
        return "moves a loop to a slider or along its bed"
    if wale != target:
        return "moves a loop to another wale (a cable or lace)"
    return "puts a loop on a needle that holds one" if full else ""


def _fabric(path: Path, courses: list[_Course]) -> list[_Course]:
    """The courses between cast-on and bind-off; InputError for what lies among them and is no course all across."""
    wales = [wale for course in courses for _, wale in course.loops]
    edges = min(wales, default=0), max(wales, default=0)
    across = []
    for number, course in enumerate(courses):
        short = _short(course, *edges) if course.loops else ""
        course.fault = course.fault or short
        if "knit" in course.loops.values() and not short:
            across.append(number)
    # Without a good course the fault of the last one says why there is no fabric.
    body = [course for course in courses if "knit" in course.loops.values()][-1:]
    if good := [number for number in across if not courses[number].fault]:
        body = [course for course in courses[good[0] : across[-1] + 1] if course.loops or course.fault]
    if not body:
        expected = "a course that knits all across on needles with loops"
        raise InputError("file knits no fabric", where=path, expected=expected)
    for course in body:
        if course.fault:
            where, expected = f"{path}:{course.start.line}", "knit, tuck and miss all across the fabric"
            raise InputError(f"{course.start.text!r} {course.fault}", where=where, expected=expected)
    return body


def _short(course: _Course, first: int, last: int) -> str:
    """The fault of a course that leaves out more needles at an edge than between its stitches."""
    loops = sorted({wale for _, wale in course.loops})
    reached = [wale for _, wale, _ in course.stitches]
    between = max((b - a for a, b in pairwise(loops)), default=1) - 1
    if max(min(reached) - first, last - max(reached)) <= max(between, EDGE):
        return ""
    return f"begins a course of needles {min(reached)} to {max(reached)} of {first} to {last} (short row or intarsia)"


def _rows(body: list[_Course], beds: int) -> list[str]:
    """The symbols of every course, of two beds front and back in turn; equal gaps between needles are no wales."""
    used = {wale for course in body for _, wale in course.loops}
    pitch = math.gcd(*(wale - min(used) for wale in used)) or 1
    wales = range(min(used), max(used) + 1, pitch)
    # A float lies between the beds: behind a front needle, in front of a back needle.
    floats = "-" * 4 if beds == 2 else "-bf-"
    rows = []
    for course in body:
        row, loops = [], course.loops
        for wale in wales:
            passed = floats[course.held[wale - course.first] & 3] if wale in used else "-"
            made = [_SYMBOLS.get((bed, loops.get((bed, wale), ""))) for bed in "fb"]
            row += [kind or passed for kind in made] if beds == 2 else [made[0] or made[1] or passed]
        rows.append("".join(row))
    return rows
