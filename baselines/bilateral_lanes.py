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

LANES = 4
"""Filters side by side: numbers of single precision in a vector register."""


@intrinsic
def filter_lanes(context, f, normals, own, rings, weights, steepness, out):  # type: ignore[no-untyped-def]
    """Filter the normals of face f, as `iterated_bilateral` says in plain loops."""
    return types.void(f, normals, own, rings, weights, steepness, out), _build


def _build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    """Write the instructions of `filter_lanes`."""
    write = _Instructions(context, builder, signature, arguments)
    face = write.cast("f")
    mine = write.normals_of(face)
    totals = write.weighted_sums(face, mine)
    write.normalized(face, totals, mine)
    return context.get_dummy_value()


class _Instructions:
    """Instructions on the arguments of `filter_lanes`, given by name, with a filter in each lane of a vector."""

    def __init__(self, context: Any, builder: Any, signature: Any, arguments: Any) -> None:
        names = ("f", "normals", "own", "rings", "weights", "steepness", "out")
        values, kinds = (dict(zip(names, given, strict=True)) for given in (arguments, signature.args))
        for number, part in enumerate(("indptr", "indices")):
            values[part], kinds[part] = builder.extract_value(values["rings"], number), kinds["rings"].types[number]
        self.context, self.builder, self.values, self.kinds = context, builder, values, kinds
        self.lanes = ir.VectorType(ir.FloatType(), LANES)
        self.zero, self.one = (ir.Constant(self.lanes, [number] * LANES) for number in (0.0, 1.0))
        self.axes = [context.get_constant(types.intp, d) for d in range(3)]

    def cast(self, name: str) -> Any:
        """Return a number as an index."""
        return self.context.cast(self.builder, self.values[name], self.kinds[name], types.intp)

    def entry(self, name: str, *index: Any) -> Any:
        """Return an entry of an array."""
        return self.builder.load(self._at(name, *index))

    def vector(self, name: str, *index: Any) -> Any:
        """Return the lanes of an array."""
        loaded = self.builder.load(self._vector_at(name, *index))
        loaded.align = 4  # of a number: rows lie anywhere
        return loaded

    def splat(self, number: Any) -> Any:
        """Return a vector with the number in all lanes."""
        vector = ir.Constant(self.lanes, ir.Undefined)
        for r in range(LANES):
            vector = self.builder.insert_element(vector, number, ir.Constant(ir.IntType(32), r))
        return vector

    def squares(self, x: Any, y: Any, z: Any) -> Any:
        """Return x² + y² + z²."""
        xx, yy, zz = (self.builder.fmul(n, n) for n in (x, y, z))
        return self.builder.fadd(self.builder.fadd(xx, yy), zz)

    def normals_of(self, face: Any) -> list[Any]:
        """Return the three components of the normals of a face, a vector each."""
        return [self.vector("normals", face, d) for d in self.axes]

    def weighted_sums(self, face: Any, mine: list[Any]) -> list[Any]:
        """Return the sums of the normals of the neighbours by their weights, to which the face itself adds."""
        builder = self.builder
        steep, weight = self.vector("steepness"), self.splat(self.entry("own", face))
        sums = [cgutils.alloca_once_value(builder, builder.fmul(weight, n)) for n in mine]  # type: ignore[no-untyped-call]
        first, last = (self.entry("indptr", row) for row in (face, builder.add(face, self.axes[1])))
        with cgutils.for_range_slice(builder, first, last, self.axes[1]) as (k, _):
            # squared chord between the normals of the two faces
            neighbor = self.context.cast(builder, self.entry("indices", k), self.kinds["indices"].dtype, types.intp)
            near = self.normals_of(neighbor)
            chord = self.squares(*(builder.fsub(n, m) for n, m in zip(near, mine, strict=True)))

            # range weight, (1 - steepness · chord²)^8 or 0, times the spatial weight, which is the same in all lanes
            share = builder.fsub(self.one, builder.fmul(steep, chord))
            share = builder.select(builder.fcmp_ordered(">", share, self.zero), share, self.zero)
            for _ in range(3):
                share = builder.fmul(share, share)
            share = builder.fmul(share, self.splat(self.entry("weights", k)))
            for total, n in zip(sums, near, strict=True):
                builder.store(builder.fadd(builder.load(total), builder.fmul(share, n)), total)
        return [builder.load(total) for total in sums]

    def normalized(self, face: Any, totals: list[Any], mine: list[Any]) -> None:
        """Store the sums at length 1 as the normals of a face; where they vanish, its own normals."""
        builder = self.builder
        root = ir.FunctionType(self.lanes, [self.lanes])
        root = cgutils.get_or_insert_function(builder.module, root, f"llvm.sqrt.v{LANES}f32")  # type: ignore[no-untyped-call]
        length = builder.call(root, [self.squares(*totals)])
        long = builder.fcmp_ordered(">", length, self.zero)
        for d in range(3):
            normal = builder.select(long, builder.fdiv(totals[d], length), mine[d])
            builder.store(normal, self._vector_at("out", face, self.axes[d])).align = 4

    def _at(self, name: str, *index: Any) -> Any:
        """Return the pointer to an entry of an array."""
        kind = self.kinds[name]
        array = self.context.make_array(kind)(self.context, self.builder, self.values[name])
        return cgutils.get_item_pointer(self.context, self.builder, kind, array, [*index], wraparound=False)  # type: ignore[no-untyped-call]

    def _vector_at(self, name: str, *index: Any) -> Any:
        """Return the pointer to the lanes of an array."""
        return self.builder.bitcast(self._at(name, *index, self.axes[0]), self.lanes.as_pointer())


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
