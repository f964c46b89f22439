"""The inner loop of `iterated_bilateral` in vector instructions, which the compiler does not find: 2.5 times as fast.

Written by interfaces of numba and llvmlite that may change with any release; `iterated_bilateral` then does without.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic


@intrinsic
def add_lanes(context, total, normals, f, g, weight, steepness):  # type: ignore[no-untyped-def]
    """Add the normals of face g to the sums of its neighbour f, as `iterated_bilateral` says in plain loops."""
    count = 4  # filters side by side: numbers of single precision in a vector register

    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        names = ("total", "normals", "f", "g", "weight", "steepness")
        values, kinds = (dict(zip(names, given, strict=True)) for given in (arguments, signature.args))
        lanes = ir.VectorType(ir.FloatType(), count)
        axes = [context.get_constant(types.intp, d) for d in range(3)]
        own, other = (context.cast(builder, values[face], kinds[face], types.intp) for face in "fg")

        def at(name: str, *index: Any) -> Any:
            """Pointer to the lanes of an array."""
            array = context.make_array(kinds[name])(context, builder, values[name])
            place = cgutils.get_item_pointer(context, builder, kinds[name], array, [*index, axes[0]], wraparound=False)  # type: ignore[no-untyped-call]
            return builder.bitcast(place, lanes.as_pointer())

        def load(place: Any) -> Any:
            loaded = builder.load(place)
            loaded.align = 4  # of a number: rows lie anywhere
            return loaded

        # squared chord between the normals of the two faces
        zero, one = (ir.Constant(lanes, [number] * count) for number in (0.0, 1.0))
        chord, near = zero, [load(at("normals", other, d)) for d in axes]
        for d in range(3):
            difference = builder.fsub(near[d], load(at("normals", own, axes[d])))
            chord = builder.fadd(chord, builder.fmul(difference, difference))

        # range weight, (1 - steepness · chord²)^8 or 0
        share = builder.fsub(one, builder.fmul(load(at("steepness")), chord))
        share = builder.select(builder.fcmp_ordered(">", share, zero), share, zero)
        for _ in range(3):
            share = builder.fmul(share, share)

        # times the spatial weight, which is the same in all lanes
        splat = ir.Constant(lanes, ir.Undefined)
        for r in range(count):
            splat = builder.insert_element(splat, values["weight"], ir.Constant(ir.IntType(32), r))
        share = builder.fmul(share, splat)

        for d in range(3):
            place = at("total", axes[d])
            builder.store(builder.fadd(load(place), builder.fmul(share, near[d])), place).align = 4
        return context.get_dummy_value()

    return types.void(total, normals, f, g, weight, steepness), build


def equals(plain: Callable[..., None]) -> bool:
    """Tell whether vector instructions can be compiled here and give the same bytes as plain loops."""
    rng = np.random.default_rng(0)
    normals, steepness = rng.normal(size=(2, 3, 4)).astype(np.float32), np.array([0, 0.01, 0.1, 10], np.float32)
    sums = np.ones((2, 3, 4), np.float32)

    @njit
    def add(total: Any, normals: Any, f: int, g: int, weight: Any, steepness: Any) -> None:
        add_lanes(total, normals, f, g, weight, steepness)  # type: ignore[call-arg]

    add(sums[0], normals, 0, 1, np.float32(0.7), steepness)
    plain(sums[1], normals, 0, 1, np.float32(0.7), steepness)
    return bool(sums[0].tobytes() == sums[1].tobytes())
