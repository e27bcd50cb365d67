"""Pages of estimated yarns: measured, shell and yarn curves, parameters, and the cell at rest and stretched."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from yarnscale.arrays import Array
from yarnscale.cell.equilibrium import Equilibrium
from yarnscale.cell.periodic import PeriodicCell
from yarnscale.kinematics import ShellStrain
from yarnscale.show import theme
from yarnscale.show.canvas import Camera
from yarnscale.show.curves import pattern_curves, rings_for
from yarnscale.show.laboratory import numbers_section
from yarnscale.show.plots import written_figure
from yarnscale.show.report import Cell, Picture, Section, Table, scaled, write_report
from yarnscale.show.strained_pane import States, cell_pane
from yarnscale.show.tubes import room_of, yarn_picture
from yarnscale.swatches.measurements import COMFORT_LOAD, POWER_LOAD, StretchTest
from yarnscale.swatches.uniform_data import UniformCurve
from yarnscale.swatches.yarn_estimate import FabricEstimate
from yarnscale.swatches.yarn_friction import YarnFrictionFit
from yarnscale.swatches.yarn_model import UNITS
from yarnscale.swatches.yarn_states import YarnCurve

_MEANINGS = {
    "k_s1": "stretch stiffness up to the knee",
    "knee": "strain where the stiff phase begins",
    "k_b": "bending stiffness",
    "R_1": "outer contact radius",
    "k_c1": "outer contact stiffness",
    "aspect": "width over height, over the drawing's",
    "shortening": "yarn shorter at rest than drawn by",
    "draw_in": "share of the way that straight yarn would draw in",
}
_YARN, _SHELL, _CLOTH, _MEASURED = theme.YARNS[1], theme.YARNS[0], theme.YARNS[2], theme.INK


def write_estimate_report(folder: Path, estimate: FabricEstimate, *, units: str = "N/m", pictures: bool = True) -> Path:
    """Write ``index.html`` and its pictures; the path of the page.

    units: of loads, "N/m", "N/5cm", "N" on the measured swatch or "cN/tex" by the mass of the fabric. pictures: whether
    to draw the cell too. Raises InputError where the folder cannot be written, and
    PicturesUnavailable where the machine cannot draw.
    """
    summary, fit = estimate.summary(), estimate.fit
    curves_plot(folder / "curves.png", estimate, units=units)
    spread_plot(folder / "spread.png", estimate)
    sections = [
        Section(
            "The fabric at rest",
            ["What the data do not tell. " + ". ".join(_sentences(estimate.unknown)) + "."],
            [_construction(estimate)],
        ),
        Section("Curves", _words(estimate), [_errors(estimate)], [Picture(folder / "curves.png", wide=True)]),
        *([] if estimate.friction is None else [_friction(estimate.friction, estimate)]),
        Section(
            "Parameters",
            [
                "How far a parameter can move: the share of its range after which the root of the objective has grown "
                "by 0.01 while all others follow within theirs. What can move through its whole range is not known."
            ],
            [_parameters(estimate)],
            [
                Picture(
                    folder / "spread.png",
                    "Singular values of the sensitivity of the residuals, and which unknowns move in their directions",
                )
            ],
        ),
    ]
    if estimate.tests is not None:
        sections.append(replace(numbers_section(estimate.tests), title="Laboratory numbers of the estimated fabric"))
    if pictures:
        sections.append(Section("Pictures of the fabric", _shape(estimate), (), _cells(folder, estimate)))
    error, apart = estimate.error, estimate.without_friction
    facts: dict[str, Cell] = {
        "error against the measurement, comfort range": _percent(error.comfort),
        "full range": _percent(error.full),
        "contraction": _percent(error.compression),
        "shell alone, comfort range": _percent(estimate.shell_error.comfort),
        f"yarn against {estimate.followed}": _percent(estimate.yarn_error.comfort),
        **(
            {}
            if estimate.cloth is None
            else {f"simulated cloth against the swatches{apart}": _percent(estimate.cloth.errors.comfort)}
        ),
        "equilibria": fit.solves,
        "seconds": round(float(str(summary["seconds"]))),
    }
    path = folder / "index.html"
    said = " ".join(f"Warning: {warning}." for warning in estimate.warnings)
    write_report(path, f"Yarn of {estimate.measurements.name}", sections, summary=said, facts=facts)
    return path


def curves_plot(path: Path, estimate: FabricEstimate, *, units: str = "N/m") -> None:
    """Load and contraction over stretch, a column for each direction, those held out last."""
    shells = estimate.shell.uniform_data(follow="shell").curves
    triples = zip(estimate.measured.curves, shells, estimate.fit.evaluation.curves, strict=True)
    panels: list[tuple[UniformCurve, UniformCurve | None, YarnCurve]] = list(triples)
    if estimate.held_out is not None and estimate.prediction is not None:
        pairs = zip(estimate.held_out.curves, estimate.prediction.curves, strict=True)
        panels += [(target, None, curve) for target, curve in pairs]
    tests = {test.direction: test for test in estimate.measurements.stretch}
    cloth = {}
    if estimate.cloth is not None:
        triples = zip(estimate.cloth.measured.curves, estimate.cloth.loads, estimate.cloth.contractions, strict=True)
        cloth = {curve.direction: (curve.stretch, loads, across) for curve, loads, across in triples}
    with written_figure(path, max(7.0, 4.2 * len(panels)), 6.0) as figure:
        grid = figure.subplots(2, len(panels), squeeze=False, sharex="col")
        for k, (target, shell, curve) in enumerate(panels):
            test = tests[target.direction]
            factor = load_factor(units, test.swatch_width, estimate.cell.area_density)
            _stress_panel(grid[0, k], test, target, shell, curve, factor)
            _cycle(grid[0, k], estimate, target, factor)
            _contraction_panel(grid[1, k], test, target, shell, curve)
            if (simulated := cloth.get(target.direction)) is not None:
                style = {"color": _CLOTH, "linewidth": 1.4, "label": "swatches of homogenized cloth"}
                grid[0, k].plot(*_from_rest(simulated[0], factor * simulated[1]), **style)
                grid[1, k].plot(*_from_rest(simulated[0], 100 * simulated[2]), **style)
            grid[0, k].set_title(f"{target.direction.value}{', held out' if shell is None else ''}")
        grid[0, 0].set_ylabel(f"{'force' if units == 'N' else 'force over width'} [{units}]")
        grid[1, 0].set_ylabel("contraction across [%]")
        handles, labels = grid[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)


def load_factor(units: str, width: float, area_density: float) -> float:
    """What 1 N/m is in other units, on a swatch of a width [m] of fabric of a mass per area [kg/m²]."""
    return {"N/m": 1.0, "N/5cm": 0.05, "N": width, "cN/tex": 1e-4 / area_density}[units]


def _stress_panel(
    axes: Axes, test: StretchTest, target: UniformCurve, shell: UniformCurve | None, curve: YarnCurve, factor: float
) -> None:
    measured = test.curve.up_to(POWER_LOAD)
    comfort, power = factor * COMFORT_LOAD, factor * POWER_LOAD
    axes.axhspan(0, comfort, color=theme.YARNS[3], alpha=0.10, linewidth=0, label="comfort range")
    axes.axhspan(comfort, power, color=theme.YARNS[2], alpha=0.10, linewidth=0, label="power range")
    low, high = measured.stretch - measured.stretch_spread, measured.stretch + measured.stretch_spread
    axes.fill_betweenx(factor * measured.load, 100 * low, 100 * high, color=theme.MUTED, alpha=0.35, linewidth=0,
                       label="spread over runs")  # fmt: skip
    axes.plot(
        100 * measured.stretch,
        factor * measured.load,
        color=_MEASURED,
        linewidth=1.2,
        label="swatches, measured: loading",
    )
    for run in test.runs:
        if run.unloading is not None:
            back = run.unloading.length / run.rest_length - 1.0
            axes.plot(100 * back, factor * run.unloading.force / test.swatch_width, color=theme.MUTED, linewidth=0.7,
                      label="unloading" if run is test.runs[0] else None)  # fmt: skip
    axes.plot(
        *_from_rest(target.stretch, factor * target.stress),
        color=_MEASURED,
        linestyle=":",
        label="measured, without clamps",
    )
    if shell is not None:
        line = _from_rest(shell.stretch, factor * shell.stress)
        axes.plot(*line, color=_SHELL, linestyle="--", label="shell, without clamps")
    _yarn_line(axes, target, curve, curve.stress, factor)
    axes.set_ylim(0, 1.15 * power)
    axes.set_xlim(left=0)


def _cycle(axes: Axes, estimate: FabricEstimate, target: UniformCurve, factor: float) -> None:
    """Both branches of the yarn with friction."""
    for cycle in () if estimate.friction is None else estimate.friction.simulated:
        if cycle.direction is target.direction:
            stretch = np.append(cycle.stretch, cycle.stretch[::-1])
            stress = np.maximum(np.append(cycle.loading, cycle.unloading[::-1]), 0.0)
            style = {"color": _YARN, "linewidth": 1.2, "linestyle": "-.", "label": "yarn with friction"}
            axes.plot(100 * stretch, factor * stress, **style)


def _contraction_panel(
    axes: Axes, test: StretchTest, target: UniformCurve, shell: UniformCurve | None, curve: YarnCurve
) -> None:
    measured = test.curve.up_to(POWER_LOAD)
    if measured.contraction is not None and measured.contraction_spread is not None:
        low, high = (measured.contraction + sign * measured.contraction_spread for sign in (-1, 1))
        axes.fill_between(100 * measured.stretch, 100 * low, 100 * high, color=theme.MUTED, alpha=0.35, linewidth=0)
        axes.plot(100 * measured.stretch, 100 * measured.contraction, color=_MEASURED, linewidth=1.2)
        axes.plot(*_from_rest(target.stretch, 100 * target.contraction), color=_MEASURED, linestyle=":")
    if shell is not None:
        axes.plot(*_from_rest(shell.stretch, 100 * shell.contraction), color=_SHELL, linestyle="--")
    _yarn_line(axes, target, curve, curve.contraction, 100.0)
    axes.axvspan(0, 100 * target.comfort_stretch, color=theme.YARNS[3], alpha=0.10, linewidth=0)
    axes.axvspan(100 * target.comfort_stretch, 100 * target.stretch[-1], color=theme.YARNS[2], alpha=0.10, linewidth=0)
    axes.set_xlabel("stretch [%]")


def _from_rest(stretch: Array, values: Array) -> tuple[Array, Array]:
    return 100 * np.append(0.0, stretch), np.append(0.0, values)


def _yarn_line(axes: Axes, target: UniformCurve, curve: YarnCurve, values: Array, scale: float) -> None:
    good = curve.converged
    line = _from_rest(target.stretch[good], scale * values[good])
    axes.plot(*line, color=_YARN, marker="o", markersize=3, linewidth=1.8, label="yarn model", zorder=3)


def spread_plot(path: Path, estimate: FabricEstimate) -> None:
    """Singular values, and the share of every parameter in their directions."""
    spread = estimate.fit.spread
    with written_figure(path, 6.4, 3.4) as figure:
        left, right = figure.subplots(1, 2, width_ratios=[1, 1.6])
        numbers = np.arange(1, len(spread.singular) + 1)
        left.bar(numbers, np.maximum(spread.singular, 1e-6), color=theme.SAMPLE)
        left.set(yscale="log", xticks=numbers, xlabel="singular direction", ylabel="singular value")
        right.grid(False)
        image = right.imshow(spread.vectors.T**2, cmap="Blues", vmin=0, vmax=1, aspect="auto")
        right.set_yticks(range(len(spread.names)), spread.names)
        right.set_xticks(range(len(numbers)), [str(n) for n in numbers])
        right.set_xlabel("singular direction")
        figure.colorbar(image, ax=right, label="share of the unknown")


def _sentences(parts: Sequence[str]) -> list[str]:
    return [part[:1].upper() + part[1:] for part in parts] or ["Nothing stands out"]


def _construction(estimate: FabricEstimate) -> Table:
    """Counts and masses, estimated and measured."""
    measured, found = estimate.measurements, estimate.construction
    known = measured.known
    rows: list[list[Cell]] = [
        ["wales [1/cm]", scaled(found.wales, 1e-2), scaled(known.wales, 1e-2)],
        ["courses [1/cm]", scaled(found.courses, 1e-2), scaled(known.courses, 1e-2)],
        ["loop length [mm]", scaled(found.loop_length, 1e3), scaled(known.yarn_in_stitch, 1e3)],
        ["yarn in one period [mm]", 1e3 * found.yarn_length, None],
        ["yarn count [tex]", 1e6 * found.yarn_count, scaled(measured.yarn_count, 1e6)],
        ["area density [g/m²]", 1e3 * found.area_density, scaled(measured.area_density, 1e3)],
        ["thickness [mm]", 1e3 * found.thickness, None],
    ]
    for direction, (own, given) in estimate.bending.items():
        rows.append([f"bending rigidity B along {direction.value} [µN m]", 1e6 * own, 1e6 * given])
    own = set() if estimate.friction is None else {cycle.direction for cycle, _ in estimate.friction.pairs}
    for test in measured.stretch:
        if test.lost_work is not None and test.direction not in own:
            rows.append([f"work lost in unloading, {test.direction.value}", None, _percent(test.lost_work)])
    return Table(["", "estimated", "measured"], rows)


def _errors(estimate: FabricEstimate) -> Table:
    rows: list[list[Cell]] = [
        [name, *map(_percent, (errors.comfort, errors.full, errors.compression)), failed]
        for name, errors, failed in estimate.error_rows()
    ]
    columns = ["errors", "stress, comfort range", "stress, full range", "contraction", "states not at rest"]
    caption = "Mean errors of σ/(1 + s) and of the contraction over the largest measured value of the comfort range"
    return Table(columns, rows, caption)


def _friction(fit: YarnFrictionFit, estimate: FabricEstimate) -> Section:
    """Friction of the yarns, and both branches of every direction in numbers."""
    share = "as much"
    if not fit.matched:
        share = f"{100 * abs(fit.missed):.1f} % {'more' if fit.missed > 0 else 'less'}"
    text = [
        f"Coefficient {fit.coefficient:.3g} ± {fit.uncertainty:.2g}: with it the cell returns {share} of the work of "
        f"loading {'as' if fit.matched else 'than'} was measured; the uncertainty is that of 2 % of the work. The "
        "elastic yarn is fitted to what the measured loading would be without friction, in the ratio of the cell's own."
    ]
    missed, rows = fit.unloading_error(estimate.measured), []
    for cycle, own in fit.pairs:
        alone = fit.by_direction.get(cycle.direction)
        rows.append(
            [
                cycle.direction.value, alone, _percent(own.returned), _percent(cycle.returned),
                _percent(own.stretch_left), _percent(cycle.stretch_left), _percent(missed[cycle.direction]),
            ]
        )  # fmt: skip
    columns = [
        "direction", "friction by it alone", "work returned", "measured", "stretch left", "measured",
        "error of unloading",
    ]  # fmt: skip
    return Section("Friction of the yarns", text, [Table(columns, rows)])


def _parameters(estimate: FabricEstimate) -> Table:
    fit, rows = estimate.fit, []
    low, high = fit.model.bounds
    for k, name in enumerate(fit.model.names):
        where = "at the end of its range" if name in fit.at_bounds else ""
        power = estimate.parameters[name] / float(fit.values[k]) if fit.values[k] else 1.0
        values: list[Cell] = [estimate.parameters[name], *(power * float(end) for end in (low[k], high[k]))]
        meaning, unit = _MEANINGS[name], UNITS.get(name, "–")
        rows.append([name, meaning, unit, *values, _percent(float(fit.spread.shift[k])), where])
    columns = ["parameter", "what", "unit", "value", "least", "largest", "can move by", ""]
    return Table(columns, rows)


def _words(estimate: FabricEstimate) -> list[str]:
    fit, text = estimate.fit, []
    text.append(
        f"Solver {fit.options.solver}, {fit.evaluations} yarns tried, {fit.solves} equilibria, "
        f"{fit.cpu_seconds:.0f} s of all processes."
    )
    if (deviation := estimate.deviation) is not None:
        text.append(f"{deviation[0].upper()}{deviation[1:]}.")
    if estimate.failed:
        text.append(f"{estimate.failed} states are not at rest; they are left out of curves and errors.")
    if estimate.biaxial is not None:
        shares = ", ".join(f"{name} {100 * share:.0f} %" for name, share in estimate.biaxial.items())
        apart = "" if estimate.friction is None else ", yarn without friction"
        text.append(f"Weft and warp pulled at once, mean error over the largest load{apart}: {shares}.")
    if fit.at_bounds:
        text.append("At the ends of their ranges: " + ", ".join(fit.at_bounds) + ".")
    return text + list(estimate.measurements.notes)


def _shape(estimate: FabricEstimate) -> list[str]:
    pattern, change = estimate.cell.pattern, estimate.fit.evaluation.rested.change
    px, py = 1e3 * pattern.period
    return [
        f"Period at rest {px:.3g} × {py:.3g} mm, R_est {1e3 * pattern.radius:.3g} mm. Coming to rest changed the drawn "
        f"periods by {100 * change[0]:.1f} % and {100 * change[1]:.1f} %. Yarns are drawn as thick as they can be "
        "without running through each other, up to R_est; all pictures have one scale."
    ]


def _cells(folder: Path, estimate: FabricEstimate) -> list[Picture]:
    """The cell at rest, from two sides, and at the largest stretch of every direction, on one scale."""
    cell = estimate.fit.evaluation.rested.cell
    shown: list[tuple[str, Equilibrium | None, Camera]] = [
        ("at rest", None, "top"),
        ("at rest, seen along the wales", None, "side"),
    ]
    evaluations = [("", estimate.fit.evaluation)]
    if estimate.prediction is not None:
        evaluations.append((", held out", estimate.prediction))
    for held, evaluation in evaluations:
        for curve in evaluation.curves:
            good = np.flatnonzero(curve.converged)
            if len(good):
                k = int(good[-1])
                words = f"{curve.direction.value}{held}, stretched by {100 * curve.stretch[k]:.0f} %"
                shown.append((words, curve.states[k], "top"))
    strains = [ShellStrain() if state is None else state.strain for _, state, _ in shown]
    periods = [cell.pattern.period * [1.0 + strain.s_x, 1.0 + strain.s_y] for strain in strains]
    # As much fabric in every picture, so that what is at rest is no stamp beside what is stretched to thrice its width.
    side = max(3.0 * float(np.max(periods)), 32.0 * cell.pattern.radius)
    pieces = [
        pattern_curves(cell.pattern, cell.placement(state), rings=rings_for(period, side / 32.0))
        for (_, state, _), period in zip(shown, periods, strict=True)
    ]
    radius, pictures = _drawn_radius(cell, [state for _, state, _ in shown]), []
    room = room_of(pieces, radius)
    for number, ((caption, _, camera), piece) in enumerate(zip(shown, pieces, strict=True)):
        path = folder / f"cell-{number}.png"
        yarn_picture(path, piece, radius, camera=camera, size=(720, 720), room=room)
        pictures.append(Picture(path, caption))
    rest = cell.relax()
    paths = {
        f"tension along the {curve.direction.value}{held}": [
            rest,
            *(state for state, good in zip(curve.states, curve.converged, strict=True) if good),
        ]
        for held, evaluation in evaluations
        for curve in evaluation.curves
    }
    states = States.of([rest, *(state for path in paths.values() for state in path[1:])], paths)
    pictures[0] = replace(pictures[0], pane=cell_pane(cell, states, "at rest and along the curves"))
    return pictures


def _drawn_radius(cell: PeriodicCell, states: Sequence[Equilibrium | None]) -> float:
    """A radius at which yarns that press on each other do not run through each other much."""
    gaps = [state.min_distance_over_diameter for state in states if state is not None]
    closest = min([gap for gap in gaps if np.isfinite(gap)], default=1.0)
    return cell.pattern.radius * float(np.clip(closest, 0.5, 1.0))


def _percent(value: float | None) -> str | None:
    return None if value is None or not np.isfinite(value) else f"{100 * value:.1f}\N{NO-BREAK SPACE}%"
