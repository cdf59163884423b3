"""Run a study: the truth of every case, then its cells, each kept when it is finished.

In this process one after another, or by Dask (``spread``) several at a time; the errors are the
same bits on one model of processor.
"""

import dataclasses
import functools
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, TypeVar

from ..frames import SurfacePoints
from .bench import Bench, Cell, Truth, cell_key
from .preparation import Preparation
from .settings import Case, MethodSpec, Plan, digest, machine
from .store import Store, recorded

if TYPE_CHECKING:
    from distributed import Client

    from ..cubemap import CubeMap

Step = Callable[[], None]
Work = tuple[Case, MethodSpec, int, str]
Kept = TypeVar("Kept")
Progress = Callable[[Any], Iterator[Step]]


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
        Continue with the measurements in ``folder``; the plan may have more cases, methods and
        budgets.
    command : str
        The command line that reproduces the study, for the record.
    arguments : mapping of JSON values, optional
        What that line says, for a command that resumes the study.

    Raises
    ------
    ValueError
        If the folder holds another study, or one that must not be overwritten; or as ``Bench``.
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
        arguments: Mapping[str, Any] | None = None,
    ) -> None:
        old = recorded(folder) if resume else None
        if old is not None:  # cells that are added have the old ones' baseline
            plan = dataclasses.replace(plan, baseline=tuple(old[0]["baseline"]))
        self.bench = Bench(plan, cube, points)
        self.plan, self.command, self.arguments = plan, command, dict(arguments or {})
        seen = self.bench.seen
        self.settings = {
            **plan.describe(),
            "environment": environment,
            "cube_size": cube.size,
            "cube_sha256": digest(cube.faces),
            "width": seen.shape[1],
            "height": seen.shape[0],
            "pixels": int(seen.sum()),
            "points_sha256": digest(points.normal, points.tangent, points.view, seen),
        }
        self.store = Store(folder, self.settings, self._session(), resume)
        self.truths: dict[str, Truth] = {}
        self._cells: dict[str, Cell] = {}
        self.preparations: list[Preparation] = []

    def _session(self, workers: str = "") -> dict[str, Any]:
        said = {"command": self.command, "arguments": self.arguments}
        return {**machine(), **said, "workers": workers}

    @property
    def cells(self) -> list[Cell]:
        """The finished cells, in the order of the plan."""
        keys = (cell_key(c.name, m.label, n, kind) for c, m, n, kind in self.wanted())
        return [self._cells[key] for key in keys if key in self._cells]

    def wanted(self) -> list[Work]:
        """Case, method, budget and kind of bias of every cell, in order."""
        return [(case, *rest) for case in self.plan.cases for rest in self.bench.wanted[case.name]]

    def steps(self) -> list[Step]:
        """The work in order: each call finishes one truth or one cell."""
        steps: list[Step] = []
        for case in self.plan.cases:
            steps.append(functools.partial(self._truth, case))
            for rest in self.bench.wanted[case.name]:
                steps.append(functools.partial(self._cell, case, *rest))
        return steps

    def run(self, progress: Progress = iter, client: "Client | None" = None) -> list[Cell]:
        """Do what is not done, in this process or on the workers of a Dask client.

        ``progress`` may wrap the steps; each is a call that keeps one truth or one cell. What is in
        the folder is read first.

        Raises
        ------
        ValueError
            A file of the folder is damaged or of another study, or another process works there.
        """
        with self.store.lock:
            self.store.check_mine()
            self._find_all()
            self._run(progress, client)
        return self.cells

    def _run(self, progress: Progress, client: "Client | None") -> None:
        work: Iterable[Step] = self.steps()
        workers = ""
        if client is not None:
            from .spread import Arrivals, describe

            work, workers = Arrivals(self, client), describe(client)
        for step in progress(work):
            step()
        self.preparations = [
            self._preparation(case, method)
            for case in self.plan.cases
            for method in self.plan.methods
        ]
        self.store.sessions[-1] = self._session(workers)  # the threading layer is known now
        self.store.save_manifest()

    def _find_all(self) -> None:
        """Load what is in the store; one refusal for all that is wrong, before any work."""
        finders: list[Callable[[], object]] = []
        for case in self.plan.cases:
            finders.append(functools.partial(self.find_truth, case))
            for rest in self.bench.wanted[case.name]:
                finders.append(functools.partial(self.find_cell, (case, *rest)))
            for method in self.plan.methods:
                finders.append(functools.partial(self._find_preparation, case, method))
        faults = []
        for find in finders:
            try:
                find()
            except (OSError, ValueError) as error:
                faults.append(error)
        if len(faults) > 1:
            raise ValueError(f"{faults[0]} (and {len(faults) - 1} more such files)")
        if faults:
            raise faults[0]

    def _preparation(self, case: Case, method: MethodSpec) -> Preparation:
        """Measured here, where nothing else runs any more, or found in the store."""
        found = self._find_preparation(case, method)
        if found is None:
            found = self.bench.preparation(case, method)
            key = cell_key(case.name, method.label, 0, "preparation")
            self.store.put(key, dataclasses.asdict(found))
        return found

    def _find_preparation(self, case: Case, method: MethodSpec) -> Preparation | None:
        key = cell_key(case.name, method.label, 0, "preparation")
        return self._find(Preparation, key, case=case.name, method=method.label)

    def _find(self, kind: Callable[..., Kept], key: str, **names: Any) -> Kept | None:
        """A measurement of the store, which must be of what its name says."""
        stored = self.store.get(key, names["case"], kind)  # type: ignore[arg-type]
        if stored is None:
            return None
        with self.store.naming(self.store.cell_path(key)):
            other = [name for name, value in names.items() if stored[name] != value]
            if other:
                raise ValueError(f"of another {' and '.join(other)}")
            if not 0 <= stored.get("session", 0) < len(self.store.sessions):
                raise ValueError("of a session that is not on record")
        return kind(**stored)

    def find_truth(self, case: Case) -> bool:
        """Whether the truth of a case is in the store; it is loaded then."""
        if case.name not in self.truths:
            arrays = self.store.get_truth(case.slug, case.name)
            if arrays is None:
                return False
            self.truths[case.name] = Truth.of(arrays)
        return True

    def keep_truth(self, case: Case, arrays: dict[str, Any]) -> None:
        """Put a finished truth into the store."""
        self.store.put_truth(case.slug, case.name, arrays)
        self.truths[case.name] = Truth.of(arrays)

    def find_cell(self, work: Work) -> bool:
        """Whether a cell is in the store; it is loaded then."""
        case, method, budget, bias = work
        key = cell_key(case.name, method.label, budget, bias)
        if key not in self._cells:
            names = {"case": case.name, "method": method.label, "budget": budget, "bias_kind": bias}
            stored = self._find(Cell, key, **names)
            if stored is None:
                return False
            self._cells[key] = stored
        return True

    def keep_cell(self, cell: Cell) -> None:
        """Put a finished cell into the store."""
        cell = dataclasses.replace(cell, session=self.store.session)
        self.store.put(cell.key, dataclasses.asdict(cell))
        self._cells[cell.key] = cell

    def _truth(self, case: Case) -> None:
        if not self.find_truth(case):
            self.keep_truth(case, self.bench.truth(case))

    def _cell(self, case: Case, method: MethodSpec, budget: int, kind: str) -> None:
        if not self.find_cell((case, method, budget, kind)):
            truth = self.truths[case.name]
            self.keep_cell(self.bench.measure(case, method, budget, kind, truth))
