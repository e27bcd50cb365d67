"""Shell materials against the cells that they are fitted to: virtual tests, unseen states, moduli at rest, time.

python benchmarks/materials.py [PATTERN ...] --out DIR [--unseen] [--form hylc2020] [--table]

PATTERN: names or files, default all built-in ones. What is done is kept in DIR and not repeated: ``PATTERN/FORM`` is
the folder of ``yarnscale homogenize``, ``PATTERN/FORM.json`` how long it took, ``PATTERN/FORM-tests.json`` the tests of
the shell, ``cells/PATTERN/tests.json`` those of the cell (``yarnscale test PATTERN --out DIR/cells/PATTERN``), and
``unseen/PATTERN`` a store of states that no fit sees. --table: rows of patterns whose tests are there,
others are left out.

Columns: tension is the share of loads (0°, 45°, 90°, 0.02 to 50 N/m) at which stretch is within 0.01 + 3 % and
contraction within 0.02 + 3 % of the cell's, and how often the shell's stretch falls where the cell's rises; moments
that of curvatures up to 0.1/r at which the moment is within 10 % of the larger of itself and a twentieth of the
largest of its direction; curl, natural curvatures within 10 %. loads, box: errors of the stress over its norm +
0.02 N/m, median / 95th percentile [%], at 300 states along rays of loads and 300 of a box of strains. rest: least
eigenvalue of the moduli at rest over the cell's. s: wall and processor seconds of ``homogenize``.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time
from itertools import islice, pairwise
from pathlib import Path

import numpy as np

from yarnscale.cell import PeriodicCell
from yarnscale.drawing import library
from yarnscale.files.material_json import read_material
from yarnscale.files.patterns import read_pattern, read_yarns
from yarnscale.homogenize.compact_problem import StressErrors
from yarnscale.homogenize.rays import box_strains, load_rays, ray_to
from yarnscale.homogenize.sample import create_ray_store, resumed_ray_store, sample
from yarnscale.homogenize.states import FabricStates
from yarnscale.homogenize.store import SampleStore
from yarnscale.kinematics import strain_units
from yarnscale.laboratory.programme import Programme, run_tests
from yarnscale.shell.materials.material import ShellMaterial

UNSEEN_SEED, UNSEEN_STATES = 77, 300
CURL = 1.0
"""Curvature [1/m] below which a fabric counts as flat."""


def homogenized(name: str, folder: Path, form: str) -> Path:
    """The folder of a material, made if it is not there."""
    if not (folder / form / "material.json").exists():
        before, began = _processor_seconds(), time.perf_counter()
        _yarnscale("homogenize", name, "--form", form, "--out", folder / form, "--overwrite")
        spent = {"wall": time.perf_counter() - began, "processor": _processor_seconds() - before}
        (folder / f"{form}.json").write_text(json.dumps(spent))
    return folder / form


def _processor_seconds() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _yarnscale(*arguments: object) -> None:
    """Run a command; one that only misses some states ends with status 1."""
    done = subprocess.run([sys.executable, "-m", "yarnscale", *map(str, arguments)], capture_output=True, text=True)
    if done.returncode > 1:
        raise SystemExit(done.stderr)


def tests_of_cell(name: str, out: Path) -> dict:
    """Virtual tests of the yarns."""
    folder = out / "cells" / Path(name).stem
    if not (folder / "tests.json").exists():
        _yarnscale("test", name, "--out", folder, "--overwrite")
    return json.loads((folder / "tests.json").read_text())


def tests_of_shell(material: ShellMaterial, cell: dict, path: Path) -> dict:
    """The same tests of the material, at the curvatures of the cell's."""
    if not path.exists():
        curvatures = tuple(p["curvature"] for p in cell["bending"] if p["direction"] == 0.0)
        tests = run_tests(material, programme=Programme(curvatures=curvatures))
        path.write_text(json.dumps(tests.plain()))
    return json.loads(path.read_text())


def _pairs(shell: dict, cell: dict, test: str, at: str) -> list[tuple[dict, dict]]:
    """Points of both where the cell has an equilibrium."""
    found = {(p["direction"], round(p[at], 6)): p for p in shell[test]}
    return [(found[p["direction"], round(p[at], 6)], p) for p in cell[test] if p["status"] == "converged"]


def _near(pair: tuple[dict, dict], name: str, allowed: float, share: float) -> bool:
    shell, cell = (p[name] for p in pair)
    return shell is not None and abs(shell - cell) <= allowed + share * abs(cell)


def tension(shell: dict, cell: dict) -> tuple[float, int]:
    """Share of loads within tolerance, and falls of the stretch."""
    pairs = _pairs(shell, cell, "tension", "load")
    good = [_near(p, "stretch", 0.01, 0.03) and _near(p, "contraction", 0.02, 0.03) for p in pairs]
    falls = sum(
        a[1]["direction"] == b[1]["direction"]
        and b[1]["stretch"] > a[1]["stretch"]
        and not (b[0]["stretch"] or np.nan) >= (a[0]["stretch"] or np.nan)
        for a, b in pairwise(pairs)
    )
    return float(np.mean(good)), falls


def moments(shell: dict, cell: dict) -> float:
    """Share of bending moments within tolerance."""
    pairs, good = _pairs(shell, cell, "bending", "curvature"), []
    largest = {
        d: max(abs(p["moment"]) for _, p in pairs if p["direction"] == d) for d in {p["direction"] for _, p in pairs}
    }
    for pair in pairs:
        allowed = 0.1 * max(abs(pair[1]["moment"]), 0.05 * largest[pair[1]["direction"]])
        good.append(_near(pair, "moment", allowed, 0.0))
    return float(np.mean(good))


def curl(shell: dict, cell: dict) -> str:
    """Natural curvatures [1/m] of the shell and of the cell, marked where they differ by more than 10 %."""
    texts = []
    for mine, other in zip(shell["rolls"], cell["rolls"], strict=True):
        a, b = mine["curvature"], other["curvature"]
        good = a is not None and b is not None and abs(a - b) <= max(0.1 * abs(b), CURL)
        texts.append(f"{_number(a)} for {_number(b)}{'' if good else ' !'}")
    return ", ".join(texts)


def _number(value: float | None) -> str:
    return "?" if value is None else f"{value:.0f}"


def unseen(folder: Path, path: Path) -> FabricStates:
    """States that no fit sees: along rays of loads, and of a box."""
    kept = folder / "pattern.json"
    cell = PeriodicCell(read_pattern(kept), read_yarns(kept))
    rays = load_rays(cell, solves=6 * UNSEEN_STATES // 5, seed=UNSEEN_SEED, fixed=False)
    rays = [ray for ray in rays if ray.kind != "strain"]
    rays += [ray_to(strain, 1) for strain in islice(box_strains(cell.pattern.radius, UNSEEN_SEED), UNSEEN_STATES)]
    store = resumed_ray_store(SampleStore(path), cell, rays) if path.exists() else create_ray_store(path, cell, rays)
    sample(cell, store, workers=1)
    return FabricStates.of(store)


def errors(material: ShellMaterial, states: FabricStates) -> list[str]:
    """Errors of the stress at states of loads, and at those of the box."""
    scale, texts = strain_units(states.radius), []
    for mine in (states.kinds != "strain", states.kinds == "strain"):
        found = StressErrors.of(material.stress(states.strains[mine]), states.stresses[mine], scale)
        texts.append(f"{100 * found.median:.1f} / {100 * found.high:.0f}")
    return texts


def at_rest(material: ShellMaterial, states: FabricStates) -> float:
    """Least eigenvalue of the moduli at rest in units of strain, over that of the cell."""
    scale, rest = strain_units(states.radius), int(np.argmax(states.kinds == "rest"))
    mine, other = (
        np.linalg.eigvalsh(moduli * scale * scale[:, None])[0]
        for moduli in (material.moduli(states.strains[rest]), states.moduli[rest])
    )
    return float(mine / other)


def row(name: str, options: argparse.Namespace) -> list[str]:
    folder = options.out / Path(name).stem
    folder.mkdir(parents=True, exist_ok=True)
    material_folder = homogenized(name, folder, options.form)
    material = read_material(material_folder / "material.json")
    cell = tests_of_cell(name, options.out)
    shell = tests_of_shell(material, cell, folder / f"{options.form}-tests.json")
    (share, falls), spent = tension(shell, cell), json.loads((folder / f"{options.form}.json").read_text())
    store = options.out / "unseen" / Path(name).stem
    found = errors(material, unseen(material_folder, store)) if options.unseen else ["–", "–"]
    compact = options.form == "compact"
    rest = f"{at_rest(material, FabricStates.of(SampleStore(material_folder / 'samples'))):.2f}" if compact else "–"
    return [
        Path(name).stem, f"{100 * share:.0f} ({falls})", f"{100 * moments(shell, cell):.0f}", curl(shell, cell), *found,
        rest, f"{spent['wall']:.0f}, {spent['processor']:.0f}",
    ]  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("patterns", nargs="*", default=[*library.names()])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--form", choices=("compact", "hylc2020"), default="compact")
    parser.add_argument("--unseen", action="store_true")
    parser.add_argument("--table", action="store_true")
    options = parser.parse_args()
    titles = ["pattern", "tension (falls) [%]", "moments [%]", "curl [1/m]", "loads", "box", "rest", "s"]
    print("|", " | ".join(titles), "|\n|" + "---|" * len(titles), flush=True)
    for name in options.patterns:
        if options.table and not (options.out / Path(name).stem / f"{options.form}-tests.json").exists():
            continue
        print("|", " | ".join(row(name, options)), "|", flush=True)


if __name__ == "__main__":
    main()
