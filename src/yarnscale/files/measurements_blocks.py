"""Whether readings below a line of text belong to the swatch above it, to another swatch, or are results.

Machines and operators write lines of text into a log: "Specimen 2", "Cycle 2", "Break detected". Another swatch begins
where the text names another specimen, or where length and time begin anew.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from yarnscale.arrays import Array
from yarnscale.files.measurements_table import MeasuredTable

_SPECIMEN = re.compile(
    r"\b(?:specimen|sample|swatch|probe|prüfling|versuch|test|run|replicate|éprouvette|probeta|provino|試験片)"
    r"(?:\s*(?:no|nr|id|number|name))?[\s.:#=_-]*([\w-]*\d[\w-]*\b(?!\s*(?:%|°|[cm]m\b|n\b|s\b))|[a-z]\b)"
)
_DIRECTION = re.compile(r"\b(weft|warp|bias|course|wale|quer|längs|schuss|kette)(?:s|wise)?\b")
_CYCLE = re.compile(r"\b(?:cycle|zyklus|ciclo|cyclus)(?!\W*0*1\b)")
CYCLE_OR_DATE = re.compile(r"cycle|zyklus|dat", re.I)
"""Names of columns that do not count readings."""
_NEAR = 0.1
"""Share of the range of length or force by which one reading may differ from the one before."""


@dataclass(frozen=True, eq=False)
class Block:
    """Readings between two lines of text: line of the text above, text, length, force and time or number, all (n,)."""

    line: int
    text: tuple[str, ...]
    length: Array
    force: Array
    count: Array | None
    other_names: bool = False
    """Whether the line above looks like names of other columns."""


def joined_tables(tables: list[MeasuredTable], blocks: list[Block]) -> list[MeasuredTable]:
    """One table a swatch: readings below a line of text continue the table, unless another specimen or results begin.

    blocks: the readings of each table. Remarks of the tables name the lines that are not read.
    """
    found, before = [tables[0]], blocks[0]
    for previous, table, block in zip(tables, tables[1:], blocks[1:], strict=False):
        last = found[-1]
        place = _place(last, before, table, block, again=table.header == previous.header)
        if place == "other":
            found.append(table)
            before = block
            continue
        above = f"below '{table.title:.40}' in line {block.line}"
        if place == "results":
            lines = dict.fromkeys((table.rows[0][0], table.rows[-1][0]))
            remark = f"row {'-'.join(map(str, lines))}, {above}: taken for results, not read"
        else:
            remark = f"readings {above} are taken for the swatch above"
            last, before = replace(last, rows=last.rows + table.rows), _both(before, block)
        found[-1] = replace(last, remarks=(*last.remarks, remark))
    return found


def _place(
    last: MeasuredTable, before: Block, table: MeasuredTable, block: Block, *, again: bool
) -> Literal["same", "other", "results"]:
    """What a table is; again: whether it has no line of names of its own."""
    few = len(table.rows) < 3 and again
    another = _names_another(last.title, before.text, block.text)
    if last.names != table.names or not (again or _says_cycle(block.text)):
        return "other"
    if any(name.quantity in ("run", "fabric") for name in table.names):
        # Every reading says its own run.
        return "results" if block.other_names and again else "same"
    if another:
        return "results" if few else "other"
    return _goes_on(before, block, few=few)


def _names_another(title: str, known: tuple[str, ...], text: tuple[str, ...]) -> bool:
    """Whether lines of text name another specimen than the title and the lines known so far."""
    if _new(_SPECIMEN, known, text):
        return True
    words = re.sub(r"\d+", "#", title.lower())
    return "#" in words and any(
        re.sub(r"\d+", "#", line.lower()) == words and line.lower() != title.lower() and not _says_cycle((line,))
        for line in text
    )


def _new(form: re.Pattern[str], known: tuple[str, ...], text: tuple[str, ...]) -> set[str]:
    return set(form.findall(" | ".join(text).lower())) - set(form.findall(" | ".join(known).lower()))


def _says_cycle(text: tuple[str, ...]) -> bool:
    """Whether lines of text announce a further cycle of the same swatch."""
    return _CYCLE.search(" | ".join(text).lower()) is not None


def _goes_on(before: Block, after: Block, *, few: bool) -> Literal["same", "other", "results"]:
    """What readings are by their numbers; few: too few for a swatch of their own."""
    jump = abs(after.length[0] - before.length[-1])
    far = jump > max(_NEAR * np.ptp(before.length), 3 * _largest(np.abs(np.diff(before.length))))
    rise = after.force[0] - before.force[-1]
    harder = rise > max(_NEAR * np.ptp(before.force), 3 * _largest(np.diff(before.force)))
    anew = None if before.count is None or after.count is None else bool(after.count[0] < before.count[-1])
    if (few or after.other_names) and (far or harder or anew):
        return "results"
    if _says_cycle(after.text):
        return "same"
    first = abs(after.length[0] - before.length[0]) <= _NEAR * np.ptp(before.length)
    restarts = first and jump > 0.5 * np.ptp(before.length) if anew is None else anew and (first or far)
    turned = (first or far) and _new(_DIRECTION, before.text, after.text)
    return "other" if restarts or turned else "same"


def _largest(steps: Array) -> float:
    return float(steps.max()) if len(steps) else np.inf


def _both(before: Block, after: Block) -> Block:
    counts = [block.count for block in (before, after) if block.count is not None]
    return replace(
        before,
        text=before.text + after.text,
        length=np.append(before.length, after.length),
        force=np.append(before.force, after.force),
        count=np.concatenate(counts) if len(counts) == 2 else None,
    )
