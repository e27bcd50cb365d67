"""Writer of a spline material as C source: energy density, gradient and Hessian by the six strains.

The file stands alone (C99 and its mathematics library): patches of all splines as static arrays, the interval search,
and the element's formula, generated from the same symbolic energy that the package compiles for itself. So the numbers
agree to rounding with those of the package, which ``tests/files/test_c_export.py`` checks with the C compiler found.
"""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from yarnscale.files.atomic import write_text
from yarnscale.kinematics import COMPONENTS
from yarnscale.shell.materials.spline_material import SplineMaterial, energy_of_strains
from yarnscale.shell.materials.spline_patches import AXES, MEETING, PARAMETER_COUNT, PackedSplines

Array = NDArray[np.float64]

_KNOTS = ("x", "a", "y", "bend_x", "bend_y")
_IN_PLANE = (("plane_xa", 0, 1), ("plane_xy", 0, 2), ("plane_ay", 1, 2))
_INSIDE = ("x", "a", "y")
_FAMILIES = (("bend_xx", "bend_ax", "bend_yx"), ("bend_xy", "bend_ay", "bend_yy"))


def write_c_source(path: str | Path, material: SplineMaterial) -> None:
    """Write the C source of a material, whole or not at all; InputError where the file cannot be written."""
    write_text(path, c_source(material))


def c_source(material: SplineMaterial) -> str:
    """One C file with the function ``yarnscale_energy`` and a comment that says how to use it."""
    packed = material.packed
    parts = [
        _header(material),
        "#include <math.h>\n",
        _tables(packed),
        _SEARCH,
        _element(material.parameter_count),
    ]
    parts.append(_gather(packed, material.parameter_count))
    return "\n".join(parts)


def _header(material: SplineMaterial) -> str:
    name = str(material.provenance.get("pattern", material.provenance.get("file", "spline material")))
    limits = [
        f"   {n:<9} {low:.6g} to {high:.6g}" for n, (low, high) in zip(AXES, material.range, strict=True)
    ]
    lines = [
        f"/* {_comment(name)}: energy density of a thin shell, written by yarnscale.",
        "",
        "   int yarnscale_energy(const double strain[6], double *energy, double gradient[6], double hessian[36]);",
        "",
        f"   strain: {', '.join(COMPONENTS)};",
        "   s_x = sqrt(I11) - 1, s_a = I12 / sqrt(I11 I22), s_y = sqrt(I22) - 1 [-], second form II [1/m].",
        "   energy [J/m^2] per rest area; gradient and hessian (row by row) are its derivatives by the strain.",
        "   Any of the three outputs may be null. Returns 0, or 1 for a strain that no surface has",
        "   (s_x <= -1, s_y <= -1, |s_a| >= 1 or not a number), and then writes nothing.",
        "   Thread-safe: no state is kept. Compile as C99 or later, without -ffast-math; link with -lm.",
        "",
        f"   density: {material.density:.9g} kg/m^2. Sampled range, outside of which the energy is continued:",
        *limits,
        "*/",
    ]
    return "\n".join(lines) + "\n"


def _comment(text: str) -> str:
    """Text that cannot end the comment it stands in."""
    return re.sub(r"[^\w .,()+-]", "_", text)[:80]


def _array(name: str, values: Array) -> str:
    flat = values.ravel()
    if not np.any(flat):
        return f"static const double {name}[{len(flat)}] = {{0}};\n"
    words = [repr(float(v)) if np.isfinite(v) else "HUGE_VAL" for v in flat]
    rows = [", ".join(words[k : k + 8]) for k in range(0, len(words), 8)]
    return f"static const double {name}[{len(flat)}] = {{\n" + ",\n".join(rows) + "};\n"


def _tables(packed: PackedSplines) -> str:
    # Knots without their padding: the search counts in C.
    knots = [_array(f"knots_{name}", getattr(packed, f"origins_{name}")[1:]) for name in _KNOTS]
    origins = [_array(f"origins_{name}", getattr(packed, f"origins_{name}")) for name in _KNOTS]
    names = [name for name, _, _ in _IN_PLANE] + [name for family in _FAMILIES for name in family]
    if packed.has_inside:
        own = [f"inside_origins_{name}" for name in _INSIDE]
        knots += [_array(name.replace("origins", "knots"), getattr(packed, name)[1:]) for name in own]
        names += [*own, "solids", "shapes_x", "shapes_y"]
    return "\n".join(knots + origins + [_array(name, getattr(packed, name)) for name in names])


_SEARCH = """\
/* Interval of x: the number of knots that are not above it. */
static int interval(const double *knots, int count, double x) {
  int low = 0, high = count;
  while (low < high) {
    int middle = (low + high) / 2;
    if (knots[middle] <= x) low = middle + 1; else high = middle;
  }
  return low;
}

static void copy_patch(const double *patch, double *out) {
  for (int k = 0; k < 16; ++k) out[k] = patch[k];
}

/* Patch p less patch q, about the left knot of p, `offset` after that of q; `far` unless they are neighbours. */
static void difference(const double *p, const double *q, int size, double offset, int far, double *out) {
  for (int k = 0; k < size; k += 4) {
    const double q1 = q[k + 1], q2 = q[k + 2], q3 = q[k + 3];
    out[k] = far ? p[k] - (q[k] + offset * (q1 + offset * (q2 + offset * q3))) : 0.0;
    out[k + 1] = far ? p[k + 1] - (q1 + offset * (2.0 * q2 + 3.0 * offset * q3)) : 0.0;
    out[k + 2] = p[k + 2] - (q2 + 3.0 * offset * q3);
    out[k + 3] = p[k + 3] - q3;
  }
}
"""


@cache
def _element(parameter_count: int) -> str:
    """The C function of energy, gradient and Hessian of one element from its strain and patches."""
    strain, parameters = ca.SX.sym("strain", 6), ca.SX.sym("p", parameter_count)
    energy = energy_of_strains(strain, parameters)
    hessian, gradient = ca.hessian(energy, strain)
    outputs = [energy, ca.densify(gradient), ca.densify(hessian)]
    function = ca.Function("element", [strain, parameters], outputs, {"cse": True})
    generator = ca.CodeGenerator("element.c", {"with_header": False})
    generator.add(function)
    found = re.search(r"static int casadi_f0\([^)]*\) \{\n(.*?)\n\}\n", generator.dump(), re.DOTALL)
    assert found is not None
    body = found[1].replace("casadi_real", "double").replace("casadi_sq", "square")
    for k, name in enumerate(("strain", "p")):
        body = re.sub(rf"arg\[{k}\]\? arg\[{k}\]\[(\d+)\] : 0", rf"{name}[\1]", body)
    for k, name in enumerate(("energy", "gradient", "hessian")):
        body = re.sub(rf"if \(res\[{k}\]!=0\) res\[{k}\]\[(\d+)\]=", rf"{name}[\1]=", body)
    assert "arg[" not in body and "res[" not in body and "casadi" not in body
    return (
        "static double square(double x) { return x * x; }\n\n"
        "static void element(const double *strain, const double *p, double *energy, double *gradient,\n"
        "                    double *hessian) {\n" + body.replace("  return 0;", "").rstrip() + "\n}\n"
    )


def _gather(packed: PackedSplines, parameter_count: int) -> str:
    counts = {name: len(getattr(packed, f"origins_{name}")) - 1 for name in _KNOTS}
    lines = [
        "int yarnscale_energy(const double strain[6], double *energy, double gradient[6], double hessian[36]) {",
        f"  double p[{parameter_count}], value[1], first[6], second[36];",
        "  if (!(strain[0] > -1.0 && strain[2] > -1.0 && fabs(strain[1]) < 1.0)) return 1;",
        "  for (int k = 3; k < 6; ++k) if (!isfinite(strain[k])) return 1;",
        "  if (!isfinite(strain[0]) || !isfinite(strain[2])) return 1;",
        "  const double middle = 0.5 * (strain[3] + strain[5]), half = 0.5 * (strain[3] - strain[5]);",
        "  const double radius = sqrt(half * half + strain[4] * strain[4]);",
        f"  const double span = origins_bend_x[{counts['bend_x']}] - origins_bend_x[0];",
        f"  const double reach = radius < {MEETING!r} * span ? 0.0 : radius;",
    ]
    for k, name in enumerate(_KNOTS[:3]):
        lines.append(f"  const int s{k} = interval(knots_{name}, {counts[name]}, strain[{k}]);")
    for name in _KNOTS[3:]:
        for side, sign in (("upper", "+"), ("lower", "-")):
            value = f"middle {sign} reach"
            lines.append(f"  const int {side}_{name} = interval(knots_{name}, {counts[name]}, {value});")
    lines.append(
        "  p[7] = (upper_bend_x == lower_bend_x && upper_bend_y == lower_bend_y) ? 1.0 : 0.0;"
        "  /* keeps a root away from 0 */"
    )
    lines += [f"  p[{k}] = origins_{name}[s{k}];" for k, name in enumerate(_KNOTS[:3])]
    for row, name in ((3, "bend_x"), (5, "bend_y")):
        lines += [
            f"  p[{row}] = origins_{name}[lower_{name}];",
            f"  p[{row + 1}] = origins_{name}[upper_{name}];",
        ]
    for k, (name, i, j) in enumerate(_IN_PLANE):
        lines.append(
            f"  copy_patch({name} + 16 * (s{i} * {counts[_KNOTS[j]] + 1} + s{j}), p + {8 + 16 * k});"
        )
    for row, axis, family in ((56, "bend_x", _FAMILIES[0]), (152, "bend_y", _FAMILIES[1])):
        lines += _family_lines(row, axis, family, counts[axis] + 1)
    if packed.has_inside:
        lines += _inside_lines(packed)
    lines += [
        "  element(strain, p, value, first, second);",
        "  if (energy) *energy = value[0];",
        "  if (gradient) for (int k = 0; k < 6; ++k) gradient[k] = first[k];",
        "  if (hessian) for (int k = 0; k < 36; ++k) hessian[k] = second[k];",
        "  return 0;",
        "}",
    ]
    return "\n".join(lines) + "\n"


def _inside_lines(packed: PackedSplines) -> list[str]:
    """Copy the patches of the splines of three strains, and the pieces of their shapes."""
    counts = [len(getattr(packed, f"inside_origins_{name}")) - 1 for name in _INSIDE]
    size, shapes, row = packed.solids.shape[-1], packed.shapes_x.shape[-1], PARAMETER_COUNT
    lines = [
        f"  const int t{k} = interval(inside_knots_{name}, {count}, strain[{k}]);"
        for k, (name, count) in enumerate(zip(_INSIDE, counts, strict=True))
    ]
    lines += [f"  p[{row + k}] = inside_origins_{name}[t{k}];" for k, name in enumerate(_INSIDE)]
    place = f"(t0 * {counts[1] + 1} + t1) * {counts[2] + 1} + t2"
    lines.append(f"  p[{row + 3}] = {packed.coupling!r};  /* 1/(curvature of the coupling)^2 */")
    row += 4
    lines.append(f"  for (int k = 0; k < {size}; ++k) p[{row} + k] = solids[{size} * ({place}) + k];")
    row += size
    for name in ("x", "y"):
        axis = f"bend_{name}"
        lines.append(
            f"  for (int k = 0; k < {shapes}; ++k) {{\n"
            f"    p[{row} + k] = shapes_{name}[{shapes} * lower_{axis} + k];\n"
            f"    p[{row + shapes} + k] = 0.0;\n"
            "  }\n"
            f"  if (upper_{axis} != lower_{axis})\n"
            f"    difference(shapes_{name} + {shapes} * upper_{axis},\n"
            f"               shapes_{name} + {shapes} * lower_{axis}, {shapes},\n"
            f"               origins_{axis}[upper_{axis}] - origins_{axis}[lower_{axis}],\n"
            f"               upper_{axis} > lower_{axis} + 1, p + {row + shapes});"
        )
        row += 2 * shapes
    return lines


def _family_lines(row: int, axis: str, family: tuple[str, str, str], columns: int) -> list[str]:
    """Copy the patches of one bending family at the lower curvature, and the differences to the upper one."""
    lines = [
        f"    copy_patch({name} + 16 * (s{j} * {columns} + lower_{axis}), p + {row + 16 * j});"
        for j, name in enumerate(family)
    ]
    lines.append(
        f"    if (upper_{axis} == lower_{axis}) for (int k = 0; k < 48; ++k) p[{row + 48} + k] = 0.0;"
    )
    lines.append("    else {")
    lines.append(
        f"      const double offset = origins_{axis}[upper_{axis}] - origins_{axis}[lower_{axis}];\n"
        f"      const int far = upper_{axis} > lower_{axis} + 1;"
    )
    for j, name in enumerate(family):
        base = f"{name} + 16 * (s{j} * {columns} + "
        lines.append(
            f"      difference({base}upper_{axis}), {base}lower_{axis}), 16, offset, far, p + {row + 48 + 16 * j});"
        )
    return ["  {", *lines, "    }", "  }"]
