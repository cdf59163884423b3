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


def _add_texels(
    _typing: Any, buffer: Any, corners: Any, weights: Any, w: Any, scratch: Any, at: Any
) -> Any:
    """``scratch[at:at+4] += w * sum_k weights[k] * buffer[corners[k]:corners[k]+4]``.

    ``corners`` is a tuple of indices, ``weights`` one of as many float32.
    """
    signature = types.void(buffer, corners, weights, w, scratch, at)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        texels = _make_array(signature.args[0])(context, builder, arguments[0]).data
        lanes = _make_array(signature.args[4])(context, builder, arguments[4]).data
        total: Any = None
        for k in range(len(signature.args[1])):
            texel, _ = _load(builder, texels, builder.extract_value(arguments[1], k))
            weight = _splat(builder, builder.extract_value(arguments[2], k))
            product = builder.fmul(texel, weight, flags=CONTRACT)
            total = product if total is None else builder.fadd(total, product, flags=CONTRACT)
        before, pointer = _load(builder, lanes, arguments[5])
        scaled = builder.fmul(total, _splat(builder, arguments[3]), flags=CONTRACT)
        after = builder.store(builder.fadd(before, scaled, flags=CONTRACT), pointer)
        after.align = 4
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
filter_row4: Any = intrinsic(_filter_row(FLOAT4))
filter_row16: Any = intrinsic(_filter_row(FLOAT16))
