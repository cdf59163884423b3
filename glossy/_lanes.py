"""Two small pieces of LLVM IR that Numba has no word for: float bits, and a weighted texel sum.

``bits``/``from_bits`` reinterpret a float32 as an int32 and back, so that integers can live in a
float scratch array and an exponent can be read. ``add_texels`` loads eight RGBA texels as vectors
of four and adds their weighted sum to an accumulator: what a GPU's texture unit does for one
trilinear lookup.
"""

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

FLOAT4 = ir.VectorType(ir.FloatType(), 4)
FLOAT8 = ir.VectorType(ir.FloatType(), 8)
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


def splat(builder: Any, scalar: Any, vector: Any = FLOAT4) -> Any:
    zero = ir.Constant(ir.IntType(32), 0)
    nothing = ir.Constant(vector, ir.Undefined)
    lanes = ir.Constant(ir.VectorType(ir.IntType(32), vector.count), [0] * vector.count)
    return builder.shuffle_vector(builder.insert_element(nothing, scalar, zero), nothing, lanes)


def load(builder: Any, data: Any, index: Any, vector: Any = FLOAT4) -> tuple[Any, Any]:
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
        top, low = (load(builder, texels, x, FLOAT8)[0] for x in at)
        step = builder.fmul(builder.fsub(low, top), splat(builder, down, FLOAT8), flags=CONTRACT)
        row = builder.fadd(top, step, flags=CONTRACT)
        part = builder.fmul(row, _pair(builder, left, right), flags=CONTRACT)
        total = part if total is None else builder.fadd(total, part, flags=CONTRACT)
    return total


def _accumulate(context: Any, builder: Any, scratch: Any, value: Any, at: Any, term: Any) -> None:
    lanes = _make_array(scratch)(context, builder, value).data
    before, pointer = load(builder, lanes, at, FLOAT8)
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
        scaled = builder.fmul(total, splat(builder, arguments[3], FLOAT8), flags=CONTRACT)
        for place, term in ((arguments[5], total), (arguments[6], scaled)):
            _accumulate(context, builder, signature.args[4], arguments[4], place, term)
        return context.get_dummy_value()

    return signature, generate


bits: Any = intrinsic(_bits)
from_bits: Any = intrinsic(_from_bits)
add_texels: Any = intrinsic(_add_texels)
add_texels2: Any = intrinsic(_add_texels2)
