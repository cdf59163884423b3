"""A study on Dask: cells measured by several worker processes, here or on other machines.

Every truth and every cell is a task; the results come back to this process, which keeps each as it
arrives. Workers hold the ``Bench`` and prepare their own pyramids, once. Kernels run on one thread
and a worker does one task at a time, whatever its number of threads. The errors are the bits of a
run in one process where the processors are of one model; times are taken while other cells run, and
marked so.
"""

import contextlib
import logging
import signal
import threading
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from .. import _check
from .bench import Bench, Cell, Truth
from .measure import one_thread
from .run import Step, Study, Work

if TYPE_CHECKING:
    from distributed import Client

_ONE_TASK = threading.Lock()


def _truth(bench: Bench, index: int) -> dict[str, Any]:
    with _ONE_TASK, one_thread():
        return bench.truth(bench.plan.cases[index])


def _cell(bench: Bench, index: int, place: int, arrays: dict[str, Any]) -> Cell:
    case = bench.plan.cases[index]
    with _ONE_TASK, one_thread():
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
    try:
        from distributed import Client, LocalCluster
    except ImportError:
        raise ValueError(
            "study: needs Dask for several processes: pip install 'glossy-envmap[dask]'"
        ) from None
    if scheduler is not None:
        try:
            client = Client(scheduler, timeout="10s")
        except (OSError, ValueError) as error:
            rule = f"must be the address of a Dask scheduler ({_check.shortened(str(error), 120)})"
            raise _check.fail("scheduler", rule, scheduler) from None
        with client:
            yield client
        return
    count = _check.count("workers", workers)
    with _deaf_to_interrupts():  # workers inherit it: only this process answers Ctrl-C
        cluster = LocalCluster(
            n_workers=count,
            threads_per_worker=1,
            processes=True,
            dashboard_address=None,
            silence_logs=logging.CRITICAL,
            env={"NUMBA_NUM_THREADS": "1"},
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
    """

    def __init__(self, study: Study, client: "Client") -> None:
        self.study, self.client = study, client
        self.steps = len(study.plan.cases) + len(study.wanted())

    def __len__(self) -> int:
        return self.steps

    def __iter__(self) -> Iterator[Step]:
        from distributed import as_completed

        study, client = self.study, self.client
        bench = client.scatter(study.bench, broadcast=True, hash=False)
        waiting: dict[Any, Work | int] = {}
        try:
            for index, case in enumerate(study.plan.cases):
                found = [study.find_cell((case, *rest)) for rest in study.bench.wanted[case.name]]
                yield from [_nothing] * sum(found)
                known = study.find_truth(case)
                if known:
                    yield _nothing
                if known and all(found):
                    continue
                if known:
                    # in a list: a mapping would be taken for named data
                    [truth] = client.scatter([study.store.get_truth(case.slug)], hash=False)
                else:
                    truth = client.submit(_truth, bench, index, pure=False)
                    waiting[truth] = index
                for place, rest in enumerate(study.bench.wanted[case.name]):
                    if not found[place]:
                        future = client.submit(_cell, bench, index, place, truth, pure=False)
                        waiting[future] = (case, *rest)
            for future, result in as_completed(list(waiting), with_results=True):
                yield self._keep(waiting.pop(future), result)
        finally:
            client.cancel(list(waiting))

    def _keep(self, work: Work | int, result: Any) -> Step:
        if isinstance(work, int):
            case = self.study.plan.cases[work]
            return lambda: self.study.keep_truth(case, result)
        return lambda: self.study.keep_cell(result)


def _nothing() -> None:
    """The step of what is in the store."""
