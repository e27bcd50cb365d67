"""Every instruction of the kernel translator against CasADi's own evaluation."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numba
import numpy as np
import pytest

from yarnscale.numerics import kernel, vector_ir
from yarnscale.numerics.address_call import call_address
from yarnscale.numerics.kernel import BLOCK, LANES, compile_kernel, run_columns

UNARY: dict[str, Callable[[ca.SX], ca.SX]] = {
    "neg": lambda x: -x,
    "sq": lambda x: x**2,
    "twice": lambda x: 2 * x,
    "inv": lambda x: 1 / x,
    "not": lambda x: ca.logic_not(x),
    "sign": ca.sign,
    "fabs": ca.fabs,
    "floor": ca.floor,
    "ceil": ca.ceil,
    "sin": ca.sin,
    "cos": ca.cos,
    "tan": ca.tan,
    "exp": ca.exp,
    "atan": ca.atan,
    "tanh": ca.tanh,
    "expm1": ca.expm1,
    "sqrt": lambda x: ca.sqrt(ca.fabs(x)),
    "log": lambda x: ca.log(ca.fabs(x) + 0.1),
    "log1p": lambda x: ca.log1p(ca.fabs(x)),
    "acos": lambda x: ca.acos(x / 5),
    "asin": lambda x: ca.asin(x / 5),
    "constpow": lambda x: ca.fabs(x) ** 2.3,
}
BINARY: dict[str, Callable[[ca.SX, ca.SX], ca.SX]] = {
    "add": lambda x, y: x + y,
    "sub": lambda x, y: x - y,
    "mul": lambda x, y: x * y,
    "div": lambda x, y: x / y,
    "lt": lambda x, y: x < y,
    "le": lambda x, y: x <= y,
    "eq": lambda x, y: ca.eq(x, y),
    "ne": lambda x, y: ca.ne(x, y),
    "and": lambda x, y: ca.logic_and(x > 0, y),
    "or": lambda x, y: ca.logic_or(x > 0, y),
    "fmin": ca.fmin,
    "fmax": ca.fmax,
    "atan2": ca.atan2,
    "copysign": ca.copysign,
    "pow": lambda x, y: ca.fabs(x) ** y,
    "if_else": lambda x, y: ca.if_else(x > y, ca.sin(x), y),
    "if_else_zero": lambda x, y: ca.if_else(x > y, x * y, 0),
}
TIES = np.array([0.0, -0.0, 1.0, 1.0, -2.5, 3.0, -3.0])


def columns(count: int, size: int, seed: int = 0) -> np.ndarray:
    """Random rows (count, size), among them zeros and equal values that decide comparisons."""
    rows = np.random.default_rng(seed).uniform(-4, 4, (count, size))
    ties = min(len(TIES), count)
    rows[:ties] = TIES[:ties, None]
    return rows


def by_casadi(function: ca.Function, *inputs: np.ndarray) -> list[np.ndarray]:
    rows = [[np.array(o).ravel() for o in function.call(list(row))] for row in zip(*inputs, strict=True)]
    return [np.array(output) for output in zip(*rows, strict=True)]


@pytest.mark.parametrize("name", UNARY)
def test_unary_instructions(name: str) -> None:
    x = ca.SX.sym("x")
    function = ca.Function("f", [x], [UNARY[name](x)])
    inputs = columns(37, 1)
    kernel = compile_kernel(function, name)
    np.testing.assert_allclose(run_columns(kernel, inputs)[0], by_casadi(function, inputs)[0], rtol=4e-15, atol=1e-15)


@pytest.mark.parametrize("name", BINARY)
def test_binary_instructions(name: str) -> None:
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    function = ca.Function("f", [x, y], [BINARY[name](x, y)])
    first, second = columns(61, 1), columns(61, 1, 1)
    second[:3, 0] = 2.0, -1.5, 1.0
    kernel = compile_kernel(function, name)
    np.testing.assert_allclose(
        run_columns(kernel, first, second)[0],
        by_casadi(function, first, second)[0],
        rtol=4e-15,
        atol=1e-15,
    )


def test_every_instruction_that_the_translator_knows_is_met_above() -> None:
    """Guards the two tables: an instruction added to the translator needs a line here."""
    from yarnscale.numerics import vector_ir

    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    met: set[int] = set()
    for graph in [f(x) for f in UNARY.values()] + [f(x, y) for f in BINARY.values()]:
        function = ca.Function("f", [x, y], [graph])
        met |= {function.instruction_id(k) for k in range(function.n_instructions())}
    tables = (
        vector_ir._PLAIN,
        vector_ir._COMPARE,
        vector_ir._UNARY_INTRINSIC,
        vector_ir._BINARY_INTRINSIC,
        vector_ir._LIBRARY,
    )
    known = {code for table in tables for code in table}
    assert known - met == set()


@pytest.mark.parametrize("graph", [ca.sinh, ca.erf, lambda x: ca.fmod(x, 2)], ids=["sinh", "erf", "fmod"])
def test_an_unknown_instruction_is_refused(graph: Callable[[ca.SX], ca.SX]) -> None:
    x = ca.SX.sym("x")
    with pytest.raises(NotImplementedError, match="operation"):
        compile_kernel(ca.Function("f", [x], [graph(x)]), "unknown")


def test_a_sparse_output_is_refused() -> None:
    x = ca.SX.sym("x", 2)
    diagonal = ca.diag(x)
    with pytest.raises(ValueError, match="must be dense"):
        compile_kernel(ca.Function("f", [x], [diagonal]), "sparse")


def test_infinities_pass_through() -> None:
    """A contact at zero distance is infinite, not a large number or NaN; far beyond reach it is zero."""
    x = ca.SX.sym("x")
    kernel = compile_kernel(ca.Function("f", [x], [ca.fmax(0, 1 - x) ** 2 / x, -ca.log(x)]), "barrier")
    penalty, logarithm = run_columns(kernel, np.array([[0.0], [1e-300], [0.5], [1e300], [np.inf]]))
    np.testing.assert_allclose(penalty.ravel(), [np.inf, 1e300, 0.5, 0.0, 0.0], rtol=1e-15)
    assert logarithm[0, 0] == np.inf


def test_nan_is_not_hidden() -> None:
    x = ca.SX.sym("x")
    kernel = compile_kernel(ca.Function("f", [x], [ca.sqrt(x), x * 2 + 1]), "nan")
    root, line = run_columns(kernel, np.array([[-1.0], [np.nan], [4.0]]))
    assert np.isnan(root[:2]).all() and root[2, 0] == 2.0
    assert np.isnan(line[1, 0])


@pytest.mark.parametrize("count", [1, 7, 8, 9, BLOCK - 1, BLOCK, BLOCK + 3, 3 * BLOCK + 17])
def test_several_inputs_and_outputs_for_any_count(count: int) -> None:
    x, y = ca.SX.sym("x", 3), ca.SX.sym("y", 2)
    energy = ca.sqrt(1 + ca.dot(x, x)) * ca.sin(y[0]) + ca.exp(y[1]) * x[2] ** 3
    outputs = [energy, ca.gradient(energy, x), ca.vec(ca.jacobian(ca.gradient(energy, x), y))]
    function = ca.Function("f", [x, y], [ca.densify(o) for o in outputs], {"cse": True})
    rows = columns(count, 3, count), columns(count, 2, count + 1)
    found = run_columns(compile_kernel(function, "several"), *rows)
    for a, b in zip(found, by_casadi(function, *rows), strict=True):
        np.testing.assert_allclose(a, b.reshape(a.shape), rtol=1e-13, atol=1e-13)


def test_only_the_counted_elements_are_written() -> None:
    x = ca.SX.sym("x")
    kernel = compile_kernel(ca.Function("f", [x], [x + 1]), "counted")
    values, out = np.zeros((1, 4 * LANES)), np.full((1, 4 * LANES), 7.0)
    kernel(2 * LANES, 4 * LANES, values, out)
    np.testing.assert_array_equal(out[0, : 2 * LANES], 1.0)
    np.testing.assert_array_equal(out[0, 2 * LANES :], 7.0)


@pytest.mark.parametrize(
    ("count", "stride", "shapes"),
    [
        (LANES - 1, LANES, [(2, LANES), (1, LANES)]),
        (2 * LANES, LANES, [(2, LANES), (1, LANES)]),
        (0, LANES, [(2, LANES), (1, LANES)]),
        (LANES, LANES, [(1, LANES), (1, LANES)]),
        (LANES, LANES, [(2, LANES)]),
    ],
)
def test_calls_that_would_reach_past_an_array_are_refused(
    count: int, stride: int, shapes: list[tuple[int, int]]
) -> None:
    x = ca.SX.sym("x", 2)
    kernel = compile_kernel(ca.Function("f", [x], [ca.dot(x, x)]), "refused")
    with pytest.raises(ValueError, match="kernel 'refused'"):
        kernel(count, stride, *[np.zeros(shape) for shape in shapes])


def test_arrays_of_another_type_or_order_are_refused() -> None:
    x = ca.SX.sym("x", 2)
    kernel = compile_kernel(ca.Function("f", [x], [ca.dot(x, x)]), "types")
    out = np.zeros((1, LANES))
    for wrong in (np.zeros((2, LANES), np.float32), np.zeros((LANES, 2)).T):
        with pytest.raises(ValueError, match="float64"):
            kernel(LANES, LANES, wrong, out)


@numba.njit
def _call_from_compiled_code(address, values, out):
    pointers = np.zeros(2, np.int64)
    pointers[0], pointers[1] = values.ctypes.data, out.ctypes.data
    call_address(address, (values.shape[1], values.shape[1], pointers))


def test_a_kernel_runs_from_compiled_code() -> None:
    x = ca.SX.sym("x", 2)
    kernel = compile_kernel(ca.Function("f", [x], [x[0] - 3 * x[1]]), "compiled")
    values, out = np.random.default_rng(0).normal(size=(2, 3 * LANES)), np.zeros((1, 3 * LANES))
    _call_from_compiled_code(kernel.address, values, out)
    np.testing.assert_allclose(out[0], values[0] - 3 * values[1], rtol=1e-14)


def test_logarithm_is_exact_to_the_last_place() -> None:
    x = ca.SX.sym("x", 1)
    kernel = compile_kernel(ca.Function("log", [x], [ca.log(x)]), "log")
    rng = np.random.default_rng(0)
    drawn = [
        10 ** rng.uniform(-300, 300, 2000),
        1 + rng.normal(scale=1e-3, size=2000),
        rng.uniform(0.1, 3, 1992),
    ]
    special = np.array([0.0, -1.0, np.inf, np.nan, 1.0, 2.0, 0.5, np.sqrt(2)])
    values = np.concatenate([*drawn, special])[None]
    found = np.empty_like(values)
    kernel(values.size, values.size, values, found)
    with np.errstate(divide="ignore", invalid="ignore"):
        expected = np.log(values)
    np.testing.assert_array_max_ulp(found[:, :-8], expected[:, :-8], maxulp=2)
    np.testing.assert_allclose(found[:, -8:], expected[:, -8:], rtol=1e-15)


KEY = """
import hashlib, casadi as ca
from yarnscale.numerics import kernel
x, y = ca.SX.sym("x", 2), ca.SX.sym("y", 1)
function = ca.Function("f", [x, y], [ca.sin(x * y) / 0.1 + ca.dot(x, x)], {"cse": True})
print(hashlib.sha256(kernel._key(function, {1}).encode()).hexdigest())
"""


def test_processes_agree_on_the_key_of_a_kernel() -> None:
    keys = {
        subprocess.run(
            [sys.executable, "-c", KEY], env=os.environ | {"PYTHONHASHSEED": seed}, capture_output=True, check=True
        ).stdout
        for seed in ("1", "2")
    }
    assert len(keys) == 1 and keys != {b""}


def test_graphs_of_other_code_have_other_keys() -> None:
    x = ca.SX.sym("x", 2)
    graphs = [x * 0.1, x * np.nextafter(0.1, 1), x / 0.1, ca.vertcat(x[1], x[0]) * 0.1]
    functions = [ca.Function("f", [x], [graph]) for graph in graphs]
    keys = [kernel._key(function, ()) for function in functions] + [kernel._key(functions[0], (0,))]
    assert len(set(keys)) == len(keys)
    assert Path(vector_ir.__file__).read_text() in keys[0], "a translator that is changed writes code anew"
