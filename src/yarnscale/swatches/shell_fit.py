"""The shell whose simulated swatches are nearest to the measured ones (EST22 §5.1, eq. 2).

Six stretches per direction, evenly spaced over the measured range, are applied to simulated swatches of the size
and gauge of the measured ones. Differences of line load and of contraction, each relative to its
measured average, are made small by bounded Gauss–Newton steps with exact derivatives. The start is the best of several
fits of uniform strips, which cost little. Weak priors determine what the measured directions do not, above all the
shear stiffness without a bias test; ``ShellFit.resolution`` shows which constants these are.

The material is one that stiffens, or the polynomial of EST22 eq. 1, which stiffens less than real fabric: as in EST22
the whole range is fitted all the same and the error reported.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import least_squares

from yarnscale.arrays import Array
from yarnscale.errors import InputError
from yarnscale.shell.materials.orthotropic import DirectionalMaterial
from yarnscale.swatches.measurements import POWER_LOAD, BiaxialTest, Direction, StretchTest, SwatchMeasurements
from yarnscale.swatches.membrane_constants import UNKNOWNS, AlongCurve, Scales, ShellModel
from yarnscale.swatches.swatch import ELEMENTS_ACROSS, StretchResponse, StretchSwatch
from yarnscale.swatches.uniaxial import biaxial_sensitivity, biaxial_stress, uniaxial, uniaxial_sensitivity

STATES = 6
"""Stretches per direction (EST22 §5.1)."""
_PRIOR = 2e-4
_UNMEASURED_PRIOR = 0.05
"""Weight of the prior of a stiffness whose direction was not measured: a factor of two beside errors of 10 %.

Swatches feel them all the same, through their clamps. Clamps of real rigs hold less than those of the simulation: left
alone, the fit lets the middle contract by driving shear to nothing, until the simulated cloth buckles within its
plane, or explains half of the force by a stiffness across that nobody measured.
"""
_FELT_ALONG = {
    Direction.WEFT: ("stretch_weft", "stiffening_weft", "rate_weft", "compression_warp", "saturation_weft"),
    Direction.BIAS: ("shear", "shear_rate", "coupling"),
    Direction.WARP: ("stretch_warp", "stiffening_warp", "rate_warp", "compression_weft", "saturation_warp"),
}
_BIAXIAL = 30
"""Biaxial states that are fitted, at most."""
_STARTS = 6
_ACROSS = 0.5
"""Weight of the contraction beside 1 of the load: it depends more on how much real clamps hold back."""
_FAILED = 3.0
"""Residual of a state that is no equilibrium: no fit goes there."""
_UNIFORM_PRIOR = 0.1
"""Weight, without a bias test, of the contraction of uniform strips against that of the swatches.

How much clamps hold back depends on the shear stiffness. Where nothing tells it, the fit may trade a contraction that
the clamps suppress against one that no fabric shows; this weak tie forbids that.
"""

_USUAL_CONTRACTION, _LARGEST_CONTRACTION = 0.45, 0.8
"""Exponents ν of the width (1 + s)^-ν of knits: usual and largest; 0.18 to 0.6 in four acrylic knits."""
_USUAL_PRIOR = 0.5
"""Weight of the usual contraction in uniform strips, where it was not measured and the fit would exceed the largest.

Such a fit explains the stiffening of fabric by cloth that contracts to a fifth of its width between its clamps, and
then attributes a third of the force to the clamps.
"""


@dataclass(frozen=True, eq=False)
class FittedCurve:
    """One direction, measured and simulated on the swatch, at the stretches of the fit; arrays (n,).

    load: force per width [N/m]; contraction: None where it was not measured.
    """

    direction: Direction
    stretch: Array
    measured_load: Array
    load: Array
    measured_contraction: Array | None
    contraction: Array


@dataclass(frozen=True, eq=False)
class ShellFit:
    """A shell fitted to swatches: the material, and what it reproduces.

    resolution: of every constant, one where the data alone decide it, zero where the prior does. seconds: of the fit.
    assumed_contraction: whether the usual contraction of knits was assumed, since none was measured and force alone led
    to an impossible one.
    """

    material: DirectionalMaterial
    curves: tuple[FittedCurve, ...]
    resolution: dict[str, float]
    seconds: float
    assumed_contraction: bool = False

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Constants that follow the prior more than the data."""
        return tuple(name for name, share in self.resolution.items() if share < 0.5)

    @property
    def load_error(self) -> float:
        """Mean error of the load over the mean measured load, all directions together."""
        return mean_error([(curve.load, curve.measured_load) for curve in self.curves])

    @property
    def contraction_error(self) -> float | None:
        """Mean error of the contraction over its mean, all measured directions together; None without any."""
        pairs = [(c.contraction, c.measured_contraction) for c in self.curves if c.measured_contraction is not None]
        return mean_error(pairs) if pairs else None


def mean_error(pairs: Sequence[tuple[Array, Array]]) -> float:
    """Mean of |simulated − measured| over the mean of what was measured, of all pairs (simulated, measured)."""
    errors = np.concatenate([np.abs(simulated - measured) for simulated, measured in pairs])
    return float(errors.mean() / np.concatenate([measured for _, measured in pairs]).mean())


def fit_membrane(
    measurements: SwatchMeasurements, *, model: ShellModel = "stiffening", largest_load: float = POWER_LOAD,
    states: int = STATES, elements: int = ELEMENTS_ACROSS,
) -> ShellFit:  # fmt: skip
    """Membrane constants from stretch tests along any directions.

    model: the shell that stiffens, or that of EST22 eq. 1. largest_load: the range that is fitted [N/m]; states:
    stretches per direction; elements: of the swatches' meshes. Raises InputError without a stretch test.
    """
    if not measurements.stretch:
        raise InputError(f"measurements of '{measurements.name}'", expected="a stretch test", found="none")
    begin = time.perf_counter()
    targets = tuple(_Target.of(test, largest_load, states) for test in measurements.stretch)
    density = measurements.area_density or 0.2
    both = measurements.biaxial and measurements.biaxial.up_to(largest_load, _BIAXIAL)
    problem = _Problem(targets, density, elements, model, both)
    found = problem.solved()
    if not problem.is_plausible(found):
        problem.usual_weight = _USUAL_PRIOR
        found = problem.solved()
    return ShellFit(
        problem.unknowns.material(found, density=density),
        problem.curves(found),
        problem.resolution(found),
        time.perf_counter() - begin,
        problem.usual_weight > 0,
    )


@dataclass(frozen=True, eq=False)
class _Target:
    """What a swatch is to do at stretches (n,); the usual contraction where none was measured."""

    test: StretchTest
    stretch: Array
    load: Array
    contraction: Array
    measured: bool

    @classmethod
    def of(cls, test: StretchTest, largest_load: float, states: int) -> _Target:
        curve = test.curve.up_to(largest_load)
        stretch = curve.stretch[-1] * np.arange(1, states + 1) / states
        across = curve.contraction_at(stretch)
        usual = _contraction(stretch, _USUAL_CONTRACTION)
        return cls(test, stretch, curve.load_at(stretch), usual if across is None else across, across is not None)

    @property
    def angle(self) -> float:
        return self.test.direction.angle


@dataclass(eq=False)
class _Problem:
    """Residuals of eq. 2, with inverse averages as weights, over the root of the number of states, and the prior."""

    targets: tuple[_Target, ...]
    density: float
    elements: int
    model: ShellModel
    biaxial: BiaxialTest | None = None
    usual_weight: float = 0.0
    _point: Array | None = None
    _responses: list[StretchResponse | None] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.mean_load = float(np.mean([target.load.mean() for target in self.targets]))
        across = [target.contraction.mean() for target in self.targets if target.measured]
        across = across or [target.contraction.mean() for target in self.targets]
        self.mean_contraction = max(float(np.mean(across)), 1e-3)
        self.unknowns = UNKNOWNS[self.model](_scales(self.targets))
        self.swatches = [
            StretchSwatch(
                t.test.direction, t.test.swatch_length, t.test.swatch_width, gauge_width=t.test.gauge_width,
                elements=self.elements,
            )
            for t in self.targets
        ]  # fmt: skip
        self._responses = [None] * len(self.targets)
        names = self.unknowns.names
        self.prior_weights = np.full(len(names), _PRIOR)
        measured = {target.test.direction for target in self.targets}
        for direction, constants in _FELT_ALONG.items():
            if direction not in measured:
                self.prior_weights[[name in constants for name in names]] = _UNMEASURED_PRIOR
        self.uniform_weight = 0.0 if Direction.BIAS in measured else _UNIFORM_PRIOR

    def solved(self) -> Array:
        """The unknowns of least residuals."""
        return least_squares(
            self.residuals,
            self.uniform_start(),
            jac=self.jacobian,  # pyright: ignore[reportArgumentType]
            bounds=(self.unknowns.low, self.unknowns.high),
            x_scale="jac",
            xtol=1e-5,
            ftol=1e-7,
            gtol=1e-10,
            max_nfev=100,
        ).x

    def is_plausible(self, unknowns: Array) -> bool:
        """Whether strips contract by no more than fabric does, along directions where that was not measured."""
        material, assumed = self.unknowns.material(unknowns), [t for t in self.targets if not t.measured]
        found = (uniaxial(material, target.angle, target.stretch)[1] for target in assumed)
        largest = (_contraction(target.stretch, _LARGEST_CONTRACTION) for target in assumed)
        return all((across <= most).all() for across, most in zip(found, largest, strict=True))

    def residuals(self, unknowns: Array) -> Array:
        parts = []
        for target, response in zip(self.targets, self._respond(unknowns), strict=True):
            load = response.force / response.width - target.load
            part = self._weighted(target, load, response.contraction - target.contraction)
            states = np.tile(response.converged, len(part) // len(response.converged))
            parts.append(np.where(states, part, _FAILED))
        uniform = self._uniform(unknowns, 0.0, self.uniform_weight)[0]
        return np.concatenate([*parts, uniform, self._biaxial(unknowns)[0], self._prior(unknowns)])

    def jacobian(self, unknowns: Array) -> Array:
        uniform = self._uniform(unknowns, 0.0, self.uniform_weight)[1]
        both = self._biaxial(unknowns)[1]
        return np.vstack([self._sensitivity(unknowns), uniform, both, np.diag(self.prior_weights)])

    def uniform_start(self) -> Array:
        """The best of several fits of uniform strips."""
        low, high = self.unknowns.low, self.unknowns.high
        best = None
        for draw in np.random.default_rng(0).normal(size=(_STARTS, len(low))) * np.arange(_STARTS)[:, None] / _STARTS:
            start = self.unknowns.prior + draw * self.unknowns.draws
            found = least_squares(
                lambda x: np.concatenate([self._uniform(x, 1.0, 1.0)[0], self._biaxial(x)[0], self._prior(x)]),
                np.clip(start, low + 1e-3, high - 1e-3),
                jac=lambda x: np.vstack(  # pyright: ignore
                    [self._uniform(x, 1.0, 1.0)[1], self._biaxial(x)[1], np.diag(self.prior_weights)]
                ),
                bounds=(low, high),
                x_scale="jac",
                max_nfev=60,
            )
            if best is None or found.cost < best.cost:
                best = found
        assert best is not None
        return np.clip(best.x, low + 1e-6, high - 1e-6)

    def _prior(self, unknowns: Array) -> Array:
        return self.prior_weights * (unknowns - self.unknowns.prior)

    def _uniform(self, unknowns: Array, load_weight: float, contraction_weight: float) -> tuple[Array, Array]:
        """Differences of uniform strips, weighted, and their derivative by the unknowns."""
        material, chain = self.unknowns.material(unknowns), self.unknowns.jacobian(unknowns)
        rows, slopes = [np.empty(0)], [np.empty((0, len(unknowns)))]
        for target in self.targets:
            load, contraction, by_load, by_contraction = uniaxial_sensitivity(
                material, target.angle, target.stretch, self.unknowns.names
            )
            scale = self._scale(len(target.stretch))
            across = contraction_weight if target.measured else self.usual_weight
            for weight, difference, slope in (
                (load_weight * scale / self.mean_load, load - target.load, by_load),
                (across * scale / self.mean_contraction, contraction - target.contraction, by_contraction),
            ):
                if weight:
                    rows.append(weight * difference)
                    slopes.append(weight * slope @ chain)
        return np.concatenate(rows), np.vstack(slopes)

    def _biaxial(self, unknowns: Array) -> tuple[Array, Array]:
        """Differences of loads of the biaxial states, which count like one direction, and their derivative."""
        if self.biaxial is None:
            return np.empty(0), np.empty((0, len(unknowns)))
        material, chain = self.unknowns.material(unknowns), self.unknowns.jacobian(unknowns)
        load = biaxial_stress(material, self.biaxial.stretch)
        slopes = biaxial_sensitivity(material, self.biaxial.stretch, self.unknowns.names)
        scale = self._scale(load.size) / self.mean_load
        return scale * (load - self.biaxial.load).ravel(), scale * slopes.reshape(-1, slopes.shape[-1]) @ chain

    def curves(self, unknowns: Array) -> tuple[FittedCurve, ...]:
        return tuple(
            FittedCurve(
                t.test.direction, t.stretch, t.load, found.force / found.width, t.contraction if t.measured else None,
                found.contraction,
            )
            for t, found in zip(self.targets, self._respond(unknowns), strict=True)
        )  # fmt: skip

    def resolution(self, unknowns: Array) -> dict[str, float]:
        sensitivity = np.vstack([self._sensitivity(unknowns), self._biaxial(unknowns)[1]])
        felt = sensitivity.T @ sensitivity
        share = np.diag(np.linalg.solve(felt + np.diag(self.prior_weights**2), felt))
        return dict(zip(self.unknowns.names, share.tolist(), strict=True))

    def _scale(self, states: int) -> float:
        return 1.0 / np.sqrt(len(self.targets) * states)

    def _weighted(self, target: _Target, load: Array, contraction: Array) -> Array:
        """Differences of load and of measured contraction (n, …), or their derivatives, as rows of the residuals."""
        scale = self._scale(len(target.stretch))
        across = _ACROSS * scale / self.mean_contraction * contraction
        return np.concatenate([scale / self.mean_load * load, *([across] if target.measured else [])])

    def _sensitivity(self, unknowns: Array) -> Array:
        """d(differences)/d(unknowns)."""
        material, rows = self.unknowns.material(unknowns, density=self.density), []
        for target, response, swatch in zip(self.targets, self._respond(unknowns), self.swatches, strict=True):
            slopes = np.nan_to_num(swatch.derivatives(material, response, self.unknowns.names))
            rows.append(self._weighted(target, slopes[:, 0] / swatch.width, slopes[:, 1]))
        return np.vstack(rows) @ self.unknowns.jacobian(unknowns)

    def _respond(self, unknowns: Array) -> Sequence[StretchResponse]:
        if self._point is None or not np.array_equal(unknowns, self._point):
            material = self.unknowns.material(unknowns, density=self.density)
            for k, (target, swatch) in enumerate(zip(self.targets, self.swatches, strict=True)):
                self._responses[k] = swatch.respond(material, target.stretch, near=self._responses[k])
            self._point = unknowns.copy()
        return [response for response in self._responses if response is not None]


def _scales(targets: Sequence[_Target]) -> Scales:
    """The curves along weft and warp; one that was not measured is taken to be like another direction's."""
    found = {t.test.direction: AlongCurve.of(t.stretch, t.load, t.contraction if t.measured else None) for t in targets}
    other = next(iter(found.values()))
    return Scales(found.get(Direction.WEFT, other), found.get(Direction.WARP, other))


def _contraction(stretch: Array, exponent: float) -> Array:
    """Contraction of fabric whose width is (1 + s)^-exponent, (n,)."""
    return 1.0 - (1.0 + stretch) ** -exponent
