"""What a shell material or a store of samples says about the cell behind it: its pattern and its yarns."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass

from yarnscale.errors import InputError
from yarnscale.files.fields import Fields
from yarnscale.files.material_json import read_material
from yarnscale.files.material_toml import material_of
from yarnscale.yarn.pattern import YarnPattern
from yarnscale.yarn.stiffness import Materials


@dataclass(frozen=True)
class CellOrigin:
    """The cell: name and hash of its pattern, number of tiles of a smaller pattern, its yarn materials.

    where: the file that says so.
    """

    where: str | os.PathLike[str]
    name: str
    pattern_hash: str
    tiles: tuple[int, int]
    yarns: Materials

    @classmethod
    def of(cls, provenance: Mapping[str, object], where: str | os.PathLike[str]) -> CellOrigin | None:
        """From the provenance of a material or store; None where it names no pattern. Raises InputError."""
        if not isinstance(provenance.get("pattern_hash"), str):
            return None
        stored, tiles = provenance.get("material"), provenance.get("tiles", [1, 1])
        tables = [t for t in (stored if isinstance(stored, list) else [stored]) if isinstance(t, dict)]
        if not tables:
            raise InputError("field 'provenance.material'", where=where, expected="yarn materials")
        if not (isinstance(tiles, list) and len(tiles) == 2 and all(isinstance(n, int) for n in tiles)):
            raise InputError("field 'provenance.tiles'", where=where, expected="two integers", found=tiles)
        given = tuple(material_of(Fields(table, os.fspath(where))) for table in tables)
        return cls(
            where,
            str(provenance.get("pattern")),
            str(provenance["pattern_hash"]),
            (tiles[0], tiles[1]),
            given if isinstance(stored, list) else given[0],
        )

    @classmethod
    def of_material(cls, path: str | os.PathLike[str]) -> CellOrigin | None:
        """From a shell material file; None where it names no pattern, as published ones. Raises InputError."""
        return cls.of(read_material(os.fspath(path)).provenance, path)

    def cell_pattern(self, pattern: YarnPattern, source: str | os.PathLike[str]) -> YarnPattern:
        """The pattern of the cell, from one of its tiles or all; InputError where ``source`` has another."""
        for tiles in ((1, 1), self.tiles):
            cell = pattern if tiles == (1, 1) else pattern.repeated(*tiles)
            if cell.content_hash() == self.pattern_hash:
                return cell
        raise InputError(
            f"pattern {os.fspath(source)} is not the one behind {os.fspath(self.where)}",
            expected=f"{self.name} with hash {self.pattern_hash[:12]}: the pattern.json beside the shell material, or "
            "the pattern that was sampled",
            found=f"{pattern.name} with hash {pattern.content_hash()[:12]}",
        )
