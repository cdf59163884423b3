"""What a study measures and how, without the folder it is kept in: the truth of a case, and cells.

A ``Bench`` holds nothing that is not in the plan and the scene; it can be sent to another process,
where it gives the same numbers.

All methods of a budget take the count that the regular pattern reaches there (19 for 20), so that
they are compared at equal samples; the thresholds are ``settings.threshold_for``. A method whose
count does not depend on the budget (``split-sum``) is measured once, at a budget of 1.
"""

import dataclasses
import itertools
import time
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from .. import methods
from .._threads import using
from ..frames import SurfacePoints
from ..render import actual_samples
from ..shading import shade
from . import preparation
from .measure import Judge, best_bias, timed
from .preparation import Preparation
from .settings import PREPARED, Case, MethodSpec, Plan, cpu_model, threshold_for

if TYPE_CHECKING:
    from ..brdf import Material
    from ..cubemap import CubeMap

FloatArray = npt.NDArray[np.floating]
BIAS_KINDS = ("zero", "best")
CPU_TOLERANCE = 1e-6
"""RMS error without bias over the truth's RMS: how far two models of processor may differ."""


@dataclasses.dataclass(frozen=True)
class Cell:
    """One measurement; field names are those of study.json and study.csv.

    ``samples``: taps per pixel over all lobes (``taps``: of each); ``threshold``: None where the
    method has none; ``truth_error``: RMS of the truth's own error estimate, in the units of
    ``rms``; ``truth_level``: RMS of the truth; ``seconds`` to ``cpu_ratio``: see ``Timing``;
    ``ns_per_sample``: CPU time of a tap; ``search``: the (bias, RMS of the subset) tried;
    ``cpu``: model of the processor; ``loaded``: other cells were measured on the machine meanwhile,
    so that its times must not be compared with others; ``session``: which run measured it.
    """

    case: str
    kind: str
    widths: list[float]
    method: str
    budget: int
    samples: int
    taps: list[int]
    threshold: float | None
    bias_kind: str
    bias: float
    pixels: int
    rms: float
    relative_rms: float
    psnr: float | None
    peak: float
    max_error: float
    spread: float
    roughness: float
    dark_bias: float
    truth_error: float
    truth_level: float
    seconds: float
    runs: list[float]
    calls: list[int]
    cpu_seconds: float
    cpu_ratio: float
    ns_per_sample: float
    search: list[list[float]]
    cpu: str
    loaded: bool
    session: int

    @property
    def key(self) -> str:
        """Its file name in the store."""
        return cell_key(self.case, self.method, self.budget, self.bias_kind)


def cell_key(case: str, method: str, budget: int, bias_kind: str) -> str:
    """File name of a measurement."""
    slug = "".join(c if c.isalnum() or c == "." else "-" for c in f"{case}_{method}")
    return f"{slug}_{budget}_{bias_kind}"


def comparable(cells: Sequence[Cell]) -> list[Cell]:
    """The cells whose times may stand beside each other: of one processor, quiet or all loaded.

    Quiet cells come before loaded ones, then the processor with the most cells.
    """
    if not cells:
        return []
    groups: dict[tuple[bool, str], list[Cell]] = {}
    for cell in cells:
        groups.setdefault((cell.loaded, cell.cpu), []).append(cell)
    first = min(groups, key=lambda group: (group[0], -len(groups[group]), group[1]))
    return groups[first]


@dataclasses.dataclass(frozen=True)
class Truth:
    """Ground truth (K, 3) of the covered pixels of one case, with its error."""

    radiance: FloatArray
    error: FloatArray
    kind: str
    seconds: float

    @classmethod
    def of(cls, arrays: Mapping[str, Any]) -> "Truth":
        """From what ``Bench.truth`` returns and the store keeps."""
        kind, seconds = str(arrays["kind"]), float(arrays["seconds"])
        return cls(arrays["radiance"], arrays["error"], kind, seconds)

    @property
    def rms_error(self) -> float:
        """Root mean square of the error estimates."""
        return float(np.sqrt(np.mean(np.square(self.error))))


class Bench:
    """A plan on an environment and surface points, ready to measure.

    Parameters
    ----------
    plan : Plan
    cube : CubeMap
    points : SurfacePoints of shape (H, W)

    ``wanted`` holds method, budget and kind of bias of the cells of each case, by its name.

    Raises
    ------
    ValueError
        For an unknown filter, a size that is not a power of two, or a picture of less than two
        pixels.
    """

    def __init__(self, plan: Plan, cube: "CubeMap", points: SurfacePoints) -> None:
        self.plan, self.cube = plan, cube
        self.seen = points.coverage
        self.points = points[self.seen]
        pixels = int(self.seen.sum())
        if pixels < 2:
            raise ValueError("study: the picture shows less than two pixels of the surface")
        stride = max(1, pixels // plan.subset)
        self.subset = np.arange(stride // 2, pixels, stride)
        self._prepared: dict[tuple[str, ...], Any] = {}
        for case, method in itertools.product(plan.cases, plan.methods):
            self.prepared(case, method)  # refuses before anything is kept
        self.wanted = {case.name: self._wanted(case) for case in plan.cases}

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "_prepared": {}}  # made anew where it is needed

    def prepared(self, case: Case, method: MethodSpec) -> Any:
        """What a method looks up, made once; for every case if it depends on the material."""
        make = methods.preparation(method.name)
        key = (
            make.__module__,
            make.__qualname__,
            case.name if methods.bound_to_material(method.name) else "",
            *method.preparation.values(),
        )
        if key not in self._prepared:
            self._prepared[key] = self._make(case.material, method)
        return self._prepared[key]

    def _make(self, material: "Material", method: MethodSpec) -> Any:
        known = methods.preparation_options(method.name)
        known = [k for k in known if k != PREPARED.get(method.name)]
        own = {k: v for k, v in self.plan.preparation.items() if k in known} | method.preparation
        return methods.prepare(method.name, self.cube, material, **own)

    def truth(self, case: Case) -> dict[str, Any]:
        """Ground truth of a case, its error, its kind and the seconds it took, as arrays."""
        from ..reference import reference

        start = time.perf_counter()
        truth = reference(
            self.points, case.material, self.cube, tolerance=self.plan.tolerance, diffuse=False
        )
        if not np.any(truth.radiance):
            raise ValueError(f"environment: must light the surface, {case.name} is black")
        return {
            "radiance": truth.radiance,
            "error": truth.error,
            "kind": np.array(truth.error_kind),
            "seconds": np.array(time.perf_counter() - start),
        }

    def _wanted(self, case: Case) -> list[tuple[MethodSpec, int, str]]:
        """Method, budget and kind of bias of each cell of a case, in order."""
        found = []
        for method in self.plan.methods:
            alone = "samples" not in methods.options(method.name)
            fixed = alone or max(self.taps(case, method, max(self.plan.budgets))) == 1
            kinds = BIAS_KINDS if "bias" in methods.options(method.name) else BIAS_KINDS[:1]
            budgets = (1,) if fixed else self.plan.budgets
            found += list(itertools.product([method], budgets, kinds))
        return found

    def options(self, case: Case, method: MethodSpec, budget: int) -> dict[str, Any]:
        """Options of ``shade`` but for the bias."""
        threshold = threshold_for(budget)
        own = dict(method.options)
        known = methods.options(method.name)
        if "threshold" in known:  # the schedule is the paper's; the thesis's ring goes with its own
            own["threshold"] = known["threshold"] if method.name == "thesis" else threshold
        if "samples" not in known:
            return own
        reached = actual_samples(case.material, "regular", budget, threshold)
        same = method.name == "regular"
        own["samples"] = budget if same else round(float(np.mean(reached)))
        return own

    def taps(self, case: Case, method: MethodSpec, budget: int) -> list[int]:
        """Taps of each lobe."""
        own = self.options(case, method, budget)
        if method.name in methods.PLANNED:
            prepared = self.prepared(case, method)
            own["points"] = self.points
            return methods.planned_counts(method.name, case.material, prepared, own)
        samples = own.get("samples", 1)
        return actual_samples(case.material, method.name, samples, threshold_for(budget))

    def image(
        self,
        case: Case,
        method: MethodSpec,
        budget: int,
        bias: float,
        points: SurfacePoints | None = None,
    ) -> FloatArray:
        """The method's radiance (K, 3) at the covered pixels, or at ``points``."""
        own = self.options(case, method, budget)
        where = self.points if points is None else points
        if "bias" in methods.options(method.name):
            own["bias"] = bias
        prepared = self.prepared(case, method)
        result: FloatArray = shade(where, case.material, prepared, method=method.name, **own)
        return result

    def preparation(self, case: Case, method: MethodSpec) -> Preparation:
        """What a method needs before its first picture, at the baseline's budget."""
        own = self.options(case, method, self.plan.reference[2])
        pixel = self.points if method.name in methods.PLANNED else self.points[:1]  # planned for
        return preparation.measure(
            case.name,
            method.label,
            case.material,
            prepare=lambda material: self._make(material, method),
            shade=lambda material, made: shade(pixel, material, made, method=method.name, **own),
            bound=methods.bound_to_material(method.name),
            given=self.cube,
        )

    def _baseline(self) -> FloatArray:
        name, label, budget = self.plan.reference
        case = next(c for c in self.plan.cases if c.name == name)
        method = next(m for m in self.plan.methods if m.label == label)
        return self.image(case, method, budget, bias=0.0)

    def measure(
        self,
        case: Case,
        method: MethodSpec,
        budget: int,
        bias_kind: str,
        truth: Truth,
        loaded: bool = False,
    ) -> Cell:
        """One cell. ``loaded``: other cells are measured meanwhile."""
        judge = Judge(truth.radiance, self.seen)
        bias: float = 0.0
        search: list[tuple[float, float]] = []
        if bias_kind == "best":
            few = self.points[self.subset]
            with using(1):  # too few pixels to share
                bias, search = best_bias(
                    lambda b: judge.rms(self.image(case, method, budget, b, few), self.subset)
                )
            without, best = (judge.rms(self.image(case, method, budget, b)) for b in (0.0, bias))
            bias = bias if best <= without else 0.0  # the subset may mislead
        self.image(case, method, budget, bias, self.points[:1])  # compile outside the clock
        taps = self.taps(case, method, budget)  # plans, too
        self._baseline()
        image, timing = timed(
            lambda: self.image(case, method, budget, bias), self._baseline, self.plan.repeats
        )
        pixels = len(self.points.normal)
        return Cell(
            case=case.name,
            kind=case.kind,
            widths=case.widths,
            method=method.label,
            budget=budget,
            samples=sum(taps),
            taps=taps,
            threshold=self.options(case, method, budget).get("threshold"),
            bias_kind=bias_kind,
            bias=bias,
            pixels=pixels,
            truth_error=truth.rms_error,
            truth_level=judge.level,
            ns_per_sample=timing.cpu_seconds * 1e9 / (pixels * max(sum(taps), 1)),
            search=[list(pair) for pair in search],
            cpu=cpu_model(),
            loaded=loaded,
            session=0,
            **dataclasses.asdict(judge.figures(image)),
            **dataclasses.asdict(timing),
        )
