"""`.pyp` files: a periodic yarn pattern at rest, in text (format of MADYPG; Sperl, Narain, Wojtan 2021)."""

from __future__ import annotations

import math
import os
import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from yarnscale.drawing.proportions import check_proportions
from yarnscale.errors import InputError, quoted
from yarnscale.files.atomic import write_text
from yarnscale.files.source_text import finite_number, read_source
from yarnscale.yarn.clearance import check_clearance
from yarnscale.yarn.pattern import YarnPattern

COLUMNS = {
    "pattern": ("px", "py", "radius", "n"),
    "Q": ("x", "y", "z", "theta"),
    "E": ("v0", "v1", "dx", "dy"),
    "RL": ("length",),
    "RK": ("kappa1", "kappa2"),
    "RT": ("twist",),
    "RefD1": ("x", "y", "z"),
    "RefT": ("twist",),
}
INTEGERS = {("pattern", "n"), ("E", "v0"), ("E", "v1"), ("E", "dx"), ("E", "dy")}


@dataclass
class _Block:
    """Rows of one block, with the line of its keyword and of each row."""

    name: str
    line: int
    rows: list[list[float]] = field(default_factory=list)
    lines: list[int] = field(default_factory=list)


def read_pyp(path: str | os.PathLike[str]) -> YarnPattern:
    """Read a pattern; the name is the file's stem.

    The quantities of edges are already stored by the edge's first vertex in the file; the rows of ``*E``
    may have any order there and are sorted here. Directors are made exactly unit and perpendicular.
    Raises InputError with file, line, field, expected and found for anything that is no pattern, and for yarns that
    run through each other.
    """
    path = Path(path)
    blocks = _parse(path, read_source(path))
    _check_rows(path, blocks["pattern"], 1)
    n = max(1, int(blocks["pattern"].rows[0][3]))
    for name, block in blocks.items():
        _check_rows(path, block, n if name != "pattern" else 1)
    pattern = _assemble(path, blocks)
    check_proportions(pattern, where=path)
    check_clearance(pattern, where=path)
    return pattern


def write_pyp(pattern: YarnPattern, path: str | os.PathLike[str]) -> None:
    """Write a pattern with all digits, so that it is read back exactly; completely or not at all.

    Raises InputError for a pattern of several yarn materials: the format has no place for them.
    """
    for what, several in (("materials", pattern.material_of_vertex.any()), ("radii", pattern.yarn_radius is not None)):
        if several:
            expected = "one, or the format .json"
            raise InputError(f"pattern has several yarn {what}", where=path, expected=expected, found=".pyp")
    px, py = pattern.period
    parts = [
        "*pattern # px py radius num_vertedges",
        f"{float(px)!r} {float(py)!r} {pattern.radius!r} {len(pattern.edges)}",
    ]

    def block(title: str, table: np.ndarray) -> None:
        rows = table.reshape(len(table), -1).tolist()
        parts.extend(["", title, *(" ".join(map(repr, row)) for row in rows)])

    block("*Q # dofs: x y z t", np.column_stack([pattern.vertices, pattern.twist]))
    block("*E # edges [v0, v1, dx, dy]", pattern.edges)
    block("*RL # rest lengths, by v0", pattern.rest_length)
    block("*RK # rest kappas, by vertex", pattern.rest_curvature)
    block("*RT # rest twists, by vertex", pattern.rest_twist)
    block("*RefD1 # reference directors, by v0", pattern.reference_director)
    block("*RefT # reference twists, by vertex", pattern.reference_twist)
    write_text(path, "\n".join(parts) + "\n")


def _parse(path: Path, text: str) -> dict[str, _Block]:
    """Split the text into blocks of numbers."""
    blocks: dict[str, _Block] = {}
    block: _Block | None = None
    for number, line in enumerate(text.splitlines(), start=1):
        content = line.split("#", 1)[0].strip()
        if not content:
            continue
        where = f"{path}:{number}"
        if content.startswith("*"):
            block = _open_block(where, content, number, blocks)
        elif block is None:
            raise InputError("number before any block", where=where, expected="*pattern", found=quoted(content))
        else:
            block.rows.append(_parse_row(where, block.name, content.split()))
            block.lines.append(number)
    if not blocks:
        raise InputError("file holds no block", where=path, expected="*pattern", found="only blanks and comments")
    for name in COLUMNS:
        if name not in blocks:
            raise InputError(
                f"block *{name} is missing",
                where=f"{path}:{number}",
                expected=" ".join(f"*{known}" for known in COLUMNS),
                found=" ".join(f"*{known}" for known in blocks),
            )
    return blocks


def _open_block(where: str, content: str, number: int, blocks: dict[str, _Block]) -> _Block:
    words = content[1:].split()
    name = words[0] if words else ""
    if name not in COLUMNS or len(words) > 1:
        raise InputError(
            "unknown block", where=where, expected=" ".join(f"*{known}" for known in COLUMNS), found=quoted(content)
        )
    if name in blocks:
        raise InputError(
            f"block *{name} occurs twice", where=where, expected=f"only the one of line {blocks[name].line}"
        )
    blocks[name] = _Block(name, number)
    return blocks[name]


def _parse_row(where: str, name: str, tokens: list[str]) -> list[float]:
    columns = COLUMNS[name]
    if len(tokens) != len(columns):
        raise InputError(
            f"*{name} row has the wrong number of columns",
            where=where,
            expected=f"{len(columns)} ({' '.join(columns)})",
            found=len(tokens),
        )
    return [_number(where, name, column, token) for column, token in zip(columns, tokens, strict=True)]


def _number(where: str, name: str, column: str, token: str) -> float:
    """One number of a row: indices strictly integer, the rest finite."""
    label = f"*{name} {column}"
    if (name, column) in INTEGERS:
        if not re.fullmatch(r"[+-]?\d{1,15}", token, re.ASCII):
            raise InputError(f"{label} is no integer", where=where, expected="an integer", found=quoted(token))
        return int(token)
    if math.isnan(value := finite_number(token)):
        raise InputError(f"{label} is no number", where=where, expected="a finite number", found=quoted(token))
    return value


def _check_rows(path: Path, block: _Block, expected: int) -> None:
    if (found := len(block.rows)) == expected:
        return
    fault = "truncated" if found < expected else "too long"
    line = [block.line, *block.lines][min(found, expected + 1)]
    what = f"block *{block.name} is {fault}"
    raise InputError(what, where=f"{path}:{line}", expected=f"{expected} rows", found=found)


_BLOCKS = {
    "vertices": "Q", "twist": "Q", "edges": "E", "rest_length": "RL", "rest_curvature": "RK", "rest_twist": "RT",
    "reference_director": "RefD1", "reference_twist": "RefT", "period": "pattern", "radius": "pattern",
}  # fmt: skip
"""Field of a pattern -> the block that holds it."""


def _assemble(path: Path, blocks: dict[str, _Block]) -> YarnPattern:
    """The pattern; what it refuses is named by the block's line, with rows as the pattern counts them."""
    tables = {name: np.array(block.rows) for name, block in blocks.items()}
    edges = np.array(blocks["E"].rows, dtype=np.int64)
    order = np.argsort(edges[:, 0], kind="stable")
    blocks["E"].lines = [blocks["E"].lines[row] for row in order]
    edges, (px, py, radius, _) = edges[order], blocks["pattern"].rows[0]
    vertices, period = np.ascontiguousarray(tables["Q"][:, :3]), np.array([px, py])
    try:
        return YarnPattern(
            vertices=vertices,
            twist=tables["Q"][:, 3],
            edges=edges,
            rest_length=tables["RL"][:, 0],
            rest_curvature=tables["RK"],
            rest_twist=tables["RT"][:, 0],
            reference_director=_clean_directors(tables["RefD1"], vertices, edges, period),
            reference_twist=tables["RefT"][:, 0],
            period=period,
            radius=radius,
            name=path.stem,
            polyline=True,
        )
    except InputError as error:
        field, row = re.match(r"(\w*)(?:\[(\d+)\])?", error.what).groups()  # type: ignore[union-attr]
        block = blocks.get(_BLOCKS.get(field, ""))
        row = 0 if field in ("period", "radius") else row
        raise error.at(path if block is None or row is None else f"{path}:{block.lines[int(row)]}") from None


def _clean_directors(director: np.ndarray, vertices: np.ndarray, edges: np.ndarray, period: np.ndarray) -> np.ndarray:
    """Unit directors at right angles to their edges: small deviations (rounded digits) are removed, others kept."""
    edge = vertices[np.clip(edges[:, 1], 0, len(vertices) - 1)] - vertices
    edge[:, :2] += edges[:, 2:] * period
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        tangent = edge / np.linalg.norm(edge, axis=1)[:, None]
        norm = np.linalg.norm(director, axis=1)
        cosine = np.einsum("ij,ij->i", director, tangent) / norm
        clean = director / norm[:, None] - cosine[:, None] * tangent
        clean /= np.linalg.norm(clean, axis=1)[:, None]
    # Directors that are exact already keep their digits, so that writing and reading is the identity.
    exact = (np.abs(norm - 1.0) < 1e-12) & (np.abs(cosine) < 1e-12)
    small = (np.abs(np.log2(np.maximum(norm, 1e-300))) < 1.0) & (np.abs(cosine) < 0.1)
    return np.where((small & ~exact)[:, None], clean, director)
