"""Which loads to sample: rays of growing loads from rest, where the fabric itself finds its strains.

Fabric is worn at some mN/m and breaks at some kN/m, and its strains say little of either: a box of strains spends its
samples where the fabric never is. So a state is chosen by its loads. A ray grows one load, evenly over the decades from
a fraction of the weight of a centimetre of the fabric up to a limit, each state starting from the one before.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, cycle

import numpy as np
from scipy.special import ndtri
from scipy.stats import qmc

from yarnscale.arrays import Array
from yarnscale.cell.periodic import PeriodicCell
from yarnscale.errors import InputError
from yarnscale.homogeneous.loads import FLAT, Loads, Prescribed
from yarnscale.kinematics import COMPONENTS, GRAVITY, strain_units

LEVELS = 9
"""Magnitudes of load on a ray."""
ITERATES = 3
"""Most equilibria of the cell that a level takes; all of them are samples."""
LIMIT = 50.0
"""Largest load by default [N/m]."""
SOLVES = 750
"""Equilibria of the cell by default."""
_PER_LEVEL = 2.1  # equilibria, as measured over ten patterns
_FEWEST_RAYS = 9  # of a plan that begins with the axes: tension and bending along both
_LEAST = 0.05  # of the weight of a centimetre of the fabric
_BENDS = np.array([0.008, 0.025, 0.05, 0.075, 0.1])
"""Curvatures of rays of pure bending, times the yarn radius."""
_WALK = np.array([0.03, 0.08, 0.14, 0.2, 0.26])
"""Curvatures of rays of bending under tension, times the yarn radius: through natural curvatures and beyond them."""
_HELD, _ROLLED, _BENT_ALONG = (6, 8, 11), 7, 9
"""Levels of tension that bending across starts from; that at which a piece rolls up freely; that of bending along."""
_BOTH, _SHEARED, _SHEARS = np.array([1.0, 0.0, 1.0]), ((7, 1.0), (5, -1.0)), np.array([0.02, 0.07, 0.16])
"""Tension both ways, its levels that are sheared and to which side, and the shear s_a."""
_IN_TURN = "stress", "bent", "tension", "stress", "stress", "bent", "stress", "stress"
"""Kinds of random rays. Loads of all six strains have the most directions, and soon roll the fabric up."""
_STRESSED = 2
"""First level of loads of all six strains: the weight of a centimetre of the fabric, about."""
_BOX = np.array([[-0.2, 0.7], [-0.6, 0.6], [-0.2, 0.7]])
"""Least and largest s_x, s_a, s_y of states that are chosen by strain, for safety; they bend up to 0.1/r."""


@dataclass(frozen=True, eq=False)
class Ray:
    """States that start one from the other: loads and prescribed strains of every level.

    kind: "rest", "tension" (in-plane loads, flat), "bending" (no load, curvature grows or is free), "bent" (in-plane
    loads at a given curvature), "stress" (loads of all strains), "strain" (all strains given), "visited" (strains of a
    simulation), "tested" (of a first fit's virtual tests). origin: number of the state in the store that the first
    level starts from, 0 that of rest.
    """

    kind: str
    levels: tuple[tuple[Loads, Prescribed], ...]
    origin: int = 0

    def plain(self) -> dict[str, object]:
        """As JSON values."""
        return {
            "kind": self.kind,
            "origin": self.origin,
            "levels": [
                {
                    "stress": list(loads.stress),
                    "tensions": [list(pair) for pair in loads.tensions],
                    "prescribed": np.column_stack([prescribed.matrix, prescribed.values]).tolist(),
                }
                for loads, prescribed in self.levels
            ],
        }

    @classmethod
    def from_plain(cls, entry: dict) -> Ray:
        """From what ``plain`` gives; KeyError, TypeError or ValueError for anything else."""
        levels = []
        for level in entry["levels"]:
            rows = np.asarray(level["prescribed"], np.float64).reshape(-1, 7)
            tensions = tuple((float(angle), float(load)) for angle, load in level["tensions"])
            levels.append((Loads(tuple(level["stress"]), tensions), Prescribed(rows[:, :6], rows[:, 6])))
        return cls(str(entry["kind"]), tuple(levels), int(entry["origin"]))


def load_rays(
    cell: PeriodicCell, *, solves: int = SOLVES, limit: float | None = None, seed: int = 0, fixed: bool = True
) -> list[Ray]:
    """Rays of about ``solves`` equilibria in all, the state of rest first; up to ``limit`` [N/m].

    limit: by default ``LIMIT``, or less where that would stretch all of the yarn by more than a quarter.

    fixed: begin with tension and bending along the axes and diagonals, else with random loads at once. The same numbers
    give the same rays, and those of more solves begin with those of fewer. Raises InputError for a limit that is no
    load, or too few solves for all kinds of states.
    """
    least = _LEAST * GRAVITY * 0.01 * cell.area_density
    most = doubling_load(cell)
    limit = largest_load(cell) if limit is None else limit
    if not 10 * least < limit <= most:
        expected = f"between {10 * least:.2g} and {most:.3g}, at which the yarn is twice as long"
        raise InputError("largest load [N/m]", expected=expected, found=limit)
    if solves < FEWEST:
        raise InputError("number of solves", expected=f"at least {FEWEST}", found=solves)
    radius, sizes = cell.pattern.radius, np.geomspace(least, limit, LEVELS)
    rays, spent = [Ray("rest", ((Loads(), strains_held(np.zeros(6))),))], 1.0
    close = np.concatenate([np.geomspace(least, 0.1 * limit, 10), np.linspace(0.1, 1.1, 9)[1:] * limit])
    drawn = _random_rays(radius, sizes, seed)
    # Few solves have some of all kinds too. Bending and shear under tension start from the rays at the beginning.
    axes = _along_axes(radius, sizes, close) if fixed else iter(())
    mixed = chain.from_iterable((ray, next(drawn)) if k % 2 else (ray,) for k, ray in enumerate(axes))
    pulled = [_tension(0.0, close), _tension(np.pi / 2, close), _in_plane(_BOTH, sizes)] if fixed else []
    for ray in chain(pulled, mixed, drawn):
        if spent >= solves and (not fixed or len(rays) > _FEWEST_RAYS):
            break
        rays.append(ray)
        spent += len(ray.levels) * (1.0 if ray.kind == "strain" else _PER_LEVEL)
    return rays


def largest_load(cell: PeriodicCell) -> float:
    """Largest load by default [N/m]."""
    return min(LIMIT, 0.25 * doubling_load(cell))


def doubling_load(cell: PeriodicCell) -> float:
    """Load [N/m] that would stretch all yarn of a fabric to twice its length, if it all lay along it."""
    moduli = (max(m.young_modulus, m.stretch.stiff_modulus) / m.density for m in cell.materials)
    return cell.area_density * max(moduli)


FEWEST = 30
"""Fewest solves of a plan."""
VISITED, TESTED = "visited", "tested"
"""Kinds of rays that are no part of a plan: to states where a simulation went, or a first fit in its own tests."""


def _along_axes(radius: float, sizes: Array, close: Array) -> Iterator[Ray]:
    """Bending with and without tension, rolling up, twist, tension along diagonals; close: closer levels of load."""
    yield from (_rolling(straight) for straight in ("II22", "II11"))
    yield from (_bending(angle, sign, radius) for angle in (0.0, np.pi / 2) for sign in (1.0, -1.0))
    yield from (
        _bent_under(close, pulled, across, level, sign / radius * _WALK)
        for level in _HELD
        for sign in (1.0, -1.0)
        for pulled, across in ((0, 1), (1, 0))
    )
    yield from (_rolled_under(close, pulled) for pulled in (0, 1))
    yield from (
        _bent_under(close, pulled, pulled, _BENT_ALONG, sign / radius * _WALK[:3])
        for sign in (1.0, -1.0)
        for pulled in (0, 1)
    )
    yield from (_sheared_under(sizes[level], sign * _SHEARS, _on_level(close, 2, level)) for level, sign in _SHEARED)
    yield _tension(np.pi / 4, close)
    yield from (_bending(angle, sign, radius) for angle in (np.pi / 4, 3 * np.pi / 4) for sign in (1.0, -1.0))
    yield from (_twisting(sign, radius) for sign in (1.0, -1.0))


def _random_rays(radius: float, sizes: Array, seed: int) -> Iterator[Ray]:
    """All kinds of loads in turn, and states of the box between them, without end."""
    # Each kind has a sequence of its own: every eighth point of one lies in a corner of the cube.
    draws = {kind: qmc.Sobol(7, rng=np.random.default_rng((seed, k))) for k, kind in enumerate(sorted(set(_IN_TURN)))}
    taken, box = Counter[str](), box_strains(radius, seed + 1)
    for kind in cycle(_IN_TURN):
        yield ray_to(next(box))
        turn, place = taken[kind], draws[kind].random(1)[0]
        taken[kind] += 1
        normal = ndtri(np.clip(place[:6], 1e-3, 1 - 1e-3))
        pull = normal[:3].copy()
        if turn % 3:  # fabric bears little compression before it buckles
            pull[[0, 2]] = np.abs(pull[[0, 2]])
        if kind == "stress":
            yield _stress(np.concatenate([pull, normal[3:]]) * _emphasis(turn // 3), sizes[_STRESSED:], radius)
        elif kind == "bent":
            yield _bent(pull, curvature(place[3:7], radius, least=0.004, most=0.15), sizes)
        elif turn % 2 == 0:
            yield _in_plane(pull, sizes)
        else:
            yield _tension(np.pi * place[6], sizes)


def _emphasis(turn: int) -> Array:
    """Weights of in-plane loads and moments: alike, mostly in-plane, mostly moments."""
    return np.repeat([(1.0, 1.0), (1.0, 0.1), (0.1, 1.0)][turn % 3], 3)


def curvature(place: Array, radius: float, *, least: float, most: float) -> Array:
    """(II11, II12, II22) [1/m] of four numbers in [0, 1): direction, size, second curvature, sign; half bend once.

    least, most: bounds of the larger principal curvature times the yarn radius, evenly over its decades.
    """
    turn, size, second, sign = place
    first = math.copysign(least * (most / least) ** size, 0.5 - sign) / radius
    other = 0.0 if second < 0.5 else first * (4 * second - 3)
    c, s = math.cos(math.pi * turn), math.sin(math.pi * turn)
    return np.array([first * c * c + other * s * s, (first - other) * c * s, first * s * s + other * c * c])


def strains_held(strain: Array) -> Prescribed:
    """All six strains at given values (6,)."""
    return Prescribed(np.eye(6), np.array(strain, np.float64))


def ray_to(strain: Array, parts: int = 3) -> Ray:
    """States on the straight way from rest to a strain (6,)."""
    return Ray("strain", tuple((Loads(), strains_held(k / parts * strain)) for k in range(1, parts + 1)))


def box_strains(radius: float, seed: int) -> Iterator[Array]:
    """Strains (6,) spread over a box that holds usual clothing, half of them bent doubly, in any direction; endless."""
    draws = qmc.Sobol(7, rng=seed)
    while True:
        place = draws.random(1)[0]
        in_plane = _BOX[:, 0] + (_BOX[:, 1] - _BOX[:, 0]) * place[:3]
        yield np.concatenate([in_plane, curvature(place[3:], radius, least=0.005, most=0.1)])


def _tension(angle: float, sizes: Array) -> Ray:
    return Ray("tension", tuple((Loads.tension(angle, size), FLAT) for size in sizes))


def _in_plane(direction: Array, sizes: Array, prescribed: Prescribed = FLAT, kind: str = "tension") -> Ray:
    along = direction / np.linalg.norm(direction)
    return Ray(kind, tuple((_loads(size * along), prescribed) for size in sizes))


def _bent(direction: Array, second_form: Array, sizes: Array) -> Ray:
    prescribed = Prescribed.components(**dict(zip(COMPONENTS[3:], second_form.tolist(), strict=True)))
    return _in_plane(direction, sizes, prescribed, "bent")


def _bending(angle: float, sign: float, radius: float) -> Ray:
    return Ray("bending", tuple((Loads(), Prescribed.bent(angle, sign * size / radius)) for size in _BENDS))


def _twisting(sign: float, radius: float) -> Ray:
    twists = (Prescribed.components(II11=0.0, II12=sign * float(size) / radius, II22=0.0) for size in _BENDS)
    return Ray("bending", tuple((Loads(), twist) for twist in twists))


def _rolling(straight: str) -> Ray:
    """A free piece that rolls up by itself along one axis."""
    prescribed = Prescribed.components(**{"II12": 0.0, straight: 0.0})
    return Ray("bending", ((Loads(), prescribed),) * 5)


def _bent_under(close: Array, pulled: int, bent: int, level: int, curvatures: Array) -> Ray:
    """Growing curvature about or along a tension, by axes 0 and 1; the cell is free across and to shear."""
    load = Loads.tension(pulled * math.pi / 2, close[level])
    walk = tuple((load, Prescribed.bent(bent * math.pi / 2, curvature)) for curvature in curvatures)
    return Ray("bent", walk, _on_level(close, pulled, level))


def _rolled_under(close: Array, pulled: int) -> Ray:
    """A piece under tension that rolls up by itself across."""
    straight = Prescribed.components(**{"II12": 0.0, ("II11", "II22")[pulled]: 0.0})
    load = Loads.tension(pulled * math.pi / 2, close[_ROLLED])
    return Ray("bent", ((load, straight),) * 4, _on_level(close, pulled, _ROLLED))


def _sheared_under(size: float, shears: Array, origin: int) -> Ray:
    """Growing shear at tension along both axes."""
    load = _loads(size * (_BOTH / np.linalg.norm(_BOTH)))
    return Ray("tension", tuple((load, FLAT + Prescribed.components(s_a=float(s))) for s in shears), origin)


def _on_level(close: Array, ray: int, level: int) -> int:
    """Number in the store of the last state on a level of one of the first rays behind that of rest."""
    return ((1 + ray) * len(close) + level + 1) * ITERATES - 1


def _stress(direction: Array, sizes: Array, radius: float) -> Ray:
    """Loads of all six strains; moments count by the work they do over a tenth of the yarn's curvature."""
    along = direction / np.linalg.norm(direction) * 0.5 / strain_units(radius)
    return Ray("stress", tuple((_loads(size * along), Prescribed()) for size in sizes))


def _loads(values: Sequence[float] | Array) -> Loads:
    return Loads(tuple(float(v) for v in values) + (0.0,) * (6 - len(values)))
