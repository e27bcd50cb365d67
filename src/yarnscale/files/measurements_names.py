"""Names of the columns of testing machines' logs and their units, in the languages that machines write."""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass
from importlib.resources import files

_TABLES = tomllib.loads((files("yarnscale") / "files" / "measurements_names.toml").read_text(encoding="utf-8"))
QUANTITIES: dict[str, list[str]] = _TABLES["quantities"]
"""Quantity → names of its column, the own one first, without capitals, accents and units."""
UNITS: dict[str, dict[str, float]] = _TABLES["units"]
"""Kind of quantity → unit in small letters → factor to SI."""
KINDS = {
    "force": ("force", "line load"),
    "extension": ("length", "strain"),
    **dict.fromkeys(("clamp_distance", "mid_width", "swatch_width", "swatch_length"), ("length",)),
    "stress": ("stress",),
    **{
        f"{name}_{along}": kinds
        for along in ("weft", "warp")
        for name, kinds in (("force", ("force", "line load")), ("strain", ("strain",)), ("width", ("length",)))
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
