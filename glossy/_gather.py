"""One texel as a weighted sum of 8 x 8 texels with weights of its own, sixteen numbers at a time.

Four RGBA texels of a row are one vector; their four weights are spread over its lanes. The mirrored
build reads each row's weights backwards, so that one table serves both halves of a face.
"""

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

from ._lanes import CONTRACT, FLOAT4, FLOAT8, load

TAPS = 8
LANES = 16
VECTOR = ir.VectorType(ir.FloatType(), LANES)
INT32 = ir.IntType(32)

_make_array: Any = make_array


def _pick(builder: Any, value: Any, lanes: list[int]) -> Any:
    order = ir.Constant(ir.VectorType(INT32, len(lanes)), lanes)
    return builder.shuffle_vector(value, ir.Constant(value.type, ir.Undefined), order)


def _generator(mirrored: bool) -> Any:
    spread = [[4 * half + k // 4 for k in range(LANES)] for half in range(2)]
    if mirrored:
        spread = [[TAPS - 1 - k for k in lanes] for lanes in spread]

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        source, start, width, weights, first, step, target, begin = arguments
        fine = _make_array(signature.args[0])(context, builder, source).data
        table = _make_array(signature.args[3])(context, builder, weights).data
        coarse = _make_array(signature.args[6])(context, builder, target).data
        sums: list[Any] = [None] * 4
        for row in range(TAPS):
            factors, _ = load(builder, table, first, FLOAT8)
            for half in range(2):
                at = builder.add(start, start.type(half * LANES))
                texels, _ = load(builder, fine, at, VECTOR)
                term = builder.fmul(texels, _pick(builder, factors, spread[half]), flags=CONTRACT)
                k = 2 * (row % 2) + half
                old = sums[k]
                sums[k] = term if old is None else builder.fadd(old, term, flags=CONTRACT)
            start, first = builder.add(start, width), builder.add(first, step)
        pairs = [builder.fadd(sums[k], sums[k + 2]) for k in range(2)]
        total = builder.fadd(*pairs)
        eight = builder.fadd(
            _pick(builder, total, list(range(8))), _pick(builder, total, list(range(8, 16)))
        )
        four = builder.fadd(
            _pick(builder, eight, list(range(4))), _pick(builder, eight, list(range(4, 8)))
        )
        pointer = builder.bitcast(builder.gep(coarse, [begin]), FLOAT4.as_pointer())
        builder.store(four, pointer).align = 4
        return context.get_dummy_value()

    return generate


def _gather(
    _typing: Any, source: Any, start: Any, width: Any, weights: Any, first: Any, step: Any,
    target: Any, begin: Any,
) -> Any:  # fmt: skip
    """``target[begin:begin+4]``: sum of 8 x 8 texels of ``source`` times their weights.

    ``start``: number of the window's first texel, ``width``: numbers in a row. ``first``: the first
    row's weights, ``step``: from one row's weights to the next's.
    """
    signature = types.void(source, start, width, weights, first, step, target, begin)
    return signature, _generator(mirrored=False)


def _gather_mirrored(
    _typing: Any, source: Any, start: Any, width: Any, weights: Any, first: Any, step: Any,
    target: Any, begin: Any,
) -> Any:  # fmt: skip
    """As ``gather``, with each row's weights read backwards."""
    signature = types.void(source, start, width, weights, first, step, target, begin)
    return signature, _generator(mirrored=True)


gather: Any = intrinsic(_gather)
gather_mirrored: Any = intrinsic(_gather_mirrored)
