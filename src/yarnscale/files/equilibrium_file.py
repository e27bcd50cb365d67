"""A relaxed cell as one .npz file: its equilibrium, and its pattern with the yarns as the text of a pattern file."""

from __future__ import annotations

import json
import os

import numpy as np

from yarnscale.arrays import Array
from yarnscale.cell.equilibrium import Equilibrium
from yarnscale.cell.periodic import PeriodicCell
from yarnscale.errors import InputError, located
from yarnscale.files.array_file import checked_array, read_arrays, write_arrays
from yarnscale.files.fields import Fields
from yarnscale.files.pattern_json import pattern_content, pattern_of, yarns_of

_NUMBERS = ("strain", "fluctuation", "energy_density", "stress")


def write_equilibrium(path: str | os.PathLike[str], cell: PeriodicCell, state: Equilibrium) -> None:
    """Write an equilibrium of a cell; InputError where the file cannot be written."""
    numbers = {name: getattr(state, name) for name in ("positions", "twist", *_NUMBERS[1:])}
    text = json.dumps(pattern_content(cell.pattern, cell.material))
    write_arrays(path, edges=cell.pattern.edges, strain=state.strain.vector, pattern=np.array(text), **numbers)


def read_equilibrium(path: str | os.PathLike[str]) -> tuple[PeriodicCell, dict[str, Array]]:
    """The cell, and its strain (6,), fluctuation (n, 3) [m], energy_density () [J/m²] and stress (6,).

    Raises InputError where the file is no equilibrium.
    """
    found = read_arrays(path, "pattern", *_NUMBERS, what="relaxed cell, as relax --out writes it")
    try:
        content = json.loads(str(found["pattern"]))
    except (ValueError, RecursionError):
        raise InputError("pattern", where=path, expected="JSON of a pattern", found="other text") from None
    with located(path):
        document = Fields(content, str(path))
        pattern = pattern_of(document)
        yarns = yarns_of(document, lambda: pattern)
    if yarns is None:
        raise InputError("missing field 'materials'", where=path)
    shapes = {"strain": (6,), "fluctuation": pattern.vertices.shape, "energy_density": (), "stress": (6,)}
    numbers = {name: checked_array(found[name], name=name, shape=shape, where=path) for name, shape in shapes.items()}
    return PeriodicCell(pattern, yarns), numbers
