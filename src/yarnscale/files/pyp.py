"""`.pyp` files: a periodic yarn pattern at rest, in text (format of MADYPG; Sperl, Narain, Wojtan 2021)."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from yarnscale.errors import InputError, located, quoted
from yarnscale.files.atomic import write_text
from yarnscale.files.source_text import read_source
from yarnscale.yarn.clearance import check_clearance
from yarnscale.yarn.pattern import YarnPattern
from yarnscale.yarn.pattern_fields import LARGEST_LENGTH
from yarnscale.yarn.proportions import check_proportions

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
LARGEST_TILE_SHIFT = 10_000


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
    stand in any order there and are sorted here. Directors are made exactly unit and perpendicular.
    Raises InputError with file, line, field, expected and found for anything that is no pattern, and for yarns that
    run through each other.
    """
    path = Path(path)
    blocks = _parse(path, read_source(path))
    n = _count(path, blocks)
    for name, block in blocks.items():
        _check_rows(path, block, n if name != "pattern" else 1)
    pattern = _assemble(path, blocks)
    check_proportions(pattern, where=path)
    check_clearance(pattern, where=path)
    return pattern


def write_pyp(pattern: YarnPattern, path: str | os.PathLike[str]) -> None:
    """Write a pattern with every digit, so that reading it gives the same numbers; whole or not at all.

    Raises InputError for a pattern of several yarn materials: the format has no place for them.
    """
    for what, several in (
        ("materials", pattern.material_of_vertex.any()),
        ("radii", pattern.yarn_radius is not None),
    ):
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
            raise InputError(
                "number before any block", where=where, expected="*pattern", found=quoted(content)
            )
        else:
            block.rows.append(_parse_row(where, block.name, content.split()))
            block.lines.append(number)
    if not blocks:
        raise InputError(
            "file holds no block", where=path, expected="*pattern", found="only blanks and comments"
        )
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
            "unknown block",
            where=where,
            expected=" ".join(f"*{known}" for known in COLUMNS),
            found=quoted(content),
        )
    if name in blocks:
        raise InputError(
            f"block *{name} stands twice", where=where, expected=f"only the one of line {blocks[name].line}"
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
    # Python would also accept 1_000 and digits of other scripts.
    plain = token.isascii() and "_" not in token and len(token) <= 64
    if (name, column) in INTEGERS:
        digits = token[1:] if token[:1] in "+-" else token
        if not (plain and digits.isdigit() and len(digits) <= 15):
            raise InputError(
                f"{label} is no integer", where=where, expected="an integer", found=quoted(token)
            )
        return int(token)
    try:
        value = float(token) if plain else math.nan
    except ValueError:
        raise InputError(
            f"{label} is no number", where=where, expected="a number", found=quoted(token)
        ) from None
    if not math.isfinite(value):
        raise InputError(
            f"{label} is not finite", where=where, expected="a finite number", found=quoted(token)
        )
    return value


def _count(path: Path, blocks: dict[str, _Block]) -> int:
    """The number of vertices in the header, believed only where the blocks bear it out."""
    header = blocks["pattern"]
    _check_rows(path, header, 1)
    where = f"{path}:{header.lines[0]}"
    for column, value in zip(("px", "py", "radius"), header.rows[0][:3], strict=True):
        if not 0.0 < value <= LARGEST_LENGTH:
            raise InputError(
                f"*pattern {column} must be positive", where=where, expected="> 0 m", found=f"{value:g}"
            )
    n = int(header.rows[0][3])
    if n < 1:
        raise InputError("*pattern n must be positive", where=where, expected="≥ 1 vertices", found=n)
    return n


def _check_rows(path: Path, block: _Block, expected: int) -> None:
    if (found := len(block.rows)) == expected:
        return
    fault = "truncated" if found < expected else "too long"
    line = [block.line, *block.lines][min(found, expected + 1)]
    what = f"block *{block.name} is {fault}"
    raise InputError(what, where=f"{path}:{line}", expected=f"{expected} rows", found=found)


def _assemble(path: Path, blocks: dict[str, _Block]) -> YarnPattern:
    edges = _sorted_edges(path, blocks["E"])
    (px, py, radius, _), q = blocks["pattern"].rows[0], np.array(blocks["Q"].rows)
    rest_length = np.array(blocks["RL"].rows)[:, 0]
    for row, value in enumerate(rest_length):
        if not 0.0 < value <= LARGEST_LENGTH:
            where = f"{path}:{blocks['RL'].lines[row]}"
            raise InputError("*RL length must be positive", where=where, expected="> 0 m", found=f"{value:g}")
    vertices, period = np.ascontiguousarray(q[:, :3]), np.array([px, py])
    director = _clean_directors(path, blocks, vertices, edges, period)
    with located(path):
        return YarnPattern(
            vertices=vertices,
            twist=np.ascontiguousarray(q[:, 3]),
            edges=edges,
            rest_length=rest_length,
            rest_curvature=np.array(blocks["RK"].rows),
            rest_twist=np.array(blocks["RT"].rows)[:, 0],
            reference_director=director,
            reference_twist=np.array(blocks["RefT"].rows)[:, 0],
            period=period,
            radius=radius,
            name=path.stem,
        )


def _sorted_edges(path: Path, block: _Block) -> np.ndarray:
    """Rows of *E by their first vertex, after checking that every vertex has one edge in and one out."""
    n = len(block.rows)
    edges = np.array(block.rows, dtype=np.int64)
    for role, column in (("v0", 0), ("v1", 1)):
        first_seen: dict[int, int] = {}
        for row, vertex in enumerate(edges[:, column].tolist()):
            where = f"{path}:{block.lines[row]}"
            if not 0 <= vertex < n:
                raise InputError(
                    f"*E {role} is out of range", where=where, expected=f"0 to {n - 1}", found=vertex
                )
            if vertex in first_seen:
                direction = "outgoing" if column == 0 else "incoming"
                raise InputError(
                    f"*E {role}: vertex {vertex} has two {direction} edges",
                    where=where,
                    expected=f"only the one of line {first_seen[vertex]}",
                )
            first_seen[vertex] = block.lines[row]
    for row, shift in enumerate(np.abs(edges[:, 2:]).max(axis=1)):
        if shift > LARGEST_TILE_SHIFT:
            raise InputError(
                "*E tile shift is too large",
                where=f"{path}:{block.lines[row]}",
                expected=f"at most {LARGEST_TILE_SHIFT}",
                found=int(shift),
            )
    return edges[np.argsort(edges[:, 0], kind="stable")]


def _clean_directors(
    path: Path, blocks: dict[str, _Block], vertices: np.ndarray, edges: np.ndarray, period: np.ndarray
) -> np.ndarray:
    """Unit directors at right angles to their edges; small deviations (rounded digits) are removed."""
    director, lines = np.array(blocks["RefD1"].rows), blocks["RefD1"].lines
    if np.abs(vertices).max() > LARGEST_LENGTH:
        row = int(np.argmax(np.abs(vertices).max(axis=1)))
        raise InputError(
            "*Q position lies too far out",
            where=f"{path}:{blocks['Q'].lines[row]}",
            expected=f"metres, below {LARGEST_LENGTH:g}",
            found=f"{np.abs(vertices[row]).max():g}",
        )
    edge = vertices[edges[:, 1]] - vertices
    edge[:, :2] += edges[:, 2:] * period
    length = np.linalg.norm(edge, axis=1)
    for row in np.flatnonzero(~(length > 0.0)):
        raise InputError(
            f"*Q: the edge from vertex {row} to {edges[row, 1]} has no length",
            where=f"{path}:{blocks['Q'].lines[row]}",
            expected="two distinct positions",
        )
    tangent = edge / length[:, None]
    with np.errstate(over="ignore"):
        norm = np.linalg.norm(director, axis=1)
    for row in np.flatnonzero(~((norm > 0.5) & (norm < 2.0))):
        raise InputError(
            "*RefD1 must be a unit vector",
            where=f"{path}:{lines[row]}",
            expected="length 1",
            found=f"{norm[row]:g}",
        )
    cosine = np.einsum("ij,ij->i", director, tangent) / norm
    for row in np.flatnonzero(np.abs(cosine) > 0.1):
        raise InputError(
            f"*RefD1 must be perpendicular to the edge from vertex {row}",
            where=f"{path}:{lines[row]}",
            expected="cosine 0 (within 0.1)",
            found=f"{cosine[row]:.3g}",
        )
    clean = director / norm[:, None] - cosine[:, None] * tangent
    clean /= np.linalg.norm(clean, axis=1)[:, None]
    # Directors that are exact already keep their digits, so that writing and reading is the identity.
    exact = (np.abs(norm - 1.0) < 1e-12) & (np.abs(cosine) < 1e-12)
    return np.where(exact[:, None], director, clean)
