"""Compiled code called by its address, inside functions that numba compiles."""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from yarnscale.arrays import Integers


@intrinsic
def _call_address(typingctx, address, arguments):  # type: ignore[no-untyped-def]
    signature = types.void(types.int64, arguments)

    def generate(context, builder, signature, given):  # type: ignore[no-untyped-def]
        word = ir.IntType(64)
        kinds = signature.args[1].types
        words = [
            builder.ptrtoint(context.make_array(kind)(context, builder, value=value).data, word)
            if isinstance(kind, types.Array)
            else context.cast(builder, value, kind, types.int64)
            for kind, value in zip(kinds, cgutils.unpack_tuple(builder, given[1], len(kinds)), strict=True)
        ]
        function = ir.FunctionType(ir.VoidType(), [word] * len(words))
        builder.call(builder.inttoptr(given[0], function.as_pointer()), words)
        return context.get_dummy_value()

    return signature, generate


call_address = cast("Callable[[int, tuple[int | Integers, ...]], None]", _call_address)
"""Inside ``@njit``: call code by its address with a tuple of int64 numbers, addresses, or arrays, whose data it gets.

An array that is used only so lives until the call; one whose ``ctypes.data`` is taken may be freed before. (An
intrinsic's own first argument is numba's.)"""
