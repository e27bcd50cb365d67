"""Stiffness of every edge, joint and contact pair of a pattern with one yarn material or several (EST22 §6).

The unit of length is the yarn radius, that of energy E π r³ with the largest Young's modulus of the materials.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from yarnscale.arrays import Array, Integers
from yarnscale.checked import MAKERS, WrongArgument
from yarnscale.errors import InputError
from yarnscale.numerics.energy import StencilEnergy
from yarnscale.yarn.contact import contact_reach
from yarnscale.yarn.material import ContactRule, YarnMaterial
from yarnscale.yarn.rod import STRETCH, TWO_PHASE_STRETCH
from yarnscale.yarn.strands import Neighbours, Strands

Materials = YarnMaterial | Sequence[YarnMaterial]
"""One material for all yarns of a pattern, or one for each number in its ``yarn_material``."""


class Yarns(Protocol):
    """Yarns of one period or of a whole fabric: sizes and materials of n edges and joints.

    radius: of the thickest yarns [m]; relative_radius: of the yarn of every edge and joint over it (n,). rest_length:
    of every edge (n,) [m]. rest_curvature, rest_twist: integrated, of every joint at rest (n, 2) and (n,) [rad].
    voronoi_length: of every joint (n,) [m]. material_of_vertex: number of the material of every edge (n,). area: at
    rest [m²]. polyline: whether yarns are straight segments with the published convention of contact. Any: cached
    properties, which are no arrays to type checkers.
    """

    @property
    def name(self) -> str: ...
    @property
    def radius(self) -> float: ...
    @property
    def relative_radius(self) -> Any: ...
    @property
    def rest_length(self) -> Array: ...
    @property
    def rest_curvature(self) -> Array: ...
    @property
    def rest_twist(self) -> Array: ...
    @property
    def voronoi_length(self) -> Any: ...
    @property
    def material_of_vertex(self) -> Any: ...
    @property
    def area(self) -> float: ...
    @property
    def polyline(self) -> bool: ...


def materials_of(pattern: Yarns, material: Materials) -> tuple[YarnMaterial, ...]:
    """The materials of a pattern by number; InputError if they do not fit the pattern or each other."""
    if isinstance(material, YarnMaterial):
        return (material,)
    if isinstance(material, str) or not isinstance(material, Iterable):
        raise WrongArgument(
            "yarn material", expected=f"YarnMaterial or several ({MAKERS['YarnMaterial']})", found=repr(material)
        )
    given = tuple(material)
    for k, entry in enumerate(given):
        if not isinstance(entry, YarnMaterial):
            raise WrongArgument(f"material {k} is no yarn material", expected="YarnMaterial", found=repr(entry))
    asked = int(pattern.material_of_vertex.max()) + 1
    if len(given) != asked:
        raise InputError(
            f"yarns of pattern '{pattern.name}' are of {asked} materials", expected=f"one or {asked} materials"
            if len(given) > asked or asked == 1 else f"{asked} materials, or one that is not in a sequence",
            found=len(given),
        )  # fmt: skip
    elastic = [replace(entry.contact, friction=None) for entry in given]
    for k, contact in enumerate(elastic):
        if contact != elastic[0]:
            raise InputError(
                f"materials of one pattern must count contact alike; number {k} does not",
                expected=elastic[0],
                found=contact,
            )
    return given


@dataclass(frozen=True, eq=False)
class PatternStiffness:
    """Stiffnesses of a pattern's edges, joints and contact pairs.

    materials: by their number. kind: number of the material of each edge and joint (n,). unit: of energy [J].
    """

    pattern: Yarns
    materials: tuple[YarnMaterial, ...]
    kind: Integers
    unit: float

    @classmethod
    def of(cls, pattern: Yarns, material: Materials) -> PatternStiffness:
        """Stiffnesses of a pattern made of one material or several."""
        materials = materials_of(pattern, material)
        one = isinstance(material, YarnMaterial)
        kind = np.zeros(len(pattern.rest_length), np.int64) if one else pattern.material_of_vertex
        largest = max(materials[k].young_modulus for k in np.unique(kind))
        return cls(pattern, materials, kind, largest * math.pi * pattern.radius**3)

    @property
    def rule(self) -> ContactRule:
        """Law and quadrature of contact, the same for all materials."""
        return self.materials[0].contact

    def neighbours(self, strands: Strands) -> Neighbours:
        """Segments of one yarn that do not touch; lengths in radii."""
        if self.pattern.polyline:
            return Neighbours.by_edges(strands, self.rule.neighbours)
        distance = contact_reach(self.rule) * self.pattern.relative_radius
        return Neighbours.by_length(strands, self.pattern.rest_length / self.pattern.radius, distance)

    @property
    def stretch_energy(self) -> StencilEnergy:
        """The stretch energy of an edge: two-phase if any material is."""
        two_phase = any(m.stretch.law == "two_phase" for m in self.materials)
        return TWO_PHASE_STRETCH if two_phase else STRETCH

    def edge_parameters(self) -> Array:
        """Parameters of ``stretch_energy`` of every edge but ``turns`` (n, 2 or 4); a linear yarn has knee 0."""
        r, force = self.pattern.radius, self.unit / self.pattern.radius
        section = self.pattern.relative_radius**2
        soft = section * self._by_kind([m.stretch_stiffness(r) / force for m in self.materials])
        columns = [self.pattern.rest_length / r, soft]
        if self.stretch_energy is TWO_PHASE_STRETCH:
            columns.append(section * self._by_kind([m.stiff_stretch_stiffness(r) / force for m in self.materials]))
            two_phase = [m.stretch.law == "two_phase" for m in self.materials]
            knees = [m.stretch.knee if w else 0.0 for m, w in zip(self.materials, two_phase, strict=True)]
            columns.append(self._by_kind(knees))
        return np.column_stack(columns)

    def joint_stiffness(self) -> tuple[Array, Array]:
        """Bending and twist stiffness over Voronoi length of every joint (n,)."""
        r = self.pattern.radius
        scale = self.pattern.voronoi_length * self.unit / self.pattern.relative_radius**4
        bend = self._by_kind([m.bending_stiffness(r) for m in self.materials]) / scale
        twist = self._by_kind([m.twist_stiffness(r) for m in self.materials]) / scale
        return bend, twist

    def pair_parameters(self, first: Integers, second: Integers, measure: Array) -> Array:
        """Parameters of the contact energy of pairs of edges (N, 2 or 4).

        first, second: edges (N,). measure: product of their lengths [r²] and the weight of the pair.
        """
        rule, unit = self.rule, self.unit / self.pattern.radius**2
        columns = [self.pair_stiffness(first, second) / unit * measure]
        diameter = self.pattern.relative_radius[first] + self.pattern.relative_radius[second]
        if rule.kernel == "hylc2020":
            columns.append(diameter**-2.0)
        else:
            columns.append((diameter * rule.outer_radius_ratio) ** -2.0)
            columns.append(rule.inner_stiffness / unit * measure)
            columns.append((diameter * rule.inner_radius_ratio) ** -2.0)
        return np.column_stack(columns)

    def pair_stiffness(self, first: Integers, second: Integers) -> Array:
        """Contact stiffness of pairs of edges (N,) [kg/s²]: the harmonic mean, two springs in series."""
        k = np.array([m.contact_stiffness for m in self.materials])
        mean = 2.0 / (1.0 / k[:, None] + 1.0 / k)
        # Exactly its own for a pair of one material.
        np.fill_diagonal(mean, k)
        return mean[self.kind[first], self.kind[second]]

    def position_scale(self) -> Array:
        """Typical translational stiffness of each vertex (n,): stretch stiffness over the mean edge length."""
        soft = self.edge_parameters()[:, 1]
        return soft / (self.pattern.rest_length / self.pattern.radius).mean()

    def twist_scale(self) -> Array:
        """Typical twist stiffness of each edge (n,)."""
        r = self.pattern.radius
        twist = self._by_kind([m.twist_stiffness(r) / self.unit for m in self.materials])
        twist = twist * self.pattern.relative_radius**4
        return np.maximum(twist * (1.0 / self.pattern.voronoi_length).mean(), 1e-12)

    def area_density(self) -> float:
        """Mass per reference area [kg/m²]."""
        return float(self.mass_per_length() @ self.pattern.rest_length / self.pattern.area)

    def mass_per_length(self) -> Array:
        """Of every edge and joint (n,) [kg/m]."""
        line = self._by_kind([m.mass_per_length(self.pattern.radius) for m in self.materials])
        return line * self.pattern.relative_radius**2

    def _by_kind(self, values: Sequence[float]) -> Array:
        return np.array(values, np.float64)[self.kind]
