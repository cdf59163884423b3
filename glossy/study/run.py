"""Run a study: truth, then every case, method, budget and bias, each kept when it is finished.

All methods of a budget take the count that the regular pattern reaches there (19 for 20), so that
they are compared at equal samples; the thresholds are ``settings.threshold_for``.
"""

import dataclasses
import itertools
import time
from collections.abc import Callable, Iterator
from inspect import signature
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..frames import SurfacePoints
from .measure import Figures, Judge, Timing, best_bias, one_thread, timed
from .settings import Case, MethodSpec, Plan, digest, machine, threshold_for
from .store import Store

if TYPE_CHECKING:
    from ..cubemap import CubeMap

FloatArray = npt.NDArray[np.floating]
BIAS_KINDS = ("zero", "best")


@dataclasses.dataclass(frozen=True)
class Cell:
    """One measurement; field names are those of study.json and study.csv.

    ``samples``: taps per pixel over all lobes (``taps``: of each); ``threshold``: None where the
    method has none; ``truth_error``: RMS of the truth's own error estimate, in the units of
    ``rms``; ``truth_level``: RMS of the truth; ``seconds`` to ``cpu_ratio``: see ``Timing``;
    ``ns_per_sample``: CPU time of a tap; ``search``: the (bias, RMS of the subset) tried;
    ``session``: which run measured it.
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
    session: int

    @property
    def key(self) -> str:
        """Its file name in the store."""
        return cell_key(self.case, self.method, self.budget, self.bias_kind)


def cell_key(case: str, method: str, budget: int, bias_kind: str) -> str:
    """File name of a measurement."""
    slug = "".join(c if c.isalnum() or c == "." else "-" for c in f"{case}_{method}")
    return f"{slug}_{budget}_{bias_kind}"


@dataclasses.dataclass(frozen=True)
class Truth:
    """Ground truth (K, 3) of the covered pixels of one case, with its error."""

    radiance: FloatArray
    error: FloatArray
    kind: str
    seconds: float

    @property
    def rms_error(self) -> float:
        """Root mean square of the error estimates."""
        return float(np.sqrt(np.mean(np.square(self.error))))


class Study:
    """A plan on a scene's environment and points, with its store.

    Parameters
    ----------
    plan : Plan
    cube : CubeMap
    points : SurfacePoints of shape (H, W)
    environment : str
        Its name, for the record.
    folder : path
    resume : bool
        Continue with the measurements in ``folder``.
    command : str
        The command line that reproduces the study, for the record.

    Raises
    ------
    ValueError
        If the folder holds another study, or one that must not be overwritten; for an unknown
        filter, a size that is not a power of two, or a picture of less than two pixels.
    """

    def __init__(
        self,
        plan: Plan,
        cube: "CubeMap",
        points: SurfacePoints,
        environment: str,
        folder: Any,
        resume: bool = False,
        command: str = "",
    ) -> None:
        self.plan, self.cube, self.command = plan, cube, command
        self.seen = points.coverage
        self.points = points[self.seen]
        if self.seen.sum() < 2:
            raise ValueError("study: the picture shows less than two pixels of the surface")
        self._prepared: dict[tuple[str, str, str], Any] = {}
        for case, method in itertools.product(plan.cases, plan.methods):
            self.prepared(case, method)  # refuses before anything is kept
        self.settings = {
            **plan.describe(),
            "environment": environment,
            "cube_size": cube.size,
            "cube_sha256": digest(cube.faces),
            "width": self.seen.shape[1],
            "height": self.seen.shape[0],
            "pixels": int(self.seen.sum()),
            "points_sha256": digest(points.normal, points.tangent, points.view, self.seen),
        }
        self.store = Store(folder, self.settings, self._session(), resume)
        self.truths: dict[str, Truth] = {}
        self.cells: list[Cell] = []
        stride = max(1, int(self.seen.sum()) // plan.subset)
        self.subset = np.arange(stride // 2, int(self.seen.sum()), stride)

    def prepared(self, case: Case, method: MethodSpec) -> Any:
        """What a method looks up, made once; for every case if it depends on the material."""
        from .. import methods

        make = methods.preparation(method.name)
        own = {k: v for k, v in self.plan.preparation.items() if k in signature(make).parameters}
        bound = "material" in signature(make).parameters
        key = (make.__module__, make.__qualname__, case.name if bound else "")
        if key not in self._prepared:
            self._prepared[key] = methods.prepare(method.name, self.cube, case.material, **own)
        return self._prepared[key]

    def _session(self) -> dict[str, Any]:
        return {**machine(), "command": self.command}

    def steps(self) -> list[Callable[[], None]]:
        """The work in order: each call finishes one truth or one measurement."""
        work: list[Callable[[], None]] = []
        for case in self.plan.cases:
            work.append(lambda case=case: self._truth(case))  # type: ignore[misc]
            for method in self.plan.methods:
                for budget in self.plan.budgets:
                    for kind in BIAS_KINDS:
                        args = (case, method, budget, kind)
                        work.append(lambda args=args: self._cell(*args))  # type: ignore[misc]
        return work

    def run(self, progress: Callable[[list[Any]], Iterator[Any]] = iter) -> list[Cell]:
        """Do what is not done; ``progress`` may wrap the list of steps."""
        for step in progress(self.steps()):
            step()
        self.store.sessions[-1] = self._session()  # the threading layer is known now
        self.store.save_manifest()
        return self.cells

    def _truth(self, case: Case) -> None:
        arrays = self.store.get_truth(case.slug)
        if arrays is None:
            from ..reference import reference

            start = time.perf_counter()
            truth = reference(
                self.points, case.material, self.cube, tolerance=self.plan.tolerance, diffuse=False
            )
            if not np.any(truth.radiance):
                raise ValueError(f"environment: must light the surface, {case.name} is black")
            arrays = {
                "radiance": truth.radiance,
                "error": truth.error,
                "kind": np.array(truth.error_kind),
                "seconds": np.array(time.perf_counter() - start),
            }
            self.store.put_truth(case.slug, arrays)
        self.truths[case.name] = Truth(
            arrays["radiance"], arrays["error"], str(arrays["kind"]), float(arrays["seconds"])
        )

    def options(self, case: Case, method: MethodSpec, budget: int) -> dict[str, Any]:
        """Options of ``shade`` but for the bias."""
        from .. import methods
        from ..render import actual_samples

        threshold = threshold_for(budget)
        own = dict(method.options)
        known = methods.options(method.name)
        if "threshold" in known:  # the schedule is the paper's; the thesis's ring goes with its own
            own["threshold"] = known["threshold"] if method.name == "thesis" else threshold
        reached = actual_samples(case.material, "regular", budget, threshold)
        same = method.name == "regular"
        own["samples"] = budget if same else round(float(np.mean(reached)))
        return own

    def image(
        self,
        case: Case,
        method: MethodSpec,
        budget: int,
        bias: float,
        points: SurfacePoints | None = None,
    ) -> FloatArray:
        """The method's radiance (K, 3) at the covered pixels, or at ``points``."""
        from ..shading import shade

        own = self.options(case, method, budget)
        where = self.points if points is None else points
        prepared = self.prepared(case, method)
        result: FloatArray = shade(
            where, case.material, prepared, method=method.name, bias=bias, **own
        )
        return result

    def _baseline(self) -> FloatArray:
        first = self.plan.cases[0], self.plan.methods[0], min(self.plan.budgets)
        return self.image(*first, bias=0.0)

    def _cell(self, case: Case, method: MethodSpec, budget: int, bias_kind: str) -> None:
        key = cell_key(case.name, method.label, budget, bias_kind)
        stored = self.store.get(key)
        if stored is None:
            cell = self._measure(case, method, budget, bias_kind)
            self.store.put(key, dataclasses.asdict(cell))
        else:
            try:
                cell = Cell(**stored)
            except TypeError:
                path = self.store.cell_path(key)
                raise ValueError(f"{path}: of another version; delete it to redo it") from None
        self.cells.append(cell)

    def _measure(self, case: Case, method: MethodSpec, budget: int, bias_kind: str) -> Cell:
        from ..render import actual_samples

        truth = self.truths[case.name]
        judge = Judge(truth.radiance, self.seen)
        bias: float = 0.0
        search: list[tuple[float, float]] = []
        if bias_kind == "best":
            few = self.points[self.subset]
            with one_thread():  # too few pixels to share
                bias, search = best_bias(
                    lambda b: judge.rms(self.image(case, method, budget, b, few), self.subset)
                )
            if judge.rms(self.image(case, method, budget, bias)) > self.cells[-1].rms:
                bias = 0.0  # the cell before is the same without bias; the subset misled
        self.image(case, method, budget, bias, self.points[:1])  # compile outside the clock
        self._baseline()
        image, timing = timed(
            lambda: self.image(case, method, budget, bias), self._baseline, self.plan.repeats
        )
        figures = judge.figures(image)
        options = self.options(case, method, budget)
        taps = actual_samples(case.material, method.name, options["samples"], threshold_for(budget))
        return self._cell_of(
            case, method, budget, bias_kind, bias, search, figures, timing, truth, judge.level, taps
        )

    def _cell_of(
        self,
        case: Case,
        method: MethodSpec,
        budget: int,
        bias_kind: str,
        bias: float,
        search: list[tuple[float, float]],
        figures: Figures,
        timing: Timing,
        truth: Truth,
        level: float,
        taps: list[int],
    ) -> Cell:
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
            truth_level=level,
            ns_per_sample=timing.cpu_seconds * 1e9 / (pixels * sum(taps)),
            search=[list(pair) for pair in search],
            session=self.store.session,
            **dataclasses.asdict(figures),
            **dataclasses.asdict(timing),
        )
