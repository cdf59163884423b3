"""Rows shared among threads: each once, errors passed on; safe under threads, forks, Ctrl-C."""

import multiprocessing
import os
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import glossy
from glossy import _threads

PYRAMID = glossy.Pyramid([np.random.default_rng(5).random((6, 8, 8, 3))])
POINTS = glossy.SurfacePoints(
    normal=np.tile([0.0, 0.0, 1.0], (700, 1)),
    tangent=np.tile([1.0, 0.0, 0.0], (700, 1)),
    view=glossy.frames.normalise(np.random.default_rng(6).random((700, 3)) + np.array([0, 0, 0.1])),
)


def radiance(_: Any = None) -> bytes:
    return glossy.shade(POINTS, glossy.Lobe(0.2, 0.1), PYRAMID, precision="double").tobytes()


@given(st.integers(0, 500), st.integers(1, 9), st.integers(1, 70))
def test_each_row_is_filled_once_whatever_the_threads(count: int, threads: int, grain: int) -> None:
    met = np.zeros(count, dtype=int)
    ranges = []

    def fill(begin: int, end: int, out: Any) -> None:
        ranges.append((begin, end))
        out[begin:end] += 1

    with _threads.using(threads):
        _threads.in_rows(fill, count, met, grain=grain)
    assert (met == 1).all()
    assert len(ranges) <= _threads.CHUNKS
    assert all(0 <= begin < end <= count for begin, end in ranges)
    if threads > 1 and len(ranges) > 1:
        assert {(b, e) for b, e in ranges if e < count and e - b < grain} == set()


@pytest.mark.parametrize("bad", [0, 37, 99])
def test_an_error_in_any_row_is_passed_on_and_ends_the_others(bad: int) -> None:
    def fill(begin: int, end: int) -> None:
        if begin <= bad < end:
            raise ValueError(f"row {bad}")

    with _threads.using(3), pytest.raises(ValueError, match=f"row {bad}"):
        _threads.in_rows(fill, 100)


def test_an_interruption_ends_after_the_running_chunks() -> None:
    """The caller is interrupted at its first chunk; a helper that runs meanwhile takes no other."""
    started, after, done = threading.Event(), [], []
    main = threading.current_thread()

    def fill(begin: int, end: int) -> None:
        if threading.current_thread() is main:
            started.wait(10.0)
            raise KeyboardInterrupt
        after.append(begin)
        started.set()
        threading.Event().wait(0.2)
        done.append(begin)

    with _threads.using(2), pytest.raises(KeyboardInterrupt):
        _threads.in_rows(fill, 1000)
    assert len(after) < 60
    assert done == after  # nobody writes into the arrays any more


def test_calls_within_calls_end() -> None:
    out = np.zeros((40, 40), dtype=int)

    def outer(begin: int, end: int) -> None:
        for i in range(begin, end):
            _threads.in_rows(lambda b, e, i=i: out[i, b:e].__iadd__(1), 40)

    with _threads.using(4):
        _threads.in_rows(outer, 40)
    assert (out == 1).all()


def test_any_number_of_python_threads_may_shade_and_integrate_at_once() -> None:
    cube = glossy.CubeMap(PYRAMID.levels[0])
    few = glossy.SurfacePoints(POINTS.normal[:20], POINTS.tangent[:20], POINTS.view[:20])

    def truth(_: Any) -> bytes:
        result = glossy.reference(few, glossy.Lobe(0.3, 0.2), cube, estimator="qmc", samples=64)
        return result.radiance.tobytes()

    alone = [radiance(), truth(None)]
    with ThreadPoolExecutor(6) as pool:
        shaded, integrated = list(pool.map(radiance, range(24))), list(pool.map(truth, range(12)))
    assert set(shaded) == {alone[0]}
    assert set(integrated) == {alone[1]}


FORKED = """
import multiprocessing, sys, warnings
warnings.simplefilter("ignore")
sys.path.insert(0, {tests!r})
import test_threads
before = test_threads.radiance()
with multiprocessing.get_context("fork").Pool(2) as pool:
    print(pool.map_async(test_threads.radiance, range(4)).get(timeout=60) == [before] * 4)
print(test_threads.radiance() == before)
"""


@pytest.mark.skipif(
    "fork" not in multiprocessing.get_all_start_methods(), reason="this system does not fork"
)
def test_a_fork_after_use_computes_the_same_bits() -> None:
    code = FORKED.format(tests=os.path.dirname(__file__))
    env = {**os.environ, "PYTHONPATH": os.path.dirname(os.path.dirname(glossy.__file__))}
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=env, timeout=300
    )
    assert (run.returncode, run.stdout) == (0, "True\nTrue\n"), run.stderr


def test_numbas_own_setting_is_followed(monkeypatch: pytest.MonkeyPatch) -> None:
    before = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        assert _threads.threads() == 1
    finally:
        numba.set_num_threads(before)
    monkeypatch.setenv("NUMBA_NUM_THREADS", "1")
    assert _threads.available() == 1
    monkeypatch.setenv("NUMBA_NUM_THREADS", "0")
    processors = _threads.available()
    assert processors >= 1
    monkeypatch.setenv("NUMBA_NUM_THREADS", "100000")
    assert _threads.available() == processors


def test_the_setting_is_of_the_calling_thread() -> None:
    before = _threads.threads()
    with _threads.using(before + 1):
        assert _threads.threads() == before + 1
    assert _threads.threads() == before
    with _threads.using(1), ThreadPoolExecutor(1) as pool:
        assert _threads.threads() == 1
        assert pool.submit(lambda: getattr(_threads._asked, "count", None)).result() is None
