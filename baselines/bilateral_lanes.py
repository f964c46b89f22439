"""The filter of one face of `iterated_bilateral` in vector instructions, which the compiler does not generate itself.

The interfaces of numba and llvmlite that it uses may change with any release; `iterated_bilateral` then runs its loops.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic

from cascadenorm.mesh import Csr

LANES = 4  # number of filters that run side by side: single-precision numbers in a vector register


@intrinsic
def filter_lanes(context, f, normals, own, rings, weights, steepness, out):  # type: ignore[no-untyped-def]
    """Filter the normals of face f, as the plain loops of `iterated_bilateral` do."""
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
        self.zero = ir.Constant(self.lanes, [0.0] * LANES)
        self.axes = [context.get_constant(types.intp, d) for d in range(3)]

    def cast(self, name: str) -> Any:
        """Return a number as an index."""
        return self.context.cast(self.builder, self.values[name], self.kinds[name], types.intp)

    def entry(self, name: str, *index: Any) -> Any:
        return self.builder.load(self._at(name, *index))

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
        first = self._vector_at("normals", face, self.axes[0])
        return [self._loaded(self.builder.gep(first, [d])) for d in self.axes]

    def weighted_sums(self, face: Any, mine: list[Any]) -> list[Any]:
        """Return the weighted sums of the normals of the neighbours and of the face itself."""
        builder = self.builder
        steep, weight = self._loaded(self._vector_at("steepness")), self.splat(self.entry("own", face))
        first, last = (self.entry("indptr", row) for row in (face, builder.add(face, self.axes[1])))

        # two neighbours at a time in vectors of twice the length, which is faster
        odd = builder.sub(last, builder.and_(builder.sub(last, first), self.axes[1]))
        none = ir.Constant(ir.VectorType(ir.FloatType(), 2 * LANES), [0.0] * 2 * LANES)
        pairs = [self.variable(none) for _ in mine]
        with cgutils.for_range_slice(builder, first, odd, self.axes[2]) as (k, _):
            self.add_terms(pairs, [k, builder.add(k, self.axes[1])], mine, steep)

        # the face itself, first and second of the pairs, then the last neighbour
        sums = []
        for n, total in zip(mine, map(builder.load, pairs), strict=True):
            one = builder.fadd(builder.fmul(weight, n), self.lanes_of(total, 0))
            sums.append(self.variable(builder.fadd(one, self.lanes_of(total, 1))))
        with cgutils.for_range_slice(builder, odd, last, self.axes[1]) as (k, _):
            self.add_terms(sums, [k], mine, steep)
        return [builder.load(total) for total in sums]

    def variable(self, value: Any) -> Any:
        """Return a pointer to a variable with this first value."""
        return cgutils.alloca_once_value(self.builder, value)  # type: ignore[no-untyped-call]

    def add_terms(self, sums: list[Any], places: list[Any], mine: list[Any], steep: Any) -> None:
        """Add the weighted normals of one or two neighbours to the sums, each neighbour in lanes of its own."""
        builder, count = self.builder, len(places)

        # squared chord between the normals of the two faces
        neighbors = [self.entry("indices", k) for k in places]
        kind = self.kinds["indices"].dtype
        nears = [self.normals_of(self.context.cast(builder, n, kind, types.intp)) for n in neighbors]
        near = [self.joined(axis) for axis in zip(*nears, strict=True)]
        differences = (builder.fsub(n, self.joined([m] * count)) for n, m in zip(near, mine, strict=True))
        chord = self.squares(*differences)

        # range weight, (1 - steepness · chord²)^8 or 0, times the spatial weight, which is the same in all lanes
        zero, one = (ir.Constant(chord.type, [number] * LANES * count) for number in (0.0, 1.0))
        share = builder.fsub(one, builder.fmul(self.joined([steep] * count), chord))
        share = builder.select(builder.fcmp_ordered(">", share, zero), share, zero)
        for _ in range(3):
            share = builder.fmul(share, share)
        share = builder.fmul(share, self.joined([self.splat(self.entry("weights", k)) for k in places]))
        for total, n in zip(sums, near, strict=True):
            builder.store(builder.fadd(builder.load(total), builder.fmul(share, n)), total)

    def joined(self, vectors: Sequence[Any]) -> Any:
        """Return one or two vectors as one."""
        return vectors[0] if len(vectors) == 1 else self.shuffled(vectors[0], vectors[1], range(2 * LANES))

    def lanes_of(self, vector: Any, part: int) -> Any:
        """Return one of the two vectors that were joined."""
        return self.shuffled(vector, vector, range(part * LANES, (part + 1) * LANES))

    def shuffled(self, one: Any, other: Any, numbers: range) -> Any:
        """Return lanes of two vectors by number, those of the first one first."""
        mask = ir.Constant(ir.VectorType(ir.IntType(32), len(numbers)), [*numbers])
        return self.builder.shuffle_vector(one, other, mask)

    def normalized(self, face: Any, totals: list[Any], mine: list[Any]) -> None:
        """Normalise the sums and store them as the normals of a face; where a sum vanishes, keep its own normal."""
        builder = self.builder
        root = ir.FunctionType(self.lanes, [self.lanes])
        root = cgutils.get_or_insert_function(builder.module, root, f"llvm.sqrt.v{LANES}f32")  # type: ignore[no-untyped-call]
        length = builder.call(root, [self.squares(*totals)])
        long = builder.fcmp_ordered(">", length, self.zero)
        for d in range(3):
            normal = builder.select(long, builder.fdiv(totals[d], length), mine[d])
            builder.store(normal, self._vector_at("out", face, self.axes[d])).align = 4

    def _loaded(self, pointer: Any) -> Any:
        """Return the lanes at a pointer."""
        loaded = self.builder.load(pointer)
        loaded.align = 4  # that of a single number, because rows may begin anywhere
        return loaded

    def _at(self, name: str, *index: Any) -> Any:
        """Return the pointer to an entry of an array."""
        kind = self.kinds[name]
        array = self.context.make_array(kind)(self.context, self.builder, self.values[name])
        return cgutils.get_item_pointer(self.context, self.builder, kind, array, [*index], wraparound=False)  # type: ignore[no-untyped-call]

    def _vector_at(self, name: str, *index: Any) -> Any:
        """Return the pointer to the lanes of an array."""
        return self.builder.bitcast(self._at(name, *index, self.axes[0]), self.lanes.as_pointer())


def equals(plain: Callable[..., None]) -> bool:
    """Test whether vector instructions can be compiled here and give the same bytes as plain loops."""
    rng = np.random.default_rng(0)
    normals, steepness = rng.normal(size=(5, 3, 4)).astype(np.float32), np.array([0, 0.01, 0.1, 10], np.float32)
    normals[4] = 0  # a face whose sums vanish
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
