"""Strains read back from frames of a cloth whose shape is known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.files.cloth_frames import FrameFolder
from yarnscale.files.visited import visited_strains
from yarnscale.shell.mesh import TriangleMesh, rectangle
from yarnscale.shell.state import ClothState


def test_strains_of_a_stretched_and_a_rolled_frame(tmp_path: Path) -> None:
    mesh = rectangle(0.2, 0.1, 0.01)
    flat = ClothState.flat(mesh)
    frames = FrameFolder(tmp_path / "run" / "frames", mesh)
    stretched = flat.positions * np.array([1.3, 0.9, 1.0])
    angle = flat.positions[:, 0] * 20.0
    rolled = np.column_stack([np.sin(angle) / 20.0, flat.positions[:, 1], (1 - np.cos(angle)) / 20.0])
    for number, positions in enumerate((flat.positions, stretched, rolled)):
        frames.write(number, ClothState(positions, np.zeros_like(positions), 0.1 * number))
    strains = visited_strains(tmp_path / "run").reshape(3, -1, 6)
    assert strains[0] == pytest.approx(0.0, abs=1e-9)
    assert strains[1][:, :3] == pytest.approx(np.tile([0.3, 0.0, -0.1], (strains.shape[1], 1)), abs=1e-9)
    assert np.median(strains[2][:, 3]) == pytest.approx(20.0, rel=0.02)
    assert np.abs(strains[2][:, :3]).max() < 0.02
    assert visited_strains(tmp_path / "run" / "frames").shape == (strains.size // 6, 6)


def test_folders_without_frames_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="nothing"):
        visited_strains(tmp_path / "nothing")


def test_of_panels_that_are_sewn_together(tmp_path: Path) -> None:
    """Two unit squares that share an edge in space; the second one is stretched by a tenth."""
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    corners = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    triangles = np.array([0, 1, 2, 3, 1, 4, 5, 2])[corners]
    places = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0], [2, 1, 0]], float)
    mesh = TriangleMesh(
        np.vstack([square, square + np.array([3.0, 0.0])]), triangles, corners=corners, assembled=places
    )
    writer = FrameFolder(tmp_path, mesh)
    pulled = places + 0.1 * np.maximum(places[:, :1] - 1.0, 0.0) * np.array([1.0, 0.0, 0.0])
    for number, positions in enumerate((places, pulled)):
        writer.write(number, ClothState(positions, np.zeros_like(positions), float(number)))
    strains = visited_strains(tmp_path)
    assert strains[:, 0].max() == pytest.approx(0.1) and strains[:, 0].min() == pytest.approx(0.0, abs=1e-9)
