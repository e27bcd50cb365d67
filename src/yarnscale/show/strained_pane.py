"""Panes of fabric of one strain, a periodic cell of yarns or a piece of shell, which stretches and bends under sliders.

The page interpolates between equilibria as ``detail.fluctuations`` does for yarns on cloth, by radial functions |Δz|
and a linear polynomial; fluctuations are kept by their principal components, to 0.2 % of the yarn's radius.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.distance import cdist

from yarnscale.arrays import Array
from yarnscale.cell.equilibrium import Equilibrium
from yarnscale.cell.periodic import PeriodicCell
from yarnscale.homogeneous.fabrics import HomogeneousFabric, fabric_of
from yarnscale.homogeneous.loads import FLAT, LoadedState, Loads, Prescribed, equilibrium_under
from yarnscale.homogenize.rays import LIMIT, Ray, box_strains, doubling_load
from yarnscale.homogenize.states import FabricStates
from yarnscale.homogenize.store import SampleStore
from yarnscale.homogenize.worker import CODE_OF
from yarnscale.shell.materials.compact import CompactMaterial
from yarnscale.shell.materials.material import ShellMaterial
from yarnscale.show import theme
from yarnscale.show.curves import pattern_curves, rings_for
from yarnscale.show.pane import Pane, framed

Progress = Callable[[int, int], None]
"""Called with the number of load paths done and that of all."""
BEND_SIZE = 0.2
"""Curvature times yarn radius that counts as a strain of one, as for yarns on cloth."""
PRECISION = 0.002
"""Error of the kept fluctuations over the yarn's radius."""
_BENDS, _SHEARS, _TENSIONS = (0.015, 0.04, 0.07), (0.1, 0.25), 6
_TOLERANCE, _FLOOR = 0.02, 5e-4
"""Residual that counts as equilibrium in a view, over the loads and over the largest of all."""
_SPREAD = 200
"""States of a shell material without samples."""
_SHEET, _CHECKS = 0.05, 20
"""Side [m] of the piece of shell, and its fields along a side."""


@dataclass(frozen=True, eq=False)
class States:
    """Equilibria: strains (m, 6), energies (m,) [J/m²], stresses (m, 6), fluctuations (m, 3n) [m].

    paths: strains (k, 6) of equilibria in a row, by what was done to the fabric.
    """

    strains: Array
    energies: Array
    stresses: Array
    fluctuations: Array
    paths: Mapping[str, Array] = field(default_factory=dict)

    @classmethod
    def of(cls, states: Sequence[Equilibrium], paths: Mapping[str, Sequence[Equilibrium]] | None = None) -> States:
        """Of equilibria, the usable ones among them (at least one, else the first)."""
        good = [state for state in states if state.usable] or list(states[:1])
        rows = {
            name: np.array([one.strain.vector for one in path if one.usable]) for name, path in (paths or {}).items()
        }
        return cls(
            np.array([state.strain.vector for state in good]),
            np.array([state.energy_density for state in good]),
            np.array([state.stress for state in good]),
            np.array([state.fluctuation.ravel() for state in good]),
            {name: row for name, row in rows.items() if len(row) > 1},
        )

    @classmethod
    def stored(cls, store: SampleStore, woven: bool) -> States:
        """The converged states of a store, and the first rays of loads as paths from rest."""
        good = np.flatnonzero(store.status() == CODE_OF["converged"])
        found = FabricStates.of(store)
        moved = np.array([store.read(int(i), "fluctuation").ravel() for i in good])
        usable = np.isfinite(moved.reshape(len(good), -1)).all(axis=1)
        paths: dict[str, Array] = {}
        level = good // store.shape[-1]
        last = np.append(level[1:] != level[:-1], True) & usable
        for number, plain in enumerate(store.rays):
            # Of each level the last iterate.
            strains = found.strains[last & (level // store.shape[1] == number)]
            name = _named(Ray.from_plain(plain), strains[-1], woven) if len(strains) > 1 else ""
            if name and name not in paths:
                paths[name] = np.vstack([np.zeros(6), strains])
        return cls(found.strains[usable], found.energies[usable], found.stresses[usable], moved[usable], paths)

    @classmethod
    def loaded(cls, cell: PeriodicCell, progress: Progress | None = None, patience: float = math.inf) -> States:
        """Relaxed here, along a few loads (seconds for small cells), as many as begin within a processor time [s]."""
        pattern, limit = cell.pattern, min(LIMIT, 0.25 * doubling_load(cell))
        paths = load_paths(cell, pattern.radius, limit, pattern.woven, progress, patience)
        rest = cell.relax()
        found = {name: [rest, *(state.response.state for state in path)] for name, path in paths.items()}
        return cls.of([rest, *(state for path in found.values() for state in path[1:])], found)

    @classmethod
    def material(cls, material: ShellMaterial) -> States:
        """Of a shell material: at its samples, or over the strains of usual clothing, and along a few loads."""
        radius = 0.1 / float(material.strain_scale[3])
        paths = load_paths(material, radius, LIMIT, False)
        rows = {name: np.array([np.zeros(6), *(state.strain for state in path)]) for name, path in paths.items()}
        if isinstance(material, CompactMaterial) and len(material.samples) > 1:
            spread = material.samples
        else:
            box = box_strains(radius, 0)
            spread = np.array([0.6 * next(box) for _ in range(_SPREAD)])
        strains = np.unique(np.vstack([*rows.values(), spread, np.zeros((1, 6))]), axis=0)
        energies, stresses = material.energy_density(strains), material.stress(strains)
        good = np.isfinite(energies) & np.isfinite(stresses).all(axis=1)
        return cls(strains[good], energies[good], stresses[good], np.zeros((int(good.sum()), 0)), rows)


def load_paths(
    subject: PeriodicCell | ShellMaterial, radius: float, limit: float, woven: bool, progress: Progress | None = None,
    patience: float = math.inf,
) -> dict[str, list[LoadedState]]:  # fmt: skip
    """Equilibria along tension up to a limit [N/m], shear and bending, by name, as far as the fabric has them.

    patience: processor time [s] after which no other equilibrium is begun.
    """
    fabric: HomogeneousFabric = fabric_of(subject)
    along, across = _threads(woven)
    levels = np.geomspace(0.02, 1.0, _TENSIONS) * limit
    nothing = Loads()
    plans: dict[str, list[tuple[Loads, Prescribed]]] = {
        f"tension along {along}": [(Loads.tension(0.0, q), FLAT) for q in levels],
        f"tension along {across}": [(Loads.tension(math.pi / 2, q), FLAT) for q in levels],
        "tension at 45°": [(Loads.tension(math.pi / 4, q), FLAT) for q in levels],
        "shear": [(nothing, FLAT + Prescribed.components(s_a=a)) for a in _SHEARS],
        "shear the other way": [(nothing, FLAT + Prescribed.components(s_a=-a)) for a in _SHEARS],
    }
    for angle, name in ((0.0, along), (math.pi / 2, across)):
        for sign, side in ((1.0, "inwards"), (-1.0, "outwards")):
            bends = [(nothing, Prescribed.bent(angle, sign * b / radius)) for b in _BENDS]
            plans[f"bending of {name}, {side}"] = bends
    found, ends = {}, time.process_time() + patience
    for done, (name, plan) in enumerate(plans.items(), start=1):
        states, start = [], None
        for loads, prescribed in plan:
            if time.process_time() > ends:
                break
            state = equilibrium_under(
                fabric, loads, start=start, prescribed=prescribed, tolerance=_TOLERANCE, floor=_FLOOR * limit
            )
            if not state.converged:
                break
            states.append(state)
            start = state
        if states:
            found[name] = states
        if progress is not None:
            progress(done, len(plans))
    return found


def cell_pane(cell: PeriodicCell, states: States, title: str) -> Pane:
    """The cell and its copies between equilibria."""
    pattern = cell.pattern
    rings = rings_for(pattern.period, pattern.radius)
    # Points are vertices and tiles, for the page to place.
    curves = pattern_curves(
        pattern, lambda vertices, tiles: np.column_stack([vertices, tiles]).astype(float), rings=rings
    )
    points = np.vstack([curve.points for curve in curves]).astype(np.int64)
    radii = [pattern.radius if curve.radius is None else curve.radius for curve in curves]
    solid = [np.ones(len(c.points), bool) if c.solid is None else c.solid for c in curves]
    drawn = cell.placement(None)(points[:, 0], points[:, 1:])
    length = np.linalg.norm(pattern.edge_vectors(), axis=1)
    centre = np.average(pattern.vertices[:, :2], axis=0, weights=length + length[pattern.previous_vertex])
    arrays = {
        "reference": pattern.vertices.astype(float), "vertex": points[:, 0], "tile": points[:, 1:],
        "offsets": np.concatenate([[0], np.cumsum([len(curve.points) for curve in curves])]),
        "closed": np.array([curve.closed for curve in curves], bool),
        "yarn": np.array([curve.yarn for curve in curves]), "radius": np.array(radii, float),
        "solid": np.concatenate(solid),
    }  # fmt: skip
    strain = {"factor": 100, "unit": "%", "label": "stretch of yarn since rest"}
    header = {
        "colours": [
            {"name": "yarns"}, {"name": "one cell", "fade": True},
            {"name": "stretch of yarn", "fields": {"yarns": strain}},
        ],
        "eye": [0.0, 0.0, 1.0], "up": [0.0, 1.0, 0.0],
        "period": pattern.period.tolist(), "centre": centre.tolist(), **framed(drawn),
    }  # fmt: skip
    return _pane(title, states, pattern.radius, pattern.woven, header, arrays)


def sheet_pane(material: ShellMaterial, states: States, title: str) -> Pane:
    """A chequered piece of shell."""
    lines = _SHEET * (np.arange(_CHECKS + 1) / _CHECKS - 0.5)
    x, y = (grid.ravel() for grid in np.meshgrid(lines, lines, indexing="ij"))
    corner = (np.arange(_CHECKS)[:, None] * (_CHECKS + 1) + np.arange(_CHECKS)).ravel()
    fields = np.stack([corner, corner + _CHECKS + 1, corner + _CHECKS + 2, corner + 1], axis=1)
    count = 4 * len(fields)
    first = 4 * np.arange(len(fields))[:, None]
    triangles = np.concatenate([first + np.array([0, 1, 2]), first + np.array([0, 2, 3])])
    row, column = np.divmod(np.arange(len(fields)), _CHECKS)
    points = np.column_stack([x, y, np.zeros(len(x))])[fields.ravel()]
    arrays = {
        "reference": points, "vertex": np.arange(count), "tile": np.zeros((count, 2), int), "triangles": triangles,
        "tint": np.repeat((row + column) % 2, 4).astype(bool),
    }  # fmt: skip
    header = {
        "colours": [{"name": "fields"}], "eye": [0.45, -0.95, 0.9], "up": [0.0, 0.0, 1.0], "period": [0.0, 0.0],
        "centre": [0.0, 0.0], "cloth_colours": [theme.CLOTH_FRONT, theme.CLOTH_BACK],
        **framed(1.4 * points),
    }  # fmt: skip
    return _pane(title, states, 0.1 / float(material.strain_scale[3]), False, header, arrays)


def _pane(title: str, states: States, radius: float, woven: bool, header: dict[str, object], arrays: dict) -> Pane:
    """The pane with its interpolant."""
    size = np.array([1.0] * 3 + [BEND_SIZE / radius] * 3)
    strains, first = np.unique(states.strains, axis=0, return_index=True)
    varying = np.flatnonzero(np.ptp(strains / size, axis=0) > 1e-9)
    answers = np.column_stack([states.energies, states.stresses])[first]
    floors = np.maximum(0.1 * np.median(np.abs(answers), axis=0), 1e-9)
    shares, modes = _modes(states.fluctuations[first], PRECISION * radius)
    values = np.column_stack([np.arcsinh(answers / floors), shares])
    knots = (strains / size)[:, varying]
    rest = strains[np.abs(strains / size).sum(axis=1).argmin()]
    along, across = _threads(woven)
    header |= {
        "start": rest.tolist(), "size": size.tolist(), "varying": varying.tolist(), "states": len(strains),
        "floors": floors.tolist(), "range": np.stack([strains.min(axis=0), strains.max(axis=0)], axis=1).tolist(),
        "paths": [{"name": name, "states": path.tolist()} for name, path in states.paths.items()],
        "components": [
            [f"stretch along {along}", "%", 100], ["shear s_a", "%", 100], [f"stretch along {across}", "%", 100],
            [f"curvature along {along}", "1/m", 1], ["twist II12", "1/m", 1], [f"curvature along {across}", "1/m", 1],
        ],
        "answers": [
            ["energy", "J/m²", 1], [f"tension along {along}", "N/m", 1], ["shear force", "N/m", 1],
            [f"tension along {across}", "N/m", 1], [f"moment along {along}", "mN", 1e3], ["twisting moment", "mN", 1e3],
            [f"moment along {across}", "mN", 1e3],
        ],
    }  # fmt: skip
    arrays |= {"knots": knots, "coefficients": _coefficients(knots, values), "modes": modes}
    return Pane(title, header, arrays)


def _modes(values: Array, tolerance: float) -> tuple[Array, Array]:
    """Shares (m, k) and modes (k, q) whose product is nearer to values (m, q) than a tolerance."""
    left, sizes, modes = np.linalg.svd(values, full_matrices=False)
    shares = left * sizes
    for count in range(len(sizes)):
        if np.abs(values - shares[:, :count] @ modes[:count]).max(initial=0.0) < tolerance:
            return shares[:, :count], modes[:count]
    return shares, modes


def _coefficients(knots: Array, values: Array) -> Array:
    """Of |Δ| at knots (m, d), then of 1 and of the places: (m + 1 + d, q), by which values (m, q) are met."""
    count, size = knots.shape
    plane = np.column_stack([np.ones(count), knots])
    matrix = np.block([[cdist(knots, knots), plane], [plane.T, np.zeros((size + 1, size + 1))]])
    target = np.vstack([values, np.zeros((size + 1, values.shape[1]))])
    # Few states leave the plane undetermined: the smallest one then.
    return np.asarray(np.linalg.lstsq(matrix, target, rcond=1e-12)[0], np.float64)


def _threads(woven: bool) -> tuple[str, str]:
    return ("weft", "warp") if woven else ("courses", "wales")


def _named(ray: Ray, end: Array, woven: bool) -> str:
    """What a ray of loads does to the fabric; nothing for rays that need many words."""
    along, across = _threads(woven)
    loads, _ = ray.levels[-1]
    if ray.kind == "tension" and loads.tensions:
        turn = round(math.degrees(loads.tensions[0][0]))
        return "tension " + {0: f"along {along}", 90: f"along {across}"}.get(turn, f"at {turn}°")
    place = int(np.abs(end[3:]).argmax())
    if ray.kind != "bending" or np.delete(np.abs(end[3:]), place).max() > 0.1 * abs(end[3 + place]):
        return ""
    side = "inwards" if end[3 + place] > 0 else "outwards"
    return "twist" if place == 1 else f"bending of {(along, '', across)[place]}, {side}"


def shown_states(states: Mapping[str, Equilibrium]) -> States:
    """A few equilibria, the first one at rest, with a path from there to each other one."""
    rest, *others = states.values()
    names = list(states)[1:]
    return States.of(list(states.values()), {name: [rest, state] for name, state in zip(names, others, strict=True)})
