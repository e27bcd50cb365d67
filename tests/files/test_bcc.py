"""Binary curve collections: the bytes are those of the format, and come back."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.files.bcc import read_bcc, write_bcc
from yarnscale.files.curve_frames import CurveSet

CURVES = CurveSet([0, 2, 5], 1e-3, closed=[False, True])
POINTS = np.random.default_rng(2).normal(size=(5, 3))


def test_every_byte_is_where_the_format_has_it(tmp_path) -> None:
    """Read as the format's author reads it: sign, sizes, type, dimensions, up, counts, 40 bytes, then curves."""
    path = tmp_path / "gestrick ü.bcc"
    write_bcc(path, CURVES, POINTS, comment="a comment")
    content = path.read_bytes()
    assert content[:8] == b"BCC\x44C0\x03\x02"
    assert struct.unpack("<QQ", content[8:24]) == (2, 5)
    assert content[24:64] == b"a comment".ljust(40, b"\0")
    assert struct.unpack("<i6f", content[64:92]) == (2, *POINTS[:2].astype(np.float32).ravel())
    assert struct.unpack("<i9f", content[92:]) == (-3, *POINTS[2:].astype(np.float32).ravel())


@pytest.mark.parametrize("smooth", [True, False])
def test_curves_come_back(tmp_path, smooth) -> None:
    path = tmp_path / "curves.bcc"
    write_bcc(path, CURVES, POINTS, comment="Maschen äöü" * 9, smooth=smooth)
    curves, points, comment = read_bcc(path, radius=2e-3)
    np.testing.assert_array_equal(curves.offsets, CURVES.offsets)
    np.testing.assert_array_equal(curves.closed, CURVES.closed)
    np.testing.assert_array_equal(curves.radii, 2e-3)
    np.testing.assert_allclose(points, POINTS, atol=1e-6)
    assert ("Maschen äöü" * 9).startswith(comment) and len(comment.encode()) in (39, 40)


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (lambda b: b"", "no binary curve"),
        (lambda b: b"BCD" + b[3:], "no binary curve"),
        (lambda b: b[:3] + b"\x88" + b[4:], "kind of curves"),
        (lambda b: b[:-4], "wrong size"),
        (lambda b: b[:64] + struct.pack("<i", 9) + b[68:], "longer"),
        (lambda b: b[:8] + struct.pack("<QQ", 2**60, 2**60) + b[24:], "wrong size"),
        (lambda b: b[:68] + struct.pack("<f", float("nan")) + b[72:], "control points"),
    ],
)
def test_damage_is_named(tmp_path, change, what) -> None:
    path = tmp_path / "curves.bcc"
    write_bcc(path, CURVES, POINTS)
    path.write_bytes(change(path.read_bytes()))
    with pytest.raises(InputError, match=what):
        read_bcc(path, radius=1e-3)
