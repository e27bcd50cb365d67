"""LLVM IR of a symbolic graph (``vector_ir``) → SIMD machine code.

It is compiled through llvmlite: no compiler on the user's machine. Object code is kept on disk (``object_cache``).
"""

from __future__ import annotations

import ctypes
import inspect
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from functools import cache

import casadi as ca
import llvmlite.binding as llvm
import numpy as np

from yarnscale.arrays import Array
from yarnscale.numerics import object_cache
from yarnscale.numerics import vector_ir as translator
from yarnscale.numerics.vector_ir import LANES, vector_ir

BLOCK = 128
"""Elements that callers usually hand over at once, so that all arrays of a block stay in cache."""

_EFFORT = 1
"""Of code generation. Graphs come without repeated parts: LLVM's passes take half the time and gain nothing."""


class _Machine:
    """The LLVM target of this machine; keeps loaded code alive."""

    def __init__(self) -> None:
        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        self.cpu = llvm.get_host_cpu_name()
        self.features = llvm.get_host_cpu_features().flatten()
        self.triple = llvm.get_process_triple()
        self.loaded: list[object] = []

    def target(self) -> llvm.TargetMachine:
        target = llvm.Target.from_triple(self.triple)
        return target.create_target_machine(cpu=self.cpu, features=self.features, opt=_EFFORT)

    def object_code(self, text: str) -> bytes:
        module = llvm.parse_assembly(text)
        module.verify()
        return self.target().emit_object(module)

    def load(self, code: bytes) -> int:
        engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), self.target())
        file = llvm.ObjectFileRef.from_data(code)
        engine.add_object_file(file)
        engine.finalize_object()
        self.loaded.append((engine, file, code))
        return engine.get_function_address("kernel")


@cache
def _machine() -> _Machine:
    return _Machine()


@dataclass(frozen=True)
class Kernel:
    """Compiled code of one CasADi function; arguments are inputs, then outputs, each (size, stride) float64.

    shared: places of the inputs of which all elements read the same numbers, (size, 1).
    """

    name: str
    address: int
    sizes: tuple[int, ...]
    operations: int
    shared: frozenset[int]
    _call: Callable[..., None] = field(repr=False)

    def __call__(self, count: int, stride: int, *arrays: Array) -> None:
        """Run on the first ``count`` elements (a multiple of LANES) of arrays of shape (size, stride)."""
        if len(arrays) != len(self.sizes):
            raise ValueError(f"kernel '{self.name}' takes {len(self.sizes)} arrays, found {len(arrays)}")
        if count % LANES or count > stride or count <= 0:
            raise ValueError(f"kernel '{self.name}': count {count} must be a multiple of {LANES} up to {stride}")
        for k, (size, array) in enumerate(zip(self.sizes, arrays, strict=True)):
            columns = 1 if k in self.shared else stride
            if array.size != size * columns or not array.flags.c_contiguous or array.dtype != np.float64:
                raise ValueError(f"kernel '{self.name}': expected float64 ({size}, {columns}), found {array.shape}")
        table = (ctypes.c_void_p * len(arrays))(*(a.ctypes.data for a in arrays))
        self._call(count, stride, table)


@cache
def _compiler() -> str:
    """All that decides on a kernel's code but its graph: versions, the translator's source and the target."""
    machine = _machine()
    versions = [llvm.__name__, str(llvm.llvm_version_info), ca.CasadiMeta.version(), inspect.getsource(translator)]
    return "\n".join([*versions, machine.triple, machine.cpu, machine.features, str(_EFFORT)])


def _key(function: ca.Function, shared: Collection[int]) -> str:
    """Of a kernel in the disk cache. The graph is serialized, a tenth of the time that its IR takes."""
    return "\n".join([_compiler(), str(sorted(shared)), function.serialize()])


def compile_kernel(function: ca.Function, name: str, *, shared: Collection[int] = ()) -> Kernel:
    """Machine code for a CasADi function whose inputs and outputs are dense; from the disk cache where it is there.

    shared: places of inputs of which all elements read the same numbers.
    """
    machine = _machine()
    code = object_cache.fetch(_key(function, shared), lambda: machine.object_code(vector_ir(function, shared)))
    address = machine.load(code)
    sizes = [function.numel_in(k) for k in range(function.n_in())]
    sizes += [function.numel_out(k) for k in range(function.n_out())]
    call = ctypes.CFUNCTYPE(None, ctypes.c_int64, ctypes.c_int64, ctypes.c_void_p)(address)
    return Kernel(name, address, tuple(sizes), function.n_instructions(), frozenset(shared), call)


def run_columns(kernel: Kernel, *inputs: Array) -> list[Array]:
    """Run a kernel on arrays (n, size), one row an element, (1, size) where all share it; its outputs likewise."""
    n = max(len(array) for array in inputs)
    count = max(LANES, -(-n // LANES) * LANES)
    arrays = []
    for k, array in enumerate(inputs):
        column = np.empty((array.shape[1], 1 if k in kernel.shared else count))
        column[:, :n] = array.T
        column[:, n:] = array[-1:].T
        arrays.append(column)
    outputs = [np.empty((size, count)) for size in kernel.sizes[len(inputs) :]]
    kernel(count, count, *arrays, *outputs)
    return [output[:, :n].T.copy() for output in outputs]
