"""Every tap of one pixel of ``auto``: the plan, then the trace of each method that it chose.

Lobes that share a method and a number of taps are traced together; a lobe without taps adds
nothing. The sum over the parts is the pixel.
"""

import dataclasses
from typing import Any

import numpy as np

from ..brdf import Material
from ..frames import SurfacePoints
from ..pyramid import Pyramid
from ..trace import Printed, Vector, to_vector, trace, vector_text
from .auto import auto, planned
from .model import candidate_options
from .plan import Plan, groups


@dataclasses.dataclass(frozen=True, repr=False)
class PlanTrace(Printed):
    """A plan and the traces of its parts; the other fields as in ``glossy.trace.Trace``.

    ``lobes``: for each part, which lobes of the material it holds, in the trace's order.
    """

    method: str
    options: dict[str, Any]
    normal: Vector
    tangent: Vector
    bitangent: Vector
    view: Vector
    view_local: Vector
    radiance: Vector
    tap_sum: Vector
    plan: Plan
    lobes: tuple[tuple[int, ...], ...]
    parts: tuple[Any, ...]

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON; ``schema`` 1."""
        own = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        parts = [part.to_dict() for part in self.parts]
        return {"schema": 1, **own, "plan": self.plan.to_dict(), "parts": parts}

    def format_table(self) -> str:
        """The plan's reasons, then the taps of each part as text, then the pixel."""
        lines = [f"method {self.method}  {self.options}", *self.plan.reasons]
        for own, part in zip(self.lobes, self.parts, strict=True):
            lines += [f"lobes {', '.join(map(str, own))} of the material:", part.format_table()]
        lines.append(f"sum of all  {vector_text(self.tap_sum, 12, 7, 'g')}")
        lines.append(f"pixel       {vector_text(self.radiance, 12, 7, 'g')}")
        return "\n".join(lines)


def trace_plan(
    point: SurfacePoints, material: Material, pyramid: Pyramid, precision: str, **options: Any
) -> PlanTrace:
    """Every tap at one point, by the plan for it; ``glossy.trace`` has checked the arguments."""
    found = planned(material, pyramid, points=point, **options)
    options.pop("plan", None)
    parts, lobes = [], []
    for candidate, some in groups(material, found):
        own = candidate_options(candidate)
        parts.append(trace(point, some, pyramid, candidate.method, precision, **own))
        alike = (candidate.method, candidate.samples)
        lobes.append(
            tuple(k for k, row in enumerate(found.lobes) if (row.method, row.samples) == alike)
        )
    total = np.sum([part.tap_sum for part in parts], axis=0) if parts else np.zeros(3)
    return PlanTrace(
        method="auto",
        options={"precision": precision, **options},
        normal=to_vector(point.normal),
        tangent=to_vector(point.tangent),
        bitangent=to_vector(point.bitangent),
        view=to_vector(point.view),
        view_local=to_vector(point.local_view),
        radiance=to_vector(auto(point, material, pyramid, precision=precision, plan=found)),
        tap_sum=to_vector(total),
        plan=found,
        lobes=tuple(lobes),
        parts=tuple(parts),
    )
