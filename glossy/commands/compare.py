"""``glossy compare``: how far images are from their references, with limits for a CI job."""

import argparse
import json
import math
import os
import pathlib
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from ..metrics import Comparison

EXAMPLE = """\
examples:
  glossy compare shader.exr truth.exr --max-relative-rms 0.02
  glossy compare shader.png truth.png --encoding srgb --min-psnr 40 --diff difference.png
  glossy compare renders/ references/ --json

exit code: 0 within the limits, 1 outside, 2 unusable input
"""

LIMITS = {"max_rms": 0.0, "max_relative_rms": 0.0, "min_psnr": -math.inf}  # and their least values
IMAGE_SUFFIXES = (".exr", ".hdr", ".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp", ".pfm")
OUTSIDE = 1


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command to the ``glossy`` parser."""
    parser = subparsers.add_parser(
        "compare",
        help="compare images with references (RMS, PSNR, FLIP), with limits",
        description="Compare an image with a reference, or the images of two folders under the "
        "same names, worst relative RMS first. Values are linear; the figures are over R, G and B "
        "(or Y) unless other channels are named.",
        epilog=EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("image", metavar="A", help="image, or folder of images")
    parser.add_argument("reference", metavar="REFERENCE", help="reference, or folder of them")
    limits = parser.add_argument_group("limits")
    limits.add_argument("--max-rms", type=float, metavar="X", help="largest RMS error allowed")
    limits.add_argument(
        "--max-relative-rms", type=float, metavar="X", help="of the RMS of the reference"
    )
    limits.add_argument("--min-psnr", type=float, metavar="Y", help="smallest PSNR allowed [dB]")
    what = parser.add_argument_group("what is compared")
    what.add_argument("--peak", type=float, default=1.0, metavar="P", help="of the PSNR (1)")
    what.add_argument("--mask", metavar="M", help="image; only its pixels above 0 are compared")
    what.add_argument("--encoding", choices=("linear", "srgb"), help="meaning of integer images")
    what.add_argument("--channels", metavar="C,C", help="channels by name (default R,G,B or Y)")
    what.add_argument("--flip", action="store_true", help="the mean FLIP error, too")
    what.add_argument(
        "--flip-kind",
        choices=("auto", "ldr", "hdr"),
        default="auto",
        help="for what displays; auto: ldr for a reference of integers, else hdr",
    )
    what.add_argument(
        "--max-pixels", type=int, metavar="N", help="largest image admitted (default 2^28)"
    )
    parser.add_argument(
        "--diff", metavar="D.png", help="false-colour picture of the difference; a folder for two"
    )
    parser.add_argument(
        "--signed", action="store_true", help="difference picture with its sign (blue: too dark)"
    )
    parser.add_argument("--json", action="store_true", help="print all figures as JSON")
    parser.set_defaults(run=run)


def _pairs(a: str, b: str) -> list[tuple[str, str, str]]:
    """(name, image, reference) of two files, or of the images of two folders."""
    for path in (a, b):
        if not os.path.exists(path):
            raise FileNotFoundError(f"{path}: no such file or folder")
    if os.path.isdir(a) != os.path.isdir(b):
        raise ValueError(f"{a}, {b}: must be two images or two folders")
    if not os.path.isdir(a):
        return [(os.path.basename(a), a, b)]
    names = [
        {p.name for p in pathlib.Path(folder).iterdir() if p.suffix.lower() in IMAGE_SUFFIXES}
        for folder in (a, b)
    ]
    for folder, missing in ((b, names[0] - names[1]), (a, names[1] - names[0])):
        if missing:
            raise ValueError(f"{folder}: has no {', '.join(sorted(missing))}")
    if not names[0]:
        raise ValueError(f"{a}: holds no images ({' '.join(IMAGE_SUFFIXES)})")
    return [(name, os.path.join(a, name), os.path.join(b, name)) for name in sorted(names[0])]


def _check_target(path: str, inputs: Sequence[str | None], folders: bool) -> None:
    """The place of the difference pictures, before anything is read: none of the inputs."""
    if os.path.realpath(path) in [os.path.realpath(p) for p in inputs if p is not None]:
        raise ValueError(f"{path}: is one of the inputs, so the difference must go elsewhere")
    if folders:
        if os.path.exists(path) and not os.path.isdir(path):
            raise ValueError(f"{path}: must be a folder, for the pictures of two folders")
    elif not path.lower().endswith(".png"):
        raise ValueError(f"{path}: a difference picture is a .png")


def _compare(name: str, a: str, b: str, args: argparse.Namespace) -> "Comparison":
    """One comparison, and its difference picture if one is asked for."""
    from concurrent.futures import ThreadPoolExecutor

    from .. import metrics
    from ..image import MAX_PIXELS, colour_channels, read_planes

    limit = MAX_PIXELS if args.max_pixels is None else args.max_pixels
    with ThreadPoolExecutor(2) as pool:  # the libraries let other threads run while they read
        jobs = [pool.submit(read_planes, path, args.encoding, limit) for path in (a, b)]
        first, second = (job.result() for job in jobs)
    wanted: Sequence[str] | None
    if args.channels is not None:
        wanted = list(dict.fromkeys(n.strip() for n in args.channels.split(",")))
    else:
        wanted = colour_channels(tuple(second.planes))
        if wanted is None:
            have = ", ".join(second.planes)
            raise ValueError(f"{b}: has no R, G, B and no Y, only {have}: name some (--channels)")
        other = colour_channels(tuple(first.planes))
        if other != wanted:
            raise ValueError(
                f"{a}: has channels {', '.join(first.planes)}, the reference "
                f"{', '.join(second.planes)}"
            )
    if first.shape != second.shape:
        sizes = [f"{w} x {h}" for h, w in (first.shape, second.shape)]
        raise ValueError(f"{a}: is {sizes[0]}, the reference {sizes[1]}")
    windows = [str(p.metadata.get("dataWindow", "")) for p in (first, second)]
    if all(windows) and windows[0] != windows[1]:
        raise ValueError(f"{a}: its data window is not the reference's, pixels do not correspond")
    planes = [dict(zip(wanted, p.select(wanted), strict=True)) for p in (first, second)]
    mask = None if args.mask is None else _mask(args.mask, args.encoding, limit, first.shape)
    flip: bool | str = args.flip and args.flip_kind
    if flip == "auto":
        integers = str(second.metadata.get("sample_type", "")).startswith("uint")
        flip = "ldr" if integers else "hdr"
    found = metrics.compare_planes(*planes, peak=args.peak, mask=mask, flip=flip, labels=(a, b))
    if args.diff is not None:
        _draw(name, planes, mask, args)
    return found


def _mask(
    path: str, encoding: str | None, limit: int, shape: tuple[int, int]
) -> "npt.NDArray[np.bool_]":
    """Where a colour channel of a mask image is above 0, or any channel if it has no colours."""
    import numpy as np

    from ..image import colour_channels, read_planes

    shown = read_planes(path, encoding or "linear", limit)
    if shown.shape != shape:
        sizes = [f"{w} x {h}" for h, w in (shown.shape, shape)]
        raise ValueError(f"{path}: is {sizes[0]}, the images {sizes[1]}")
    kept = np.zeros(shape, dtype=np.bool_)
    for plane in shown.select(colour_channels(tuple(shown.planes)) or tuple(shown.planes)):
        unknown = int(np.count_nonzero(np.isnan(plane)))
        if unknown:
            raise ValueError(f"{path}: a mask must not hold NaN, got {unknown} of them")
        kept |= plane > 0
    if not kept.any():
        raise ValueError(f"{path}: has no pixel above 0")
    return kept


def _draw(
    name: str,
    planes: list[dict[str, Any]],
    mask: "npt.NDArray[np.bool_] | None",
    args: argparse.Namespace,
) -> None:
    from ..difference import planes_picture
    from ..image_write import write_png

    target = args.diff
    if os.path.isdir(args.image):
        os.makedirs(target, exist_ok=True)
        target = os.path.join(target, f"{name}.png")
    first, second = (list(p.values()) for p in planes)
    write_png(target, planes_picture(first, second, mask=mask, signed=args.signed))


def _failures(found: "Comparison", args: argparse.Namespace) -> list[str]:
    """The limits that a comparison is outside of, in words."""
    out = []
    for limit, value, worse in (
        ("max_rms", found.rms, args.max_rms is not None and found.rms > args.max_rms),
        (
            "max_relative_rms",
            found.relative_rms,
            args.max_relative_rms is not None and found.relative_rms > args.max_relative_rms,
        ),
        ("min_psnr", found.psnr, args.min_psnr is not None and found.psnr < args.min_psnr),
    ):
        if worse:
            out.append(f"{limit} {getattr(args, limit):g}: is {value:.6g}")
    return out


def _describe(name: str, found: "Comparison", failures: list[str]) -> str:
    x, y = found.max_at
    rows = [
        ("pixels", f"{found.pixels} of {found.width} x {found.height}, {' '.join(found.channels)}"),
        ("RMS", f"{found.rms:.6g}"),
        ("relative RMS", f"{found.relative_rms:.6g}"),
        ("PSNR", f"{found.psnr:.4f} dB (peak {found.peak:g})"),
        ("mean absolute", f"{found.mae:.6g}"),
        ("bias", f"{found.bias:+.6g}"),
        ("largest", f"{found.max_abs:.6g} at x={x}, y={y}, channel {found.max_channel}"),
        ("relative MSE", f"{found.relative_mse:.6g} (epsilon {found.relative_epsilon:g})"),
        ("log RMS", f"{found.log_rms:.6g} (epsilon {found.log_epsilon:g})"),
    ]
    if found.flip is not None:
        rows.append((f"FLIP ({found.flip_kind})", f"{found.flip:.6f}"))
    lines = [f"{name}{': identical' if found.identical else ''}"]
    lines += [f"  {label:14} {text}" for label, text in rows]
    lines += [f"  outside {text}" for text in failures]
    return "\n".join(lines)


def run(args: argparse.Namespace) -> int:
    """Compare, print worst first, and judge by the limits."""
    from .. import _check

    _check.positive("peak", args.peak)
    for limit, low in LIMITS.items():
        if getattr(args, limit) is not None:
            _check.in_range(limit, getattr(args, limit), low=low)
    pairs = _pairs(args.image, args.reference)
    if args.diff is not None:
        inputs = (args.image, args.reference, args.mask)
        _check_target(args.diff, inputs, os.path.isdir(args.image))
    results = []
    for name, a, b in pairs:
        found = _compare(name, a, b, args)
        results.append((name, a, b, found, _failures(found, args)))
    results.sort(key=lambda r: (-r[3].relative_rms, -r[3].rms, r[0]))
    outside = any(r[4] for r in results)
    if args.json:
        comparisons = [
            {"name": n, "image": a, "reference": b, "outside": bad, **found.to_dict()}
            for n, a, b, found, bad in results
        ]
        limits = {limit: getattr(args, limit) for limit in LIMITS}
        folder = os.path.isdir(args.image)
        record: dict[str, Any] = {"schema": 1, "command": "compare", "limits": limits}
        record |= {"within": not outside}
        record |= {"comparisons": comparisons} if folder else comparisons[0]
        print(json.dumps(record, indent=2, allow_nan=False))
    else:
        print("\n".join(_describe(n, found, bad) for n, _, _, found, bad in results))
        if len(results) > 1:
            print(f"{len(results)} images, {sum(bool(r[4]) for r in results)} outside the limits")
    return OUTSIDE if outside else 0
