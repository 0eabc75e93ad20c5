# SPDX-License-Identifier: BSD-3-Clause
"""Moving values between rows of nodes and lanes of elements, as vector shuffles.

A tile keeps one quantity of W elements in consecutive places (a row of lanes); nodes keep the quantities of one node
in consecutive places. Loading lane by lane, or adding lane by lane to nodes, takes one instruction per value. Here V
lanes at a time are transposed in registers, and a node takes several values with one instruction. V is what fills
32 bytes: 8 lanes of float32 or 4 of float64. The shuffles are LLVM's own and compile for any processor.

    gather_points    tile[at + c W + l]  = points[4 index[from_ + l] + c]      c = 0, 1, 2
    scatter_vectors  sums[4 index[..] + c]  += tile[at + c W + l]              c = 0, 1, 2
    scatter_terms    sums[12 index[..] + c] += tile[at + c W + l]              c = 0, ..., 8

each for all W lanes, in the order of the lanes. `prefetch` asks for data that the next tile will read, `flush_tiny` and
`restore` enclose arithmetic in which numbers below the normal range count as zero.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

# Elements per tile. 32 was fastest in float32 and as good as any in float64: the scratch of a tile stays in the
# first-level cache.
W = 32

# Values per node of the arrays below; the unused ones keep rows aligned.
POINT, VECTOR, TERMS = 4, 4, 12

_INDEX = ir.IntType(64)
_LANE = ir.IntType(32)

# Interleaving two vectors within halves of 128 bits is one instruction, exchanging halves another.
_MASKS = {
    8: (
        ([0, 8, 1, 9, 4, 12, 5, 13], [2, 10, 3, 11, 6, 14, 7, 15]),
        ([0, 1, 8, 9, 4, 5, 12, 13], [2, 3, 10, 11, 6, 7, 14, 15]),
    ),
    4: (([0, 4, 2, 6], [1, 5, 3, 7]), ([0, 1, 4, 5], [2, 3, 6, 7])),
}


def _shuffle(builder: Any, a: Any, b: Any, mask: Sequence[int]) -> Any:
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(_LANE, len(mask)), list(mask)))


def _transpose(builder: Any, rows: Sequence[Any]) -> list[Any]:
    """Transpose four vectors: 4 x 4 in float64; in float32 both halves, 4 x 4 each. The map is its own inverse."""
    (low, high), (even, odd) = _MASKS[rows[0].type.count]
    a, b = _shuffle(builder, rows[0], rows[1], low), _shuffle(builder, rows[0], rows[1], high)
    c, d = _shuffle(builder, rows[2], rows[3], low), _shuffle(builder, rows[2], rows[3], high)
    if rows[0].type.count == 8:
        pairs = ((a, c), (b, d))
        return [_shuffle(builder, p, q, mask) for p, q in pairs for mask in (even, odd)]
    return [
        _shuffle(builder, a, c, even),
        _shuffle(builder, b, d, even),
        _shuffle(builder, a, c, odd),
        _shuffle(builder, b, d, odd),
    ]


class _Emitter:
    """Loads, stores and adds vectors at element offsets of Numba arrays."""

    def __init__(self, context: Any, builder: Any, signature: Any, arguments: Sequence[Any]) -> None:
        self.builder = builder
        self._scalars = list(arguments)
        self._data = [
            make_array(kind)(context, builder, value).data if isinstance(kind, types.Array) else value
            for kind, value in zip(signature.args, arguments, strict=True)
        ]
        self.real = ir.FloatType() if signature.args[0].dtype == types.float32 else ir.DoubleType()
        self.size = 4 if self.real == ir.FloatType() else 8
        self.lanes = 32 // self.size

    def pointer(self, argument: int, offset: Any) -> Any:
        return self.builder.gep(self._data[argument], [offset])

    def at(self, base: int, shift: int) -> Any:
        """Value of an integer argument plus a constant."""
        return self.builder.add(self._scalars[base], ir.Constant(_INDEX, shift))

    def index(self, array: int, offset: Any, factor: int) -> Any:
        raw = self.builder.zext(self.builder.load(self.pointer(array, offset)), _INDEX)
        return self.builder.mul(raw, ir.Constant(_INDEX, factor))

    def load(self, pointer: Any, lanes: int) -> Any:
        vector = ir.VectorType(self.real, lanes).as_pointer()
        value = self.builder.load(self.builder.bitcast(pointer, vector))
        value.align = self.size
        return value

    def store(self, value: Any, pointer: Any) -> None:
        stored = self.builder.store(value, self.builder.bitcast(pointer, value.type.as_pointer()))
        stored.align = self.size

    def add(self, value: Any, pointer: Any) -> None:
        """*pointer += value."""
        self.store(self.builder.fadd(self.load(pointer, value.type.count), value), pointer)

    def add_one(self, vector: Any, lane: int, pointer: Any) -> None:
        one = self.builder.extract_element(vector, ir.Constant(_LANE, lane))
        self.builder.store(self.builder.fadd(self.builder.load(pointer), one), pointer)

    def rows(self, argument: int, base: int, first: int, count: int, lane: int) -> list[Any]:
        """`count` rows of V lanes that start at row `first` of a tile."""
        return [
            self.load(self.pointer(argument, self.at(base, (first + c) * W + lane)), self.lanes) for c in range(count)
        ]

    def row_pairs(self, rows: Sequence[Any]) -> list[Any]:
        """Four components of each of the V lanes, as vectors of four, from four rows of lanes."""
        turned = _transpose(self.builder, rows)
        if self.lanes == 4:
            return turned
        halves = ([0, 1, 2, 3], [4, 5, 6, 7])
        return [_shuffle(self.builder, v, v, half) for half in halves for v in turned]


def _emit_gather(emit: _Emitter) -> None:
    """Arguments tile, at, index, from_, points."""
    builder = emit.builder
    for lane in range(0, W, emit.lanes):
        points = [emit.load(emit.pointer(4, emit.index(2, emit.at(3, lane + k), POINT)), 4) for k in range(emit.lanes)]
        if emit.lanes == 8:
            both = list(range(8))
            points = [_shuffle(builder, points[k], points[k + 4], both) for k in range(4)]
        for c, row in enumerate(_transpose(builder, points)[:3]):
            emit.store(row, emit.pointer(0, emit.at(1, c * W + lane)))


def _emit_scatter_vectors(emit: _Emitter) -> None:
    """Arguments tile, at, index, from_, sums."""
    for lane in range(0, W, emit.lanes):
        rows = emit.rows(0, 1, 0, 3, lane)
        rows.append(ir.Constant(rows[0].type, [0.0] * emit.lanes))
        for k, vector in enumerate(emit.row_pairs(rows)):
            emit.add(vector, emit.pointer(4, emit.index(2, emit.at(3, lane + k), VECTOR)))


def _emit_scatter_terms(emit: _Emitter) -> None:
    """Arguments tile, at, index, from_, sums."""
    builder = emit.builder
    for lane in range(0, W, emit.lanes):
        rows = emit.rows(0, 1, 0, 9, lane)
        first, second = _transpose(builder, rows[:4]), _transpose(builder, rows[4:8])
        for k in range(emit.lanes):
            node = emit.pointer(4, emit.index(2, emit.at(3, lane + k), TERMS))
            if emit.lanes == 8:
                half = [0, 1, 2, 3, 8, 9, 10, 11] if k < 4 else [4, 5, 6, 7, 12, 13, 14, 15]
                emit.add(_shuffle(builder, first[k % 4], second[k % 4], half), node)
            else:
                emit.add(first[k], node)
                emit.add(second[k], builder.gep(node, [ir.Constant(_INDEX, 4)]))
            emit.add_one(rows[8], k, builder.gep(node, [ir.Constant(_INDEX, 8)]))


def _on_tile(body: Callable[[_Emitter], None]) -> Any:
    """Intrinsic of (tile, at, index, from_, nodes) whose code `body` emits."""

    def typer(context, tile, at, index, from_, nodes):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            body(_Emitter(context, builder, signature, arguments))
            return context.get_dummy_value()

        return types.void(tile, types.intp, index, types.intp, nodes), generate

    return intrinsic(typer)


gather_points = _on_tile(_emit_gather)
scatter_vectors = _on_tile(_emit_scatter_vectors)
scatter_terms = _on_tile(_emit_scatter_terms)


def _prefetch(context, array, at):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Start to load the cache line of array[at]; harmless past the end."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        emit, byte, number = _Emitter(context, builder, signature, arguments), ir.IntType(8).as_pointer(), _LANE
        kind = ir.FunctionType(ir.VoidType(), [byte, number, number, number])
        function = builder.module.declare_intrinsic("llvm.prefetch", [byte], kind)
        # To be read, into the nearest cache, data.
        options = [ir.Constant(number, value) for value in (0, 3, 1)]
        builder.call(function, [builder.bitcast(emit.pointer(0, arguments[1]), byte), *options])
        return context.get_dummy_value()

    return types.void(array, types.intp), generate


prefetch: Any = intrinsic(_prefetch)


# Bits of the x86 control register: results and operands below the normal range become zero.
_FLUSH = 0x8040


def _control(context: Any, builder: Any, name: str, place: Any) -> None:
    byte = ir.IntType(8).as_pointer()
    function = builder.module.declare_intrinsic(name, (), ir.FunctionType(ir.VoidType(), [byte]))
    builder.call(function, [builder.bitcast(place, byte)])


def _is_x86(builder: Any) -> bool:
    return str(builder.module.triple).startswith(("x86_64", "i686", "i386"))


def _flush_tiny(context):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Let numbers below the normal range be zero in this thread; returns what `restore` needs.

    Where a wave has not arrived yet displacements are 1e-20 and their cubes no normal numbers in float32; a processor
    takes a hundred times as long over those. Other processors than x86 do not, or not as badly: there it does nothing.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        if not _is_x86(builder):
            return ir.Constant(_LANE, 0)
        place = builder.alloca(_LANE)
        _control(context, builder, "llvm.x86.sse.stmxcsr", place)
        before = builder.load(place)
        builder.store(builder.or_(before, ir.Constant(_LANE, _FLUSH)), place)
        _control(context, builder, "llvm.x86.sse.ldmxcsr", place)
        return before

    return types.uint32(), generate


def _restore(context, before):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Undo `flush_tiny`."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        if _is_x86(builder):
            place = builder.alloca(_LANE)
            builder.store(arguments[0], place)
            _control(context, builder, "llvm.x86.sse.ldmxcsr", place)
        return context.get_dummy_value()

    return types.void(types.uint32), generate


flush_tiny: Any = intrinsic(_flush_tiny)
restore: Any = intrinsic(_restore)
