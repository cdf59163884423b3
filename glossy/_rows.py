"""Rows of texels filtered and halved, sixteen numbers at a time: the pyramid's inner loops in IR.

``halve_rows`` filters and decimates rows of RGBA texels, four output rows at once, so that the rows
they share are loaded once, and four output texels a step. A column of texels is summed down its
rows first, outermost pair first; the sums of one step serve the next, so nothing is stored between
the vertical and the horizontal sum. ``quarter_rgb`` takes the 2 x 2 mean twice, from packed RGB:
four rows of input make two rows of one level and one of the next. The former are most of what is
written and go past the caches, which saves fetching what is to be overwritten.

Both ask early for the rows that come next. Plain loops over these arrays stay scalar: so many rows
of one array are too many pointers for the compiler's own proof that they do not overlap.
"""

from collections.abc import Sequence
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

from ._lanes import CONTRACT, FLOAT4, load, splat

LANES = 16
VECTOR = ir.VectorType(ir.FloatType(), LANES)
INT32 = ir.IntType(32)
LINE = 64  # bytes: a cache line, and a vector
OUTPUT_ROWS = 4
DISTANT = 1  # how far from the core a prefetched line is kept: 3 is nearest

_make_array: Any = make_array
_alloca: Any = cgutils.alloca_once


def _shuffle(builder: Any, left: Any, right: Any, lanes: Sequence[int]) -> Any:
    """Sixteen numbers of the thirty-two of two vectors."""
    return builder.shuffle_vector(left, right, ir.Constant(ir.VectorType(INT32, LANES), lanes))


def _texels(builder: Any, left: Any, right: Any, order: Sequence[int]) -> Any:
    """Four RGBA texels of the eight of two vectors."""
    return _shuffle(builder, left, right, [4 * k + c for k in order for c in range(4)])


def _symmetric(builder: Any, values: Sequence[Any], factors: Sequence[Any]) -> Any:
    """Sum over k of factors[k] (values[k] + values[-1 - k])."""
    total: Any = None
    for k, factor in enumerate(factors):
        part = builder.fmul(builder.fadd(values[k], values[-1 - k]), factor, flags=CONTRACT)
        total = part if total is None else builder.fadd(total, part, flags=CONTRACT)
    return total


def prefetch(builder: Any, data: Any, index: Any) -> None:
    byte = ir.IntType(8).as_pointer()
    kind = ir.FunctionType(ir.VoidType(), [byte, INT32, INT32, INT32])
    function = builder.module.declare_intrinsic("llvm.prefetch", [byte], kind)
    pointer = builder.bitcast(builder.gep(data, [index]), byte)
    builder.call(function, [pointer, INT32(0), INT32(DISTANT), INT32(1)])


def _store(builder: Any, value: Any, data: Any, index: Any, past_caches: bool = False) -> None:
    """``past_caches`` needs a whole line: ``LINE`` divides the address."""
    pointer = builder.bitcast(builder.gep(data, [index]), VECTOR.as_pointer())
    stored = builder.store(value, pointer)
    stored.align = LINE if past_caches else 4
    if past_caches:
        stored.set_metadata("nontemporal", builder.module.add_metadata([INT32(1)]))


def _rows(builder: Any, start: Any, width: Any, count: int) -> list[Any]:
    rows = [start]
    for _ in range(count - 1):
        rows.append(builder.add(rows[-1], width))
    return rows


def _across(builder: Any, columns: Sequence[Any], taps: int) -> list[Any]:
    """For each tap the texels it takes for four outputs.

    ``columns``: four times four texels, the second at the first output's centre.
    """
    a, b, c, d = columns
    even, odd = (_texels(builder, b, c, (k, k + 2, k + 4, k + 6)) for k in (0, 1))
    if taps == 2:
        return [even, odd]
    before = _texels(builder, a, odd, (3, 4, 5, 6))
    after = _texels(builder, even, d, (1, 2, 3, 4))
    if taps == 4:
        return [before, even, odd, after]
    first = _texels(builder, a, even, (2, 4, 5, 6))
    return [first, before, even, odd, after, _texels(builder, odd, d, (1, 2, 3, 5))]


def _halve_rows(
    _typing: Any, source: Any, start: Any, width: Any, weights: Any, target: Any, begin: Any,
    target_width: Any, steps: Any,
) -> Any:  # fmt: skip
    """Four output rows of a symmetric filter, decimated by two; 2 len(weights) taps each way.

    ``weights``: outermost first. ``start``: in the flat ``source`` the number of the column at the
    first output's centre, in the uppermost row the filter reaches; ``begin``: in ``target`` the
    first output. Widths are of rows, in numbers; ``steps`` are of four output texels. For more than
    two taps up to four texels left and right of the row are read.
    """
    signature = types.void(source, start, width, weights, target, begin, target_width, steps)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        source, start, width, weights, target, begin, target_width, steps = arguments
        fine = _make_array(signature.args[0])(context, builder, source).data
        coarse = _make_array(signature.args[4])(context, builder, target).data
        half = len(signature.args[3])
        factors = [splat(builder, builder.extract_value(weights, k), VECTOR) for k in range(half)]
        index, used = start.type, 2 * (half + OUTPUT_ROWS - 1)
        rows = _rows(builder, start, width, used + 2 * OUTPUT_ROWS)
        begins = _rows(builder, begin, target_width, OUTPUT_ROWS)

        def column(x: Any) -> list[Any]:
            values = [load(builder, fine, builder.add(row, x), VECTOR)[0] for row in rows[:used]]
            for row in rows[used:]:
                prefetch(builder, fine, builder.add(row, x))
            parts = [values[2 * r : 2 * (r + half)] for r in range(OUTPUT_ROWS)]
            return [_symmetric(builder, part, factors) for part in parts]

        nothing = [ir.Constant(VECTOR, ir.Undefined)] * OUTPUT_ROWS
        carried = [_alloca(builder, VECTOR) for _ in range(2 * OUTPUT_ROWS)]
        if half > 1:
            ahead = [*column(index(-LANES)), *column(index(0))]
            for slot, value in zip(carried, ahead, strict=True):
                builder.store(value, slot)
        with cgutils.for_range(builder, steps) as loop:
            x = builder.mul(loop.index, index(2 * LANES))
            places = [builder.add(x, index(k * LANES)) for k in range(3)]
            if half == 1:
                columns = [nothing, column(places[0]), column(places[1]), nothing]
            else:
                old = [builder.load(slot) for slot in carried]
                new = [column(place) for place in places[1:]]
                columns = [old[:OUTPUT_ROWS], old[OUTPUT_ROWS:], *new]
                for slot, value in zip(carried, [*new[0], *new[1]], strict=True):
                    builder.store(value, slot)
            for r in range(OUTPUT_ROWS):
                taps = _across(builder, [c[r] for c in columns], 2 * half)
                place = builder.add(begins[r], builder.mul(loop.index, index(LANES)))
                _store(builder, _symmetric(builder, taps, factors), coarse, place)
        return context.get_dummy_value()

    return signature, generate


def _rgb_pairs(builder: Any, left: Any, right: Any, first: int) -> Any:
    """Sums of neighbouring RGB texels as four RGBA texels, the fourth channel 0."""
    index = ir.VectorType(ir.IntType(1), LANES)
    keep, zero = ir.Constant(index, [1, 1, 1, 0] * 4), ir.Constant(VECTOR, [0.0] * LANES)
    even, odd = (
        _shuffle(
            builder,
            left,
            right,
            [first + x + 6 * k + min(c, 2) for k in range(4) for c in range(4)],
        )
        for x in (0, 3)
    )
    return builder.select(keep, builder.fadd(even, odd), zero)


def _quarter_rgb(
    _typing: Any, source: Any, start: Any, width: Any, factor: Any, target: Any, begin: Any,
    target_width: Any, second: Any, steps: Any,
) -> Any:  # fmt: skip
    """Two rows of 2 x 2 means, and one row of the means of those; ``factor`` is 1/4.

    ``source`` is flat packed RGB, four rows from ``start`` on; the first means go to ``begin`` and
    a row further, the others to ``second``, all in ``target``, as RGBA. A step is eight texels of
    the first. ``LINE`` must divide the addresses of ``begin`` and of the row below.
    """
    signature = types.void(source, start, width, factor, target, begin, target_width, second, steps)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        source, start, width, factor, target, begin, target_width, second, steps = arguments
        fine = _make_array(signature.args[0])(context, builder, source).data
        coarse = _make_array(signature.args[4])(context, builder, target).data
        quarter, index = splat(builder, factor, VECTOR), start.type
        rows = _rows(builder, start, width, 8)
        begins = _rows(builder, begin, target_width, 2)
        with cgutils.for_range(builder, steps) as loop:
            x = builder.mul(loop.index, index(3 * LANES))
            places = [builder.add(x, index(k * LANES)) for k in range(3)]
            for place in places:
                for row in rows[4:]:
                    prefetch(builder, fine, builder.add(row, place))
            means = []
            for r in range(2):
                down = [
                    builder.fadd(
                        *(load(builder, fine, builder.add(row, place), VECTOR)[0] for row in pair)
                    )
                    for place in places
                    for pair in [rows[2 * r : 2 * r + 2]]
                ]
                for k in range(2):
                    total = _rgb_pairs(builder, down[k], down[k + 1], 8 * k)
                    means.append(builder.fmul(total, quarter))
                    at = builder.add(loop.index, loop.index)
                    at = builder.mul(builder.add(at, index(k)), index(LANES))
                    _store(builder, means[-1], coarse, builder.add(begins[r], at), True)
            down = [builder.fadd(means[k], means[2 + k]) for k in range(2)]
            taps = _across(builder, [None, *down, None], 2)
            place = builder.add(second, builder.mul(loop.index, index(LANES)))
            _store(builder, builder.fmul(builder.fadd(*taps), quarter), coarse, place)
        builder.fence("seq_cst")  # what went past the caches is there before the row counts as done
        return context.get_dummy_value()

    return signature, generate


def _copy_texel(_typing: Any, source: Any, start: Any, target: Any, begin: Any) -> Any:
    """``target[begin:begin+4] = source[start:start+4]``."""
    signature = types.void(source, start, target, begin)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        fine, coarse = (
            _make_array(signature.args[k])(context, builder, arguments[k]).data for k in (0, 2)
        )
        value, _ = load(builder, fine, arguments[1])
        pointer = builder.bitcast(builder.gep(coarse, [arguments[3]]), FLOAT4.as_pointer())
        builder.store(value, pointer).align = 4
        return context.get_dummy_value()

    return signature, generate


halve_rows: Any = intrinsic(_halve_rows)
quarter_rgb: Any = intrinsic(_quarter_rgb)
copy_texel: Any = intrinsic(_copy_texel)
