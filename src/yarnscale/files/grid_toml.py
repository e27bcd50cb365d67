"""Strain grids as TOML files: arrays named ``s_x``, ``s_a``, ``s_y``, ``lambda_x``, ``lambda_y``; missing means [0]."""

from __future__ import annotations

import math
import os

from yarnscale.checked import checked
from yarnscale.errors import InputError
from yarnscale.files.toml_text import fields_of, read_toml
from yarnscale.homogenize.plan import StrainGrid
from yarnscale.homogenize.worker import STRAINS


@checked
def read_grid(path: str | os.PathLike[str]) -> StrainGrid:
    """The grid of a file; InputError naming file, field (or line), expected and found for anything else."""
    content, text = read_toml(path)
    with fields_of(path, text):
        for name in content:
            if name not in STRAINS:
                raise InputError(f"unknown field {name!r:.60}", expected=", ".join(STRAINS))
        return StrainGrid(**{name: _numbers(path, name, values) for name, values in content.items()})


def _numbers(path: str | os.PathLike[str], name: str, values: object) -> tuple[float, ...]:
    fault = InputError(f"field '{name}'", where=path, expected="an array of numbers", found=f"{values!r:.60}")
    if not isinstance(values, list):
        raise fault
    for value in values:
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise fault
    try:
        return tuple(float(value) for value in values)
    except OverflowError:
        return (math.inf,)  # a whole number beyond all floats, which the grid refuses by its name
