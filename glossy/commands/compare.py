"""``glossy compare``: one image against its reference, or two folders file by file."""

import argparse
import contextlib
import dataclasses
import json
import os
import sys
import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING

from . import compare_limits

if TYPE_CHECKING:
    from .compare_files import Result

OUTSIDE = 1
UNUSABLE = 2

_EPILOG = """\
PSNR takes the peak as 20 log10(peak / rms) and is printed with it. Pictures of integers (PNG, most
TIFF) need --encoding.

Channels R, G, B are compared, else Y if it is alone or with A, else all if both have the same
ones. What is left out is named; "identical" is said only if every channel of both files was
compared and windows, pixel aspect ratio, chromaticities, envmap and whiteLuminance agree.

Each --max-X (and --min-psnr) has a --warn-X (--warn-psnr) that prints a warning and leaves the
exit code. A pixel is an outlier if |a - b| is above X + R |b| in a channel (--max-difference X,
--max-relative-difference R). Percentile P of the pixels' largest differences is the least value
that P percent of the pixels do not exceed.

Folders are matched by relative path, with all they hold, links followed; suffixes may differ in
case. What is in one only, is no image, cannot be read or compared is listed and ends in exit code
2. Names that start with a dot, Thumbs.db, desktop.ini, __MACOSX and --ignore are left out. The
list starts with what could not be compared, then the largest relative RMS.

exit code: 0 within the limits, 1 outside, 2 unusable input (of a folder: any, after all others
were compared)

PNG pictures of one scene have one exposure by default, and say which: two of unlike exposures are
refused, one of them against radiance is warned of.

examples:
  glossy render --method lattice --filter round --samples 14 -o render.exr
  glossy reference -o truth.exr
  glossy compare render.exr truth.exr --max-relative-rms 0.2 --diff difference.png
  glossy render --method lattice --filter round --samples 14 -o render.png
  glossy reference -o truth.png
  glossy compare render.png truth.png --encoding srgb --min-psnr 25
  glossy compare a.exr b.exr --max-difference .01 --max-outliers 0.1% --warn-outliers 20px
  glossy compare a.exr b.exr --percentiles 50,95 --max-percentile 99=.02 --channels all
  glossy compare renders/ references/ --ignore "*.json" --json
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add ``compare`` to the command line."""
    parser = subparsers.add_parser(
        "compare",
        help="RMS, PSNR and more of an image against a reference",
        description="Compare an image, or a folder of images, with a reference.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "a", metavar="A", help="the image under test, or a folder; - for standard input"
    )
    parser.add_argument("reference", metavar="REFERENCE", help="its reference, or a folder, or -")
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")
    compare_limits.add_arguments(parser)
    parser.add_argument(
        "--peak", type=float, default=1.0, metavar="P", help="peak of the PSNR (default 1)"
    )
    parser.add_argument(
        "--mask",
        metavar="M",
        help="compare only pixels that are not black in this image (or, of a folder, in the "
        "image of the same name)",
    )
    parser.add_argument(
        "--encoding", choices=("linear", "srgb"), help="what integer samples mean (required there)"
    )
    parser.add_argument(
        "--channels",
        metavar="C,C,...",
        help="channels to compare, by name; all: every one, layers included",
    )
    parser.add_argument(
        "--percentiles", metavar="P,P,...", help="percentiles of the pixels' largest differences"
    )
    parser.add_argument(
        "--flip",
        action="store_true",
        help="also the mean FLIP error: LDR-FLIP if both files hold integers, else HDR-FLIP",
    )
    parser.add_argument(
        "--ignore",
        action="append",
        default=[],
        metavar="PATTERN",
        help="of folders: leave out these names or relative paths; may be repeated",
    )
    parser.add_argument(
        "--max-pixels", type=int, metavar="N", help="refuse larger images (default 2^28)"
    )
    picture = parser.add_argument_group("difference picture")
    picture.add_argument("--diff", metavar="D.png", help="write it (a folder if A is one)")
    picture.add_argument("--signed", action="store_true", help="a - b in place of |a - b|")
    picture.add_argument("--diff-limit", type=float, metavar="X", help="end of its scale")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Compare, print, and judge by the limits."""
    from . import compare_print

    _check_arguments(args)
    folders = os.path.isdir(args.a), os.path.isdir(args.reference)
    if folders[0] != folders[1]:
        missing = [p for p in (args.a, args.reference) if p != "-" and not os.path.exists(p)]
        if missing:
            raise FileNotFoundError(f"{missing[0]}: no such file or directory")
        only = args.a if folders[0] else args.reference
        raise ValueError(f"{only}: is a folder and the other is not")
    if args.ignore and not folders[0]:
        raise ValueError("--ignore: is an option of folders")
    results = _folders(args) if folders[0] else [_files(args)]
    if args.json:
        record = compare_print.as_dict(args, results, folders[0])
        print(json.dumps(record, indent=2, allow_nan=False))
    elif folders[0]:
        compare_print.print_table(args, results)
    else:
        compare_print.print_figures(results[0])
    for result in results:
        for text in result.warnings:
            warnings.warn(f"{result.paths[0]}: {text}", stacklevel=1)
        a = compare_print.shown(result.paths[0])
        lines = [f"{a}: {text}" for text in result.failures]
        lines += [compare_print.shown(result.error)] if result.error else []
        for line in lines:
            print(f"glossy compare: {line}", file=sys.stderr)
    if any(r.error for r in results):
        return UNUSABLE
    return OUTSIDE if any(r.failures for r in results) else 0


def _check_arguments(args: argparse.Namespace) -> None:
    from .. import _check

    _check.positive("--peak", args.peak)
    compare_limits.parse(args)
    if args.percentiles is not None:
        args.percentiles = compare_limits.percents("--percentiles", args.percentiles)
    if args.max_pixels is not None:
        _check.count("--max-pixels", args.max_pixels)
    if args.diff_limit is not None:
        _check.positive("--diff-limit", args.diff_limit)
    if args.diff is None and (args.signed or args.diff_limit is not None):
        raise ValueError("--signed, --diff-limit: are options of --diff")
    args.flip |= args.max_flip is not None or args.warn_flip is not None
    if args.flip and args.mask is not None:
        raise ValueError("--flip: is a figure of whole images, without --mask")


def _files(args: argparse.Namespace) -> "Result":
    """Two files, one of which may come through standard input."""
    from .compare_files import compare_files
    from .standard_input import spooled

    if args.diff is not None:
        places = [p for p in (args.a, args.reference, args.mask, args.diff) if p is not None]
        there = [p for p in places if os.path.exists(p)]
        if args.diff in there and any(os.path.samefile(args.diff, p) for p in there[:-1]):
            raise ValueError(f"--diff {args.diff}: is one of the inputs")
        if os.path.splitext(args.diff)[1].lower() != ".png":
            raise ValueError(f"--diff {args.diff}: must end in .png")
    given = args.a, args.reference
    if given == ("-", "-"):
        raise ValueError("A, REFERENCE: only one of them can be standard input")
    with contextlib.ExitStack() as stack:
        paths = tuple(stack.enter_context(spooled("-")) if p == "-" else p for p in given)
        try:
            found = compare_files(args, (paths[0], paths[1]), None, args.diff)
        except (ValueError, OSError) as error:
            text = str(error)
            for path, name in zip(paths, given, strict=True):
                text = text.replace(path, name) if name == "-" else text
            raise ValueError(text) from None
    return dataclasses.replace(found, paths=given)


def _folders(args: argparse.Namespace) -> "list[Result]":
    """Everything that the folders hold, what could not be compared first, then the worst."""
    from .compare_files import Result, compare_files
    from .compare_folders import pairs

    found = pairs(args.a, args.reference, args.ignore)
    picture = _picture_places(args, [p for pair in found for p in (pair.a, pair.reference)])
    results = []
    for i, pair in enumerate(found):
        _progress(i, len(found))
        paths, error = (pair.a, pair.reference), pair.trouble
        if not error:
            try:
                results.append(compare_files(args, paths, pair.name, picture(pair.name)))
                continue
            except (ValueError, OSError, OverflowError, MemoryError) as unusable:
                error = " ".join(str(unusable).split()) or type(unusable).__name__
        results.append(Result(pair.name, paths, error=error))
    _progress(len(found), len(found))

    def worst_first(r: Result) -> tuple[float, float, str]:
        c = r.comparison
        inf = float("inf")
        return (-inf, -inf, str(r.name)) if c is None else (-c.relative_rms, -c.rms, str(r.name))

    results.sort(key=lambda r: (not r.error, worst_first(r)))
    return results


def _picture_places(args: argparse.Namespace, inputs: list[str]) -> Callable[[str], str | None]:
    """Where the difference picture of a row goes; never one of the ``inputs``, never one twice."""
    if args.diff is None:
        return lambda name: None
    folder = os.path.realpath(args.diff)
    for given in (args.a, args.reference, args.mask):
        place = None if given is None else os.path.realpath(given)
        if place is not None and (folder == place or folder.startswith(os.path.join(place, ""))):
            raise ValueError(f"--diff {args.diff}: is one of the inputs, or inside of one")
    if os.path.exists(args.diff) and not os.path.isdir(args.diff):
        raise ValueError(f"--diff {args.diff}: must be a folder, as A is one")
    os.makedirs(args.diff, exist_ok=True)
    taken = {os.path.realpath(path) for path in inputs}

    def place_of(name: str) -> str:
        path = os.path.join(args.diff, name)
        path += "" if path.lower().endswith(".png") else ".png"
        os.makedirs(os.path.dirname(path), exist_ok=True)
        while os.path.realpath(path) in taken:
            path += ".png"
        taken.add(os.path.realpath(path))
        return path

    return place_of


def _progress(done: int, total: int) -> None:
    if total < 2 or not sys.stderr.isatty():
        return
    text = f"{done} of {total}" if done < total else ""
    print(f"\r\x1b[K{text}", end="", file=sys.stderr, flush=True)
