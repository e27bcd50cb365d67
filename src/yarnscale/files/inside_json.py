"""The field ``terms.inside`` of a material file: terms of all three in-plane strains and of both curvatures."""

from __future__ import annotations

from itertools import product

import numpy as np

from yarnscale.files.json_fields import Fields
from yarnscale.shell.materials.inside import COUPLING, SHAPES, SOLIDS, InsideTerms
from yarnscale.shell.materials.tables import CubicSpline

DERIVATIVES = {
    "".join(name for name, order in zip("xay", orders, strict=True) if order) or "value": orders
    for orders in product((0, 1), repeat=3)
}
"""Names of nodal data and how often they are differentiated by s_x, s_a, s_y."""


def inside_content(terms: InsideTerms) -> dict[str, object]:
    """The field as plain JSON values."""
    return {
        "knots": [knots.tolist() for knots in terms.knots],
        "splines": [_spline_content(terms, t) for t in range(COUPLING)],
        "shapes_x": [_shape_content(shape) for shape in terms.shapes_x],
        "shapes_y": [_shape_content(shape) for shape in terms.shapes_y],
        "coupling": {"curvature": terms.curvature, "spline": _spline_content(terms, COUPLING)},
    }


def read_inside(fields: Fields) -> InsideTerms:
    """Terms of the field; InputError that names what is wrong in it."""
    lists = fields.get("knots")
    if not isinstance(lists, list) or len(lists) != 3:
        raise fields.fault("knots", expected="three lists of knots", found=repr(lists)[:60])
    sides = Fields(dict(zip("xay", lists, strict=True)), fields.path, fields.label("knots"))
    x, a, y = (sides.knots(name) for name in "xay")
    splines = fields.items("splines")
    if len(splines) != COUPLING:
        raise fields.fault("splines", expected=f"{COUPLING} splines", found=len(splines))
    shapes_x, shapes_y = _shapes(fields, "shapes_x"), _shapes(fields, "shapes_y")
    nodal, curvature = np.zeros((SOLIDS, 2, 2, 2, len(x), len(a), len(y))), 1.0
    if "coupling" in fields.content:
        coupling = fields.fields("coupling")
        curvature = coupling.number("curvature", positive=True)
        splines.append(coupling.fields("spline"))
    for t, item in enumerate(splines):
        for name, orders in DERIVATIVES.items():
            nodal[(t, *orders)] = item.numbers(name, shape=nodal.shape[4:])
    return InsideTerms((x, a, y), nodal, shapes_x, shapes_y, curvature)


def _spline_content(terms: InsideTerms, spline: int) -> dict[str, object]:
    return {name: terms.nodal[(spline, *orders)].tolist() for name, orders in DERIVATIVES.items()}


def _shape_content(shape: CubicSpline) -> dict[str, object]:
    return {"knots": shape.knots.tolist(), "values": shape.values.tolist(), "slopes": shape.slopes.tolist()}


def _shapes(fields: Fields, key: str) -> tuple[CubicSpline, ...]:
    items = fields.items(key)
    if len(items) != SHAPES:
        raise fields.fault(key, expected=f"{SHAPES} splines", found=len(items))
    found = []
    for item in items:
        knots = item.knots("knots")
        values, slopes = (item.numbers(name, shape=knots.shape) for name in ("values", "slopes"))
        found.append(CubicSpline(knots, values, slopes))
    return tuple(found)
