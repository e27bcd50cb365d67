"""Strain grids as TOML files: arrays named ``s_x``, ``s_a``, ``s_y``, ``lambda_x``, ``lambda_y``; missing means [0]."""

from __future__ import annotations

import os
from pathlib import Path

from yarnscale.checked import checked
from yarnscale.files.fields import toml_file
from yarnscale.homogenize.plan import StrainGrid
from yarnscale.homogenize.worker import STRAINS


@checked
def read_grid(path: str | os.PathLike[str]) -> StrainGrid:
    """The grid of a file; InputError naming file, field (or line), expected and found for anything else."""
    with toml_file(Path(path)) as table:
        table.known(*STRAINS)
        return StrainGrid(**{name: tuple(table.numbers(name).tolist()) for name in table.content})
