"""The estimated yarn of a fabric: its errors, what the data do not determine, and what to distrust."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from yarnscale.arrays import Array
from yarnscale.cell.periodic import PeriodicCell
from yarnscale.kinematics import ShellStrain
from yarnscale.laboratory.programme import FabricTests
from yarnscale.swatches.cloth_check import ClothCheck, without_own_clamps
from yarnscale.swatches.construction import FabricConstruction, sized, weighed
from yarnscale.swatches.fabric_shell import FabricShell
from yarnscale.swatches.measurements import POWER_LOAD, Direction, SwatchMeasurements
from yarnscale.swatches.objective import Evaluation
from yarnscale.swatches.uniaxial import biaxial_stress
from yarnscale.swatches.uniform_cycle import has_unloading
from yarnscale.swatches.uniform_data import UniformData, UniformErrors, swatch_data
from yarnscale.swatches.yarn_fit import AMBIGUOUS, YarnFit
from yarnscale.swatches.yarn_friction import YarnFrictionFit, with_yarn_friction
from yarnscale.swatches.yarn_states import bending_stiffness

UNKNOWN_STIFFNESS = 60.0
"""k_s2 where the yarn's stiffness at 5 cN was not measured [N]: a spun hand-knitting yarn, to a factor of three.
Fabrics stretch by bending and sliding of their loops long before such a yarn stretches, so little depends on it."""


_OFF = 0.1
"""Error of the shell, and effect of the clamps computed with such a shell, from which there is a warning."""

_BIAXIAL = 7
"""Biaxial states at which the yarn is compared, at most."""
_FREE = 0.5
"""Share of its range through which a parameter can move that counts as unknown."""
_LARGE_EFFECT = 0.3
"""Effect of clamps that needs a warning however good the shell is."""

Follow = Literal["measured", "shell"]


@dataclass(frozen=True, eq=False)
class FabricEstimate:
    """The estimated yarn of a fabric, and how far it is from the measurement.

    follow: what the yarn was fitted to. shell: fitted to the directions that the yarn was fitted to. measured: the
    measured curves of these directions without the effect of the clamps, which the errors refer to. held_out: the
    measured curves of the other directions, likewise, and what the yarn does there; None where there are none.
    short: strips shorter than wide, simulated as cloth of the shell, if any. cloth: the swatches simulated as cloth of
    the homogenized yarn, if any. tests: of the laboratory on the fabric at rest, if any.
    clamps: with which cloth their effect on the measurement was computed, the fitted shell or that of an earlier fit.
    friction: of the yarns, if it was fitted; the yarn of ``fit`` is fitted to the curves without its part. remarks: on
    how they were fitted, which are warnings.
    """

    measurements: SwatchMeasurements
    follow: Follow
    shell: FabricShell
    fit: YarnFit
    measured: UniformData
    held_out: UniformData | None
    prediction: Evaluation | None
    short: ClothCheck | None = None
    cloth: ClothCheck | None = None
    tests: FabricTests | None = None
    clamps: Literal["shell", "cloth"] = "shell"
    friction: YarnFrictionFit | None = None
    remarks: tuple[str, ...] = ()

    @cached_property
    def cell(self) -> PeriodicCell:
        """The fabric at rest with the estimated yarn, whose density follows from the measured mass."""
        measured = self.measurements
        cell = weighed(
            sized(self.fit.evaluation.rested.cell, self.scale),
            area_density=measured.area_density, yarn_count=measured.yarn_count,
        )  # fmt: skip
        return cell if self.friction is None else with_yarn_friction(cell, self.friction.coefficient)

    @cached_property
    def bending(self) -> dict[Direction, tuple[float, float]]:
        """Rigidity B of the yarn's fabric and of the measured one by direction [N m]."""
        bends = self.measured.bending if self.fit.evaluation.rested.relaxed else ()
        own = bending_stiffness(self.cell, [bend.direction for bend in bends]) if bends else ()
        return {
            bend.direction: (2.0 * float(k), 2.0 * bend.stiffness)
            for bend, k in zip(bends, own, strict=True)
            if np.isfinite(k)
        }

    @cached_property
    def biaxial(self) -> dict[str, float] | None:
        """Mean errors of shell and yarn, without friction, over the largest load of weft and warp pulled at once."""
        if self.measurements.biaxial is None or not self.fit.evaluation.rested.relaxed:
            return None
        measured = self.measurements.biaxial.up_to(POWER_LOAD, _BIAXIAL)
        states = [self.cell.relax(ShellStrain(s_x=float(x), s_y=float(y))) for x, y in measured.stretch]
        yarn = np.array([s.stress[[0, 2]] if s.converged else [np.nan] * 2 for s in states])
        stresses = {"shell": biaxial_stress(self.shell.membrane.material, measured.stretch), "yarn": yarn}
        largest = float(measured.load.max())
        return {name: float(np.nanmean(np.abs(s - measured.load))) / largest for name, s in stresses.items()}

    @property
    def scale(self) -> float:
        """Size of the fabric over that of the fit, by the stitch density where that is known."""
        model, period = self.fit.model, self.fit.evaluation.rested.cell.pattern.period
        if model.stitch_area is None or model.stitches is None:
            return 1.0
        return math.sqrt(model.stitch_area * math.prod(model.stitches) / float(np.prod(period)))

    @property
    def parameters(self) -> dict[str, float]:
        """Estimated parameters by name, in SI, with k_s2 and R_est."""
        fit, powers = self.fit, {"k_s1": 1, "k_b": 3, "R_1": 1}
        found = dict(zip(fit.model.names, fit.values.tolist(), strict=True))
        found = {name: value * self.scale ** powers.get(name, 0) for name, value in found.items()}
        return found | {
            "k_s2": self.scale * fit.model.stiffness, "R_est": self.scale * fit.model.pattern.radius,
        }  # fmt: skip

    @property
    def construction(self) -> FabricConstruction:
        """Stitch density, yarn count and the like of the fabric at rest."""
        return FabricConstruction.of(self.cell, self.fit.model.stitches)

    @property
    def target(self) -> UniformData:
        """The curves that the yarn follows, with friction in them."""
        return self.measured if self.follow == "measured" else self.shell.uniform_data(follow="shell")

    @cached_property
    def loading(self) -> tuple[tuple[Array, Array], ...]:
        """Stress [N/m] and contraction of the yarn, with its friction, at the stretches of ``measured``; or NaN."""
        return self._loading(self.fit.evaluation, self.measured)

    def _loading(self, evaluation: Evaluation, data: UniformData) -> tuple[tuple[Array, Array], ...]:
        if self.friction is not None:
            return tuple(self.friction.loading_at(curve) for curve in data.curves)
        return tuple(
            (np.where(c.converged, c.stress, np.nan), np.where(c.converged, c.contraction, np.nan))
            for c in evaluation.curves
        )

    @property
    def failed(self) -> int:
        """States of the measured directions at which the yarn is not at rest, or which it cannot follow with friction.

        Those beyond the measured cycle are left out of the errors, but did not fail.
        """
        return self._failed(self.fit.evaluation)

    def _failed(self, evaluation: Evaluation) -> int:
        lost = (
            [] if self.friction is None else [c for c in evaluation.curves if c.direction in self.friction.not_followed]
        )
        return evaluation.failed + sum(int(curve.converged.sum()) for curve in lost)

    @property
    def error(self) -> UniformErrors:
        """Of the yarn against the measurement: the error of the estimate."""
        stresses, contractions = zip(*self.loading, strict=True)
        return self.measured.errors(stresses, contractions)

    @property
    def shell_error(self) -> UniformErrors:
        """Of the fitted shell against the measurement, both in uniform stretch."""
        curves = self.shell.uniform_data(follow="shell").curves
        measured = self.shell.uniform_data(follow="measured")
        return measured.errors([c.stress for c in curves], [c.contraction for c in curves])

    @property
    def yarn_error(self) -> UniformErrors:
        """Of the yarn against what it was fitted to: the shell, or the measurement."""
        return self.fit.evaluation.errors

    @property
    def held_out_error(self) -> UniformErrors | None:
        """Of the yarn against the measurement in the directions that it was not fitted to."""
        if self.prediction is None or self.held_out is None:
            return None
        stresses, contractions = zip(*self._loading(self.prediction, self.held_out), strict=True)
        return self.held_out.errors(stresses, contractions)

    def error_rows(self) -> Iterator[tuple[str, UniformErrors, int | None]]:
        """Every error, its name, and the number of states without equilibrium."""
        yield "yarn against the measurement", self.error, self.failed
        for along, errors in self.error.directions.items():
            yield f"{along.value} alone", errors, None
        if self.held_out_error is not None and self.prediction is not None:
            yield "held out, predicted", self.held_out_error, self._failed(self.prediction)
        yield "stage 1: shell against the measurement", self.shell_error, None
        if self.short is not None:
            yield "shell against strips shorter than wide, not fitted", self.short.errors, None
        yield f"stage 2: yarn against {self.followed}", self.yarn_error, None
        if self.cloth is not None:
            lost = sum(int((~response.converged).sum()) for response in self.cloth.responses)
            swatches = f"the measured swatches{self.without_friction}"
            yield f"stage 3: simulated cloth against {swatches}", self.cloth.errors, lost

    @property
    def followed(self) -> str:
        """What the yarn was fitted to, in words."""
        return ("the measurement" if self.follow == "measured" else "the shell") + self.without_friction

    @property
    def without_friction(self) -> str:
        """What is said of curves from which the part of friction was taken, nothing where it was not fitted."""
        return "" if self.friction is None else ", both without friction"

    @property
    def deviation(self) -> str | None:
        """``largest_deviation`` in words."""
        if self.largest_deviation is None:
            return None
        along, stretch, own, measured = self.largest_deviation
        place = f"{along.value} at a stretch of {100 * stretch:.0f} %"
        return (
            f"largest deviation in the comfort range: {place}, where the yarn has {own:.3g} N/m and the fabric "
            f"{measured:.3g} N/m"
        )

    @property
    def largest_deviation(self) -> tuple[Direction, float, float, float] | None:
        """Direction, stretch, stress of the yarn and measured stress [N/m] where they differ most in the comfort range.

        None where no state is at rest.
        """
        found = [
            (abs(own - target), curve.direction, stretch, own, target)
            for curve, (stress, _) in zip(self.measured.curves, self.loading, strict=True)
            for stretch, own, target, used in zip(
                curve.stretch.tolist(), stress.tolist(), curve.stress.tolist(),
                (curve.comfort & np.isfinite(stress)).tolist(), strict=True,
            )
            if used
        ]  # fmt: skip
        return max(found, key=lambda entry: entry[0])[1:] if found else None

    @property
    def clamp_effect(self) -> float:
        """Largest effect of the clamps, as a share of the measured force of the comfort range."""
        tests = {test.direction: test.curve for test in self.measurements.stretch}
        return _largest(
            (curve.stress / tests[curve.direction].load_at(curve.stretch) - 1.0)[curve.comfort]
            for curve in self.measured.curves
        )

    @property
    def clamp_difference(self) -> float:
        """Largest relative difference of the stress without clamps, as the shell and as the cloth of the yarn has them.

        Zero without cloth.
        """
        if self.cloth is None:
            return 0.0
        clean = without_own_clamps(self.cloth, swatch_data(self.measurements))
        own = {curve.direction: curve.stress for curve in clean.curves}
        return _largest((own[c.direction] / c.stress - 1.0)[c.comfort] for c in self.measured.curves)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences on results that are not to be trusted."""
        shell, yarn = self.shell_error.comfort, self.yarn_error.comfort
        found = []
        if self.follow == "shell" and shell > _OFF and shell > yarn:
            found.append(
                f"the shell is {100 * shell:.0f} % off the measurement in the comfort range, the yarn only "
                f"{100 * yarn:.0f} % off the shell: what the yarn misses is the shell's error; try --follow measured"
            )
        left, scale = float(np.abs(self.fit.evaluation.rested.stress).max()), self.measured.stress_scale
        if left > _OFF * scale:
            found.append(
                f"yarns set as drawn leave a coarse stress of {left:.2g} N/m in the fabric at rest, "
                f"{100 * left / scale:.0f} % of the largest of the comfort range: it would change its periods"
            )
        if (ambiguity := self.fit.ambiguity) > AMBIGUOUS:
            change = f"give stresses that differ by {100 * ambiguity:.2g} % of the largest of the comfort range"
            if not np.isfinite(ambiguity):
                change = "do not converge to the same states"
            found.append(
                "the rest shape of the yarns is not unique: load paths from parameters that hardly differ "
                f"{change}, and another computer may find other parameters"
            )
        effect = self.clamp_effect
        if self.clamps == "shell" and (effect > _LARGE_EFFECT or (effect > _OFF and shell > _OFF)):
            found.append(
                f"clamps change the force by up to {100 * effect:.0f} %, as a shell says that is itself "
                f"{100 * shell:.0f} % off the measurement in the comfort range: longer swatches depend less on clamps"
            )
        if self.friction is not None:
            found.extend(self.friction.warnings)
        found.extend(self.remarks)
        if self.shell.membrane.assumed_contraction:
            found.append(
                "contraction was not measured: the usual one of knits is assumed to take out the effect of the clamps"
            )
        return tuple(found)

    @property
    def unknown(self) -> tuple[str, ...]:
        """Quantities that the measurement does not determine, in sentences."""
        fit, tests, found = self.fit, self.measurements.stretch, []
        free = [name for name, shift in zip(fit.spread.names, fit.spread.shift, strict=True) if shift > _FREE]
        if free:
            found.append(
                f"{', '.join(free)}: other values, together with others of the rest, give the same curves within 1 %"
            )
        missing = [d for d in Direction if d not in [test.direction for test in tests]]
        for along in missing:
            if along is Direction.BIAS:
                found.append("resistance to shear: no swatch was pulled along the bias")
            else:
                found.append(
                    f"stress along the {along.value}: no swatch was pulled along it; yarns of three knits that were "
                    "fitted along the weft alone were 29 to 40 % off along the warp"
                )
        if narrow := [t.direction.value for t in tests if t.curve.contraction is None]:
            found.append(f"contraction along {', '.join(narrow)}: no width was measured")
        if not self.bending:
            found.append("bending: it was not measured, so it follows from the yarn that the tensile curves suggest")
        if self.friction is None and any(has_unloading(test) for test in tests):
            found.append(
                "friction of the yarns: loading alone was fitted, of which friction is a part (--fit-friction)"
            )
        if self.measurements.area_density is None and self.measurements.yarn_count is None:
            found.append("mass of the yarn: neither the fabric nor its yarn was weighed, so its density is assumed")
        if self.measurements.known.stitch_area is None and self.measurements.known.yarn_in_stitch is None:
            found.append("size of the stitches: neither stitch density nor loop length was measured")
        return tuple(found)

    def summary(self) -> dict[str, object]:
        """The numbers that the command prints."""
        fit, largest = self.fit, self.largest_deviation
        names = ("direction", "stretch", "stress", "measured_stress")
        error = self.error.summary()
        error["largest"] = largest and dict(zip(names, (largest[0].value, *largest[1:]), strict=True))
        found: dict[str, object] = {
            "error": error,
            "stages": {
                "shell": self.shell_error.summary()
                | {
                    "swatch_load": self.shell.membrane.load_error,
                    "swatch_contraction": self.shell.membrane.contraction_error,
                    "clamp_effect": self.clamp_effect,
                    "clamps_by": self.clamps,
                    "short_strips": None if self.short is None else self.short.errors.summary(),
                },
                "yarn": {"follows": self.follow, **self.yarn_error.summary()},
            },
            "warnings": [*self.warnings],
            "unknown": [*self.unknown],
            "friction": None if self.friction is None else self.friction.summary(self.measured),
            "lost_work": {t.direction.value: t.lost_work for t in self.measurements.stretch},
            "notes": [*self.measurements.notes],
            "parameters": self.parameters,
            "bending_error": float(np.mean([abs(own / B - 1.0) for own, B in self.bending.values()]))
            if self.bending
            else None,
            "bending_rigidity": {
                along.value: {"estimated": own, "measured": measured} for along, (own, measured) in self.bending.items()
            },
            "solves": fit.solves,
            "seconds": fit.seconds + self.shell.membrane.seconds,
            "evaluations": fit.evaluations,
            "cpu_seconds": fit.cpu_seconds,
            "failed_states": self.failed,
            "ambiguity": fit.ambiguity,
            "at_bounds": list(fit.at_bounds),
            "period": self.cell.pattern.period.tolist(),
            "fabric": self.construction.summary(),
            "stress_at_rest": dict(
                zip(("course", "shear", "wale"), fit.evaluation.rested.stress.tolist(), strict=True)
            ),
            "biaxial_error": self.biaxial,
            "tests": None if self.tests is None else self.tests.plain()["summary"],
            "cloth_error": None if self.cloth is None else self.cloth.errors.summary(),
        }
        if (ahead := self.held_out_error) is not None:
            found["held_out"] = ahead.summary()
        return found


def _largest(changes: Iterable[Array]) -> float:
    """Largest size among all entries, zero where there are none."""
    return float(np.max(np.abs(np.concatenate([np.zeros(1), *changes]))))
