"""The parameters that a fit may vary: their names, bounds, scales, and what is held fixed.

A set of parameters is one row: kd (in transmission ``diffuse_transmission``) of every channel, then
mx, my, alpha, r0 and ks of every channel for each lobe. The search sees only the free ones,
roughness by its logarithm.

Names are ``kd``, ``diffuse_transmission`` and, for all lobes, ``mx``, ``my``, ``alpha``, ``r0``,
``ks``; one lobe's are ``reflection[0].mx`` and so on, which overrides the common one.
"""

import dataclasses
import re
from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from .. import _check
from ..brdf import M_MAX, M_MIN
from .fit_kernels import LOBE

Float64Array = npt.NDArray[np.float64]

SHAPE_NAMES = ("mx", "my", "alpha", "r0")
DIFFUSE = {"reflection": "kd", "transmission": "diffuse_transmission"}
NAMES = (*SHAPE_NAMES, "ks", *DIFFUSE.values())
DEFAULT_BOUNDS = {
    "mx": (0.003, 1.0),
    "my": (0.003, 1.0),
    "alpha": (0.0, 1.0),
    "r0": (0.0, 1.0),
    "ks": (0.0, 1.0),
    "kd": (0.0, 1.0),
    "diffuse_transmission": (0.0, 1.0),
}
LIMITS = {"mx": (M_MIN, M_MAX), "my": (M_MIN, M_MAX), "alpha": (0.0, 1.0), "r0": (0.0, 1.0)}
SPACINGS = ("log", "linear")

Bounds = Mapping[str, tuple[float, float]]
Fixed = Mapping[str, float | Sequence[float]]

_NAME = re.compile(r"(?:(reflection|transmission)(?:\[(\d+)\])?\.)?(\w+)")


@dataclasses.dataclass(frozen=True)
class Space:
    """Names, bounds and scales of the parameters of one side.

    ``low``, ``high`` (P,); ``logarithmic`` (P,) bool; ``tied``: my equals mx, the bounds of my
    play no part.
    """

    side: str
    lobes: int
    channels: int
    low: Float64Array
    high: Float64Array
    logarithmic: npt.NDArray[np.bool_]
    tied: bool

    @property
    def names(self) -> list[str]:
        """One name a parameter: ``kd``, ``reflection[0].mx`` ..., with the channel of several."""
        ends = [""] if self.channels == 1 else [f"[{c}]" for c in range(self.channels)]
        names = [f"{DIFFUSE[self.side]}{e}" for e in ends]
        for j in range(self.lobes):
            own = [*SHAPE_NAMES, *(f"ks{e}" for e in ends)]
            names += [f"{self.side}[{j}].{n}" for n in own]
        return names

    def at(self, lobe: int) -> int:
        """Position of a lobe's first parameter."""
        return self.channels + lobe * (LOBE + self.channels)

    @property
    def free(self) -> npt.NDArray[np.intp]:
        """Positions of the parameters that the search varies."""
        vary = self.high > self.low
        if self.tied:
            for j in range(self.lobes):
                vary[self.at(j) + 1] = False
        return np.flatnonzero(vary)

    def encode(self, parameters: Float64Array) -> Float64Array:
        """The free parameters of (..., P) as the search sees them, (..., F)."""
        free = self.free
        values = np.clip(parameters, self.low, self.high)[..., free]
        return np.where(self.logarithmic[free], np.log(np.maximum(values, 1e-300)), values)

    def decode(self, free_values: Float64Array) -> Float64Array:
        """All parameters (..., P), within their bounds, from the free ones (..., F)."""
        free = self.free
        scale = self.logarithmic[free]
        values = np.where(scale, np.exp(np.where(scale, free_values, 0.0)), free_values)
        full = np.array(np.broadcast_to(self.low, (*free_values.shape[:-1], len(self.low))))
        full[..., free] = np.clip(values, self.low[free], self.high[free])
        if self.tied:
            for j in range(self.lobes):
                full[..., self.at(j) + 1] = full[..., self.at(j)]
        return full

    @property
    def box(self) -> tuple[Float64Array, Float64Array]:
        """Bounds of the free parameters as the search sees them."""
        return self.encode(self.low), self.encode(self.high)

    def at_bounds(self, parameters: Float64Array) -> list[str]:
        """Names of the free parameters that ended on a bound: the data does not hold them."""
        free, names = self.free, self.names
        u, (low, high) = self.encode(parameters), self.box
        margin = 1e-3 * (high - low)
        near = (u - low < margin) | (high - u < margin)
        return [names[k] for k in free[near]]

    def only(self, lobe: int) -> "Space":
        """The space of one lobe with the diffuse part."""
        c, at = self.channels, self.at(lobe)
        keep = np.r_[0:c, at : at + LOBE + c]
        return dataclasses.replace(
            self,
            lobes=1,
            low=self.low[keep],
            high=self.high[keep],
            logarithmic=self.logarithmic[keep],
        )


def check_names(bounds: Bounds, fixed: Fixed, lobes: Mapping[str, int]) -> None:
    """Refuse names that no parameter has, and values outside what a lobe can have."""
    for kind, mapping in (("bounds", bounds), ("fixed", fixed)):
        for name, value in mapping.items():
            match = _NAME.fullmatch(name)
            known = match is not None and match[3] in NAMES
            if match is None or not known or (match[1] and match[3] in DIFFUSE.values()):
                names = ", ".join(NAMES)
                rule = f"must be one of {names}, or such as reflection[0].mx"
                raise _check.fail(f"{kind}: name", rule, name)
            if match[2] is not None and int(match[2]) >= lobes.get(match[1], 0):
                rule = f"there are {lobes.get(match[1], 0)} {match[1]} lobes"
                raise _check.fail(f"{kind}: {name}", rule, name)
            values = _check.array(f"{kind}: {name}", value).reshape(-1)
            low, high = LIMITS.get(match[3], (0.0, np.inf))
            if kind == "bounds" and (len(values) != 2 or not values[0] <= values[1]):
                raise _check.fail(f"bounds: {name}", "must be (low, high)", value)
            if kind == "fixed" and len(values) != 1 and match[3] not in ("ks", *DIFFUSE.values()):
                raise _check.fail(f"fixed: {name}", "must be one number", value)
            for v in values:
                _check.in_range(f"{kind}: {name}", float(v), low, high)


def make_space(
    side: str,
    lobes: int,
    channels: int,
    bounds: Bounds,
    fixed: Fixed,
    tied: bool = False,
) -> Space:
    """The space of one side; ``bounds`` and ``fixed`` have been through ``check_names``."""
    width = channels + lobes * (LOBE + channels)
    low, high = np.zeros(width), np.zeros(width)
    logarithmic = np.zeros(width, dtype=bool)

    def put(where: slice, name: str, *names: str) -> None:
        low[where], high[where] = DEFAULT_BOUNDS[name]
        for key in names:  # from the most general to the most particular
            if key in bounds:
                low[where], high[where] = bounds[key]
            if key in fixed:
                value = np.asarray(fixed[key], dtype=np.float64).reshape(-1)
                if len(value) not in (1, channels):
                    rule = f"must have one value or one for each of {channels} channels"
                    raise _check.fail(f"fixed: {key}", rule, fixed[key])
                low[where] = high[where] = value

    put(slice(0, channels), DIFFUSE[side], DIFFUSE[side])
    for j in range(lobes):
        at = channels + j * (LOBE + channels)
        for k, name in enumerate((*SHAPE_NAMES, "ks")):
            where = slice(at + k, at + k + 1 if k < LOBE else at + LOBE + channels)
            put(where, name, name, f"{side}.{name}", f"{side}[{j}].{name}")
            if name in ("mx", "my"):
                logarithmic[where] = True
    return Space(side, lobes, channels, low, high, logarithmic, tied)
