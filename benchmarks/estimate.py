"""Estimation of yarns: measured knits, twins, ablations, the published solver. Run with --help for the parts.

python benchmarks/estimate.py knits --shared ../shared --out DIR
"""

from __future__ import annotations

import argparse
import json
import time
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np

from yarnscale.estimate.evaluations import Evaluations
from yarnscale.estimate.fabric_shell import fit_shell
from yarnscale.estimate.gauss_newton import gauss_newton
from yarnscale.estimate.measurements import Direction
from yarnscale.estimate.objective import YarnObjective, coarser
from yarnscale.estimate.one_yarn import SharedObjective, with_one_yarn
from yarnscale.estimate.uniform_data import UniformCurve, UniformData
from yarnscale.estimate.yarn_estimate import UNKNOWN_STIFFNESS, estimate_yarn
from yarnscale.estimate.yarn_fit import FitOptions, fit_yarn
from yarnscale.estimate.yarn_model import YarnModel, yarn_model
from yarnscale.estimate.yarn_rest import RestRule
from yarnscale.files.measurements import read_measurements
from yarnscale.homogenize.executors import local_workers
from yarnscale.yarn.library import build

KNITS = {
    "Stockinette": ("stockinette", 11.28e-3),
    "Garter": ("garter", 2 * 10.55e-3),
    "Rib": ("rib-1x1", 16.10e-3),
    "Seed": ("seed", 2 * 15.67e-3),
}
"""Sample -> pattern, yarn in one period of it [m], from the authors' yarn length per repeat of their unit cell."""
TWIN_TRUTH = {
    "stockinette": np.array([0.12, 0.15, 0.40, 0.60, 0.60]),
    "rib-1x1": np.array([0.12, 0.15, 0.40, 0.60, 0.60]),
    "garter": np.array([0.12, 0.15, 0.40, 0.60, 0.60]),
}
TWIN_STRETCH = {"stockinette": (0.7, 0.4), "rib-1x1": (0.9, 0.4), "garter": (0.7, 0.7)}
"""Largest stretch along weft and warp."""


def model_of(sample: str, *, free: bool = True) -> YarnModel:
    """The model of a measured knit."""
    pattern, length = KNITS[sample]
    return yarn_model(build(pattern), UNKNOWN_STIFFNESS, yarn_length=length, free_shape=free)


def knits(options: argparse.Namespace, executor) -> list[dict]:
    """Each knit with both directions, and with the warp held out."""
    from yarnscale.show.estimate import write_estimate_report, write_summary_report

    rows, found = [], []
    for sample in options.samples:
        measured = read_measurements(_table(options), sample=f"Acrylic Yarn {sample}")
        for holdout in (None, Direction.WARP):
            estimate = estimate_yarn(
                measured, model_of(sample), holdout=holdout, executor=executor, options=_settings(options)
            )
            rows.append({"sample": sample, "holdout": str(holdout), **estimate.summary()})
            folder = options.out / f"{sample}{'' if holdout is None else '-holdout'}"
            folder.mkdir(parents=True, exist_ok=True)
            write_estimate_report(folder, estimate)
            if holdout is None:
                found.append(estimate)
            _tell(rows[-1])
    write_summary_report(options.out / "index.html", found)
    return rows


def ablations(options: argparse.Namespace, executor) -> list[dict]:
    """Local search alone, linear stretch, no rest shape; against the default (EST22 Fig. 11, 16, 17)."""
    rows = []
    for sample in options.samples:
        data = fit_shell(read_measurements(_table(options), sample=f"Acrylic Yarn {sample}")).uniform_data()
        default, model = _settings(options), model_of(sample)
        cases = {
            "default": (model, default, RestRule()),
            "local": (model, replace(default, solver="local"), RestRule()),
            "linear": (replace(model, two_phase=False), default, RestRule()),
            "as-drawn": (model, default, RestRule(rounds=0, release=False)),
        }
        if options.paper:
            cases["paper"] = (model, replace(default, solver="paper"), RestRule())
        for name, (case, settings, rule) in cases.items():
            fit = fit_yarn(case, data, options=settings, rule=rule, executor=executor)
            errors = fit.evaluation.errors
            rows.append({"sample": sample, "case": name, "objective": fit.objective, "comfort": errors.comfort,
                         "full": errors.full, "compression": errors.compression, "solves": fit.solves,
                         "failed": fit.evaluation.failed, "cpu_seconds": fit.cpu_seconds})  # fmt: skip
            _tell(rows[-1])
    return rows


def twins(options: argparse.Namespace, executor) -> list[dict]:
    """Parameters found again from a yarn's own curves, without and with noise of 3 % of every value."""
    rows = []
    for pattern, truth in TWIN_TRUTH.items():
        model = yarn_model(build(pattern), 20.0, yarn_length=None)
        clean = twin_data(model, truth, TWIN_STRETCH[pattern])
        for noise in (0.0, 0.03):
            generator = np.random.default_rng(1)
            data = replace(clean, curves=tuple(_noisy(curve, noise, generator) for curve in clean.curves))
            fit = fit_yarn(model, data, options=_settings(options), executor=executor)
            errors = clean.errors(
                [c.stress for c in fit.evaluation.curves], [c.contraction for c in fit.evaluation.curves]
            )
            off = np.abs(fit.values / model.values(truth) - 1.0)
            rows.append({"pattern": pattern, "noise": noise, "off": off.tolist(), "stress": errors.full,
                         "contraction": errors.compression, "objective": fit.objective, "solves": fit.solves,
                         "shift": fit.spread.shift.tolist()})  # fmt: skip
            _tell(rows[-1])
    return rows


def twin_data(
    model: YarnModel, truth: np.ndarray, largest: tuple[float, float], samples: int = 20
) -> UniformData:
    """Uniform data that a yarn makes itself."""
    curves = []
    for direction, end in zip((Direction.WEFT, Direction.WARP), largest, strict=True):
        stretch = end * np.arange(1, samples + 1) / samples
        blank = UniformCurve(direction, stretch, np.ones(samples), np.ones(samples), end)
        curve = YarnObjective(model, UniformData("twin", (blank,))).evaluate(truth).curves[0]
        curves.append(UniformCurve(direction, stretch, curve.contraction, curve.stress, end))
    return UniformData("twin", tuple(curves))


def _noisy(curve: UniformCurve, noise: float, generator: np.random.Generator) -> UniformCurve:
    factors = 1.0 + noise * generator.standard_normal((2, len(curve.stretch)))
    return replace(curve, stress=curve.stress * factors[0], contraction=curve.contraction * factors[1])


def one_yarn(options: argparse.Namespace, executor) -> list[dict]:
    """All knits with the parameters of one yarn, each with its own shape, from fits of each alone."""
    models = with_one_yarn([model_of(sample) for sample in options.samples])
    parts, starts = [], []
    for sample, model in zip(options.samples, models, strict=True):
        data = fit_shell(read_measurements(_table(options), sample=f"Acrylic Yarn {sample}")).uniform_data()
        fit = fit_yarn(model, data, options=_settings(options), executor=executor)
        parts.append(YarnObjective(model, coarser(data, 7)))
        starts.append(fit.evaluation.unknowns)
    shared = SharedObjective(tuple(parts))
    evaluations = Evaluations(shared, executor)  # pyright: ignore[reportArgumentType]
    joined = shared.joined(starts)
    # From the middle of the yarns, and from each of them in all fabrics.
    tries = [joined] + [np.concatenate([start[:5], joined[5:]]) for start in starts]
    first = tries[int(np.argmin([found.objective for found in evaluations.many(tries)]))]
    found = shared.evaluate(gauss_newton(evaluations, first, iterations=12))
    values = models[0].values(found.parts[0].unknowns)
    rows = [{"parameters": values[:5].tolist(), "solves": evaluations.solves}]
    for sample, part in zip(options.samples, found.parts, strict=True):
        errors = part.errors
        rows.append({"sample": sample, "comfort": errors.comfort, "full": errors.full,
                     "compression": errors.compression, "failed": part.failed})  # fmt: skip
    for row in rows:
        _tell(row)
    return rows


def _settings(options: argparse.Namespace) -> FitOptions:
    return FitOptions(seed=options.seed, starts=options.starts)


def _table(options: argparse.Namespace) -> Path:
    return options.shared / "measured" / "acrylic_uniaxial.csv"


def _tell(row: dict) -> None:
    print(json.dumps(row, default=float), flush=True)


PARTS = {"knits": knits, "ablations": ablations, "twins": twins, "one-yarn": one_yarn}

if __name__ == "__main__":
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("part", choices=PARTS)
    arguments.add_argument("--shared", type=Path, default=Path("../shared"))
    arguments.add_argument("--out", type=Path, default=Path("estimates"))
    arguments.add_argument("--samples", nargs="+", choices=KNITS, default=list(KNITS))
    arguments.add_argument("--starts", type=int, default=128)
    arguments.add_argument("--seed", type=int, default=0)
    arguments.add_argument("--workers", type=int, default=2)
    arguments.add_argument("--paper", action="store_true", help="the published solver too")
    chosen = arguments.parse_args()
    began = time.perf_counter()
    with local_workers(chosen.workers) if chosen.workers > 1 else nullcontext() as pool:
        PARTS[chosen.part](chosen, pool)
    print(f"{time.perf_counter() - began:.0f} s")
