"""Feed damaged files to every reader and report what is not a plain refusal.

    python benchmarks/fuzz_readers.py --inputs 20000 --seed 1 --jobs 2 --keep found

A reader may return, or raise ``ValueError`` or ``OSError`` with one line: the command line turns
those into one line and exit code 2. Anything else is a finding: another exception, several lines,
a warning that is not the package's own, a crash, 10 seconds of CPU for one input, three times the
memory that the package is told to stay within (``GLOSSY_MAX_MEMORY``), or text written past Python
to the terminal.

Inputs are mutated by what they consist of (``fuzz_formats``, ``fuzz_trees``): chunks, attributes,
lines, values; lengths and checksums are made to fit. An input that reaches new lines of the readers
joins those that are mutated. All is a function of the seed and the number of jobs. A finding is cut
down while it stays one and kept with ``--keep``; ``--replay`` reads kept files again. Needs
``fork`` and ``/proc`` (Linux).
"""

import argparse
import json
import multiprocessing
import pathlib
import sys
import tempfile
import time

from fuzz_judge import all_lines, fault_key, reader_files
from fuzz_targets import Files, Target
from fuzz_work import Board, Fault, Job, Worker, make_targets, run_job, summary


def keep_fault(folder: pathlib.Path, fault: Fault, number: int) -> None:
    """Write the files of a fault: TARGET/NUMBER/FILE, beside which the target's own stand."""
    for name, data in fault.files.items():
        path = folder / fault.target / str(number) / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)


def kept_inputs(folder: pathlib.Path, made: list[Target]) -> list[tuple[Target, str, Files]]:
    """What ``keep_fault`` wrote, with the rest of each target's files."""
    found = []
    for target in made:
        for place in sorted((folder / target.name).glob("*")):
            paths = [p for p in place.rglob("*") if p.is_file()]
            own = {str(p.relative_to(place)): p.read_bytes() for p in paths}
            found.append((target, f"{target.name}/{place.name}", {**target.files, **own}))
    return found


def replay(folder: pathlib.Path, made: list[Target], place: pathlib.Path) -> list[str]:
    """Read kept inputs again in this process: what is wrong with which."""
    worker = Worker(place, made, trace=False)
    found = []
    for target, name, files in kept_inputs(folder, made):
        wrong, _ = worker.judge(target, files)
        if wrong:
            found.append(f"{name}: {wrong}")
    return found


def run_all(
    args: argparse.Namespace, made: list[Target], folder: pathlib.Path, number: int
) -> tuple[list[int], int, dict[tuple[str, str], int]]:
    """One job: inputs by target, lines reached, and how often which fault."""
    board = Board(len(made))
    job = Job(args.seed, number, args.jobs, args.inputs, args.traced, args.end)
    faults: dict[tuple[str, str], int] = {}
    for fault in run_job(job, folder / f"job{number}", made, board):
        key = fault.target, fault_key(fault.wrong)
        faults[key] = faults.get(key, 0) + 1
        if faults[key] == 1:
            print(f"{fault.target}: {fault.wrong}", flush=True)
            if args.keep:
                keep_fault(args.keep, fault, 100 * number + len(faults))
    return board.counts.tolist(), int(board.numbers[2]), faults


def _entry(args, made, folder, number, sink):  # type: ignore[no-untyped-def]
    sink.send(run_all(args, made, folder, number))


def main(argv: list[str] | None = None) -> int:
    """Fuzz; exit 1 when anything was found."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--inputs", type=int, default=20_000, help="how many, all jobs together")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="stop after these")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1, help="processes at a time")
    parser.add_argument("--only", default="", help="targets whose name or group starts so")
    parser.add_argument("--traced", type=float, default=0.1, help="share with coverage")
    parser.add_argument("--keep", type=pathlib.Path, help="folder for the files found")
    parser.add_argument("--replay", type=pathlib.Path, help="read the files kept there instead")
    parser.add_argument("--json", type=pathlib.Path, help="file for the figures")
    args = parser.parse_args(argv)
    start = time.monotonic()
    args.end = start + args.seconds
    memory = pathlib.Path("/dev/shm")
    with tempfile.TemporaryDirectory(dir=memory if memory.is_dir() else None) as name:
        folder = pathlib.Path(name)
        (folder / "made").mkdir()
        made = make_targets(folder / "made", args.only)
        if args.replay:
            (folder / "replay").mkdir()
            found = replay(args.replay, made, folder / "replay")
            print("\n".join(found) or "no fault")
            return 1 if found else 0
        context = multiprocessing.get_context("fork")
        pipes = []
        for number in range(args.jobs):
            source, sink = context.Pipe(duplex=False)
            child = context.Process(target=_entry, args=(args, made, folder, number, sink))
            child.start()
            sink.close()
            pipes.append(source)
        results = [source.recv() for source in pipes]
    board = Board(len(made))
    faults: dict[str, int] = {}
    for counts, _, own in results:
        board.counts[:] += counts
        for (target, key), times in own.items():
            faults[f"{target}: {key}"] = faults.get(f"{target}: {key}", 0) + times
    groups = summary(board, made)
    total = sum(len(all_lines(file)) for file in reader_files())
    lines = max(reached for _, reached, _ in results)
    for group, count in groups.items():
        print(f"{group:16}{count:10}")
    seconds = time.monotonic() - start
    print(f"{sum(groups.values())} inputs in {seconds:.0f} s, {lines} of {total} lines of readers, "
          f"{len(faults)} kinds of fault")  # fmt: skip
    for key, times in sorted(faults.items()):
        print(f"  {times} x {key}")
    if args.json:
        figures = {"schema": 1, "seed": args.seed, "jobs": args.jobs, "inputs": groups,
                   "lines": [lines, total], "faults": faults}  # fmt: skip
        args.json.write_text(json.dumps(figures, indent=1) + "\n")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
