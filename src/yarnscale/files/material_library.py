"""The material library: built-in patterns in common yarns, homogenized and tested, which every installation has.

A material is a folder of the package, as the command ``library`` makes it: ``material.json`` (the shell material),
``pattern.json`` (the fabric at rest with its yarn) and ``tests/tests.json`` (virtual tests of both).
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from yarnscale.errors import InputError, misspelt

if TYPE_CHECKING:
    from yarnscale.laboratory.programme import FabricTests

LIBRARY = Path(__file__).parents[1] / "materials"
MATERIAL, PATTERN, TESTS = "material.json", "pattern.json", "tests/tests.json"


def names(folder: Path = LIBRARY) -> tuple[str, ...]:
    """Names of the materials of a library, as ``stockinette-wool``."""
    return tuple(sorted(path.parent.name for path in folder.glob(f"*/{MATERIAL}")))


def file_of(source: str | os.PathLike[str], kind: str) -> str | os.PathLike[str]:
    """The file (``MATERIAL``, ``PATTERN``) of a material by its name; any other source as it is."""
    return LIBRARY / source / kind if os.fspath(source) in names() else source


def tests(name: str, folder: Path = LIBRARY) -> tuple[FabricTests, FabricTests]:
    """Virtual tests of a material by its name: of the cell of yarns, and of the shell material.

    Raises InputError for an unknown name.
    """
    from yarnscale.files.fields import read_json
    from yarnscale.laboratory.programme import FabricTests

    if not (folder / name / TESTS).is_file():
        known = names(folder)
        raise InputError("unknown material", expected=", ".join(known), found=misspelt(name, known))
    content = read_json(folder / name / TESTS)
    cell, shell = (FabricTests.of({**found, "subject": name}) for found in (content, content["against"]))
    return cell, shell
