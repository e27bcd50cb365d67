"""Estimation of yarns: measured knits, twins, ablations, the published solver. Run with --help for the parts.

python benchmarks/estimate.py all --shared ../shared --out DIR

A run that is killed goes on where it was: evaluations are kept, and rows in the files of DIR are not made again.
``table`` prints what is there as tables for docs/validation/estimate.md.
"""

from __future__ import annotations

import argparse
import json
import time
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
from one_yarn import SharedEvaluations, with_one_yarn
from scipy.stats import qmc

from yarnscale.drawing.library import build
from yarnscale.files.estimate_run import EstimateFolder, evaluation_folder
from yarnscale.files.measurements import read_measurements
from yarnscale.homogenize.executors import local_workers
from yarnscale.swatches.evaluations import Evaluations
from yarnscale.swatches.fabric_fit import fit_fabric
from yarnscale.swatches.fabric_shell import fit_shell
from yarnscale.swatches.gauss_newton import jacobian
from yarnscale.swatches.measurements import Direction
from yarnscale.swatches.objective import YarnObjective, coarser
from yarnscale.swatches.search import race, sobol_starts
from yarnscale.swatches.uniform_data import UniformCurve, UniformData
from yarnscale.swatches.yarn_estimate import UNKNOWN_STIFFNESS
from yarnscale.swatches.yarn_fit import FitOptions, ParameterSpread, fit_yarn
from yarnscale.swatches.yarn_model import YarnModel, yarn_model
from yarnscale.swatches.yarn_rest import RestRule

KNITS = {
    "Stockinette": ("stockinette", 11.28e-3),
    "Garter": ("garter", 2 * 10.55e-3),
    "Rib": ("rib-1x1", 16.10e-3),
    "Seed": ("seed", 2 * 15.67e-3),
}
"""Sample -> pattern, yarn in one period of it [m], from the authors' yarn length per repeat of their unit cell."""
CASES = ("default", "local", "linear", "as-drawn", "paper")
"""Of the ablations; "paper" is the published solver."""
TWINS = (
    "stockinette", "garter", "rib-1x1", "interlock", "double-pique", "links", "all-needle", "single-jersey",
)  # fmt: skip
TWIN_TRUTH = {"rib-1x1": np.array([0.50, 0.25, 0.40, 0.60, 0.60])}
USUAL_TRUTH = np.array([0.55, 0.30, 0.40, 0.60, 0.60])
"""Unknowns of soft yarns that stretch through their knee before their loops are straight: every parameter shows."""
TWIN_STRETCH = {
    "stockinette": (1.0, 0.8, 0.6), "garter": (0.8, 1.0, 1.2), "rib-1x1": (1.4, 0.9, 0.5),
}  # fmt: skip
"""Largest stretch along weft, bias and warp, 0.8 for others; less where the yarn has no equilibrium."""


def model_of(sample: str, *, free: bool = True) -> YarnModel:
    """The model of a measured knit."""
    pattern, length = KNITS[sample]
    return yarn_model(build(pattern), UNKNOWN_STIFFNESS, yarn_length=length, free_shape=free)


def knits(options: argparse.Namespace, executor) -> list[dict]:
    """Each knit with both directions, and with the warp held out."""
    from yarnscale.show.estimate import write_estimate_report
    from yarnscale.show.estimates import write_estimates_page

    rows, found = [], {}
    for sample in options.samples:
        measured = read_measurements(table_of(options), sample=f"Acrylic Yarn {sample}")
        for holdout in [Direction.WARP if name == "warp" else None for name in options.holdouts]:
            held = None if holdout is None else holdout.value
            if (row := made(options, "knits", sample=sample, holdout=held)) is not None:
                found |= {} if held else {sample: row}
                continue
            estimate = fit_fabric(
                measured, model_of(sample), holdout=holdout, executor=executor, options=settings_of(options),
                store=store_of(options),
            )  # fmt: skip
            rows.append({"sample": sample, "holdout": held, **estimate.summary()})
            tell(options, rows[-1])
            folder = options.out / f"{sample}{'' if holdout is None else '-holdout'}"
            folder.mkdir(parents=True, exist_ok=True)
            write_estimate_report(folder, estimate, pictures=options.pictures)
            if holdout is None:
                found[sample] = estimate.summary()
    if found:
        write_estimates_page(options.out / "index.html", found)
    return rows


def ablations(options: argparse.Namespace, executor) -> list[dict]:
    """Local search alone, linear stretch, no rest shape; against the default (EST22 Fig. 11, 16, 17)."""
    rows = []
    for sample in options.samples:
        data = fit_shell(read_measurements(table_of(options), sample=f"Acrylic Yarn {sample}")).uniform_data()
        default, model = settings_of(options), model_of(sample)
        cases = {
            "default": (model, default, RestRule()),
            "local": (model, replace(default, solver="local"), RestRule()),
            "linear": (replace(model, two_phase=False), default, RestRule()),
            "as-drawn": (model, default, RestRule(rounds=0, release=False)),
            "paper": (model, replace(default, solver="paper"), RestRule()),
        }
        for name in options.cases:
            if made(options, "ablations", sample=sample, case=name) is not None:
                continue
            case, settings, rule = cases[name]
            fit = fit_yarn(case, data, options=settings, rule=rule, executor=executor, store=store_of(options))
            errors = fit.evaluation.errors
            rows.append({"sample": sample, "case": name, "objective": fit.objective, "comfort": errors.comfort,
                         "full": errors.full, "compression": errors.compression, "solves": fit.solves,
                         "evaluations": fit.evaluations, "failed": fit.evaluation.failed,
                         "cpu_seconds": fit.cpu_seconds, "values": fit.values.tolist()})  # fmt: skip
            tell(options, rows[-1])
    return rows


def twins(options: argparse.Namespace, executor) -> list[dict]:
    """Parameters found again from a yarn's own curves, without and with noise of 3 % of every value."""
    rows = []
    for pattern in options.patterns:
        truth, model = (
            TWIN_TRUTH.get(pattern, USUAL_TRUTH),
            yarn_model(build(pattern), 20.0, yarn_length=None),
        )
        left = [n for n in options.noises if made(options, "twins", pattern=pattern, noise=n) is None]
        clean = twin_data(model, truth, TWIN_STRETCH.get(pattern, (0.8, 0.8, 0.8))) if left else None
        for noise in left:
            assert clean is not None
            generator = np.random.default_rng(1)
            data = replace(clean, curves=tuple(_noisy(curve, noise, generator) for curve in clean.curves))
            objective = YarnObjective(model, coarser(data, 7))
            evaluations = Evaluations(objective, executor, store_of(options)(objective))
            unknowns = race(evaluations, _starts(evaluations, options, truth), iterations=20)
            value = evaluations.many([unknowns])[0].objective
            spread = ParameterSpread.of(model.names, jacobian(evaluations, unknowns))
            # Against the curves before noise came in.
            end = replace(objective, data=clean).evaluate(unknowns)
            off = np.abs(model.values(unknowns) / model.values(truth) - 1.0)
            rows.append({"pattern": pattern, "noise": noise, "around": options.around, "off": off.tolist(),
                         "stress": end.errors.full, "contraction": end.errors.compression, "objective": value,
                         "values": model.values(unknowns).tolist(), "shift": spread.shift.tolist(),
                         "singular": spread.singular.tolist(), "evaluations": evaluations.count,
                         "solves": evaluations.solves, "cpu_seconds": evaluations.seconds})  # fmt: skip
            tell(options, rows[-1])
    return rows


def _starts(evaluations: Evaluations, options: argparse.Namespace, truth: np.ndarray) -> list[np.ndarray]:
    """Where a twin's search begins: the best of yarns scattered over all of the ranges, or about the truth."""
    if options.around is None:
        return sobol_starts(evaluations, options.starts, options.refined, seed=options.seed)
    generator = np.random.default_rng(options.seed)
    away = options.around * (2.0 * generator.random((options.starts, len(truth))) - 1.0)
    points = [np.clip(truth + step, 0.0, 1.0) for step in away]
    order = np.argsort([found.objective for found in evaluations.many(points)], kind="stable")
    return [points[k] for k in order[: options.refined]]


def twin_data(
    model: YarnModel, truth: np.ndarray, largest: tuple[float, float, float], samples: int = 21
) -> UniformData:
    """Uniform data that a yarn makes itself, as far as it has equilibria; a search uses 7 of 21 stretches."""
    ends, share = np.array(largest), np.arange(1, samples + 1) / samples
    for _ in range(2):
        blank = tuple(
            UniformCurve(direction, end * share, np.ones(samples), np.ones(samples), end)
            for direction, end in zip(Direction, ends, strict=True)
        )
        found = YarnObjective(model, UniformData("twin", blank)).evaluate(truth).curves
        good = [curve.converged for curve in found]
        reach = np.array([share[max(g.argmin() - 1, 0)] if not g.all() else 1.0 for g in good])
        if (reach == 1.0).all():
            break
        ends = ends * reach
    return UniformData(
        "twin",
        tuple(
            UniformCurve(c.direction, c.stretch[g], c.contraction[g], c.stress[g], float(c.stretch[g][-1]))
            for c, g in zip(found, good, strict=True)
        ),
    )


def _noisy(curve: UniformCurve, noise: float, generator: np.random.Generator) -> UniformCurve:
    factors = 1.0 + noise * generator.standard_normal((2, len(curve.stretch)))
    return replace(curve, stress=curve.stress * factors[0], contraction=curve.contraction * factors[1])


def one_yarn(options: argparse.Namespace, executor) -> list[dict]:
    """All knits with the parameters of one yarn, each with its own shape, from the fits of each that ``knits`` left."""
    models = with_one_yarn([model_of(sample) for sample in options.samples])
    alone = {sample: made(options, "knits", sample=sample, holdout=None) for sample in options.samples}
    parts, starts, full = [], [], []
    for sample, model in zip(options.samples, models, strict=True):
        data = fit_shell(read_measurements(table_of(options), sample=f"Acrylic Yarn {sample}")).uniform_data()
        full.append(data)
        parts.append(YarnObjective(model, coarser(data, 7)))
        row = alone[sample]
        assert row is not None, "knits come first"
        values = row["parameters"]
        starts.append(model.unknowns(np.array([values[name] for name in model.names])))
    evaluations = SharedEvaluations(tuple(Evaluations(part, executor, store_of(options)(part)) for part in parts))
    firsts = _first_yarns(options, evaluations, starts)[: options.refined]
    end = race(evaluations, firsts, iterations=options.iterations)  # pyright: ignore[reportArgumentType]
    yarn = models[0].values(evaluations.split(end)[0])[:5]
    rows: list[dict] = [{"parameters": yarn.tolist(), "unknowns": end.tolist(),
                         "objective": evaluations.many([end])[0].objective, "solves": evaluations.solves,
                         "cpu_seconds": evaluations.seconds}]  # fmt: skip
    for sample, part, data, unknowns in zip(options.samples, parts, full, evaluations.split(end), strict=True):
        last = replace(part, data=data).evaluate(unknowns)
        rows.append({"sample": sample, "comfort": last.errors.comfort, "full": last.errors.full,
                     "compression": last.errors.compression, "failed": last.failed,
                     "values": part.model.values(unknowns).tolist()})  # fmt: skip
    for row in rows:
        tell(options, row)
    return rows


def _first_yarns(
    options: argparse.Namespace, evaluations: SharedEvaluations, starts: list[np.ndarray]
) -> list[np.ndarray]:
    """Where to begin: the middle of the yarns and each of them in all fabrics, each in the best of some shapes; the
    best first."""
    joined = evaluations.joined(starts)
    found = []
    for name, yarn in zip(["middle", *options.samples], [joined, *starts], strict=True):
        shaped, objectives = [], []
        for own, part in zip(starts, evaluations.parts, strict=True):
            shapes = qmc.Sobol(len(own) - 5, rng=options.seed).random(options.shapes)
            points = [np.concatenate([yarn[:5], shape]) for shape in [own[5:], *shapes]]
            values = [entry.objective for entry in part.many(points)]
            shaped.append(points[int(np.argmin(values))])
            objectives.append(min(values))
        found.append((float(np.mean(objectives)), np.concatenate([yarn[:5], *(point[5:] for point in shaped)])))
        tell(options, {"yarn of": name, "objective": found[-1][0], "objectives": objectives})
    return [unknowns for _, unknowns in sorted(found, key=lambda pair: pair[0])]


def rows_of(options: argparse.Namespace, part: str) -> list[dict]:
    """What the file of a part holds."""
    path = options.out / f"{part}.jsonl"
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()] if path.exists() else []


def made(options: argparse.Namespace, part: str, **entries: object) -> dict | None:
    """The last row of a part with these entries, of the same search."""
    wanted = _searched_with(options) | entries
    rows = [row for row in rows_of(options, part) if wanted.items() <= row.items()]
    return rows[-1] if rows else None


def _searched_with(options: argparse.Namespace) -> dict[str, int]:
    return {"starts": options.starts, "refined": options.refined, "seed": options.seed}


def every(options: argparse.Namespace, executor) -> None:
    """All parts, the cheapest first."""
    for part in ("twins", "ablations", "knits", "one-yarn"):
        options.part = part
        if part != "one-yarn" or not rows_of(options, part):
            PARTS[part](options, executor)


def tables(options: argparse.Namespace, _) -> None:
    """Print what was made as tables of Markdown, shares in per cent."""
    columns = {
        "twins": (
            "pattern",
            "noise",
            "off",
            "stress",
            "contraction",
            "singular",
            "evaluations",
            "cpu_seconds",
        ),
        "ablations": (
            "sample",
            "case",
            "comfort",
            "full",
            "compression",
            "objective",
            "solves",
            "cpu_seconds",
        ),
    }
    shares = {"noise", "off", "stress", "contraction", "comfort", "full", "compression"}
    for part, names in columns.items():
        print(f"\n| {' | '.join(names)} |\n|{'---|' * len(names)}")
        for row in rows_of(options, part):
            row |= {name: worst(row[name]) for name, worst in (("off", max), ("singular", min)) if name in row}
            cells = [row[name] for name in names]
            said = [
                f"{100 * cell:.3g} %" if name in shares else f"{cell:.4g}" if isinstance(cell, float) else str(cell)
                for name, cell in zip(names, cells, strict=True)
            ]
            print(f"| {' | '.join(said)} |")


def settings_of(options: argparse.Namespace) -> FitOptions:
    return FitOptions(seed=options.seed, starts=options.starts, refined=options.refined)


def store_of(options: argparse.Namespace):
    """Keeps every evaluation, so that a run that was ended goes on where it was."""
    folder = evaluation_folder(options.out / "evaluations", resume=(options.out / "evaluations").is_dir())
    return lambda objective: EstimateFolder(folder, objective)


def table_of(options: argparse.Namespace) -> Path:
    return options.shared / "measured" / "acrylic_uniaxial.csv"


def tell(options: argparse.Namespace, row: dict) -> None:
    """Print a row and add it to the file of the part, as soon as it is there."""
    line = json.dumps(_searched_with(options) | row, default=float)
    print(line, flush=True)
    with (options.out / f"{options.part}.jsonl").open("a", encoding="utf-8") as file:
        file.write(line + "\n")


PARTS = {
    "knits": knits, "ablations": ablations, "twins": twins, "one-yarn": one_yarn, "all": every, "table": tables,
}  # fmt: skip

if __name__ == "__main__":
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("part", choices=PARTS)
    arguments.add_argument("--shared", type=Path, default=Path("../shared"))
    arguments.add_argument("--out", type=Path, default=Path("estimates"))
    arguments.add_argument("--samples", nargs="+", choices=KNITS, default=list(KNITS))
    arguments.add_argument("--starts", type=int, default=64)
    arguments.add_argument("--refined", type=int, default=8)
    arguments.add_argument("--iterations", type=int, default=12, help="Gauss-Newton with one yarn in all")
    arguments.add_argument("--shapes", type=int, default=16, help="tried for each fabric with each first yarn")
    arguments.add_argument("--seed", type=int, default=0)
    arguments.add_argument("--workers", type=int, default=2)
    arguments.add_argument("--cases", nargs="+", choices=CASES, default=list(CASES), help="of the ablations")
    arguments.add_argument("--patterns", nargs="+", choices=TWINS, default=list(TWINS), help="of the twins")
    arguments.add_argument("--noises", nargs="+", type=float, default=[0.0, 0.03], help="of the twins")
    arguments.add_argument("--around", type=float, help="scatter twins' starts so far about the truth, of the ranges")
    arguments.add_argument("--holdouts", nargs="+", choices=("none", "warp"), default=["none", "warp"])
    arguments.add_argument("--pictures", action=argparse.BooleanOptionalAction, default=True, help="of the cells")
    chosen = arguments.parse_args()
    chosen.out.mkdir(parents=True, exist_ok=True)
    began = time.perf_counter()
    with local_workers(chosen.workers) if chosen.workers > 1 else nullcontext() as pool:
        PARTS[chosen.part](chosen, pool)
    print(f"{time.perf_counter() - began:.0f} s")
