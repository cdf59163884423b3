"""``glossy compare``: one image against its reference, or two folders file by file."""

import argparse
import json
import math
import os
import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from ..image import Planes
    from ..metrics import Comparison

OUTSIDE = 1
SUFFIXES = (
    ".exr", ".hdr", ".rgbe", ".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp", ".tga", ".pfm",
)  # fmt: skip
LIMITS = ("max_rms", "max_relative_rms", "min_psnr")

_EPILOG = """\
PSNR takes the peak as 20 log10(peak / rms) and is printed with it. Pictures of integers (PNG, most
TIFF) need --encoding. Channels R, G, B are compared, else Y, else all if both have the same ones.
Folders are matched by file name; the list starts with the largest relative RMS.

exit code: 0 within the limits, 1 outside, 2 unusable input

examples:
  glossy compare render.exr truth.exr --max-relative-rms 0.02 --diff difference.png
  glossy compare render.png truth.png --encoding srgb --min-psnr 40
  glossy compare renders/ references/ --json
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
    parser.add_argument("a", metavar="A", help="the image under test, or a folder")
    parser.add_argument("reference", metavar="REFERENCE", help="its reference, or a folder")
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")
    limits = parser.add_argument_group("limits")
    limits.add_argument("--max-rms", type=float, metavar="X", help="largest RMS difference")
    limits.add_argument(
        "--max-relative-rms", type=float, metavar="X", help="largest RMS over the reference's RMS"
    )
    limits.add_argument("--min-psnr", type=float, metavar="Y", help="smallest PSNR [dB]")
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
    parser.add_argument("--channels", metavar="C,C,...", help="channels to compare, by name")
    parser.add_argument(
        "--flip",
        action="store_true",
        help="also the mean FLIP error: LDR-FLIP if both files hold integers, else HDR-FLIP",
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
    _check_arguments(args)
    folders = os.path.isdir(args.a), os.path.isdir(args.reference)
    if folders[0] != folders[1]:
        only = args.a if folders[0] else args.reference
        raise ValueError(f"{only}: is a folder and the other is not")
    names = _partners(args.a, args.reference) if folders[0] else [None]
    if args.diff is not None:
        _check_picture_place(args, folders[0])
    results = []
    for i, name in enumerate(names):
        _progress(i, names)
        paths = [p if name is None else os.path.join(p, name) for p in (args.a, args.reference)]
        comparison = _compare_files(args, paths[0], paths[1], name)
        results.append((name, paths, comparison, _failures(args, comparison)))
    _progress(len(names), names)
    results.sort(key=lambda r: (-r[2].relative_rms, -r[2].rms, r[0] or ""))
    if args.json:
        limits = {name: getattr(args, name) for name in LIMITS}
        print(json.dumps(_as_dict(results, folders[0], limits), indent=2, allow_nan=False))
    else:
        _print_table(results) if folders[0] else _print_figures(results[0][1], results[0][2])
    for _, paths, _, failures in results:
        for failure in failures:
            print(f"glossy compare: {paths[0]}: {failure}", file=sys.stderr)
    return OUTSIDE if any(r[3] for r in results) else 0


def _check_arguments(args: argparse.Namespace) -> None:
    from .. import _check

    _check.positive("--peak", args.peak)
    for name in ("max_rms", "max_relative_rms"):
        if getattr(args, name) is not None:
            _check.in_range(f"--{name.replace('_', '-')}", getattr(args, name), 0.0)
    if args.min_psnr is not None:
        _check.number("--min-psnr", args.min_psnr)
    if args.max_pixels is not None:
        _check.count("--max-pixels", args.max_pixels)
    if args.diff_limit is not None:
        _check.positive("--diff-limit", args.diff_limit)
    if args.diff is None and (args.signed or args.diff_limit is not None):
        raise ValueError("--signed, --diff-limit: are options of --diff")
    if args.flip and args.mask is not None:
        raise ValueError("--flip: is a figure of whole images, without --mask")


def _partners(a: str, reference: str) -> list[str]:
    # the image names of two folders, which must be the same
    found = []
    for folder in (a, reference):
        with os.scandir(folder) as entries:
            found.append(
                {
                    e.name
                    for e in entries
                    if os.path.splitext(e.name)[1].lower() in SUFFIXES
                    and not e.name.startswith(".")
                    and e.is_file()
                }
            )
    for folder, here, there in ((reference, found[1], found[0]), (a, found[0], found[1])):
        missing = sorted(there - here)
        if missing:
            more = f" and {len(missing) - 1} more" if len(missing) > 1 else ""
            raise ValueError(f"{folder}: has no {missing[0]}{more} to compare with")
    if not found[0]:
        raise ValueError(f"{a}: holds no images")
    return sorted(found[0])


def _check_picture_place(args: argparse.Namespace, folder: bool) -> None:
    # the picture must not overwrite what is compared
    places = [os.path.realpath(p) for p in (args.a, args.reference, args.mask) if p is not None]
    if os.path.realpath(args.diff) in places:
        raise ValueError(f"--diff {args.diff}: is one of the inputs")
    if folder:
        if os.path.exists(args.diff) and not os.path.isdir(args.diff):
            raise ValueError(f"--diff {args.diff}: must be a folder, as A is one")
        os.makedirs(args.diff, exist_ok=True)
    elif os.path.splitext(args.diff)[1].lower() != ".png":
        raise ValueError(f"--diff {args.diff}: must end in .png")


def _compare_files(
    args: argparse.Namespace, a: str, reference: str, name: str | None
) -> "Comparison":
    import numpy as np

    from ..metrics import compare_planes

    first, second = _read_both(args, a, reference)
    if first.shape != second.shape:
        sizes = " and ".join(f"{p.shape[1]} x {p.shape[0]}" for p in (first, second))
        raise ValueError(f"{a}, {reference}: differ in size, {sizes}")
    windows = [np.asarray(p.metadata.get("dataWindow", ())) for p in (first, second)]
    if all(w.size for w in windows) and not np.array_equal(windows[0], windows[1]):
        raise ValueError(f"{a}, {reference}: differ in data window, so pixels do not correspond")
    channels = _channels(args.channels, first, second)
    kind: str | bool = False
    if args.flip:
        integers = all(p.metadata["sample_type"].startswith("uint") for p in (first, second))
        kind = "ldr" if integers else "hdr"
    planes = [dict(zip(channels, p.select(channels), strict=True)) for p in (first, second)]
    mask = _read_mask(args, name, first.shape)
    comparison = compare_planes(
        *planes, peak=args.peak, mask=mask, flip=kind, labels=(a, reference)
    )
    if args.diff is not None:
        from ..difference import planes_picture
        from ..image_write import write_png

        picture = planes_picture(
            *(list(p.values()) for p in planes),
            mask=mask,
            signed=args.signed,
            limit=args.diff_limit,
        )
        place = args.diff if name is None else os.path.join(args.diff, _picture_name(name))
        write_png(place, picture)
    return comparison


def _picture_name(name: str) -> str:
    return name if name.lower().endswith(".png") else f"{name}.png"


def _read_both(args: argparse.Namespace, a: str, reference: str) -> "tuple[Planes, Planes]":
    # OpenEXR and OpenImageIO let other threads run while they read
    from concurrent.futures import ThreadPoolExecutor

    from ..image import MAX_PIXELS, read_planes

    limit = MAX_PIXELS if args.max_pixels is None else args.max_pixels
    with ThreadPoolExecutor(2) as pool:
        jobs = [pool.submit(read_planes, p, args.encoding, limit) for p in (a, reference)]
        return jobs[0].result(), jobs[1].result()


def _read_mask(
    args: argparse.Namespace, name: str | None, shape: tuple[int, int]
) -> "npt.NDArray[np.bool_] | None":
    # where a colour is not 0, or any channel of a file without colours
    if args.mask is None:
        return None
    import numpy as np

    from ..image import MAX_PIXELS, colour_channels, read_planes

    path = args.mask
    if name is not None and os.path.isdir(path):
        path = os.path.join(path, name)
    limit = MAX_PIXELS if args.max_pixels is None else args.max_pixels
    source = read_planes(path, "linear", limit)
    if source.shape != shape:
        sizes = " and ".join(f"{s[1]} x {s[0]}" for s in (source.shape, shape))
        raise ValueError(f"{path}: differs in size from the images, {sizes}")
    names = tuple(source.planes)
    kept = np.zeros(shape, dtype=np.bool_)
    for plane in source.select(colour_channels(names) or names):
        if np.isnan(plane).any():
            raise ValueError(f"{path}: holds NaN, so it is not a mask")
        kept |= plane != 0
    if not kept.any():
        raise ValueError(f"{path}: is black, so no pixel is compared")
    return kept


def _channels(wanted: str | None, a: "Planes", reference: "Planes") -> list[str]:
    from ..image import colour_channels

    if wanted is not None:
        names = [n.strip() for n in wanted.split(",")]
        if "" in names or len(set(names)) != len(names):
            raise ValueError(f"--channels: must be different names with commas, got {wanted!r}")
        a.select(names), reference.select(names)
        return names
    colours = [colour_channels(tuple(p.planes)) for p in (a, reference)]
    lists = " and ".join(", ".join(p.planes) for p in (a, reference))
    if colours[0] != colours[1]:
        raise ValueError(f"{a.name}, {reference.name}: differ in channels, {lists}")
    if colours[0] is not None:
        return list(colours[0])
    if set(a.planes) != set(reference.planes):
        raise ValueError(
            f"{a.name}, {reference.name}: differ in channels, {lists}; choose with --channels"
        )
    return list(a.planes)


def _failures(args: argparse.Namespace, c: "Comparison") -> list[str]:
    out = []
    if args.max_rms is not None and c.rms > args.max_rms:
        out.append(f"rms {c.rms:.6g} is above --max-rms {args.max_rms:g}")
    if args.max_relative_rms is not None and c.relative_rms > args.max_relative_rms:
        limit = args.max_relative_rms
        out.append(f"relative rms {c.relative_rms:.6g} is above --max-relative-rms {limit:g}")
    if args.min_psnr is not None and c.psnr < args.min_psnr:
        limit = args.min_psnr
        out.append(f"psnr {c.psnr:.4f} dB (peak {c.peak:g}) is below --min-psnr {limit:g}")
    return out


def _as_dict(results: list[Any], folder: bool, limits: dict[str, Any]) -> dict[str, Any]:
    rows = [
        {
            **comparison.to_dict(),
            "a": paths[0],
            "reference": paths[1],
            "within_limits": not failures,
            "failures": failures,
        }
        for _, paths, comparison, failures in results
    ]
    if not folder:
        return {"schema": 1, "command": "compare", **rows[0], "limits": limits}
    for row, result in zip(rows, results, strict=True):
        row["name"] = result[0]
        del row["schema"]
    within = all(row["within_limits"] for row in rows)
    record = {"schema": 1, "command": "compare", "files": rows}
    return {**record, "within_limits": within, "limits": limits}


def _print_figures(paths: list[str], c: "Comparison") -> None:
    print(f"{paths[0]} against {paths[1]}")
    print(f"  {c.width} x {c.height}, {c.pixels} pixels, channels {', '.join(c.channels)}")
    by_channel = "  ".join(f"{n} {v:.6g}" for n, v in zip(c.channels, c.channel_rms, strict=True))
    psnr = "infinite" if math.isinf(c.psnr) else f"{c.psnr:.4f} dB"
    lines = [
        ("rms", f"{c.rms:.6g}   ({by_channel})"),
        ("relative rms", f"{c.relative_rms:.6g}"),
        ("psnr", f"{psnr} (peak {c.peak:g})"),
        ("mae", f"{c.mae:.6g}"),
        ("bias", f"{c.bias:+.6g}"),
        ("largest", f"{c.max_abs:.6g} at x={c.max_at[0]}, y={c.max_at[1]} in {c.max_channel}"),
        ("relative mse", f"{c.relative_mse:.6g}   (d^2 / (b^2 + {c.relative_epsilon:g}))"),
        ("log rms", f"{c.log_rms:.6g}   (ln(max(v, 0) + {c.log_epsilon:g}))"),
    ]
    if c.flip is not None:
        lines.append(("flip", f"{c.flip:.6g}   ({str(c.flip_kind).upper()}-FLIP)"))
    if c.identical:
        lines.append(("identical", "yes"))
    for label, value in lines:
        print(f"  {label:<13} {value}")


def _print_table(results: list[Any]) -> None:
    peak = results[0][2].peak
    flip = results[0][2].flip is not None
    head = f"{'rms':>12} {'relative rms':>13} {f'psnr (peak {peak:g})':>16} {'largest':>12}"
    print(head + (f" {'flip':>10}" if flip else "") + "  file")
    for name, _, c, failures in results:
        psnr = "infinite" if math.isinf(c.psnr) else f"{c.psnr:.4f} dB"
        row = f"{c.rms:12.6g} {c.relative_rms:13.6g} {psnr:>16} {c.max_abs:12.6g}"
        end = "  outside the limits" if failures else ""
        print(row + (f" {c.flip:10.6g}" if flip else "") + f"  {name}{end}")


def _progress(done: int, names: list[Any]) -> None:
    if len(names) < 2 or not sys.stderr.isatty():
        return
    text = f"{done} of {len(names)}" if done < len(names) else ""
    print(f"\r\x1b[K{text}", end="", file=sys.stderr, flush=True)
