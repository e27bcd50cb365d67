"""Strains that a simulated cloth has been through, from the frames of its run."""

from __future__ import annotations

import os

import numpy as np

from yarnscale.arrays import Array
from yarnscale.files.cloth_frames import read_cloth_frames
from yarnscale.shell.elastic.elements import shell_elements
from yarnscale.shell.mesh import TriangleMesh

FRAMES = 12
"""Frames whose strains are taken, evenly over the run."""
_LEAST_SIDE, _LARGEST_SHEAR = 0.1, 0.97


def visited_strains(folder: str | os.PathLike[str]) -> Array:
    """Strains (n, 6) of all triangles in some frames of a run, or of a folder of frames, the last one included.

    Triangles that are nearly folded flat are left out. Raises InputError where there are no frames.
    """
    stored = read_cloth_frames(folder)
    numbers = list(stored.paths)
    # Seams join panels in the first frame.
    assembled = stored.state(numbers[0]).positions
    mesh = TriangleMesh(stored.material, stored.triangles, corners=stored.corners, assembled=assembled)
    elements = shell_elements(mesh)
    taken = {numbers[int(i)] for i in np.linspace(0, len(numbers) - 1, min(FRAMES, len(numbers)))}
    found = []
    for number in numbers:
        positions = stored.state(number).positions
        elements.follow(positions)  # frame by frame: folds keep their sense beyond half a turn
        if number in taken:
            forms = np.moveaxis(elements.forms(positions), 1, -1).reshape(-1, 6)
            found.append(_strains(forms[elements.areas.ravel() > 0.0]))
    return np.concatenate(found)


def _strains(forms: Array) -> Array:
    """Strain vectors of forms (n, 6), without those of hardly any area."""
    a, b = np.sqrt(np.maximum(forms[:, 0], 0.0)), np.sqrt(np.maximum(forms[:, 2], 0.0))
    good = np.minimum(a, b) > _LEAST_SIDE
    shear = np.divide(forms[:, 1], a * b, out=np.ones(len(forms)), where=good)
    strains = np.column_stack([a - 1.0, shear, b - 1.0, forms[:, 3:]])
    return strains[good & (np.abs(shear) < _LARGEST_SHEAR) & np.isfinite(forms).all(axis=1)]
