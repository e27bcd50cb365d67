"""Commands about samples: ``sample``, ``fit``."""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Iterable
from typing import Any

from yarnscale.cell import PeriodicCell
from yarnscale.cell.supercell import check_size, supercell
from yarnscale.cli.console import ProgressLine, report, writable_file
from yarnscale.cli.given_pattern import at_rest, pattern_of
from yarnscale.cli.materials import PATTERN
from yarnscale.cli.values import refuse
from yarnscale.cli.workers import reach_dask, worker_count
from yarnscale.cli.yarn_choice import yarn_for
from yarnscale.errors import InputError
from yarnscale.files.grid_toml import read_grid
from yarnscale.files.patterns import read_pattern, read_yarns, write_pattern
from yarnscale.files.run_folder import check_place
from yarnscale.homogenize.plan import StrainGrid
from yarnscale.homogenize.rays import load_rays
from yarnscale.homogenize.sample import check_resumable, create_ray_store, create_store, resumed_ray_store
from yarnscale.homogenize.sample import sample as run_sample
from yarnscale.homogenize.store import SampleStore


def sample(options: argparse.Namespace) -> int:
    """Sample rays of loads, or a grid."""
    grid = None if options.grid is None else read_grid(options.grid)
    if grid is None:
        refuse(options, _STRAINS, "--grid GRID.toml with it")
    else:
        refuse(options, _LOADS, "no --grid with it")
    pattern, kept = pattern_of(options.pattern, options.radius), options.out / PATTERN
    begun = options.resume and kept.is_file()
    yarn = yarn_for(options.pattern, pattern, options.material, kept=read_yarns(kept) if begun else None)
    drawn = PeriodicCell(pattern, yarn.materials)
    check_size(drawn, options.size)
    if grid is None:
        load_rays(drawn, **_asked(options, _LOADS))  # refuses loads that are none before anything is settled
    reach_dask(options)
    check_place(options.out)
    if options.out.exists() and any(options.out.iterdir()):
        if not (options.overwrite or options.resume):
            expected = "a new folder, --overwrite or --resume"
            raise InputError("output exists", where=options.out, expected=expected, found="files in it")
        store = SampleStore(options.out)  # refuses what is no store before anything is settled
        if not options.resume:
            shutil.rmtree(store.path)
    tile = read_pattern(kept) if begun else at_rest(options, pattern, yarn.materials)
    cell = PeriodicCell(tile, yarn.materials, options.free_sliding).with_options(starts=options.starts)
    cell = supercell(cell, options.size)
    store = _load_store(options, cell) if grid is None else _grid_store(options, cell, grid)
    if not begun:
        write_pattern(tile, kept, yarns=yarn.materials)
    yarn.print_status()
    progress = ProgressLine(f"sampling {pattern.name}").sampled
    summary = run_sample(cell, store, workers=worker_count(options), dask=options.dask, progress=progress)
    names = ("states", "converged", "seconds", "workers", "peak_worker_megabytes")
    text = f"{summary.converged} of {summary.states} states converged in {summary.seconds:.1f} s"
    numbers = {name: getattr(summary, name) for name in names}
    report(options, yarn.summary | numbers, f"{options.out}: {text}")
    return 0 if summary.converged == summary.states else 1


_LOADS, _STRAINS = ("solves", "limit"), ("positions", "moduli", "size")
"""Options for one kind of store alone."""


def _asked(options: argparse.Namespace, names: Iterable[str]) -> dict[str, Any]:
    return {name: getattr(options, name) for name in names if getattr(options, name) is not None}


def _load_store(options: argparse.Namespace, cell: PeriodicCell) -> SampleStore:
    rays = load_rays(cell, **_asked(options, _LOADS))
    if not (options.resume and options.out.exists()):
        return create_ray_store(options.out, cell, rays)
    return resumed_ray_store(SampleStore(options.out), cell, rays)


def _grid_store(options: argparse.Namespace, cell: PeriodicCell, grid: StrainGrid) -> SampleStore:
    kept = {"positions": options.positions, "moduli": options.moduli, "tiles": options.size}
    if not (options.resume and options.out.exists()):
        return create_store(options.out, cell, grid.axes, scattered=False, **kept)
    store = SampleStore(options.out)
    check_resumable(store, cell, grid.axes, **kept)
    return store


def fit(options: argparse.Namespace) -> int:
    """Fit a material."""
    from yarnscale.files.material_json import write_material
    from yarnscale.homogenize.homogenize import fit as fit_store

    writable_file(options.out, ".json")
    material = fit_store(SampleStore(options.store))
    write_material(options.out, material)
    summary = {"out": str(options.out), "store": str(options.store), "density": material.density}
    report(options, summary, f"{options.out}: fitted to {options.store}")
    return 0
