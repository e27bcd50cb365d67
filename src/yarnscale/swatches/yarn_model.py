"""The yarn whose parameters are estimated: five unknowns within ranges, the rest set beforehand (EST22 §7.3.2).

Unknown are the soft stretch stiffness k_s1, the strain ε̄ where it ends, the bending stiffness k_b, the outer contact
radius R₁ and its stiffness k_c1. The stiff stretch stiffness k_s2 is that of the stiffest yarn of the fabric; the inner
contact only keeps yarns apart. Ranges are relative to k_s2 and to R_est, which follows from the drawing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from yarnscale.arrays import Array, Flags
from yarnscale.cell.periodic import PeriodicCell
from yarnscale.cell.rest_shape import redrawn, set_as_drawn
from yarnscale.errors import InputError, positive
from yarnscale.kinematics import ShellStrain
from yarnscale.swatches.construction import Stitches
from yarnscale.swatches.measurements import LENGTH
from yarnscale.yarn.close_pairs import close_pairs, pair_gaps, yarn_between
from yarnscale.yarn.material import ContactRule, StretchRule, YarnMaterial
from yarnscale.yarn.pattern import YarnPattern
from yarnscale.yarn.strands import Strands

PARAMETERS = ("k_s1", "knee", "k_b", "R_1", "k_c1")
"""Parameters of the yarn in their order: k_s1 [N], ε̄ [-], k_b [N m²], R₁ [m], k_c1 [kg/s²]."""
SHAPE = ("aspect", "shortening", "draw_in")
"""Unknowns of a fabric whose stitch density was not measured: the width of its drawing over its height as drawn [-],
yarn length unchanged; the share of the yarn's length by which it is shorter at rest than drawn [-]; and how far the
fabric has gone from its drawing, 0, to where straight yarn would draw it in, 1 [-]."""
UNITS = {"k_s1": "N", "k_b": "N m²", "R_1": "m", "k_c1": "kg/s²"}
_LOGARITHMIC = ("k_s1", "k_b", "k_c1", "aspect")
"""Unknowns sought by their logarithm."""
INNER_STIFFNESS = 1e3
"""k_c2 [kg/s²]."""
INNER_RADIUS = 0.25
"""R₂ [R_est]."""
LARGEST_KNEE = 0.15
_LEAST_KNEE = 1e-9
"""Knees below are zero: a search comes near the end of the range without reaching it."""
SOFTEST_CONTACT, STIFFEST_CONTACT = 1e-2, 3e3
"""Range of k_c1 [kg/s²]. EST22's ends at ``PUBLISHED_CONTACT``, where fits of thick spun yarns in tight hand
knits end too and fail."""
PUBLISHED_CONTACT = 1e2
MEASURED = 1.25
"""Factor either way within which a bending stiffness k_b that was measured on the yarn is sought."""
LARGEST_ASPECT = 3.0
LARGEST_SHORTENING = 0.15
ITERATIONS, TOLERANCE = 150, 1e-8
"""Of equilibria: loose yarns change their stress long after forces are small, which would falsify differences."""
TWIST_SHARE = 0.8
"""Twist stiffness over bending stiffness: a round rod with G = 0.4 E. EST22 §6 finds that twist does not matter."""


@dataclass(frozen=True, eq=False)
class YarnModel:
    """A pattern and what is known of its yarn.

    pattern: one period as drawn [m]; its ``radius`` is R_est. stiffness: k_s2 [N]. density: of the yarn [kg/m³].
    two_phase: whether stretch has two phases; a linear yarn has k_s1 in all of its range, and ε̄ does nothing.
    free_shape: whether ``SHAPE`` is unknown too, and the drawing a scheme that draws in first. stitches: wales and
    courses of the pattern's period, None where they are not known. stitch_area: of one stitch at rest [m²] where that
    decides the size of the fabric.
    stiffest_contact: end of the range of k_c1 [kg/s²]. bending: k_b as measured on the yarn [N m²], if it was.
    """

    pattern: YarnPattern
    stiffness: float
    density: float = 300.0
    two_phase: bool = True
    free_shape: bool = False
    largest_knee: float = LARGEST_KNEE
    stiffest_contact: float = STIFFEST_CONTACT
    stitches: Stitches | None = None
    stitch_area: float | None = None
    bending: float | None = None

    def __post_init__(self) -> None:
        if self.pattern.yarn_radius is not None:
            raise InputError(f"pattern '{self.pattern.name}'", expected="yarns of one radius", found="several radii")
        positive("stiffness k_s2 of the yarn", self.stiffness, "a positive force [N]")
        if self.bending is not None:
            positive("bending stiffness k_b of the yarn", self.bending, "a positive number [N m²]")

    @property
    def names(self) -> tuple[str, ...]:
        """Unknowns in their order, n of them."""
        return PARAMETERS + SHAPE if self.free_shape else PARAMETERS

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Lowest and highest values, both (n,) (EST22 §7.3.2)."""
        radius, k = self.pattern.radius, self.stiffness
        base = k * radius**2 / 4.0
        ranges = {
            "k_s1": (1e-3 * k, k),
            "knee": (0.0, self.largest_knee),
            "k_b": (1e-3 * base, 10.0 * base),
            "R_1": (0.5 * radius, 1.5 * radius),
            "k_c1": (SOFTEST_CONTACT, self.stiffest_contact),
            "aspect": (1.0 / LARGEST_ASPECT, LARGEST_ASPECT),
            "shortening": (0.0, LARGEST_SHORTENING),
            "draw_in": (0.0, 1.0),
        }
        if self.bending is not None:
            ranges["k_b"] = (self.bending / MEASURED, self.bending * MEASURED)
        low, high = np.array([ranges[name] for name in self.names]).T
        return low, high

    @cached_property
    def _logarithmic(self) -> Flags:
        return np.array([name in _LOGARITHMIC for name in self.names])

    def values(self, unknowns: Array) -> Array:
        """Values (n,) of unknowns (n,) in [0, 1], which cover the ranges."""
        low, high = self._scale
        share = np.clip(unknowns, 0.0, 1.0)
        inner = low + share * (high - low)
        return np.where(self._logarithmic, np.exp(inner), inner)

    def unknowns(self, values: Array) -> Array:
        """Unknowns of values; the inverse of ``values``. Values beyond the ranges go to their ends."""
        low, high = self._scale
        inner = np.where(self._logarithmic, np.log(np.maximum(values, 1e-300)), values)
        return np.clip((inner - low) / (high - low), 0.0, 1.0)

    @cached_property
    def _scale(self) -> tuple[Array, Array]:
        low, high = self.bounds
        safe = [np.log(np.where(self._logarithmic, bound, 1.0)) for bound in (low, high)]
        return np.where(self._logarithmic, safe[0], low), np.where(self._logarithmic, safe[1], high)

    def material(self, values: Array) -> YarnMaterial:
        """The yarn with these parameters."""
        radius = self.pattern.radius
        soft, knee, bending, outer, contact = (float(value) for value in values[:5])
        stretch = StretchRule()
        if self.two_phase:
            knee = knee if knee > _LEAST_KNEE else 0.0
            stretch = StretchRule("two_phase", knee, self.stiffness / (math.pi * radius**2))
        rule = ContactRule(
            kernel="est2022", weights="simpson", outer_radius_ratio=outer / radius,
            inner_radius_ratio=INNER_RADIUS, inner_stiffness=INNER_STIFFNESS,
        )  # fmt: skip
        base = YarnMaterial(1.0, 1.0, 1.0, contact, self.density, name="estimated", contact=rule, stretch=stretch)
        return base.with_stiffnesses(radius, stretch=soft, bending=bending, twist=TWIST_SHARE * bending)

    def cell(self, values: Array) -> PeriodicCell:
        """The drawn pattern made of the yarn with these values, before it draws in."""
        pattern = self.pattern
        if self.free_shape:
            aspect, shortening = (float(value) for value in values[5:7])
            pattern = reshaped(pattern, aspect)
            pattern = replace(pattern, rest_length=pattern.rest_length * (1.0 - shortening))
        return PeriodicCell(pattern, self.material(values)).with_options(tolerance=TOLERANCE, max_iterations=ITERATIONS)

    def draw_in(self, values: Array) -> float | None:
        """How far the fabric draws in before its rest shape is estimated; None for drawings of known shape."""
        return float(values[self.names.index("draw_in")]) if self.free_shape else None


def yarn_model(
    pattern: YarnPattern, stiffness: float, *, yarn_length: float | None = None, free_shape: bool = False,
    stitches: Stitches | None = None, stitch_area: float | None = None, bending: float | None = None,
) -> YarnModel:  # fmt: skip
    """The model of a drawn pattern, whose radius becomes R_est.

    stiffness: k_s2 [N]. yarn_length: of one period, to which the drawing is scaled [m]; None keeps its size.
    bending: k_b as measured [N m²], which is then sought near this value.
    """
    if yarn_length is not None:
        positive("yarn length of a period", yarn_length, LENGTH)
        pattern = pattern.scaled(yarn_length / drawn_length(pattern))
    pattern = replace(pattern, radius=estimated_radius(pattern))
    return YarnModel(
        pattern, stiffness, free_shape=free_shape, stitches=stitches, stitch_area=stitch_area, bending=bending
    )


def drawn_length(pattern: YarnPattern) -> float:
    """Length of all yarns in one period of a drawing [m]."""
    return float(pattern.drawn_length.sum())


def reshaped(pattern: YarnPattern, aspect: float) -> YarnPattern:
    """A drawing made wider than high by a factor, with as much yarn; the yarns' rest shape follows the drawing."""
    scale = np.array([math.sqrt(aspect), 1.0 / math.sqrt(aspect), 1.0])
    stretched = ShellStrain(s_x=scale[0] - 1.0, s_y=scale[1] - 1.0)
    length = drawn_length(pattern)
    drawn = replace(set_as_drawn(redrawn(pattern, stretched, pattern.vertices * scale, pattern.twist)))
    factor = length / drawn_length(drawn)
    return replace(drawn.scaled(factor), radius=pattern.radius)


def estimated_radius(pattern: YarnPattern) -> float:
    """R_est: the smallest radius at which every segment touches another [m] (EST22 §7.3.2).

    Raises InputError where a segment is alone within the cell's own size.
    """
    largest = 0.25 * float(np.linalg.norm(pattern.period))
    reach = min(4.0 * pattern.radius, largest)
    while True:
        nearest = _nearest(pattern, reach)
        # A pair search stops at ``reach``; only gaps within it are certain to be the smallest.
        if nearest.max() <= reach:
            return 0.5 * float(nearest.max())
        if reach >= 2.0 * largest:
            raise InputError(
                f"pattern '{pattern.name}'", expected="segments that lie near others", found="one that is alone"
            )
        reach *= 1.5


def _nearest(pattern: YarnPattern, reach: float) -> Array:
    """Distance of each segment to the nearest other one, infinite beyond ``reach``, (n,) [m]."""
    strands = Strands.around(pattern, reach + float(np.linalg.norm(pattern.edge_vectors(), axis=1).max()))
    nodes = strands.copies(pattern.vertices, pattern.period)
    first, second = close_pairs(strands, nodes, reach, neighbours=1, ordered=True)
    gaps = pair_gaps(nodes, strands.ends, first, second)
    # Where yarns touch at this distance, those of one yarn that count are so far apart along it (``Neighbours``).
    touching = yarn_between(strands, pattern.rest_length, first, second) >= 0.5 * np.pi * gaps
    nearest = np.full(len(pattern.edges), np.inf)
    np.minimum.at(nearest, first[touching], gaps[touching])
    return nearest
