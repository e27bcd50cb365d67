"""What decides an estimate: law of stretch (EST22 Fig. 16), bending (Table 1, Fig. 18), values measured on the yarn.

python benchmarks/estimate_effects.py plated --out DIR
python benchmarks/estimate_effects.py bending --out DIR     after ``estimate.py knits`` in the same DIR
python benchmarks/estimate_effects.py known --out DIR
python benchmarks/estimate_effects.py table --out DIR

A run that is killed goes on where it was: evaluations are kept, and rows in the files of DIR are not made again.
"""

from __future__ import annotations

import argparse
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
from estimate import KNITS, made, model_of, rows_of, settings_of, store_of, table_of, tell

from yarnscale.cell.periodic import PeriodicCell
from yarnscale.drawing.knit import knit
from yarnscale.files.measurements import read_measurements
from yarnscale.homogenize.executors import local_workers
from yarnscale.shell.materials.orthotropic import OrthotropicMaterial
from yarnscale.swatches.bend_fit import fit_bending
from yarnscale.swatches.fabric_fit import fit_fabric
from yarnscale.swatches.fabric_shell import fit_shell
from yarnscale.swatches.measurements import COMFORT_LOAD, BendTest, Direction, SwatchMeasurements
from yarnscale.swatches.objective import ErrorWeights, Evaluation, YarnObjective
from yarnscale.swatches.pear_loop import PearLoop
from yarnscale.swatches.uniform_data import UniformBend, UniformCurve, UniformData, uniform_bending
from yarnscale.swatches.yarn_fit import fit_yarn
from yarnscale.swatches.yarn_model import YarnModel, yarn_model
from yarnscale.swatches.yarn_rest import RestRule, rested_cell
from yarnscale.swatches.yarn_states import bending_stiffness, pulled
from yarnscale.yarn.material import ContactRule, YarnMaterial

SOFT, STIFF, OVERFEED = (0.3, 2e-9), (20.0, 1e-8), 0.1
"""Stretch [N] and bending stiffness [N m²] of an elastane and of a polyester plated with it; how much shorter the
elastane is at rest, which is fed stretched."""
REACH = {Direction.WEFT: 2.0, Direction.WARP: 1.4}
YARN_BENDING = 4.5e-8
"""Of the acrylic yarn, as its source measured it [N m²]."""
DISTANCES = np.linspace(0.004, 0.034, 7)
"""Of the clamps of pear loops [m]."""
WEIGHTS = (0.0, 0.1, 1.0)
NOISE = 0.02
STIFFER = (1.0, 1.5, 2.2, 3.3)
"""Bending stiffnesses over that of the yarn of stretch alone, of which the best begins a search with loops: from that
yarn itself Gauss–Newton stays where it is."""


def plated_truth() -> tuple[YarnModel, UniformData]:
    """Curves of a single jersey of two plated yarns, and a model with one yarn for the same loops."""
    drawn = knit("k", radius=0.3e-3, wale_spacing=10.0, course_spacing=6.5, yarns=["AB"])
    lengths = drawn.rest_length.copy()
    # The first yarn is the first letter's.
    lengths[drawn.yarns[0]] *= 1.0 - OVERFEED
    materials = tuple(_plain(stretch, bending, drawn.radius) for stretch, bending in (SOFT, STIFF))
    cell = PeriodicCell(replace(drawn, rest_length=lengths), materials)
    # Rest lengths stay those at which the yarns were fed: the fabric contracts until the elastane rests in its loops.
    rested = rested_cell(cell.with_options(tolerance=1e-8, max_iterations=150), RestRule(rounds=0))
    curves = []
    for direction, end in REACH.items():
        found = pulled(rested.cell, direction, end * np.arange(1, 15) / 14)
        assert found.converged.all(), direction
        comfort = float(np.interp(COMFORT_LOAD, np.maximum.accumulate(found.stress), found.stretch))
        curves.append(UniformCurve(direction, found.stretch, found.contraction, found.stress, comfort))
    single = knit("k", radius=0.3e-3, wale_spacing=10.0, course_spacing=6.5)
    length = float(drawn.drawn_length.sum()) / 2
    return yarn_model(single, STIFF[0], yarn_length=length), UniformData("plated", tuple(curves))


def _plain(stretch: float, bending: float, radius: float) -> YarnMaterial:
    rule = ContactRule(
        kernel="est2022", weights="simpson", outer_radius_ratio=1.0, inner_radius_ratio=0.25, inner_stiffness=1e3
    )
    base = YarnMaterial(1.0, 1.0, 1.0, 30.0, 300.0, name="plated", contact=rule)
    return base.with_stiffnesses(radius, stretch=stretch, bending=bending, twist=0.8 * bending)


def plated(options: argparse.Namespace, executor) -> None:
    """Two plated yarns fitted by one, with two phases of stretch and with one, each from yarns that could be meant.

    The soft phase of the plated yarns is the elastane's, its end the stretch at which it was fed; a linear yarn may be
    either of both yarns, or between them.
    """
    model, data = plated_truth()
    middle = model.values(np.full(5, 0.5))
    starts = {
        "two phases": [{"k_s1": SOFT[0], "knee": OVERFEED}],
        "linear": [{"k_s1": value} for value in (SOFT[0], np.sqrt(SOFT[0] * STIFF[0]), STIFF[0])],
    }
    for law, firsts in starts.items():
        for first in firsts:
            if made(options, "plated", law=law, first=first["k_s1"]) is not None:
                continue
            values = {
                **dict(zip(model.names, middle, strict=True)),
                "k_b": STIFF[1],
                "R_1": model.pattern.radius,
            } | first
            case = replace(model, two_phase=law == "two phases")
            fit = fit_yarn(
                case, data, options=replace(settings_of(options), samples=5), rule=RestRule(), executor=executor,
                store=store_of(options), start=model.unknowns(np.array([values[name] for name in model.names])),
            )  # fmt: skip
            row = {"law": law, "first": first["k_s1"], **_errors(fit.evaluation), "values": fit.values.tolist()}
            tell(options, row | {"objective": fit.objective, "cpu_seconds": fit.cpu_seconds})


def bending(options: argparse.Namespace, executor) -> None:
    """The measured knits with synthetic pear loops of the bending that their source measured on the yarn: yarns fitted
    to stretch alone, then also to the loops."""
    for sample in options.samples:
        alone = made(options, "knits", sample=sample, holdout=None)
        assert alone is not None, "estimate.py knits comes first"
        model = model_of(sample)
        measured = fit_shell(read_measurements(table_of(options), sample=f"Acrylic Yarn {sample}"))
        data = replace(measured.uniform_data(), bending=())
        start = model.unknowns(np.array([alone["parameters"][name] for name in model.names]))
        loops = None
        for weight in WEIGHTS:
            if made(options, "bending", sample=sample, weight=weight) is not None:
                continue
            loops = loops or _loops(model, data, start)
            bent, weights = replace(data, bending=loops), ErrorWeights(bending=weight)
            found = YarnObjective(model, bent, weights=ErrorWeights(bending=1.0)).evaluate(start)
            if weight > 0:
                objective = YarnObjective(model, bent, weights=weights)
                stiffer = [_stiffer(model, start, factor) for factor in STIFFER]
                best = min(stiffer, key=lambda unknowns: objective.evaluate(unknowns).objective)
                fit = fit_yarn(
                    model, bent, options=settings_of(options), weights=weights, executor=executor,
                    store=store_of(options), start=best,
                )  # fmt: skip
                found = fit.evaluation
            off = float(np.mean(np.abs(found.bending / [bend.stiffness for bend in loops] - 1.0)))
            values = model.values(found.unknowns).tolist()
            tell(options, {"sample": sample, "weight": weight, **_errors(found), "bending": off, "values": values})


def _stiffer(model: YarnModel, unknowns: np.ndarray, factor: float) -> np.ndarray:
    """The yarn with another bending stiffness."""
    values, place = model.values(unknowns), model.names.index("k_b")
    values[place] *= factor
    return model.unknowns(values)


def _loops(model: YarnModel, data: UniformData, unknowns: np.ndarray) -> tuple[UniformBend, ...]:
    """Bending stiffness read from simulated loops of a fabric whose yarn bends as measured, with noise."""
    values, place = model.values(unknowns), model.names.index("k_b")
    values[place] = YARN_BENDING
    cell = YarnObjective(model, data).evaluate(model.unknowns(values)).rested.cell
    weft, warp = bending_stiffness(cell, [Direction.WEFT, Direction.WARP])
    density, random = cell.area_density, np.random.default_rng(0)
    material = OrthotropicMaterial(
        100.0, 20.0, 100.0, 30.0, bend_weft=weft, bend_bias=0.5 * (weft + warp), bend_warp=warp, density=density
    )
    tests = []
    for direction in (Direction.WEFT, Direction.WARP):
        ratio = PearLoop(direction).respond(material, DISTANCES).ratio
        ratio = ratio * (1.0 + NOISE * random.standard_normal(len(ratio)))
        tests.append(BendTest(direction, 0.1, 0.06, DISTANCES, ratio))
    return uniform_bending(fit_bending(SwatchMeasurements("loops", bend=tuple(tests), area_density=density), material))


def known(options: argparse.Namespace, executor) -> None:
    """The warp predicted from the weft, without and with the bending stiffness measured on the yarn."""
    for sample in options.samples:
        measured = read_measurements(table_of(options), sample=f"Acrylic Yarn {sample}")
        for value in (None, YARN_BENDING):
            if made(options, "known", sample=sample, k_b=value) is None:
                found = fit_fabric(
                    measured, replace(model_of(sample), bending=value), holdout=Direction.WARP, executor=executor,
                    options=settings_of(options), store=store_of(options),
                )  # fmt: skip
                held = found.held_out_error
                assert held is not None
                tell(options, {"sample": sample, "k_b": value, "weft": found.error.summary(), "warp": held.summary(),
                               "values": found.fit.values.tolist(), "cpu_seconds": found.fit.cpu_seconds})  # fmt: skip


def tables(options: argparse.Namespace, _) -> None:
    """Print what was made as tables of Markdown."""
    three = ("comfort", "full", "compression")
    print("\n| law | k_s1 at first | comfort | full range | contraction | k_s1 | knee |\n|---|---|---|---|---|---|---|")
    for row in rows_of(options, "plated"):
        cells = [_percent(row[name]) for name in three] + [f"{row['values'][0]:.3g} N", f"{row['values'][1]:.3f}"]
        print(f"| {row['law']} | {row['first']:.3g} N | {' | '.join(cells)} |")
    print("\n| weight of bending | fabric | comfort | full range | contraction | bending |\n|---|---|---|---|---|---|")
    rows = rows_of(options, "bending")
    for weight in sorted({row["weight"] for row in rows}):
        own = [row for row in rows if row["weight"] == weight]
        for row in own:
            cells = (_percent(row[name]) for name in (*three, "bending"))
            print(f"| {weight:g} | {row['sample']} | {' | '.join(cells)} |")
        columns = [[row[name] for row in own] for name in (*three, "bending")]
        mean = (f"{_percent(float(np.mean(column)))} ± {_percent(float(np.std(column)))}" for column in columns)
        print(f"| {weight:g} | mean, deviation | {' | '.join(mean)} |")
    print("\n| fabric | k_b | weft | warp, predicted |\n|---|---|---|---|")
    for row in rows_of(options, "known"):
        cells = (", ".join(_percent(row[side][name]) for name in three) for side in ("weft", "warp"))
        print(f"| {row['sample']} | {'measured' if row['k_b'] else 'free'} | {' | '.join(cells)} |")


def _percent(share: float | None) -> str:
    return "–" if share is None else f"{100 * share:.1f} %"


def _errors(found: Evaluation) -> dict[str, float | None]:
    errors = found.errors
    return {"comfort": errors.comfort, "full": errors.full, "compression": errors.compression}


PARTS = {"plated": plated, "bending": bending, "known": known, "table": tables}

if __name__ == "__main__":
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("part", choices=PARTS)
    arguments.add_argument("--shared", type=Path, default=Path("../shared"))
    arguments.add_argument("--out", type=Path, default=Path("estimates"))
    arguments.add_argument("--samples", nargs="+", choices=KNITS, default=list(KNITS))
    arguments.add_argument("--starts", type=int, default=64)
    arguments.add_argument("--refined", type=int, default=8)
    arguments.add_argument("--seed", type=int, default=0)
    arguments.add_argument("--workers", type=int, default=2)
    chosen = arguments.parse_args()
    chosen.out.mkdir(parents=True, exist_ok=True)
    with local_workers(chosen.workers) if chosen.workers > 1 else nullcontext() as pool:
        PARTS[chosen.part](chosen, pool)
