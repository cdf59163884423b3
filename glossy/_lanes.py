"""Two small pieces of LLVM IR that Numba has no word for: float bits, and a weighted texel sum.

``bits``/``from_bits`` reinterpret a float32 as an int32 and back, so that integers can live in a
float scratch array and an exponent can be read. ``add_texels`` loads eight RGBA texels as vectors
of four and adds their weighted sum to an accumulator: what a GPU's texture unit does for one
trilinear lookup. ``filter_row4``/``filter_row16`` run a symmetric filter along a row, four or
sixteen numbers at a time: rows of one array are too many pointers for the compiler's own proof that
they do not overlap.
"""

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

FLOAT4 = ir.VectorType(ir.FloatType(), 4)
FLOAT8 = ir.VectorType(ir.FloatType(), 8)
FLOAT16 = ir.VectorType(ir.FloatType(), 16)
CONTRACT = ("contract",)

_make_array: Any = make_array


def _bits(_typing: Any, x: Any) -> Any:
    """The 32 bits of a float32 as int32."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.bitcast(arguments[0], ir.IntType(32))

    return types.int32(types.float32), generate


def _from_bits(_typing: Any, x: Any) -> Any:
    """The float32 of 32 bits given as int32."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.bitcast(arguments[0], ir.FloatType())

    return types.float32(types.int32), generate


def _splat(builder: Any, scalar: Any, vector: Any = FLOAT4) -> Any:
    zero = ir.Constant(ir.IntType(32), 0)
    nothing = ir.Constant(vector, ir.Undefined)
    lanes = ir.Constant(ir.VectorType(ir.IntType(32), vector.count), [0] * vector.count)
    return builder.shuffle_vector(builder.insert_element(nothing, scalar, zero), nothing, lanes)


def _load(builder: Any, data: Any, index: Any, vector: Any = FLOAT4) -> tuple[Any, Any]:
    pointer = builder.bitcast(builder.gep(data, [index]), vector.as_pointer())
    value = builder.load(pointer)
    value.align = 4
    return value, pointer


def _pair(builder: Any, left: Any, right: Any) -> Any:
    """Four lanes of ``left``, then four of ``right``."""
    order = ir.Constant(ir.VectorType(ir.IntType(32), 8), [0] * 4 + [8] * 4)
    zero = ir.Constant(ir.IntType(32), 0)
    nothing = ir.Constant(FLOAT8, ir.Undefined)
    ends = [builder.insert_element(nothing, x, zero) for x in (left, right)]
    return builder.shuffle_vector(*ends, order)


def _trilinear(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    """The weighted sum of ``add_texels``, before left and right are added."""
    texels = _make_array(signature.args[0])(context, builder, arguments[0]).data
    total: Any = None
    for level in range(2):
        at = [builder.extract_value(arguments[1], 2 * level + k) for k in range(2)]
        down, left, right = (builder.extract_value(arguments[2], 3 * level + k) for k in range(3))
        top, low = (_load(builder, texels, x, FLOAT8)[0] for x in at)
        step = builder.fmul(builder.fsub(low, top), _splat(builder, down, FLOAT8), flags=CONTRACT)
        row = builder.fadd(top, step, flags=CONTRACT)
        part = builder.fmul(row, _pair(builder, left, right), flags=CONTRACT)
        total = part if total is None else builder.fadd(total, part, flags=CONTRACT)
    return total


def _accumulate(context: Any, builder: Any, scratch: Any, value: Any, at: Any, term: Any) -> None:
    lanes = _make_array(scratch)(context, builder, value).data
    before, pointer = _load(builder, lanes, at, FLOAT8)
    builder.store(builder.fadd(before, term, flags=CONTRACT), pointer).align = 4


def _add_texels(_typing: Any, buffer: Any, at: Any, weights: Any, scratch: Any, to: Any) -> Any:
    """Add one weighted trilinear lookup to ``scratch[to:to+8]``.

    ``at``: places of the upper and lower left texel, finer level first. ``weights``: fraction down,
    weight left, weight right, of the finer and of the coarser level. The left texels' sum goes to
    the first four numbers, the right texels' to the last four.
    """
    signature = types.void(buffer, at, weights, scratch, to)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        total = _trilinear(context, builder, signature, arguments)
        _accumulate(context, builder, signature.args[3], arguments[3], arguments[4], total)
        return context.get_dummy_value()

    return signature, generate


def _add_texels2(
    _typing: Any, buffer: Any, at: Any, weights: Any, factor: Any, scratch: Any, to: Any, to2: Any
) -> Any:
    """As ``add_texels``, and the same times ``factor`` to ``scratch[to2:to2+8]``."""
    signature = types.void(buffer, at, weights, factor, scratch, to, to2)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        total = _trilinear(context, builder, signature, arguments)
        scaled = builder.fmul(total, _splat(builder, arguments[3], FLOAT8), flags=CONTRACT)
        for place, term in ((arguments[5], total), (arguments[6], scaled)):
            _accumulate(context, builder, signature.args[4], arguments[4], place, term)
        return context.get_dummy_value()

    return signature, generate


def _filter_row(vector: Any) -> Callable[..., Any]:
    def filter_row(
        _typing: Any, source: Any, start: Any, advance: Any, pairs: Any, weights: Any, target: Any,
        begin: Any, count: Any,
    ) -> Any:  # fmt: skip
        """Symmetric filter of ``count`` vectors: for i < count, with x = start + i advance, ::

        target[begin + i lanes] = sum_k weights[k] (source[x + pairs[2k]] + source[x + pairs[2k+1]])
        """
        signature = types.void(source, start, advance, pairs, weights, target, begin, count)

        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            source, start, advance, pairs, weights, target, begin, count = arguments
            texels = _make_array(signature.args[0])(context, builder, source).data
            lanes = _make_array(signature.args[5])(context, builder, target).data
            number = len(signature.args[4])
            factors = [
                _splat(builder, builder.extract_value(weights, k), vector) for k in range(number)
            ]
            with cgutils.for_range(builder, count) as loop:
                x = builder.add(start, builder.mul(loop.index, advance))
                total: Any = None
                for k in range(number):
                    two = [
                        _load(
                            builder, texels, builder.add(x, builder.extract_value(pairs, j)), vector
                        )[0]
                        for j in (2 * k, 2 * k + 1)
                    ]
                    product = builder.fmul(builder.fadd(*two), factors[k], flags=CONTRACT)
                    total = (
                        product if total is None else builder.fadd(total, product, flags=CONTRACT)
                    )
                width = ir.Constant(loop.index.type, vector.count)
                at = builder.add(begin, builder.mul(loop.index, width))
                pointer = builder.bitcast(builder.gep(lanes, [at]), vector.as_pointer())
                builder.store(total, pointer).align = 4
            return context.get_dummy_value()

        return signature, generate

    return filter_row


bits: Any = intrinsic(_bits)
from_bits: Any = intrinsic(_from_bits)
add_texels: Any = intrinsic(_add_texels)
add_texels2: Any = intrinsic(_add_texels2)
filter_row4: Any = intrinsic(_filter_row(FLOAT4))
filter_row16: Any = intrinsic(_filter_row(FLOAT16))
