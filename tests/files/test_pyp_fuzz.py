"""A damaged `.pyp` file gives a pattern or an InputError, never anything else."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, seed, settings
from hypothesis import strategies as st

from yarnscale.drawing.library import build
from yarnscale.errors import InputError
from yarnscale.files.pattern_json import read_pattern_json, write_pattern_json
from yarnscale.files.pyp import read_pyp, write_pyp
from yarnscale.yarn.pattern import YarnPattern

WORDS = (
    b'nan -inf 1e308 -1 0 1e-320 99999999999999999999 *Q *E # *pattern 3.5 \xff \x00 -- 1e5 0x10 { ] null true "x" ,'
)
TOKENS = [*WORDS.split(b" "), b"\n", b" "]
ONE_CHANGE = st.tuples(
    st.sampled_from(["cut", "drop", "insert", "replace", "swap", "double"]),
    st.floats(0.0, 1.0),
    st.floats(0.0, 1.0),
    st.sampled_from(TOKENS),
)


def damage(content: bytes, changes: list[tuple[str, float, float, bytes]]) -> bytes:
    """Apply a few changes at relative places of the file."""
    for kind, at, other, token in changes:
        words = content.split(b" ")
        i, k = int(at * (len(content) - 1)) if content else 0, int(other * (len(words) - 1))
        if kind == "cut":
            content = content[:i]
        elif kind == "drop":
            content = content[:i] + content[i + 1 + int(other * 40) :]
        elif kind == "insert":
            content = content[:i] + token + content[i:]
        elif kind == "replace":
            content = b" ".join([*words[:k], token, *words[k + 1 :]])
        elif kind == "swap":
            lines = content.split(b"\n")
            a, b = int(at * (len(lines) - 1)), int(other * (len(lines) - 1))
            lines[a], lines[b] = lines[b], lines[a]
            content = b"\n".join(lines)
        else:
            lines = content.split(b"\n")
            a = int(at * (len(lines) - 1))
            content = b"\n".join([*lines[: a + 1], *lines[a:]])
    return content


def sources() -> dict[str, bytes]:
    with tempfile.TemporaryDirectory() as folder:
        pattern = build("plain")
        write_pyp(pattern, Path(folder) / "p.pyp")
        write_pattern_json(pattern, Path(folder) / "p.json")
        return {s: (Path(folder) / f"p.{s}").read_bytes() for s in ("pyp", "json")}


SOURCES = sources()


@pytest.mark.parametrize("suffix", ["pyp", "json"])
@seed(20240501)
@settings(max_examples=400, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(changes=st.lists(ONE_CHANGE, min_size=1, max_size=3))
def test_damaged_files(suffix: str, changes, tmp_path: Path) -> None:
    path = tmp_path / f"damaged.{suffix}"
    path.write_bytes(damage(SOURCES[suffix], changes))
    try:
        pattern = (read_pyp if suffix == "pyp" else read_pattern_json)(path)
    except InputError as error:
        assert str(path) in str(error)
        assert "\n" not in str(error)
    else:
        assert isinstance(pattern, YarnPattern)
        assert np.isfinite(pattern.vertices).all()
        assert (pattern.edges[:, 0] == np.arange(len(pattern.edges))).all()
