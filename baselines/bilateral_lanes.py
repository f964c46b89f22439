"""A face of `iterated_bilateral` in vector instructions, which the compiler does not find: over four times as fast.

Written by interfaces of numba and llvmlite that may change with any release; `iterated_bilateral` then does without.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic

from cascadenorm.mesh import Csr


@intrinsic
def filter_lanes(context, f, normals, own, rings, weights, steepness, out):  # type: ignore[no-untyped-def]
    """Filter the normals of face f, as `iterated_bilateral` says in plain loops."""
    count = 4  # filters side by side: numbers of single precision in a vector register

    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        names = ("f", "normals", "own", "rings", "weights", "steepness", "out")
        values, kinds = (dict(zip(names, given, strict=True)) for given in (arguments, signature.args))
        for number, part in enumerate(("indptr", "indices")):
            values[part], kinds[part] = builder.extract_value(values["rings"], number), kinds["rings"].types[number]
        lanes = ir.VectorType(ir.FloatType(), count)
        axes = [context.get_constant(types.intp, d) for d in range(3)]

        def at(name: str, *index: Any) -> Any:
            """Pointer to an entry of an array."""
            array = context.make_array(kinds[name])(context, builder, values[name])
            return cgutils.get_item_pointer(context, builder, kinds[name], array, [*index], wraparound=False)  # type: ignore[no-untyped-call]

        def vector_at(name: str, *index: Any) -> Any:
            """Pointer to the lanes of an array."""
            return builder.bitcast(at(name, *index, axes[0]), lanes.as_pointer())

        def load(place: Any) -> Any:
            loaded = builder.load(place)
            loaded.align = 4  # of a number: rows lie anywhere
            return loaded

        def splat(number: Any) -> Any:
            """Return a vector with the number in all lanes."""
            vector = ir.Constant(lanes, ir.Undefined)
            for r in range(count):
                vector = builder.insert_element(vector, number, ir.Constant(ir.IntType(32), r))
            return vector

        def squares(x: Any, y: Any, z: Any) -> Any:
            return builder.fadd(builder.fadd(builder.fmul(x, x), builder.fmul(y, y)), builder.fmul(z, z))

        # the sums begin with the face itself
        zero, one = (ir.Constant(lanes, [number] * count) for number in (0.0, 1.0))
        face = context.cast(builder, values["f"], kinds["f"], types.intp)
        mine = [load(vector_at("normals", face, d)) for d in axes]
        steep, weight = load(vector_at("steepness")), splat(builder.load(at("own", face)))
        sums = [cgutils.alloca_once_value(builder, builder.fmul(weight, n)) for n in mine]  # type: ignore[no-untyped-call]

        first, last = (builder.load(at("indptr", row)) for row in (face, builder.add(face, axes[1])))
        with cgutils.for_range_slice(builder, first, last, axes[1]) as (k, _):
            # squared chord between the normals of the two faces
            neighbor = context.cast(builder, builder.load(at("indices", k)), kinds["indices"].dtype, types.intp)
            near = [load(vector_at("normals", neighbor, d)) for d in axes]
            chord = squares(*(builder.fsub(n, m) for n, m in zip(near, mine, strict=True)))

            # range weight, (1 - steepness · chord²)^8 or 0, times the spatial weight, which is the same in all lanes
            share = builder.fsub(one, builder.fmul(steep, chord))
            share = builder.select(builder.fcmp_ordered(">", share, zero), share, zero)
            for _ in range(3):
                share = builder.fmul(share, share)
            share = builder.fmul(share, splat(builder.load(at("weights", k))))
            for total, n in zip(sums, near, strict=True):
                builder.store(builder.fadd(builder.load(total), builder.fmul(share, n)), total)

        # at length 1
        totals = [builder.load(total) for total in sums]
        root = ir.FunctionType(lanes, [lanes])
        root = cgutils.get_or_insert_function(builder.module, root, f"llvm.sqrt.v{count}f32")  # type: ignore[no-untyped-call]
        length = builder.call(root, [squares(*totals)])
        long = builder.fcmp_ordered(">", length, zero)
        for d in range(3):
            normal = builder.select(long, builder.fdiv(totals[d], length), mine[d])
            builder.store(normal, vector_at("out", face, axes[d])).align = 4
        return context.get_dummy_value()

    return types.void(f, normals, own, rings, weights, steepness, out), build


def equals(plain: Callable[..., None]) -> bool:
    """Tell whether vector instructions can be compiled here and give the same bytes as plain loops."""
    rng = np.random.default_rng(0)
    normals, steepness = rng.normal(size=(5, 3, 4)).astype(np.float32), np.array([0, 0.01, 0.1, 10], np.float32)
    normals[4] = 0  # whose sums vanish
    rings = Csr(np.array([0, 2, 4, 4, 4, 4]), np.array([1, 2, 3, 0], np.int32))
    own, weights = rng.random((2, 5)).astype(np.float32)
    filtered = np.zeros((2, *normals.shape), np.float32)

    @njit(error_model="numpy")
    def filter_face(f: int, normals: Any, own: Any, rings: Any, weights: Any, steepness: Any, out: Any) -> None:
        filter_lanes(f, normals, own, rings, weights, steepness, out)  # type: ignore[call-arg]

    runs: tuple[Callable[..., None], ...] = (filter_face, plain)
    for run, out in zip(runs, filtered, strict=True):
        for f in range(len(normals)):
            run(f, normals, own, rings, weights, steepness, out)
    return bool(filtered[0].tobytes() == filtered[1].tobytes())
