"""One texel as a weighted sum of 8 x 8 texels with weights of its own, sixteen numbers at a time.

Four RGBA texels of a row are one vector; their four weights are spread over its lanes, once for
``FACES`` faces. The mirrored build reads each row's weights backwards, so that one table serves
both halves of a face. Asking early for the rows that come next saves a third of the time.
"""

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

from ._lanes import CONTRACT, FLOAT4, FLOAT8, load
from ._rows import prefetch

TAPS = 8
FACES = 2  # done together
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
        source, places, weights, first, step, target, ends = arguments
        fine = _make_array(signature.args[0])(context, builder, source).data
        table = _make_array(signature.args[2])(context, builder, weights).data
        coarse = _make_array(signature.args[5])(context, builder, target).data
        start, width, fine_face = (builder.extract_value(places, k) for k in range(3))
        begin, coarse_face = (builder.extract_value(ends, k) for k in range(2))
        index, faces = start.type, [start]
        for _ in range(FACES - 1):
            faces.append(builder.add(faces[-1], fine_face))
        sums: list[Any] = [None] * FACES
        for _ in range(TAPS):
            factors, _ = load(builder, table, first, FLOAT8)
            for half in range(2):
                weight = _pick(builder, factors, spread[half])
                for k in range(FACES):
                    at = builder.add(faces[k], index(half * LANES))
                    term = builder.fmul(load(builder, fine, at, VECTOR)[0], weight, flags=CONTRACT)
                    old = sums[k]
                    sums[k] = term if old is None else builder.fadd(old, term, flags=CONTRACT)
            faces = [builder.add(face, width) for face in faces]
            first = builder.add(first, step)
        for face in faces:  # the next row's windows end two rows further down
            for k in range(2):
                prefetch(builder, fine, builder.add(face, width) if k else face)
        for total in sums:
            for count in (8, 4):
                halves = [_pick(builder, total, list(range(k, k + count))) for k in (0, count)]
                total = builder.fadd(*halves)
            pointer = builder.bitcast(builder.gep(coarse, [begin]), FLOAT4.as_pointer())
            builder.store(total, pointer).align = 4
            begin = builder.add(begin, coarse_face)
        return context.get_dummy_value()

    return generate


def _gather(
    _typing: Any, source: Any, places: Any, weights: Any, first: Any, step: Any, target: Any,
    ends: Any,
) -> Any:  # fmt: skip
    """``target[begin:begin+4]``: the weighted sum of a window of ``source``; on ``FACES`` faces.

    ``places``: number of the window's first texel on the first face, numbers in a row, and from a
    face to the next; ``ends``: ``begin`` on the first face, and numbers from a face to the next.
    ``first``: the first row's weights, ``step``: from one row's weights to the next's.
    """
    signature = types.void(source, places, weights, first, step, target, ends)
    return signature, _generator(mirrored=False)


def _gather_mirrored(
    _typing: Any, source: Any, places: Any, weights: Any, first: Any, step: Any, target: Any,
    ends: Any,
) -> Any:  # fmt: skip
    """As ``gather``, with each row's weights read backwards."""
    signature = types.void(source, places, weights, first, step, target, ends)
    return signature, _generator(mirrored=True)


gather: Any = intrinsic(_gather)
gather_mirrored: Any = intrinsic(_gather_mirrored)
