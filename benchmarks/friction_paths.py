"""Loops of a shell material beside those of its cell along the same strains, those that its friction was fitted to.

yarnscale homogenize stockinette --friction 0.2 --out m
python benchmarks/friction_paths.py m
python benchmarks/friction_paths.py --fit 0.2 rib-1x1-wool garter-wool

With --fit friction is fitted to elastic materials of the library, into folders of their names.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from yarnscale.arrays import Array
from yarnscale.cell import PeriodicCell
from yarnscale.files import material_library
from yarnscale.files.material_json import read_material, write_material
from yarnscale.files.patterns import read_pattern, read_yarns
from yarnscale.homogenize.friction_fit import with_friction
from yarnscale.homogenize.friction_paths import STEPS, friction_paths
from yarnscale.shell.materials.compact import CompactMaterial
from yarnscale.shell.materials.history import MaterialHistory
from yarnscale.yarn.friction import YarnFriction

LIMIT = 50.0
"""Largest load of paths for materials of the library [N/m]."""


class Loop(NamedTuple):
    """A cycle of a path: shell over cell of the area, of the force where it turns, and of the stiffness up to there.

    area: what friction takes; both are works of the stress with friction less that without. forces are along the
    strains of the cycle; amplitude: number of the cycle, from the smallest.
    """

    path: str
    amplitude: int
    area: float
    force: float
    stiffness: float


def main() -> None:
    """Print a table of Markdown."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", type=Path, nargs="+", help="of homogenize --friction, or names of the library")
    parser.add_argument("--fit", type=float, metavar="MU", help="fit friction to materials of the library first")
    options = parser.parse_args()
    print("| fabric | path | area, smallest cycle first | force at the turn | stiffness of the smallest |")
    print("|---|---|---|---|---|")
    for folder in options.folders:
        if options.fit is not None:
            print(fitted(folder, YarnFriction(options.fit)), file=sys.stderr, flush=True)
        material = read_material(folder / "material.json")
        for file in sorted((folder / "friction").glob("*.npz")):
            kept = np.load(file)
            strains = kept["strains"]
            if len(strains) < 2:
                print(f"| {folder.name} | {file.stem} | none | | |")
                continue
            history = MaterialHistory.begin(material, strains[0])
            forces = [history.force]
            for strain in strains[1:]:
                history = history.after(strain)
                forces.append(history.force)
            shell = np.array(forces), material.stress(strains)
            print(
                row(folder.name, list(loops(file.stem, strains, (kept["stresses"], kept["elastic"]), shell))),
                flush=True,
            )


def fitted(folder: Path, friction: YarnFriction) -> str:
    """Friction for the elastic material of the library that is called as the folder; what it took."""
    elastic, drawn = (
        Path(material_library.file_of(folder.name, k)) for k in (material_library.MATERIAL, material_library.PATTERN)
    )
    material, yarns = read_material(elastic), read_yarns(drawn)
    assert isinstance(material, CompactMaterial) and yarns is not None
    cell, began = PeriodicCell(read_pattern(drawn), yarns), processor()
    paths = friction_paths(cell, friction, limit=LIMIT, folder=folder / "friction")
    walked = processor() - began
    material = with_friction(material, paths, friction.coefficient)
    write_material(folder / "material.json", material)
    states, lost = sum(len(p.strains) for p in paths), [p.name for p in paths if not p.complete]
    record = material.provenance["friction"]
    assert isinstance(record, dict)
    return (
        f"{folder.name}: {states} states, {walked:.0f} s of processor time for the paths, for the fit "
        f"{processor() - began - walked:.0f} s; error {record['error']:.3f}, not to the end: {lost}"
    )


def processor() -> float:
    """Time of this process and of its workers that ended [s]."""
    return sum(os.times()[:4])


def row(fabric: str, found: list[Loop]) -> str:
    """A row of the table."""
    areas, forces = (", ".join(f"{getattr(loop, n):.2f}" for loop in found) for n in ("area", "force"))
    return f"| {fabric} | {found[0].path} | {areas} | {forces} | {found[0].stiffness:.2f} |"


def loops(path: str, strains: Array, cell: tuple[Array, Array], shell: tuple[Array, Array]) -> Iterator[Loop]:
    """Cycles of a path (n, 6); cell, shell: stresses (n, 6) with friction and without."""
    tests = [slice(k, k + STEPS + 1) for k in range(0, len(strains) - STEPS, STEPS)]
    # Tension goes out and back. Others go out, to the other side, further out, ...; some of them are pulled first.
    first = 1 if "under" in path else 0
    pairs = [(k, (k, k + 1)) for k in range(0, len(tests) - 1, 2)]
    if not path.startswith(("tension", "biaxial")):
        pairs = [(k, (k + 1,)) for k in range(first, len(tests) - 1, 2)]
    for number, (out, cycle) in enumerate(pairs):
        moved = strains[tests[out]][-1] - strains[tests[out]][0]
        areas = [sum(work(strains[tests[k]], (s[0] - s[1])[tests[k]]) for k in cycle) for s in (cell, shell)]
        ends = [s[0][tests[out]][-1] @ moved for s in (cell, shell)]
        rises = [(s[0][tests[out]][-1] - s[0][tests[out]][0]) @ moved for s in (cell, shell)]
        yield Loop(path, number, areas[1] / areas[0], ends[1] / ends[0], rises[1] / rises[0])


def work(strains: Array, stresses: Array) -> float:
    """Work of stresses (n, 6) along strains [J/m²]."""
    return float((0.5 * (stresses[1:] + stresses[:-1]) * np.diff(strains, axis=0)).sum())


if __name__ == "__main__":
    main()
