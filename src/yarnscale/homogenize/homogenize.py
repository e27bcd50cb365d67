"""The first job as a whole: a periodic cell → sampled states → a fitted shell material."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from yarnscale.arrays import Array
from yarnscale.cell.periodic import PeriodicCell
from yarnscale.checked import checked
from yarnscale.errors import InputError
from yarnscale.homogenize.compact_fit import CompactOptions, StressErrors, fit_compact_material
from yarnscale.homogenize.executors import kept_workers
from yarnscale.homogenize.friction_fit import with_friction
from yarnscale.homogenize.friction_paths import check_friction, friction_paths
from yarnscale.homogenize.load_samples import UNSEEN_SHARE, sample_loads
from yarnscale.homogenize.plan import StrainRange, axes_and_planes, random_states, scattered_axes
from yarnscale.homogenize.published_fit import (
    IN_STRESS,
    PublishedOptions,
    fit_spline_material,
    strains_of,
)
from yarnscale.homogenize.rays import SOLVES, TESTED, largest_load
from yarnscale.homogenize.sample import SampleSummary, SamplingProgress, check_resumable, create_store, sample
from yarnscale.homogenize.states import FabricStates
from yarnscale.homogenize.store import SampleStore
from yarnscale.kinematics import strain_units
from yarnscale.laboratory.programme import strains_of_tests
from yarnscale.shell.materials.compact import CompactMaterial
from yarnscale.shell.materials.material import ShellMaterial
from yarnscale.shell.materials.spline_material import SplineMaterial
from yarnscale.yarn.friction import YarnFriction

Form = Literal["compact", "hylc2020"]
FEWEST_UNSEEN = 10
FRICTION = "friction"
"""Folder of the paths with friction."""
_PUBLISHED_STATES = 800
"""States from which another material is put into the published form."""


@dataclass(frozen=True, eq=False)
class Homogenization:
    """Outcome: the material, the states behind it, its errors at unseen states, and the cost of the solves."""

    material: CompactMaterial | SplineMaterial
    samples: FabricStates
    unseen: FabricStates
    errors: StressErrors
    """Of the stress at the unseen states."""
    summary: SampleSummary


@checked
def fit(store: SampleStore, *, options: CompactOptions | None = None) -> CompactMaterial:
    """Fit a compact shell material to the converged states of a store: energies, stresses and, where kept, moduli.

    States that tests of an earlier material passed refine a fit of the others.
    """
    states = _states_of(store)
    tested = states.kinds == TESTED
    material = _fitted(states.chosen(~tested), store, options)
    return _fitted(states, store, options, material) if tested.any() else material


def _fitted(
    states: FabricStates, store: SampleStore, options: CompactOptions | None, start: CompactMaterial | None = None
) -> CompactMaterial:
    return fit_compact_material(
        states.strains, states.energies, states.stresses, states.moduli, kinds=states.kinds,
        density=states.density, radius=states.radius, options=options, start=start,
        provenance=dict(store.attributes["provenance"]),
    )  # fmt: skip


@checked
def fit_published(store: SampleStore, *, options: PublishedOptions | None = None) -> SplineMaterial:
    """Fit the published pairwise splines (HYLC20 §6) to a store of strains: see ``published_fit``."""
    if store.rays:
        raise InputError("samples along loads", where=store.path, expected="a store of strains for the form hylc2020")
    states = _states_of(store)
    return fit_spline_material(
        np.delete(states.strains, 4, axis=1), states.energies, states.stresses[:, IN_STRESS],
        density=states.density, options=options, provenance=dict(store.attributes["provenance"]),
    )  # fmt: skip


def _states_of(store: SampleStore) -> FabricStates:
    states = FabricStates.of(store)
    if len(states.energies) == 0:
        raise InputError("no converged state to fit", where=store.path, expected="a finished sampling run")
    return states


@checked
@kept_workers()
def homogenize(
    cell: PeriodicCell,
    folder: Path,
    *,
    form: Form = "compact",
    solves: int = SOLVES,
    limit: float | None = None,
    visited: Array | None = None,
    range: StrainRange | None = None,
    options: CompactOptions | PublishedOptions | None = None,
    workers: int = 2,
    dask: str | None = None,
    resume: bool = False,
    friction: YarnFriction | None = None,
    progress: Callable[[SamplingProgress], None] | None = None,
) -> Homogenization:
    """Sample a cell, fit a material, and measure its errors at states that were not fitted.

    form: "compact" samples along loads up to ``limit`` [N/m], where a simulation went (strains ``visited``, (n, 6)) and
    where the material goes in its own virtual tests; "hylc2020" samples axes and planes of a ``range`` of strains for
    the published splines. solves: about how many equilibria, for the tests a tenth more. options: of the fit of that
    form. folder: gets the stores ``samples`` and ``unseen``, and the paths of ``friction``. resume: go on with what is
    there. friction: of the yarns, in the form "compact": the material has sliders then, see ``friction_fit``. dask:
    address of a scheduler, whose workers take the place of processes. Raises InputError for a store of another
    run.
    """
    if form == "compact":
        if range is not None:
            raise InputError("range of strains", expected="the form hylc2020 with it; loads set the range")
        if not isinstance(options, CompactOptions | None):
            raise InputError("options of the fit", expected="CompactOptions", found=options)
        run: dict[str, Any] = {"workers": workers, "dask": dask, "progress": progress}
        rubbing = None if friction is None or friction.coefficient == 0.0 else friction
        if rubbing is not None:
            check_friction(cell, rubbing)
        found = sample_loads(cell, folder, solves=solves, limit=limit, visited=visited, resume=resume, **run)
        material = fit(found.store, options=options)
        if all(ray["kind"] != TESTED for ray in found.store.rays):
            # Where the material goes in its own tests there may be no sample: a valley that the fabric does not have.
            found = found.extended(cell, strains_of_tests(material), TESTED, solves // 10, **run)
            if TESTED in found.samples.kinds:  # as ``fit`` does
                material = _fitted(found.samples, found.store, options, material)
        samples, unseen, summary = found.samples, found.unseen, found.summary
        if rubbing is not None:
            largest = limit or largest_load(cell)
            paths = friction_paths(cell, rubbing, limit=largest, folder=folder / FRICTION, **run)
            material = with_friction(material, paths, rubbing.coefficient)
    else:
        if friction is not None:
            raise InputError("friction", expected="the form compact with it", found=form)
        if limit is not None or visited is not None:
            raise InputError("loads", expected="the form compact with them; a range of strains is sampled")
        if not isinstance(options, PublishedOptions | None):
            raise InputError("options of the fit", expected="PublishedOptions", found=options)
        stores, summary = _strain_stores(cell, folder, range or StrainRange(), solves, workers, dask, resume, progress)
        samples, unseen = (FabricStates.of(store) for store in stores)
        material = fit_published(stores[0], options=options)
    errors = errors_at(material, unseen)
    if errors.states:
        material = replace(material, provenance={**material.provenance, "unseen": errors._asdict()})
    return Homogenization(material, samples, unseen, errors, summary)


def errors_at(material: ShellMaterial, states: FabricStates) -> StressErrors:
    """Errors of a material's stress at some states, relative to each state's own size."""
    return StressErrors.of(material.stress(states.strains), states.stresses, strain_units(states.radius))


def _strain_stores(
    cell: PeriodicCell, folder: Path, range: StrainRange, solves: int, workers: int, dask: str | None, resume: bool,
    progress: Callable[[SamplingProgress], None] | None,
) -> tuple[list[SampleStore], SampleSummary]:  # fmt: skip
    """Stores of the axes and planes of a range of strains, and of random states in it."""
    box = range.bounds(cell.pattern.radius)
    planned = {
        "samples": axes_and_planes(box, solves),
        "unseen": random_states(box, max(FEWEST_UNSEEN, round(UNSEEN_SHARE * solves))),
    }
    stores, summaries = [], []
    for name, states in planned.items():
        axes, path = scattered_axes(states), folder / name
        if resume:
            SampleStore.recover(path)
        if resume and path.exists():
            store = SampleStore(path)
            check_resumable(store, cell, axes)
        else:
            store = create_store(path, cell, axes, scattered=True)
        summaries.append(sample(cell, store, workers=workers, dask=dask, progress=progress))
        stores.append(store)
    return stores, summaries[0].joined(summaries[1])


def published_form(material: ShellMaterial, box: Array) -> SplineMaterial:
    """The published splines (HYLC20 §6) of another material, from its values on axes and planes of a box (5, 2)."""
    places = axes_and_planes(box, _PUBLISHED_STATES)
    six = strains_of(places)
    return fit_spline_material(
        places, material.energy_density(six), material.stress(six)[:, IN_STRESS], density=material.density
    )
