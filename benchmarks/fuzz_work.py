"""A process that makes, reads and judges many inputs, and one that watches it.

Input k of a job is a function of seed, job, k and the inputs that the job has kept before. The
worker says in shared memory what it is about to read, so that the watcher knows what a crash was
of; it starts another worker then, from the next input on.
"""

import contextlib
import ctypes
import dataclasses
import gc
import json
import mmap
import os
import pathlib
import random
import resource
import shutil
import signal
import time
import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
from fuzz_judge import Coverage, attempt, fault_key, reader_files
from fuzz_mutate import mutate_file, resealed
from fuzz_targets import Files, Target, targets

MEMORY = 256 << 20  # the package's limit, in a worker
SLACK = 3  # of that, by which a process may grow: an estimate leaves out what libraries take
CPU_SECONDS = 10  # for one input
WALL_SECONDS = 300  # for one input that waits
LIFE = 100_000  # inputs of one worker
AGAIN = 7  # status of a worker that another one shall follow
MOST_KEPT = 60  # inputs of a target beside its own


@dataclasses.dataclass(frozen=True)
class Job:
    """What one worker after another does: inputs ``number``, ``number`` + ``jobs``, ...

    ``traced``: the share of inputs whose coverage is taken; ``end``: when to stop, by the clock.
    """

    seed: int
    number: int
    jobs: int
    inputs: int
    traced: float = 0.25
    end: float = float("inf")


@dataclasses.dataclass(frozen=True)
class Fault:
    """An input that was not taken as it should be: its files that are not the target's own."""

    target: str
    wrong: str
    files: Files


class Board:
    """Numbers that outlive a worker: its input, its target, inputs by target, lines reached."""

    def __init__(self, count: int) -> None:
        self.memory = mmap.mmap(-1, 8 * (count + 4))
        self.numbers = np.frombuffer(self.memory, dtype=np.int64)
        self.counts = self.numbers[4:]


def chosen(made: list[Target], only: str) -> list[Target]:
    """The targets whose name or group starts with ``only``."""
    return [t for t in made if t.name.startswith(only) or t.group.startswith(only)]


def put(folder: pathlib.Path, files: Files, there: Files) -> None:
    """Make a folder hold these files; ``there`` is what it holds, and is kept up to date."""
    for name in there.keys() - files.keys():
        (folder / name).unlink(missing_ok=True)
    for name, data in files.items():
        if there.get(name) != data:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(data)
    there.clear()
    there.update(files)


def mutant(target: Target, pool: list[Files], draw: random.Random) -> Files:
    """One of the pool with changes in a file or two; now and then a file is lost or renamed."""
    files = dict(draw.choice(pool))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the same name twice in an archive
        return _changed(target, files, pool, draw)


def _changed(target: Target, files: Files, pool: list[Files], draw: random.Random) -> Files:
    for _ in range(draw.choice((1, 1, 1, 2)) if len(files) > 1 else 1):
        name = draw.choice(sorted(files))
        suffix = pathlib.Path(name).suffix
        if len(files) > 1 and draw.random() < 0.05:
            data = files.pop(name)
            if draw.random() < 0.5 and files:
                files[draw.choice(sorted(files))] = data
            continue
        others = [p[name] for p in pool if name in p]
        files[name] = mutate_file(suffix, files[name], draw, others)
        if target.sealed and draw.random() < 0.8:
            files[name] = resealed(suffix, files[name])
    return files


def _limits(noise: int) -> None:
    """Bound the process and send what is printed to a file."""
    os.dup2(noise, 1)
    os.dup2(noise, 2)
    gc.collect()
    with contextlib.suppress(AttributeError):  # what a parent freed must not hide what is taken
        ctypes.CDLL(None).malloc_trim(0)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    most = _memory_of("VmData") + (SLACK + 1) * MEMORY
    resource.setrlimit(resource.RLIMIT_DATA, (most, most))


def _memory_of(entry: str) -> int:
    """Bytes of an entry of this process's status: VmData, VmHWM (the peak) and others."""
    for line in pathlib.Path("/proc/self/status").read_text().splitlines():
        if line.startswith(entry):
            return int(line.split()[1]) << 10
    return 0


def _from_now_on() -> int:
    """Start the peak of memory anew, which a fork takes from its parent; what is in use now."""
    pathlib.Path("/proc/self/clear_refs").write_text("5")
    return _memory_of("VmHWM")


class Worker:
    """Judges inputs in this process."""

    def __init__(self, folder: pathlib.Path, made: list[Target], trace: bool = True) -> None:
        self.folder, self.targets = folder, made
        self.noise = os.open(folder / "noise", os.O_RDWR | os.O_CREAT | os.O_TRUNC)
        self.there: dict[str, Files] = {t.name: {} for t in made}
        self.coverage = Coverage(reader_files()) if trace else None
        self.bounded = False

    def judge(self, target: Target, files: Files, traced: bool = False) -> tuple[str, int]:
        """What is wrong, and how many lines were new."""
        place = self.folder / target.name
        put(place, files, self.there[target.name])
        before = _from_now_on()
        if self.bounded:
            signal.setitimer(signal.ITIMER_PROF, CPU_SECONDS)
            signal.alarm(WALL_SECONDS)
        if traced and self.coverage:
            self.coverage.start()
        try:
            wrong = attempt(target.read, place)
        finally:
            new = self.coverage.stop() if traced and self.coverage else 0
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.alarm(0)
        if target.rewrites:
            shutil.rmtree(place)
            self.there[target.name].clear()
        if os.fstat(self.noise).st_size:
            text = os.pread(self.noise, 80, 0).decode("latin-1")
            wrong = wrong or f"wrote past Python: {text}"
            os.ftruncate(self.noise, 0)
            os.lseek(self.noise, 0, os.SEEK_SET)
        grown = _memory_of("VmHWM") - before
        if self.bounded and grown > SLACK * MEMORY:
            wrong = wrong or f"memory: took {grown >> 20} MiB, the limit being {MEMORY >> 20}"
        return wrong, new

    def warm(self) -> None:
        """Read every target as it is, so that kernels are there; then bound the process."""
        from glossy import _memory

        os.environ["TMPDIR"] = str(self.folder)
        for target in self.targets:
            wrong, _ = self.judge(target, target.files, traced=True)
            if wrong:
                raise SystemExit(f"{target.name} is a valid input, but: {wrong}")
        _memory.set_limit(MEMORY)
        _limits(self.noise)
        self.bounded = True

    def minimised(self, target: Target, files: Files, wrong: str) -> Files:
        """The same fault from less: parts of the changed files are cut while it stays."""
        key, tries = fault_key(wrong), 0
        if key.startswith("memory"):  # a peak is seen once
            return files
        for name in [n for n, data in files.items() if n in target.files]:
            less = {**files, name: target.files[name]}
            if fault_key(self.judge(target, less)[0]) == key:
                files = less
        for name in [n for n, data in files.items() if target.files.get(n) != data]:
            size = max(len(files[name]) // 2, 1)
            while size and tries < 200:
                at = 0
                while at < len(files[name]) and tries < 200:
                    data = files[name]
                    less = {**files, name: data[:at] + data[at + size :]}
                    tries += 1
                    if fault_key(self.judge(target, less)[0]) == key:
                        files = less
                    else:
                        at += size
                size //= 2
        return files


def _loop(job: Job, worker: Worker, first: int, board: Board, log: int, keep: pathlib.Path) -> None:
    worker.warm()
    pools = {t.name: [t.files] for t in worker.targets}
    for path in sorted(keep.glob("*.json"), key=lambda p: int(p.stem)):
        name, files = json.loads(path.read_text())
        pools[name].append({n: bytes.fromhex(data) for n, data in files.items()})
        worker.judge(next(t for t in worker.targets if t.name == name), pools[name][-1], True)
    shares = [t.share for t in worker.targets]
    known: set[tuple[str, str]] = set()
    for k in range(first, job.inputs, job.jobs):
        if time.monotonic() > job.end:
            break
        draw = random.Random(f"{job.seed} {k}")
        which = draw.choices(range(len(shares)), shares)[0]
        target = worker.targets[which]
        files = mutant(target, pools[target.name], draw)
        board.numbers[:2] = k, which
        wrong, new = worker.judge(target, files, draw.random() < job.traced)
        board.counts[which] += 1
        if wrong:
            key = target.name, fault_key(wrong)
            if key not in known:
                known.add(key)
                files = worker.minimised(target, files, wrong)
            else:
                files = {}
            _say(log, target, wrong, files)
            if wrong.startswith("memory"):
                os._exit(AGAIN)
        elif new and len(pools[target.name]) <= MOST_KEPT:
            pools[target.name].append(files)
            text = json.dumps([target.name, {n: data.hex() for n, data in files.items()}])
            (keep / f"{k}.json").write_text(text)
        if worker.coverage and new:
            board.numbers[2] = worker.coverage.reached()
        if (k - first) // job.jobs >= LIFE:
            os._exit(AGAIN)


def _say(log: int, target: Target, wrong: str, files: Files) -> None:
    own = {n: data.hex() for n, data in files.items() if target.files.get(n) != data}
    row = json.dumps([target.name, " ".join(wrong.split()), own])
    os.write(log, row.encode() + b"\n")


def run_job(job: Job, folder: pathlib.Path, made: list[Target], board: Board) -> Iterator[Fault]:
    """Do a job in workers one after another; what they find wrong as it comes."""
    folder.mkdir(parents=True, exist_ok=True)
    keep = folder / "kept"
    keep.mkdir()
    first = job.number
    while first < job.inputs and time.monotonic() < job.end:
        source, sink = os.pipe()
        board.numbers[:2] = first - job.jobs, 0
        child = os.fork()
        if child == 0:
            status = 1
            try:
                os.close(source)
                os.setpgid(0, 0)
                place = folder / "work"
                shutil.rmtree(place, ignore_errors=True)
                place.mkdir()
                _loop(job, Worker(place, made, job.traced > 0.0), first, board, sink, keep)
                status = 0
            except BaseException as error:
                row = ["", f"{type(error).__name__}: {error}", {}]
                os.write(sink, json.dumps(row).encode() + b"\n")
            finally:
                os._exit(status)
        os.close(sink)
        with os.fdopen(source, "rb") as lines:
            for line in lines:
                name, wrong, files = json.loads(line)
                yield Fault(name, wrong, {n: bytes.fromhex(data) for n, data in files.items()})
        status = os.waitpid(child, 0)[1]
        last, which = int(board.numbers[0]), int(board.numbers[1])
        if os.WIFSIGNALED(status):
            target = made[which]
            place = folder / "work" / target.name
            files = {n: (place / n).read_bytes() for n in _names(place)}
            own = {n: data for n, data in files.items() if target.files.get(n) != data}
            board.counts[which] += 1
            yield Fault(target.name, f"killed by {signal.Signals(os.WTERMSIG(status)).name}", own)
        elif os.WEXITSTATUS(status) not in (0, AGAIN):
            raise SystemExit("a worker ended before its time")
        elif os.WEXITSTATUS(status) == 0:
            return
        first = last + job.jobs


def _names(place: pathlib.Path) -> list[str]:
    return [str(p.relative_to(place)) for p in place.rglob("*") if p.is_file()]


def make_targets(folder: pathlib.Path, only: str = "") -> list[Target]:
    """The chosen targets, their files made in a folder."""
    return chosen(targets(folder), only)


def summary(board: Board, made: list[Target]) -> dict[str, Any]:
    """Inputs by group."""
    found: dict[str, int] = {}
    for target, count in zip(made, board.counts, strict=True):
        found[target.group] = found.get(target.group, 0) + int(count)
    return found
