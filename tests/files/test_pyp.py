"""The `.pyp` reader and writer: identity, and every fault named with its line."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from yarnscale.drawing.library import build, names
from yarnscale.errors import InputError
from yarnscale.files.pyp import read_pyp, write_pyp

FIELDS = (
    "vertices",
    "twist",
    "edges",
    "rest_length",
    "rest_curvature",
    "rest_twist",
    "reference_director",
    "reference_twist",
    "period",
    "radius",
)


@pytest.mark.parametrize("name", names())
def test_writing_and_reading_is_the_identity(tmp_path: Path, name: str) -> None:
    pattern = build(name, rest_shape="current")
    write_pyp(pattern, tmp_path / f"{name}.pyp")
    again = read_pyp(tmp_path / f"{name}.pyp")
    for field in FIELDS:
        assert np.array_equal(getattr(again, field), getattr(pattern, field)), field
    assert again.name == name


@pytest.mark.parametrize("name", ["stockinette", "satin"])
def test_the_published_files_survive_a_round_trip(shared: Path, tmp_path: Path, name: str) -> None:
    pattern = read_pyp(shared / "reference" / f"{name}.pyp")
    write_pyp(pattern, tmp_path / "copy.pyp")
    assert read_pyp(tmp_path / "copy.pyp").content_hash() == pattern.content_hash()


def test_rows_of_edges_may_come_in_any_order(lines: list[str], tmp_path: Path) -> None:
    first = block_start(lines, "*E")
    rows = lines[first : first + 32]
    shuffled = lines[:first] + [rows[i] for i in np.random.default_rng(0).permutation(32)] + lines[first + 32 :]
    original, mixed = store(tmp_path, "a", lines), store(tmp_path, "b", shuffled)
    assert lines != shuffled
    assert read_pyp(mixed).content_hash() == read_pyp(original).content_hash()


def test_rounded_directors_are_made_exact(lines: list[str], tmp_path: Path) -> None:
    first = block_start(lines, "*RefD1")
    rounded = [" ".join(f"{float(x):.3f}" for x in line.split()) for line in lines[first : first + 32]]
    pattern = read_pyp(store(tmp_path, "rounded", [*lines[:first], *rounded, *lines[first + 32 :]]))
    edge = pattern.edge_vectors()
    assert np.abs(np.linalg.norm(pattern.reference_director, axis=1) - 1.0).max() < 1e-14
    assert np.abs((edge * pattern.reference_director).sum(axis=1)).max() < 1e-16


def test_comments_blanks_and_line_ends_do_not_matter(lines: list[str], tmp_path: Path) -> None:
    noisy = "\r\n".join(f"  {line}\t# note" if line else "" for line in ["# head", *lines])
    path = tmp_path / "noisy.pyp"
    path.write_bytes(noisy.encode())
    assert read_pyp(path).content_hash() == read_pyp(store(tmp_path, "plain", lines)).content_hash()


@pytest.fixture(scope="module")
def lines(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """The lines of a valid file with 32 vertices."""
    path = tmp_path_factory.mktemp("pyp") / "plain.pyp"
    write_pyp(build("plain"), path)
    return path.read_text().splitlines()


def block_start(lines: list[str], block: str) -> int:
    """Index of a block's first row."""
    return next(i for i, line in enumerate(lines) if line.split()[:1] == [block]) + 1


def store(folder: Path, name: str, lines: list[str]) -> Path:
    path = folder / f"{name}.pyp"
    path.write_text("\n".join(lines) + "\n")
    return path


def in_row(block: str, row: int, change: Callable[[list[str]], list[str]]) -> Callable[[list[str]], list[str]]:
    """A fault: change the tokens of one row of a block."""

    def fault(lines: list[str]) -> list[str]:
        at = block_start(lines, block) + row
        return [*lines[:at], " ".join(change(lines[at].split())), *lines[at + 1 :]]

    return fault


def put(column: int, token: str) -> Callable[[list[str]], list[str]]:
    return lambda tokens: [*tokens[:column], token, *tokens[column + 1 :]]


def without_block(name: str) -> Callable[[list[str]], list[str]]:
    def fault(lines: list[str]) -> list[str]:
        first = block_start(lines, name)
        return lines[: first - 1] + lines[first + 32 :]

    return fault


# fault, line of the error relative to the block's first row (or None), message
FAULTS: dict[str, tuple[Callable[[list[str]], list[str]], tuple[str, int] | None, str]] = {
    "truncated": (
        lambda lines: lines[: block_start(lines, "*RefT") + 10],
        ("*RefT", 9),
        r"block \*RefT is truncated; expected 32 rows; found 10",
    ),
    "cut in the middle": (
        lambda lines: lines[: block_start(lines, "*RL") + 3],
        ("*RL", 2),
        r"block \*RK is missing; expected \*pattern \*Q .*; found \*pattern \*Q \*E \*RL",
    ),
    "row too many": (
        lambda lines: [*lines, "0.0"],
        ("*RefT", 32),
        r"block \*RefT is too long; expected 32 rows; found 33",
    ),
    "missing block": (without_block("*RK"), None, r"block \*RK is missing"),
    "column missing": (
        in_row("*Q", 4, lambda tokens: tokens[:3]),
        ("*Q", 4),
        r"\*Q row has the wrong number of columns; expected 4 \(x y z theta\); found 3",
    ),
    "no number": (
        in_row("*Q", 4, put(1, "0.1x")),
        ("*Q", 4),
        r"\*Q y is no number; expected a finite number; found '0.1x'",
    ),
    "NaN": (
        in_row("*Q", 4, put(2, "nan")),
        ("*Q", 4),
        r"\*Q z is no number; expected a finite number; found 'nan'",
    ),
    "infinite": (
        in_row("*RT", 7, put(0, "1e999")),
        ("*RT", 7),
        r"\*RT twist is no number; .* found '1e999'",
    ),
    "fractional index": (
        in_row("*E", 3, put(1, "4.0")),
        ("*E", 3),
        r"\*E v1 is no integer; expected an integer; found '4.0'",
    ),
    "other digits": (in_row("*RL", 3, put(0, "1_0")), ("*RL", 3), r"\*RL length is no number"),
    "index out of range": (
        in_row("*E", 3, put(1, "32")),
        ("*E", 3),
        r"edges\[3\] ends at a vertex that is not there; expected 0 ≤ v1 < 32; found v1 = 32",
    ),
    "negative index": (
        in_row("*E", 3, put(0, "-1")),
        ("*E", 3),
        r"edges\[0\] must start at vertex 0; expected v0 = 0; found v0 = -1",
    ),
    "two outgoing": (
        in_row("*E", 3, put(0, "2")),
        ("*E", 3),
        r"edges\[3\] must start at vertex 3; expected v0 = 3; found v0 = 2",
    ),
    "two incoming": (
        in_row("*E", 3, put(1, "3")),
        None,
        "vertex 3 must have one incoming edge; expected 1 edge; found 2 edges",
    ),
    "far tile": (
        in_row("*E", 3, put(2, "123456")),
        None,
        "edges reach too many tiles away",
    ),
    "zero rest length": (
        in_row("*RL", 5, put(0, "0")),
        ("*RL", 5),
        r"rest_length\[5\] must be positive; expected > 0 m; found 0",
    ),
    "negative period": (
        in_row("*pattern", 0, put(0, "-0.01")),
        ("*pattern", 0),
        r"period\[0\] must be positive",
    ),
    "zero radius": (
        in_row("*pattern", 0, put(2, "0.0")),
        ("*pattern", 0),
        "radius must be positive",
    ),
    "no vertices": (in_row("*pattern", 0, put(3, "0")), ("*Q", 1), r"block \*Q is too long; expected 1 rows"),
    "too few announced": (
        in_row("*pattern", 0, put(3, "31")),
        ("*Q", 31),
        r"block \*Q is too long; expected 31 rows",
    ),
    "absurd count": (
        in_row("*pattern", 0, put(3, "900000000000000")),
        ("*Q", 31),
        r"block \*Q is truncated; expected 900000000000000 rows; found 32",
    ),
    "count beyond words": (
        in_row("*pattern", 0, put(3, "9" * 5000)),
        ("*pattern", 0),
        r"\*pattern n is no integer",
    ),
    "two headers": (
        in_row("*RL", 0, lambda _: ["*Q"]),
        ("*RL", 0),
        r"block \*Q occurs twice; expected only the one",
    ),
    "unknown block": (
        in_row("*RL", 0, lambda _: ["*Colour"]),
        ("*RL", 0),
        r"unknown block; .* found '\*Colour'",
    ),
    "number first": (lambda lines: ["3.0", *lines], None, r":1: number before any block; expected \*pattern"),
    "zero director": (
        in_row("*RefD1", 6, lambda _: ["0", "0", "0"]),
        ("*RefD1", 6),
        r"reference_director\[6\] must be a unit vector; expected length 1; found length 0",
    ),
    "director along the edge": (
        in_row("*RefD1", 3, lambda _: ["1", "0", "0"]),
        ("*RefD1", 3),
        r"reference_director\[3\] must be perpendicular to its edge; expected cosine 0",
    ),
    "far away": (in_row("*Q", 2, put(0, "1e200")), None, "vertices lie too far out"),
    "one point twice": (
        lambda lines: in_row("*Q", 4, lambda _: lines[block_start(lines, "*Q") + 3].split())(lines),
        ("*E", 3),
        r"edges\[3\] has no usable length; expected two distinct ends; found 0 m",
    ),
}


@pytest.mark.parametrize("name", FAULTS)
def test_faults_are_named_with_their_line(name: str, lines: list[str], tmp_path: Path) -> None:
    fault, place, message = FAULTS[name]
    broken = fault(lines)
    path = store(tmp_path, "broken", broken)
    start = time.perf_counter()
    with pytest.raises(InputError, match=message) as error:
        read_pyp(path)
    assert time.perf_counter() - start < 1.0
    text = str(error.value)
    assert text.startswith(str(path))
    assert "\n" not in text
    if place is not None:
        block, row = place
        source = lines if name in ("two headers", "unknown block") else broken
        assert text.startswith(f"{path}:{block_start(source, block) + row + 1}: "), text


def test_yarns_through_each_other_are_refused(tmp_path: Path) -> None:
    pattern = build("plain")
    flat = pattern.vertices * [1.0, 1.0, 0.01]
    edge = pattern.edge_vectors() * [1.0, 1.0, 0.01]
    director = np.cross(edge, np.cross([0.0, 0.0, 1.0], edge))
    director /= np.linalg.norm(director, axis=1)[:, None]
    path = tmp_path / "through.pyp"
    write_pyp(replace(pattern, vertices=flat, reference_director=director), path)
    with pytest.raises(InputError, match=r"yarns run through each other: segment .* expected centre lines") as e:
        read_pyp(path)
    assert re.search(r"segment \d+-\d+ and segment \d+-\d+", str(e.value))
    assert str(e.value).startswith(f"{path}: ")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "file is empty; expected text; found 0 bytes"),
        (b" \n\n", "file is empty"),
        (b"*pattern\x00\x01\x02", "file is not text; expected text; found binary data"),
        (b"*pattern\n1 1 1 1\n\xff\xfe", r":3: file is not text; expected UTF-8; found byte 0xff"),
        (b"# only a comment\n", "file holds no block"),
        (b"once upon a time\n", ":1: number before any block"),
    ],
)
def test_files_that_are_no_text(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "odd.pyp"
    path.write_bytes(content)
    with pytest.raises(InputError, match=message):
        read_pyp(path)


def test_paths_that_are_no_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="file does not exist; expected a readable file"):
        read_pyp(tmp_path / "none.pyp")
    with pytest.raises(InputError, match="path is a folder; expected a file"):
        read_pyp(tmp_path)
