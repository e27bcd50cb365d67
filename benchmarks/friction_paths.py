"""Loops of a shell material beside those of its cell along the same strains, those that its friction was fitted to.

yarnscale homogenize stockinette --friction 0.2 --out m
python benchmarks/friction_paths.py m
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from yarnscale.arrays import Array
from yarnscale.files.material_json import read_material
from yarnscale.homogenize.friction_paths import STEPS
from yarnscale.shell.materials.history import MaterialHistory


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
    parser.add_argument("folders", type=Path, nargs="+", help="of homogenize --friction")
    print("| fabric | path | area, smallest cycle first | force at the turn | stiffness of the smallest |")
    print("|---|---|---|---|---|")
    for folder in parser.parse_args().folders:
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
            print(row(folder.name, list(loops(file.stem, strains, (kept["stresses"], kept["elastic"]), shell))))


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
