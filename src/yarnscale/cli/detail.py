"""The command ``detail``: the yarns of a simulated cloth, frame by frame."""

from __future__ import annotations

import argparse
import json
import shutil
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from yarnscale.cell import PeriodicCell
from yarnscale.cli.cloth import MATERIAL
from yarnscale.cli.console import ProgressLine, print_status, report, writable_file
from yarnscale.cli.given_pattern import pattern_of
from yarnscale.cli.workers import reach_dask, worker_count
from yarnscale.cli.yarn_choice import YarnChoice, material_names, same_yarns, yarn_for
from yarnscale.detail.fluctuations import FluctuationTable, ScatteredFluctuations, detail_grid
from yarnscale.detail.yarns import YarnDetail
from yarnscale.errors import InputError
from yarnscale.files.atomic import write_text
from yarnscale.files.cell_origin import CellOrigin
from yarnscale.files.cloth_frames import ClothFrames, frame_paths, read_cloth_frames
from yarnscale.files.curve_frames import CURVES, CurveFolder, CurveSet
from yarnscale.files.run_folder import RunFolder, note_result, writable_folder
from yarnscale.homogenize.sample import check_resumable, create_store
from yarnscale.homogenize.sample import sample as run_sample
from yarnscale.homogenize.store import SampleStore
from yarnscale.homogenize.worker import CODE_OF, STRAINS
from yarnscale.shell.mesh import TriangleMesh
from yarnscale.yarn.pattern import YarnPattern

SAMPLES = "samples"
ORIGIN = "origin.json"
"""In the folder of the yarns: the store of samples, and what the frames were made from."""


def detail(options: argparse.Namespace) -> int:
    """Put yarns on the frames of a run."""
    writable_file(options.picture, ".png")
    frames = read_cloth_frames(options.frames)
    if options.chosen is not None:
        frames = frames.among(options.chosen.of(list(frames.paths)))
    out = options.out or options.frames / "yarns"
    made = (CURVES, "frame_*.npz", ORIGIN)
    with RunFolder(out, "detail", made, overwrite=options.overwrite, resume=options.resume, goes_on_from=made):
        note_result(out, options.frames)
        table, summary = _table(options, out)
        first = frames.state(next(iter(frames.paths)))
        mesh = TriangleMesh(frames.material, frames.triangles, 0.0, frames.corners, first.positions)
        yarns = YarnDetail.of(table, mesh, seams=options.seams)
        done, seconds = _write(yarns, frames, out, resume=options.resume)
        if options.picture is not None:
            note_result(options.picture, options.frames)
            _draw(options.picture, yarns, frames)
    summary |= {
        "curves": len(yarns.layout.yarn),
        "yarn_vertices": yarns.layout.vertex_count,
        "frames": len(frames.paths),
        "frames_written": done,
        "seconds_per_frame": seconds / done if done else None,
    }
    each = f", {summary['seconds_per_frame']:.2g} s each" if done else ""
    written = f"{done} of {len(frames.paths)} frames written{each}"
    report(options, summary, f"{out}: {summary['curves']} curves, {summary['yarn_vertices']} vertices; {written}")
    return 0


def _table(options: argparse.Namespace, out: Path) -> tuple[FluctuationTable, dict[str, object]]:
    """The table from the store given, or from one of the command's own, which is made or finished."""
    pattern = pattern_of(options.pattern, options.radius)
    cloth = _cloth_origin(options.frames)
    if cloth is not None:
        cloth.cell_pattern(pattern, options.pattern)
    yarn = yarn_for(options.pattern, pattern, options.material, kept=None if cloth is None else cloth.yarns)
    if options.samples is not None and options.relaxed:
        raise InputError("--relaxed", expected="no --samples with it", found=options.samples)
    found = None if options.relaxed else _stored(options, pattern, yarn)
    if found is not None:
        store, sampled = found
        if yarn.is_default:
            origin = CellOrigin.of(store.attributes["provenance"], store.path)
            assert origin is not None
            yarn = YarnChoice(yarn.pattern, origin.yarns, "of the samples")
        table = FluctuationTable.from_store(store, sampled)
        summary = _origin(store, out, resume=options.resume) | yarn.summary
        used = int((store.status() == CODE_OF["converged"]).sum())
        yarn.print_status()
        print_status(f"states of the yarns: {store.path}, {used} states")
        return table, summary | {"samples": str(store.path), "states": used} | _unseen_error(store, pattern)
    reach_dask(options)
    yarn.print_status()
    cell = PeriodicCell(pattern, yarn.materials)
    axes, path = detail_grid(cell).axes, writable_folder(out) / SAMPLES
    store = _kept(path, cell, axes, replace=options.overwrite)
    if store is None:
        store = create_store(path, cell, axes, scattered=False)
    print_status(f"no samples given or beside the pattern: {store.count} states are relaxed ('homogenize' has them)")
    progress = ProgressLine(f"sampling {pattern.name}").sampled
    run_sample(cell, store, workers=worker_count(options), dask=options.dask, progress=progress)
    table = FluctuationTable.from_store(store, pattern)
    return table, _origin(store, out, resume=options.resume) | yarn.summary | {"states_replaced": table.replaced}


def _stored(
    options: argparse.Namespace, pattern: YarnPattern, yarn: YarnChoice
) -> tuple[SampleStore, YarnPattern] | None:
    """The samples of ``--samples``, or those beside the pattern's file if of this cell, and its pattern; or None."""
    if options.samples is not None:
        store = SampleStore(options.samples)
        return store, _sampled_pattern(store, pattern, yarn, options)
    path = Path(options.pattern).parent / SAMPLES
    if not Path(options.pattern).is_file() or not path.is_dir():
        return None
    try:
        store = SampleStore(path)
        sampled = _sampled_pattern(store, pattern, yarn, options)
    except InputError as error:
        print_status(f"not used: {error}")
        return None
    return (store, sampled) if (store.status() == CODE_OF["converged"]).any() else None


def _unseen_error(store: SampleStore, pattern: YarnPattern) -> dict[str, object]:
    """Where scattered samples are interpolated: median and 95 % of what vertices err in states left out, in radii."""
    path = store.path.parent / "unseen"
    if store.dims == STRAINS or not path.is_dir():
        return {}
    stored = ScatteredFluctuations.of(store, pattern.radius)
    try:
        errors = stored.error_on(SampleStore(path)) / pattern.radius
    except InputError:
        return {}
    return {"error_in_radii": np.percentile(errors, [50.0, 95.0])} if errors.size else {}


def _kept(path: Path, cell: PeriodicCell, axes: Mapping[str, np.ndarray], *, replace: bool) -> SampleStore | None:
    """The store of an earlier run, None without one; one of another cell is removed if it may be replaced."""
    if not path.exists():
        return None
    store = SampleStore(path)
    try:
        check_resumable(store, cell, axes)
    except InputError:
        if not replace:
            raise
        shutil.rmtree(path)
        return None
    return store


def _sampled_pattern(
    store: SampleStore, pattern: YarnPattern, yarn: YarnChoice, options: argparse.Namespace
) -> YarnPattern:
    """The cell of a store; InputError where it is of another pattern, or of a yarn that contradicts what is known."""
    origin = CellOrigin.of(store.attributes["provenance"], store.path)
    assert origin is not None
    cell = origin.cell_pattern(pattern, options.pattern)
    if not yarn.is_default and not same_yarns(origin.yarns, yarn.materials):
        raise InputError(
            f"samples {store.path} are of another yarn than {yarn.pattern}",
            expected=f"{material_names(yarn.materials)} ({yarn.origin}); sample anew, or give its --material",
            found=material_names(origin.yarns),
        )
    return cell


def _cloth_origin(folder: Path) -> CellOrigin | None:
    """The cell behind the shell material of a run, None where the run has none or it names no pattern."""
    for place in (folder, folder.parent):
        if (place / MATERIAL).is_file() and (place == folder or folder.name == "frames"):
            return CellOrigin.of_material(place / MATERIAL)
    return None


def _origin(store: SampleStore, out: Path, *, resume: bool) -> dict[str, object]:
    """Note what the frames are made from; on ``resume`` InputError where those there were made from something else."""
    provenance = store.attributes["provenance"]
    names = ("pattern", "pattern_hash", "material", "sliding")
    note = {name: provenance.get(name) for name in names} | {
        "states": [np.unique(values).tolist() for values in store.states.T]
    }
    text = json.dumps(note, indent=1) + "\n"
    path = writable_folder(out) / ORIGIN
    if resume and path.is_file() and path.read_text(encoding="utf-8") != text:
        raise InputError("cannot resume: frames of other yarns", where=out, expected="the same pattern and samples")
    write_text(path, text)
    return {"pattern": provenance["pattern"]}


def _write(yarns: YarnDetail, frames: ClothFrames, out: Path, *, resume: bool) -> tuple[int, float]:
    """Write a frame of curves for every frame of the cloth; how many were written and the seconds that took."""
    layout, curves = yarns.layout, curve_set(yarns)
    there = _finished(out, layout.offsets, frames) if resume else set()
    todo = [number for number in frames.paths if number not in there]
    folder = CurveFolder(out, curves, keep=max(there, default=-1) + 1)
    line, began = ProgressLine("yarns"), time.perf_counter()
    for done, number in enumerate(todo, start=1):
        state = frames.state(number)
        folder.write(number, yarns.curves(state.positions), state.time)
        line.show(done, len(todo))
    return len(todo), time.perf_counter() - began


def curve_set(yarns: YarnDetail) -> CurveSet:
    """The curves, as thick as their yarns and with a colour for each kind: courses of one yarn look alike."""
    layout, pattern = yarns.layout, yarns.table.pattern
    kind = pattern.material_of_vertex[layout.vertex[layout.offsets[:-1]]]
    radii = pattern.radius * pattern.relative_radius[layout.vertex]
    return CurveSet(layout.offsets, radii, closed=layout.closed, yarn=kind)


def _finished(out: Path, offsets: np.ndarray, frames: ClothFrames) -> set[int]:
    """Numbers of frames that need not be written again: of these curves, and younger than the cloth's."""
    try:
        with np.load(out / CURVES, allow_pickle=False) as stored:
            if not np.array_equal(stored["offsets"], offsets):
                return set()
    except (OSError, ValueError, KeyError):
        return set()
    there = frame_paths(out)
    return {
        number
        for number, path in frames.paths.items()
        if number in there and there[number].stat().st_mtime >= path.stat().st_mtime
    }


def _draw(path: Path, yarns: YarnDetail, frames: ClothFrames) -> None:
    from yarnscale.show.detail import Solid, yarn_cloth_picture

    number = max(frames.paths)
    last, bodies = frames.state(number), frames.bodies(number)
    solids = [] if bodies is None or frames.body_triangles is None else [Solid(bodies, frames.body_triangles)]
    yarn_cloth_picture(path, curve_set(yarns), yarns.curves(last.positions), solids=solids)
