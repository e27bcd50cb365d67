"""Symbolic graph → LLVM IR that works on ``LANES`` elements at once.

A CasADi function of dense columns is translated instruction by instruction. Arrays are structures of arrays: component
k of element n lies at ``[k, n]``; an input that all elements share is one column.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

LANES = 8
"""Elements that one pass of a kernel works on; counts are multiples of it."""

# No nnan/ninf: kernels may meet infinities (a contact at zero distance) and must carry them through.
_FAST = "nsz arcp contract afn reassoc"
_VECTOR = f"<{LANES} x double>"
_MASK = f"<{LANES} x i1>"
_SUFFIX = f"v{LANES}f64"

_PLAIN = {
    ca.OP_ADD: "fadd {a}, {b}", ca.OP_SUB: "fsub {a}, {b}", ca.OP_MUL: "fmul {a}, {b}", ca.OP_DIV: "fdiv {a}, {b}",
    ca.OP_NEG: "fneg {a}", ca.OP_SQ: "fmul {a}, {a}", ca.OP_TWICE: "fadd {a}, {a}", ca.OP_INV: "fdiv {one}, {a}",
}  # fmt: skip
_COMPARE = {ca.OP_LT: "olt", ca.OP_LE: "ole", ca.OP_EQ: "oeq", ca.OP_NE: "une"}
_UNARY_INTRINSIC = {
    ca.OP_SQRT: "sqrt",
    ca.OP_SIN: "sin",
    ca.OP_COS: "cos",
    ca.OP_EXP: "exp",
    ca.OP_FABS: "fabs",
    ca.OP_FLOOR: "floor",
    ca.OP_CEIL: "ceil",
}
_BINARY_INTRINSIC = {
    ca.OP_FMAX: "maxnum",
    ca.OP_FMIN: "minnum",
    ca.OP_POW: "pow",
    ca.OP_CONSTPOW: "pow",
    ca.OP_COPYSIGN: "copysign",
}
_LIBRARY = {
    ca.OP_ATAN2: ("atan2", 2),
    ca.OP_ATAN: ("atan", 1),
    ca.OP_ACOS: ("acos", 1),
    ca.OP_ASIN: ("asin", 1),
    ca.OP_TAN: ("tan", 1),
    ca.OP_TANH: ("tanh", 1),
    ca.OP_LOG1P: ("log1p", 1),
    ca.OP_EXPM1: ("expm1", 1),
}


_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
_LOG_SERIES = (
    6.666666666666735130e-01,
    3.999999999940941908e-01,
    2.857142874366239149e-01,
    2.222219843214978396e-01,
    1.818357216161805012e-01,
    1.531383769920937332e-01,
    1.479819860511658591e-01,
)


def _constant(value: float) -> str:
    bits = np.float64(value).view(np.uint64)
    return "<" + ", ".join([f"double 0x{bits:016X}"] * LANES) + ">"


@dataclass
class _Writer:
    """Collects IR lines while walking the instruction list of a CasADi function."""

    lines: list[str] = field(default_factory=list)
    counter: int = 0

    def fresh(self) -> str:
        self.counter += 1
        return f"%t{self.counter}"

    def emit(self, expression: str) -> str:
        name = self.fresh()
        self.lines.append(f"  {name} = {expression}")
        return name

    def address(self, base: str, component: int) -> str:
        row = self.emit(f"mul i64 %stride, {component}")
        index = self.emit(f"add i64 {row}, %n")
        return self.emit(f"getelementptr double, ptr {base}, i64 {index}")

    def shared(self, base: str, component: int) -> str:
        """A number that all elements share, on all lanes."""
        pointer = self.emit(f"getelementptr double, ptr {base}, i64 {component}")
        scalar = self.emit(f"load double, ptr {pointer}, align 8")
        first = self.emit(f"insertelement {_VECTOR} undef, double {scalar}, i32 0")
        lanes = f"<{LANES} x i32>"
        return self.emit(f"shufflevector {_VECTOR} {first}, {_VECTOR} undef, {lanes} zeroinitializer")

    def truth(self, mask: str) -> str:
        return self.emit(f"select {_MASK} {mask}, {_VECTOR} {_constant(1.0)}, {_VECTOR} zeroinitializer")

    def is_true(self, value: str) -> str:
        return self.emit(f"fcmp une {_VECTOR} {value}, zeroinitializer")

    def each_lane(self, function: str, arguments: list[str]) -> str:
        result = "undef"
        for lane in range(LANES):
            scalars = [self.emit(f"extractelement {_VECTOR} {a}, i32 {lane}") for a in arguments]
            called = self.emit(f"call double @{function}({', '.join('double ' + s for s in scalars)})")
            result = self.emit(f"insertelement {_VECTOR} {result}, double {called}, i32 {lane}")
        return result

    def logarithm(self, x: str) -> str:
        """Natural logarithm on all lanes at once; the library's, lane by lane, is ten times slower.

        x = 2^e (1 + f) with 1 + f in [√½, √2), s = f/(2 + f), log(1 + f) = 2 s + s·P(s²) (minimax polynomial of fdlibm,
        error below one unit in the last place). Subnormal numbers count as the smallest normal ones.
        """
        words = f"<{LANES} x i64>"

        def whole(value: int) -> str:
            return "<" + ", ".join([f"i64 {value}"] * LANES) + ">"

        def plain(word: str, a: str, b: str) -> str:
            return self.emit(f"{word} {_VECTOR} {a}, {b}")

        bits = self.emit(f"bitcast {_VECTOR} {x} to {words}")
        exponent = self.emit(f"lshr {words} {bits}, {whole(52)}")
        mantissa = self.emit(f"and {words} {bits}, {whole(0x000FFFFFFFFFFFFF)}")
        scaled = self.emit(f"or {words} {mantissa}, {whole(0x3FF0000000000000)}")
        m = self.emit(f"bitcast {words} {scaled} to {_VECTOR}")
        large = self.emit(f"fcmp ogt {_VECTOR} {m}, {_constant(2.0**0.5)}")
        m = self.emit(f"select {_MASK} {large}, {_VECTOR} {plain('fmul', m, _constant(0.5))}, {_VECTOR} {m}")
        power = self.emit(f"sitofp {words} {exponent} to {_VECTOR}")
        offset = self.emit(f"select {_MASK} {large}, {_VECTOR} {_constant(1022.0)}, {_VECTOR} {_constant(1023.0)}")
        power = plain("fsub", power, offset)
        f = plain("fsub", m, _constant(1.0))
        s = plain("fdiv", f, plain("fadd", f, _constant(2.0)))
        z = plain("fmul", s, s)
        series = _constant(_LOG_SERIES[-1])
        for coefficient in reversed(_LOG_SERIES[:-1]):
            series = plain("fadd", plain("fmul", series, z), _constant(coefficient))
        rest = plain("fmul", series, z)
        half = plain("fmul", plain("fmul", f, f), _constant(0.5))
        low = plain("fmul", power, _constant(_LN2_LOW))
        correction = plain("fadd", plain("fmul", s, plain("fadd", half, rest)), low)
        result = plain(
            "fsub", plain("fmul", power, _constant(_LN2_HIGH)), plain("fsub", plain("fsub", half, correction), f)
        )
        finite = self.emit(f"fcmp olt {_VECTOR} {x}, {_constant(float('inf'))}")
        result = self.emit(f"select {_MASK} {finite}, {_VECTOR} {result}, {_VECTOR} {x}")
        negative = self.emit(f"fcmp olt {_VECTOR} {x}, zeroinitializer")
        result = self.emit(f"select {_MASK} {negative}, {_VECTOR} {_constant(float('nan'))}, {_VECTOR} {result}")
        nothing = self.emit(f"fcmp oeq {_VECTOR} {x}, zeroinitializer")
        return self.emit(f"select {_MASK} {nothing}, {_VECTOR} {_constant(float('-inf'))}, {_VECTOR} {result}")

    def operation(self, code: int, a: str, b: str) -> str:
        """Emit one arithmetic instruction and return the name of its value."""
        if code in _PLAIN:
            word, _, operands = _PLAIN[code].partition(" ")
            return self.emit(f"{word} {_FAST} {_VECTOR} {operands.format(a=a, b=b, one=_constant(1.0))}")
        if code in _UNARY_INTRINSIC:
            return self.emit(f"call {_FAST} {_VECTOR} @llvm.{_UNARY_INTRINSIC[code]}.{_SUFFIX}({_VECTOR} {a})")
        if code in _BINARY_INTRINSIC:
            name = f"@llvm.{_BINARY_INTRINSIC[code]}.{_SUFFIX}"
            return self.emit(f"call {_FAST} {_VECTOR} {name}({_VECTOR} {a}, {_VECTOR} {b})")
        if code in _LIBRARY:
            name, arity = _LIBRARY[code]
            return self.each_lane(name, [a, b][:arity])
        if code in _COMPARE:
            return self.truth(self.emit(f"fcmp {_COMPARE[code]} {_VECTOR} {a}, {b}"))
        return self._special(code, a, b)

    def _special(self, code: int, a: str, b: str) -> str:
        if code == ca.OP_LOG:
            return self.logarithm(a)
        if code == ca.OP_ASSIGN:
            return a
        if code == ca.OP_NOT:
            return self.truth(self.emit(f"fcmp oeq {_VECTOR} {a}, zeroinitializer"))
        if code in (ca.OP_AND, ca.OP_OR):
            word = "and" if code == ca.OP_AND else "or"
            return self.truth(self.emit(f"{word} {_MASK} {self.is_true(a)}, {self.is_true(b)}"))
        if code == ca.OP_IF_ELSE_ZERO:
            return self.emit(f"select {_MASK} {self.is_true(a)}, {_VECTOR} {b}, {_VECTOR} zeroinitializer")
        if code == ca.OP_SIGN:
            size = self.emit(f"call {_VECTOR} @llvm.copysign.{_SUFFIX}({_VECTOR} {_constant(1.0)}, {_VECTOR} {a})")
            return self.emit(f"select {_MASK} {self.is_true(a)}, {_VECTOR} {size}, {_VECTOR} zeroinitializer")
        raise NotImplementedError(f"CasADi operation {code} has no vector instruction yet")


def _declarations() -> list[str]:
    unary = [f"declare {_VECTOR} @llvm.{o}.{_SUFFIX}({_VECTOR})" for o in sorted(set(_UNARY_INTRINSIC.values()))]
    binary = [
        f"declare {_VECTOR} @llvm.{o}.{_SUFFIX}({_VECTOR}, {_VECTOR})" for o in sorted(set(_BINARY_INTRINSIC.values()))
    ]
    library = [f"declare double @{name}({', '.join(['double'] * n)})" for name, n in sorted(_LIBRARY.values())]
    return unary + binary + library


def vector_ir(function: ca.Function, shared: Collection[int]) -> str:
    """LLVM IR of ``kernel(count, stride, pointer table)`` for a CasADi function of dense columns."""
    for kind, n, sparsity in (
        ("input", function.n_in(), function.sparsity_in),
        ("output", function.n_out(), function.sparsity_out),
    ):
        for k in range(n):
            if not sparsity(k).is_dense():
                raise ValueError(f"{kind} {k} of kernel '{function.name()}' must be dense")
    names = [f"%in{k}" for k in range(function.n_in())] + [f"%out{k}" for k in range(function.n_out())]
    signature = ", ".join(["i64 %count", "i64 %stride"] + [f"ptr noalias {name}" for name in names])
    body = _Writer()
    values: dict[int, str] = {}
    for k in range(function.n_instructions()):
        code = function.instruction_id(k)
        outputs, inputs = function.instruction_output(k), function.instruction_input(k)
        if code == ca.OP_CONST:
            values[outputs[0]] = _constant(function.instruction_constant(k))
        elif code == ca.OP_INPUT:
            if inputs[0] in shared:
                values[outputs[0]] = body.shared(f"%in{inputs[0]}", inputs[1])
                continue
            pointer = body.address(f"%in{inputs[0]}", inputs[1])
            values[outputs[0]] = body.emit(f"load {_VECTOR}, ptr {pointer}, align 8")
        elif code == ca.OP_OUTPUT:
            pointer = body.address(f"%out{outputs[0]}", outputs[1])
            body.lines.append(f"  store {_VECTOR} {values[inputs[0]]}, ptr {pointer}, align 8")
        else:
            a = values[inputs[0]]
            b = values[inputs[1]] if len(inputs) > 1 else a
            values[outputs[0]] = body.operation(code, a, b)
    loads = [
        f"  %slot{k} = getelementptr ptr, ptr %table, i64 {k}\n  %pointer{k} = load ptr, ptr %slot{k}"
        for k in range(len(names))
    ]
    arguments = ", ".join(["i64 %count", "i64 %stride"] + [f"ptr %pointer{k}" for k in range(len(names))])
    return "\n".join(
        [
            *_declarations(),
            f"define internal void @body({signature}) {{",
            "entry:\n  br label %loop",
            "loop:\n  %n = phi i64 [0, %entry], [%next, %loop]",
            *body.lines,
            f"  %next = add i64 %n, {LANES}",
            "  %more = icmp slt i64 %next, %count",
            "  br i1 %more, label %loop, label %done",
            "done:\n  ret void\n}",
            "define void @kernel(i64 %count, i64 %stride, ptr %table) {",
            *loads,
            f"  call void @body({arguments})",
            "  ret void\n}",
        ]
    )
