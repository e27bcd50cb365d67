"""Names of the columns of testing machines' logs and their units, in the languages that machines write."""

from __future__ import annotations

import re
from dataclasses import dataclass

QUANTITIES = {
    "fabric": ("fabric", "sample"),
    "direction": ("direction", "richtung", "probenrichtung"),
    "run": (
        "run", "video", "specimen", "specimen no", "specimen number", "test no", "probe", "versuch",
        "replicate",
    ),
    "force": (
        "force", "load", "standard force", "tensile force", "tensile load", "axial force", "effort",
        "kraft", "standardkraft", "prufkraft", "zugkraft", "last", "f", "fuerza", "carga", "charge",
        "forza", "carico", "kracht", "line load", "force per width", "荷重", "試験力", "力", "负荷",
    ),
    "clamp_distance": (
        "clamp distance", "axial length", "grip separation", "clamp separation", "jaw separation",
        "length", "lange", "distance between clamps", "einspannabstand", "klemmenabstand",
        "klemmabstand",
    ),
    "extension": (
        "extension", "tensile extension", "tensile displacement", "axial displacement",
        "axial strain", "displacement", "crosshead displacement", "crosshead", "stroke", "travel",
        "elongation", "strain", "tensile strain", "nominal strain", "engineering strain", "dehnung",
        "weg", "standardweg", "traversenweg", "traverse", "langenanderung", "verlangerung",
        "verformung", "deformation", "hub", "position", "deplacement", "allongement",
        "desplazamiento", "deformacion", "spostamento", "allungamento", "alargamiento", "dl", "変位",
        "ストローク", "伸び", "位移", "伸长",
    ),
    "mid_width": ("mid width", "lateral length", "width at the middle", "middle width"),
    "swatch_width": (
        "swatch width", "fabric width at clamp", "specimen width", "sample width", "width",
        "probenbreite", "breite",
    ),
    "swatch_length": (
        "swatch length", "gauge length", "gage length", "specimen length", "initial length",
        "einspannlange", "messlange", "l0",
    ),
    "loop_ratio": ("loop ratio",),
    **{
        f"{name}_{along}": (f"{name} {along}", *(f"{word} {along}" for word in also))
        for along in ("weft", "warp")
        for name, also in (("force", ("load",)), ("strain", ("stretch", "elongation")), ("width", ("swatch width",)))
    },
    "wales": ("wales", "wales per", "wale density", "maschenstabchen", "maschenstabchendichte"),
    "courses": ("courses", "courses per", "course density", "maschenreihen", "maschenreihendichte"),
    "loop_length": ("loop length", "stitch length", "maschenlange"),
    "yarn_count": ("yarn count", "linear density", "tex", "dtex", "denier", "garnfeinheit", "feinheit"),
    "area_density": (
        "area density", "areal density", "mass per area", "mass per unit area", "gsm", "weight", "g/m²", "g/m2",
        "flachengewicht", "flachenmasse", "grammage",
    ),
    "stress": ("stress",),
    "ignored": (
        "time", "zeit", "prufzeit", "n frames", "point", "index", "no", "nr", "cycle", "zyklus",
        "date", "datum",
    ),
}  # fmt: skip
"""Quantity → names of its column, the own one first, without capitals, accents and units. Ignored: no remark."""

UNITS = {
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "µm": 1e-6, "um": 1e-6, "in": 0.0254, "inch": 0.0254},
    "force": {
        "n": 1.0, "kn": 1e3, "cn": 1e-2, "mn": 1e-3, "gf": 9.80665e-3, "kgf": 9.80665, "kp": 9.80665,
        "lbf": 4.4482216153, "g": 9.80665e-3, "dan": 10.0,
    },
    "line load": {"n/m": 1.0, "n/cm": 1e2, "n/mm": 1e3, "cn/cm": 1.0, "mn/mm": 1.0, "kn/m": 1e3,
                  **dict.fromkeys(("n/5cm", "n/5 cm", "n/50mm", "n/50 mm"), 20.0), "cn/5cm": 0.2, "kgf/5cm": 196.133},
    "strain": {"%": 1e-2, "percent": 1e-2, "prozent": 1e-2, "1": 1.0, "-": 1.0, "mm/mm": 1.0, "m/m": 1.0},
    "time": {"s": 1.0, "sec": 1.0, "min": 60.0},
    "count": {**dict.fromkeys(("cm", "1/cm", "/cm", "per cm"), 1e2),
              **dict.fromkeys(("in", "inch", "1/in", "/inch", "per inch"), 1 / 0.0254)},
    "yarn count": {"tex": 1e-6, "dtex": 1e-7, "den": 1 / 9e6, "denier": 1 / 9e6},
    "mass per area": {**dict.fromkeys(("g/m2", "g/m²", "gsm"), 1e-3), "kg/m2": 1.0, "kg/m²": 1.0},
    "stress": {"mpa": 1e6, "kpa": 1e3, "pa": 1.0, "n/mm²": 1e6, "n/mm2": 1e6, "n_per_mm": 1e3},
}  # fmt: skip
"""Kind of quantity → unit in small letters → factor to SI. No machine measures fabric in meganewtons: mN is small."""
KINDS = {
    "force": ("force", "line load"),
    "extension": ("length", "strain"),
    **dict.fromkeys(("clamp_distance", "mid_width", "swatch_width", "swatch_length"), ("length",)),
    "stress": ("stress",),
    **{
        f"{name}_{along}": kinds
        for along in ("weft", "warp")
        for name, kinds in (
            ("force", ("force", "line load")),
            ("strain", ("strain",)),
            ("width", ("length",)),
        )
    },
    **dict.fromkeys(("wales", "courses"), ("count",)),
    "loop_length": ("length",),
    "yarn_count": ("yarn count",),
    "area_density": ("mass per area",),
}
"""Quantity → kinds of its units; none: no number."""
CONSTRUCTION = ("wales", "courses", "loop_length", "yarn_count", "area_density")
"""What lines above a table may say of the fabric."""
USUAL_UNITS = {
    "force": "N, cN, mN, kN, gf, lbf, N/m or N/cm",
    "extension": "mm, cm, m, % or 1",
    "stress": "N_per_mm",
    **{f"{name}_{along}": units for along in ("weft", "warp")
       for name, units in (("force", "N, cN, N/m or N/cm"), ("strain", "% or 1"))},
}  # fmt: skip
"""Quantity → units to name in an error; lengths of other quantities have mm, cm, m or in."""

_PLAIN = str.maketrans("äöüéèêáàóíñúâô", "aoueeeaaoinuao")
_BRACKETS = re.compile(r"^(.*?)\s*[\[(<{]\s*([^\])>}]*?)\s*[\])>}]\s*$")
_LAST = re.compile(r"^(.+?)(?:\s*/\s*|\s*,\s*|\s+in\s+|[_\s]+)([^_\s]+)$")


def _plain(text: str) -> str:
    """A name without capitals, accents, punctuation, remarks in brackets and a number at its end."""
    plain = re.sub(r"\(.*?\)", " ", text.lower()).translate(_PLAIN)
    plain = plain.replace("ae", "a").replace("oe", "o").replace("ue", "u")
    words = " ".join(re.split(r"[\s_.\-:]+", plain)).strip()
    return re.sub(r"(?<=\w) \d+$", "", words)


_OF_NAME = {_plain(name): quantity for quantity, names in QUANTITIES.items() for name in names}


@dataclass(frozen=True)
class ColumnName:
    """What a column's name says: its quantity, None for others, and its unit as written, None where there is none."""

    text: str
    quantity: str | None
    unit: str | None


def column_name(text: str) -> ColumnName:
    """Quantity and unit of a name such as ``force_N``, ``Load (N)``, ``Kraft in N`` or ``Tensile strain [%]``."""
    if (bracketed := _BRACKETS.match(text)) is not None:
        quantity = _OF_NAME.get(_plain(bracketed.group(1)))
        return ColumnName(text, quantity, bracketed.group(2) or None)
    if (quantity := _OF_NAME.get(_plain(text))) is not None:
        return ColumnName(text, quantity, None)
    if text.startswith("stress_"):
        return ColumnName(text, "stress", text.removeprefix("stress_"))
    if (last := _LAST.match(text.strip())) is not None:
        return ColumnName(text, _OF_NAME.get(_plain(last.group(1))), last.group(2))
    return ColumnName(text, None, None)


def is_unit(text: str) -> bool:
    """Whether a cell is a unit alone, in brackets or not."""
    bare = text.strip("[]()<>{} ").lower()
    return any(bare in units for units in UNITS.values())


def factor(quantity: str, unit: str | None) -> tuple[str, float] | None:
    """Kind and factor to SI of a quantity's unit, None where it has no such unit."""
    bare = (unit or "").strip("[]()<>{} ").lower().replace("μ", "µ")
    for kind in KINDS[quantity]:
        if bare in UNITS[kind]:
            return kind, UNITS[kind][bare]
    return None
