"""The eight corners of a cell: which rows of a grid's numbers they are, what they hold together, what they are told.

A row is four numbers, which a processor can read, add and write at once; the compiler, left to itself, takes them one
by one. Corners come in the order (0, 0, 0), (0, 0, 1), (0, 1, 0) … (1, 1, 1).
"""

from typing import no_type_check

import numba
import numpy as np
from llvmlite import ir
from numba.core import types
from numba.core.errors import TypingError
from numba.extending import intrinsic

ROWS_PER_BRICK = 512
LINE = 8
"""Vertices along a brick's z: what the optimiser visits at once, 128 bytes of each of its arrays."""
CORNERS = (0, 1, 8, 9, 64, 65, 72, 73)
"""Rows of a cell's corners within one brick, from its first."""
EMPTY_RAW = np.float32(-6.0)
FOUR = ir.VectorType(ir.FloatType(), 4)
INDEX = ir.IntType(32)
FREELY = ("fast",)
"""Flags of additions and products: in any order, and fused."""


@no_type_check
def _row_type(array):
    if not (
        isinstance(array, types.Array) and array.ndim == 2 and array.layout == "C" and array.dtype == types.float32
    ):
        raise TypingError(f"rows of four single-precision numbers are needed, not {array}")
    return array


@no_type_check
def _place(context, builder, array_type, array, row):
    """Pointer to the four numbers of a row."""
    data = context.make_array(array_type)(context, builder, array).data
    return builder.gep(builder.bitcast(data, FOUR.as_pointer()), [row])


@no_type_check
def _four_times(builder, number):
    first = builder.insert_element(ir.Constant(FOUR, ir.Undefined), number, INDEX(0))
    return builder.shuffle_vector(first, ir.Constant(FOUR, ir.Undefined), ir.Constant(ir.VectorType(INDEX, 4), [0] * 4))


@intrinsic
@no_type_check
def blend(_typing, values, rows, weights):
    """Sum of `weights` times the four numbers of `rows` (tuples of the same length): four numbers."""

    @no_type_check
    def build(context, builder, signature, arguments):
        total = ir.Constant(FOUR, None)
        for corner in range(len(rows)):
            row, weight = (builder.extract_value(each, corner) for each in arguments[1:])
            four = builder.load(_place(context, builder, signature.args[0], arguments[0], row), align=4)
            total = builder.fadd(total, builder.fmul(four, _four_times(builder, weight), FREELY), FREELY)
        numbers = [builder.extract_element(total, INDEX(lane)) for lane in range(4)]
        return context.make_tuple(builder, signature.return_type, numbers)

    return types.UniTuple(types.float32, 4)(_row_type(values), rows, weights), build


@intrinsic
@no_type_check
def scatter(_typing, gradient, rows, weights, four):
    """Add `weights` times `four` numbers to those of `rows`, all different: the transpose of `blend`."""

    @no_type_check
    def build(context, builder, signature, arguments):
        told = ir.Constant(FOUR, ir.Undefined)
        for lane in range(4):
            told = builder.insert_element(told, builder.extract_value(arguments[3], lane), INDEX(lane))
        for corner in range(len(rows)):
            row, weight = (builder.extract_value(each, corner) for each in arguments[1:3])
            place = _place(context, builder, signature.args[0], arguments[0], row)
            share = builder.fmul(told, _four_times(builder, weight), FREELY)
            builder.store(builder.fadd(builder.load(place, align=4), share, FREELY), place, align=4)
        return context.get_dummy_value()

    return types.none(_row_type(gradient), rows, weights, four), build


@numba.njit(cache=True, fastmath=True, error_model="numpy", forceinline=True)
@no_type_check
def corner_weights(a, b, c):
    """Trilinear weights of a cell's corners, from the place in it (0..1 along each axis)."""
    one = np.float32(1)
    p, q, r = one - a, one - b, one - c
    pq, pb, aq, ab = p * q, p * b, a * q, a * b
    return pq * r, pq * c, pb * r, pb * c, aq * r, aq * c, ab * r, ab * c


@numba.njit(cache=True, fastmath=True, error_model="numpy", forceinline=True)
@no_type_check
def _corner_weight(offsets, n, corner):
    """One of `corner_weights`."""
    one, (a, b, c) = np.float32(1), (offsets[n, 0], offsets[n, 1], offsets[n, 2])
    return (a if corner & 4 else one - a) * (b if corner & 2 else one - b) * (c if corner & 1 else one - c)


@numba.njit(cache=True, fastmath=True, error_model="numpy", forceinline=True)
@no_type_check
def rows_within(first):
    """Rows of the corners of a cell that lies in one brick, from the first."""
    return first, first + 1, first + 8, first + 9, first + 64, first + 65, first + 72, first + 73


@numba.njit(cache=True, fastmath=True, error_model="numpy", forceinline=True)
@no_type_check
def row_of(bricks, base, i, j, k):
    """Row of a vertex; -1 where its brick has none."""
    slot = np.int64(bricks[i >> 3, j >> 3, k >> 3])
    return base + (slot << 9 | (i & 7) << 6 | (j & 7) << 3 | (k & 7)) if slot >= 0 else -1


@numba.njit(cache=True, fastmath=True, error_model="numpy", forceinline=True)
@no_type_check
def rows_across(bricks, base, i, j, k):
    """Rows of the corners of any cell; -1 where a brick has no vertices."""
    return (
        row_of(bricks, base, i, j, k),
        row_of(bricks, base, i, j, k + 1),
        row_of(bricks, base, i, j + 1, k),
        row_of(bricks, base, i, j + 1, k + 1),
        row_of(bricks, base, i + 1, j, k),
        row_of(bricks, base, i + 1, j, k + 1),
        row_of(bricks, base, i + 1, j + 1, k),
        row_of(bricks, base, i + 1, j + 1, k + 1),
    )


@numba.njit(cache=True, fastmath=True, error_model="numpy", forceinline=True)
@no_type_check
def kept_rows(rows, n):
    """What `keep_rows` kept."""
    return rows[n, 0], rows[n, 1], rows[n, 2], rows[n, 3], rows[n, 4], rows[n, 5], rows[n, 6], rows[n, 7]


@numba.njit(cache=True, fastmath=True, error_model="numpy", forceinline=True)
@no_type_check
def keep_rows(rows, n, found):
    """Remember the rows of a sample's corners."""
    rows[n, 0], rows[n, 1], rows[n, 2], rows[n, 3] = found[0], found[1], found[2], found[3]
    rows[n, 4], rows[n, 5], rows[n, 6], rows[n, 7] = found[4], found[5], found[6], found[7]


@numba.njit(cache=True, fastmath=True, error_model="numpy", forceinline=True)
@no_type_check
def all_found(found):
    """Whether none of a cell's corners is missing."""
    return (found[0] | found[1] | found[2] | found[3] | found[4] | found[5] | found[6] | found[7]) >= 0


@numba.njit(cache=True, fastmath=True, error_model="numpy", forceinline=True)
@no_type_check
def gather(bricks, base, values, x, y, z, rows, offsets, samples, n):
    """Interpolate at a point: keep its corners' rows, its place in the cell and the colour; return the raw density.

    Where all corners lie in one brick, as two cells in three have them, only the first and the last row are kept.
    """
    i, j, k = int(x), int(y), int(z)
    a, b, c = np.float32(x - i), np.float32(y - j), np.float32(z - k)
    offsets[n, 0], offsets[n, 1], offsets[n, 2] = a, b, c
    weights = corner_weights(a, b, c)
    first = row_of(bricks, base, i, j, k)
    if first >= 0 and (i & 7) < 7 and (j & 7) < 7 and (k & 7) < 7:
        rows[n, 0], rows[n, 7] = first, first + CORNERS[7]
        raw, red, green, blue = blend(values, rows_within(first), weights)
    else:
        found = rows_across(bricks, base, i, j, k)
        keep_rows(rows, n, found)
        if all_found(found):
            raw, red, green, blue = blend(values, found, weights)
        else:
            raw, red, green, blue = _blend_found(values, rows, offsets, n)
    samples[n, 4], samples[n, 5], samples[n, 6] = red, green, blue
    return raw


@numba.njit(cache=True, fastmath=True, error_model="numpy", forceinline=True)
@no_type_check
def _blend_found(values, rows, offsets, n):
    """As `blend`, of the corners that there are; the others are empty."""
    raw, red, green, blue = np.float32(0), np.float32(0), np.float32(0), np.float32(0)
    for corner in range(8):
        row, w = rows[n, corner], _corner_weight(offsets, n, corner)
        if row < 0:
            raw += w * EMPTY_RAW
        else:
            raw += w * values[row, 0]
            red += w * values[row, 1]
            green += w * values[row, 2]
            blue += w * values[row, 3]
    return raw, red, green, blue


@numba.njit(cache=True, fastmath=True, error_model="numpy", forceinline=True)
@no_type_check
def tell(gradient, touched, rows, offsets, n, four):
    """Scatter a sample's derivatives by its corners, and mark the lines that were touched."""
    weights = corner_weights(offsets[n, 0], offsets[n, 1], offsets[n, 2])
    first = rows[n, 0]
    if first >= 0 and rows[n, 7] - first == CORNERS[7]:  # all in one brick, on four of its lines
        scatter(gradient, rows_within(first), weights, four)
        at = first // LINE
        touched[at], touched[at + 1], touched[at + 8], touched[at + 9] = 1, 1, 1, 1
        return
    found = kept_rows(rows, n)
    if all_found(found):
        scatter(gradient, found, weights, four)
        for corner in range(8):
            touched[rows[n, corner] // LINE] = 1
        return
    for corner in range(8):
        row = rows[n, corner]
        if row >= 0:
            scatter(gradient, (row,), (_corner_weight(offsets, n, corner),), four)
            touched[row // LINE] = 1
