"""The first job as a whole: a periodic cell → sampled states → a fitted shell material."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from yarnscale.cell.periodic import PeriodicCell
from yarnscale.checked import checked
from yarnscale.errors import InputError
from yarnscale.homogenize.fit import FitOptions, FitReport, fit_spline_material, validate
from yarnscale.homogenize.observations import InPlane
from yarnscale.homogenize.plan import (
    StrainRange,
    axes_and_planes,
    axes_planes_and_inside,
    random_states,
    scattered_axes,
)
from yarnscale.homogenize.refine import Round, check_goal, refine
from yarnscale.homogenize.sample import Progress, SampleSummary, check_resumable, create_store, sample
from yarnscale.homogenize.states import SampledStates
from yarnscale.homogenize.store import SampleStore
from yarnscale.shell.materials.spline_material import SplineMaterial

Array = NDArray[np.float64]
UNSEEN_SHARE = 0.1
"""Random states that judge the fit, as a share of the solves for it."""


@dataclass(frozen=True, eq=False)
class Homogenization:
    """Outcome: the material, the states behind it, the unseen states that judge it, and what the solves cost."""

    material: SplineMaterial
    samples: SampledStates
    unseen: SampledStates
    report: FitReport
    summary: SampleSummary


@checked
def fit(store: SampleStore, *, options: FitOptions | None = None) -> SplineMaterial:
    """Shell material fitted to the energies and stresses of a store's converged states.

    options default to terms of all three in-plane strains, where the store has states for them.
    """
    states = SampledStates.of(store)
    if not states.converged.any():
        raise InputError("no converged state to fit", where=store.path, expected="a finished sampling run")
    provenance = dict(store.attributes["provenance"])
    return fit_spline_material(
        states.strains,
        states.energies,
        states.stresses,
        density=float(provenance["area_density"]),
        moduli=states.moduli,
        valid=states.converged,
        options=options or FitOptions(in_plane="full"),
        provenance=provenance,
    )


@checked
def homogenize(
    cell: PeriodicCell,
    folder: Path,
    *,
    solves: int = 400,
    range: StrainRange | None = None,
    in_plane: InPlane = "full",
    budget: int | None = None,
    target_error: float | None = None,
    workers: int = 2,
    dask: str | None = None,
    resume: bool = False,
    progress: Callable[[Progress], None] | None = None,
    judged: Callable[[Round], None] | None = None,
) -> Homogenization:
    """Sample a cell, fit a material, and judge it on random states that it has not seen.

    in_plane: "pairwise" samples axes and planes for the sum over pairs of HYLC20; "full" adds states inside the
    range and terms of all three in-plane strains. budget: after ``solves`` planned states, solve more where the fit
    errs most, up to so many in all or until the estimated error is below ``target_error`` (see ``refine``);
    ``judged`` is called before every batch. folder: gets the stores ``samples`` and ``unseen``. resume: go on with the
    stores that are there. dask: address of a scheduler, whose workers take the place of processes.
    Raises InputError for a refinement of pairwise samples, or a store of another run.
    """
    if target_error is not None and budget is None:
        raise InputError("target of the error", expected="a budget of solves with it")
    if budget is not None:
        check_goal(budget, target_error)
        if in_plane != "full":
            raise InputError("budget of solves", expected='in_plane "full"', found=in_plane)
    box = (range or StrainRange()).bounds(cell.pattern.radius)
    # Unseen states follow from the plan alone, so that a budget that is raised later keeps them.
    planned = {
        "samples": (axes_planes_and_inside if in_plane == "full" else axes_and_planes)(box, solves),
        "unseen": random_states(box, max(10, round(UNSEEN_SHARE * solves))),
    }
    stores, summaries = {}, []
    for name, states in planned.items():
        axes = scattered_axes(states)
        path = Path(folder) / name
        if resume:
            SampleStore.recover(path)
        if resume and path.exists():
            stores[name] = SampleStore(path)
            check_resumable(stores[name], cell, axes, more=name == "samples" and budget is not None)
        else:
            stores[name] = create_store(path, cell, axes, scattered=True, moduli=name == "samples")
        if name == "samples" and budget is not None:
            refined = refine(
                cell, stores[name], budget=budget, target_error=target_error, workers=workers, dask=dask,
                progress=progress, judged=judged,
            )  # fmt: skip
            stores[name] = refined.store
            summaries.append(refined.summary)
        else:
            summaries.append(sample(cell, stores[name], workers=workers, dask=dask, progress=progress))
    samples, unseen = SampledStates.of(stores["samples"]), SampledStates.of(stores["unseen"])
    material = fit(stores["samples"], options=FitOptions(in_plane=in_plane))
    report = validate(material, unseen.strains, unseen.energies, unseen.stresses, valid=unseen.converged)
    total = SampleSummary(
        sum(s.states for s in summaries),
        sum(s.converged for s in summaries),
        sum(s.seconds for s in summaries),
        workers,
        max(s.peak_worker_megabytes for s in summaries),
    )
    return Homogenization(material, samples, unseen, report, total)
