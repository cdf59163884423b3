"""A study on Dask: cells measured by several worker processes, here or on other machines.

Every truth and every cell is a task; the results come back to this process, which keeps each as it
arrives. Workers hold the ``Bench`` and prepare their own pyramids, once. Kernels run on one thread
and a worker does one task at a time, whatever its number of threads. The errors are the bits of a
run in one process where the processors are of one model; times are taken while other cells run, and
marked so.

What tasks need is sent from here, truths included once they are kept, so that none is computed
again with the worker that held it. It goes to one worker, from which the others take it: Dask's
broadcast never ends if a worker dies meanwhile. Tasks that are lost with their workers are
submitted anew; where none comes back, or nobody is left to work, the study ends with one line.
"""

import contextlib
import logging
import platform
import queue
import signal
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

from .. import _check
from .._threads import using
from .bench import Bench, Cell, Truth
from .run import Step, Study, Work

if TYPE_CHECKING:
    from distributed import Client, Future

_ONE_TASK = threading.Lock()
KEPT = "what is finished is kept, --resume goes on"
TRIES = 3  # times in a row that tasks are lost before any arrives
PATIENCE = 30.0  # seconds without any worker
DEAF = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"


def versions() -> dict[str, str]:
    """What must be the same here and on every worker."""
    import numba
    import numpy as np

    from .._version import __version__

    python = ".".join(platform.python_version_tuple()[:2])
    own = {"glossy": __version__, "Python": python}
    return {**own, "NumPy": np.__version__, "Numba": numba.__version__}


def _check_versions(wanted: dict[str, str], worker: str) -> None:
    found = versions()
    other = [f"{name} {found.get(name)} for {v}" for name, v in wanted.items() if found[name] != v]
    if other:
        raise ValueError(f"worker {worker} has other versions: {', '.join(other)}")


def _truth(bench: Bench, index: int, wanted: dict[str, str]) -> dict[str, Any]:
    from distributed import get_worker

    _check_versions(wanted, get_worker().address)
    with _ONE_TASK, using(1):
        return bench.truth(bench.plan.cases[index])


def _cell(
    bench: Bench, index: int, place: int, arrays: dict[str, Any], wanted: dict[str, str]
) -> Cell:
    from distributed import get_worker

    _check_versions(wanted, get_worker().address)
    case = bench.plan.cases[index]
    with _ONE_TASK, using(1):
        return bench.measure(case, *bench.wanted[case.name][place], Truth.of(arrays), loaded=True)


@contextlib.contextmanager
def _deaf_to_interrupts() -> Iterator[None]:
    if threading.current_thread() is not threading.main_thread():  # it may not handle signals
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextlib.contextmanager
def connect(workers: int | None = None, scheduler: str | None = None) -> Iterator["Client"]:
    """A Dask client: ``workers`` processes of one thread on this machine, or a scheduler's address.

    Raises
    ------
    ValueError
        If Dask is not installed, or the scheduler does not answer.
    """
    if (workers is None) == (scheduler is None):
        raise _check.fail("workers, scheduler", "must be one of the two", (workers, scheduler))
    count = None if workers is None else _check.count("workers", workers)
    try:
        import dask
        from distributed import Client, LocalCluster
    except ImportError:
        raise ValueError(
            "study: needs Dask for several processes: pip install 'glossy-envmap[dask]'"
        ) from None
    for name in ("distributed", "distributed.client"):  # what is lost is said here
        logging.getLogger(name).setLevel(logging.CRITICAL)
    if count is None:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # versions are compared with the tasks
                client = Client(scheduler, timeout="10s")
        except (OSError, ValueError) as error:
            rule = f"must be the address of a Dask scheduler ({_check.shortened(str(error), 120)})"
            raise _check.fail("scheduler", rule, scheduler) from None
        with client:
            yield client
        return
    connecting = {"distributed.comm.timeouts.connect": "10s"}  # to a worker that may be dead
    with (
        dask.config.set(connecting),
        _deaf_to_interrupts(),
    ):  # workers inherit it: only this process answers Ctrl-C
        cluster = LocalCluster(
            n_workers=count,
            threads_per_worker=1,
            processes=True,
            scheduler_kwargs={"dashboard": False, "dashboard_address": "127.0.0.1:0"},
            silence_logs=logging.CRITICAL,
            env={"NUMBA_NUM_THREADS": "1"},
            preload=[DEAF],  # those started in the place of dead ones
        )
    with cluster, Client(cluster) as client:
        yield client


def describe(client: "Client") -> str:
    """The workers of a client, for the record."""
    found = client.scheduler_info(n_workers=-1)["workers"].values()
    hosts = {str(worker["host"]) for worker in found}
    return f"{len(found)} Dask workers on {len(hosts)} host{'s' if len(hosts) > 1 else ''}"


class Arrivals:
    """The steps of a study in the order in which their results arrive.

    What is in the store is not measured again. Leaving the loop cancels what is not finished.

    Raises
    ------
    OSError
        While it is iterated: the scheduler or the workers are gone.
    """

    def __init__(self, study: Study, client: "Client") -> None:
        self.study, self.client = study, client
        self.steps = len(study.plan.cases) + len(study.wanted())
        self._waiting: dict[Future, Work | int] = {}
        self._done: queue.SimpleQueue[Future] = queue.SimpleQueue()
        self._versions = versions()
        self._sent: dict[Any, Future] = {}

    def __len__(self) -> int:
        return self.steps

    def __iter__(self) -> Iterator[Step]:
        study = self.study
        missing: list[Work | int] = []
        for index, case in enumerate(study.plan.cases):
            found = [study.find_cell((case, *rest)) for rest in study.bench.wanted[case.name]]
            known = study.find_truth(case)
            yield from [_nothing] * (sum(found) + known)
            if not known:
                missing.append(index)  # its cells follow when it is here
            elif not all(found):
                missing += self._cells_of(index)
        try:
            self._submit(missing)
            yield from self._arrivals()
        finally:
            with contextlib.suppress(Exception):  # the scheduler may be gone
                self.client.cancel(list(self._waiting))

    def _cells_of(self, index: int) -> list[Work]:
        """The cells of a case that are not in the store."""
        case = self.study.plan.cases[index]
        wanted = [(case, *rest) for rest in self.study.bench.wanted[case.name]]
        return [work for work in wanted if not self.study.find_cell(work)]

    def _arrivals(self) -> Iterator[Step]:
        lost: list[Work | int] = []
        tries = 0
        while self._waiting or lost:
            if not self._waiting:  # what was under way with the lost ones is known now
                tries += 1
                if tries > TRIES:
                    raise OSError(f"Dask: the workers die again and again; {KEPT}")
                self._sent.clear()
                self._submit(lost)
                lost = []
            future = self._next()
            work, result = self._waiting.pop(future), self._result(future)
            if result is None:
                lost.append(work)
                continue
            tries = 0
            yield self._keep(work, result)
            if isinstance(work, int):
                self._submit(self._cells_of(work))

    def _next(self) -> "Future":
        """The next task that has ended, in whatever way."""
        alone = 0.0
        while True:
            try:
                return self._done.get(timeout=1.0)
            except queue.Empty:
                pass
            if self.client.status not in ("running", "connecting"):
                raise OSError(f"the Dask scheduler is gone; {KEPT}")
            workers = self.client.scheduler_info(n_workers=-1)["workers"]
            alone = 0.0 if workers else alone + 1.0
            if alone > PATIENCE:
                raise OSError(f"no Dask worker is left; {KEPT}")

    def _result(self, future: "Future") -> Any:
        """What a task returned; None if it was lost with its worker. Its refusals are ours."""
        from distributed import CancelledError, KilledWorker

        try:
            return future.result(timeout=PATIENCE)
        except KilledWorker:
            raise OSError(f"Dask: a task killed its worker again and again; {KEPT}") from None
        except (Exception, CancelledError) as error:
            if future.status != "error":
                return None
            if isinstance(error, OSError | ValueError):
                raise
            said = _check.shortened(f"{type(error).__name__}: {error}", 200)
            raise OSError(f"a Dask worker failed ({said}); {KEPT}") from None

    def _submit(self, work: Sequence[Work | int]) -> None:
        from distributed import CancelledError

        try:
            for one in work:
                self._submit_one(one)
        except (OSError, RuntimeError, CancelledError) as error:
            who = "workers are" if self.client.status == "running" else "scheduler is"
            said = _check.shortened(str(error) or type(error).__name__, 120)
            raise OSError(f"the Dask {who} gone ({said}); {KEPT}") from None

    def _submit_one(self, work: Work | int) -> None:
        study, client = self.study, self.client
        bench = self._send("bench", lambda: study.bench)
        if isinstance(work, int):
            future = client.submit(_truth, bench, work, self._versions, pure=False)
        else:
            case, rest = work[0], work[1:]
            index = study.plan.cases.index(case)
            truth = self._send(index, lambda: study.store.get_truth(case.slug, case.name))
            place = study.bench.wanted[case.name].index(rest)
            future = client.submit(_cell, bench, index, place, truth, self._versions, pure=False)
        self._waiting[future] = work
        future.add_done_callback(self._done.put)

    def _send(self, name: Any, value: Callable[[], Any]) -> "Future":
        """The future of a value that the workers take from each other."""
        tries = 0
        while name not in self._sent:
            try:  # in a list: a mapping would be taken for named data
                [self._sent[name]] = self.client.scatter([value()], hash=False)
            except OSError:  # to a worker that has just died
                tries += 1
                if tries > TRIES or self.client.status != "running":
                    raise
                time.sleep(1.0)
        return self._sent[name]

    def _keep(self, work: Work | int, result: Any) -> Step:
        if isinstance(work, int):
            case = self.study.plan.cases[work]
            return lambda: self.study.keep_truth(case, result)
        return lambda: self.study.keep_cell(result)


def _nothing() -> None:
    """The step of what is in the store."""
