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
    lanes = forms.shape[2]
    parameters = np.zeros((PARAMETER_COUNT, lanes))
    for b in range(forms.shape[0]):
        gather_parameters(packed, forms[b], lanes, parameters)
        _run(address, forms[b], parameters, densities[b], stress, moduli, b)


@numba.njit(**FAST)
def shared_densities(
    constants: NDArray, address: int, forms: NDArray, densities: NDArray, stress: NDArray, moduli: NDArray
) -> None:
    """The same of a material whose elements share their parameters, (P, 1)."""
    for b in range(forms.shape[0]):
        _run(address, forms[b], constants, densities[b], stress, moduli, b)


@numba.njit(**FAST)
def remembered_densities(
    constants: NDArray, memory: NDArray, address: int, forms: NDArray, densities: NDArray, stress: NDArray,
    moduli: NDArray,
) -> None:  # fmt: skip
    """The same of a material whose elements also have a memory each, (nb, M, B)."""
    lanes = forms.shape[2]
    pointers = np.empty(6, np.int64)
    for b in range(forms.shape[0]):
        pointers[0], pointers[1], pointers[2] = (forms[b].ctypes.data, constants.ctypes.data, memory[b].ctypes.data)
        pointers[3] = densities[b].ctypes.data
        if len(stress):
            pointers[4] = stress[b].ctypes.data
        if len(moduli):
            pointers[5] = moduli[b].ctypes.data
        call_address(address, (lanes, lanes, pointers))


@numba.njit(**FAST)
def _run(
    address: int,
    forms: NDArray,
    parameters: NDArray,
    densities: NDArray,
    stress: NDArray,
    moduli: NDArray,
    b: int,
) -> None:
    pointers = np.empty(5, np.int64)
    pointers[0], pointers[1], pointers[2] = (forms.ctypes.data, parameters.ctypes.data, densities.ctypes.data)
    if len(stress):
        pointers[3] = stress[b].ctypes.data
    if len(moduli):
        pointers[4] = moduli[b].ctypes.data
    call_address(address, (forms.shape[1], forms.shape[1], pointers))
