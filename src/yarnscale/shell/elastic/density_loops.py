"""Loops over blocks of elements that evaluate an energy density: gather parameters, run the kernel.

Compiled without the interpreter's lock, so that parts of a mesh are evaluated on several threads.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from yarnscale.numerics.address_call import call_address
from yarnscale.shell.elastic.moduli import FAST
from yarnscale.shell.materials.spline_patches import PARAMETER_COUNT, PackedSplines, gather_parameters


@numba.njit(**FAST)
def spline_densities(
    packed: PackedSplines, address: int, forms: NDArray, densities: NDArray, stress: NDArray, moduli: NDArray
) -> None:
    """Densities (nb, B) of a spline material at forms (nb, 6, B) and, in ``stress`` and ``moduli`` if these are not
    empty, its derivatives.

    address: kernel (forms, parameters) → density[, stress (nb, 6, B), moduli (nb, 21, B)].
    """
    parameters, memory = np.zeros((PARAMETER_COUNT, forms.shape[2])), np.empty((0, 0, 0))
    for b in range(forms.shape[0]):
        gather_parameters(packed, forms[b], forms.shape[2], parameters)
        _run(address, forms, parameters, memory, densities, stress, moduli, b)


@numba.njit(**FAST)
def shared_densities(
    constants: NDArray, memory: NDArray, address: int, forms: NDArray, densities: NDArray, stress: NDArray,
    moduli: NDArray,
) -> None:  # fmt: skip
    """The same of a material whose elements share their parameters, (P, 1), and may have a memory each, (nb, M, B)."""
    for b in range(forms.shape[0]):
        _run(address, forms, constants, memory, densities, stress, moduli, b)


@numba.njit(**FAST)
def _run(
    address: int, forms: NDArray, parameters: NDArray, memory: NDArray, densities: NDArray, stress: NDArray,
    moduli: NDArray, b: int,
) -> None:  # fmt: skip
    """Run the kernel on block b; it takes a memory where there is one."""
    pointers, k = np.empty(6, np.int64), 2
    pointers[0], pointers[1] = forms[b].ctypes.data, parameters.ctypes.data
    if memory.shape[1]:
        pointers[2], k = memory[b].ctypes.data, 3
    pointers[k] = densities[b].ctypes.data
    if len(stress):
        pointers[k + 1] = stress[b].ctypes.data
    if len(moduli):
        pointers[k + 2] = moduli[b].ctypes.data
    call_address(address, (forms.shape[2], forms.shape[2], pointers))
