"""Binary curve collections: the bytes are those of the format, and come back."""

from __future__ import annotations

import struct

import numpy as np

from yarnscale.files.bcc import write_bcc
from yarnscale.files.curve_frames import CurveSet

CURVES = CurveSet([0, 2, 5], 1e-3, closed=[False, True])
POINTS = np.random.default_rng(2).normal(size=(5, 3))


def test_every_byte_is_where_the_format_has_it(tmp_path) -> None:
    """Read as the format's author reads it: sign, sizes, type, dimensions, up, counts, 40 bytes, then curves."""
    path = tmp_path / "gestrick ü.bcc"
    write_bcc(path, CURVES, POINTS)
    content = path.read_bytes()
    assert content[:8] == b"BCC\x44C0\x03\x02"
    assert struct.unpack("<QQ", content[8:24]) == (2, 5)
    assert content[24:64] == b"yarnscale, m, radius 0.001".ljust(40, b"\0")
    assert struct.unpack("<i6f", content[64:92]) == (2, *POINTS[:2].astype(np.float32).ravel())
    assert struct.unpack("<i9f", content[92:]) == (-3, *POINTS[2:].astype(np.float32).ravel())
