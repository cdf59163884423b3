"""One file against another: what ``glossy compare`` reads, and whether it may be compared."""

import argparse
import dataclasses
import os
from typing import TYPE_CHECKING, Any

from ..exposure import recorded
from . import compare_limits

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from ..image import Planes
    from ..metrics import Comparison

REC709 = (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329)  # what an OpenEXR file means by default


@dataclasses.dataclass(frozen=True)
class Result:
    """One row: two files and their figures, or the ``error`` that stands for them.

    ``left_out``: channels of each file that were not compared; ``unlike``: what else the files
    differ in; ``failures`` and ``warnings``: limits exceeded.
    """

    name: str | None
    paths: tuple[str, str]
    comparison: "Comparison | None" = None
    error: str = ""
    left_out: tuple[tuple[str, ...], ...] = ((), ())
    unlike: tuple[str, ...] = ()
    failures: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    @property
    def identical(self) -> bool:
        """No value differs, none was left out, and the files mean the same by them."""
        same = self.comparison is not None and self.comparison.identical
        return same and not any(self.left_out) and not self.unlike


def compare_files(
    args: argparse.Namespace, paths: tuple[str, str], name: str | None, picture: str | None
) -> Result:
    """Compare two files, judge by the limits, and write the difference picture if asked for.

    Raises
    ------
    ValueError, OSError
        For files that cannot be read or compared.
    """
    from .._outliers import count_outliers
    from ..metrics import compare_planes

    first, second = _read_both(args, paths)
    if first.shape != second.shape:
        sizes = " and ".join(f"{p.shape[1]} x {p.shape[0]}" for p in (first, second))
        raise ValueError(f"{paths[0]}, {paths[1]}: differ in size, {sizes}")
    unlike = _unlike(first, second)
    channels = _channels(args.channels, first, second)
    kind: str | bool = False
    if args.flip:
        integers = all(p.metadata["sample_type"].startswith("uint") for p in (first, second))
        kind = "ldr" if integers else "hdr"
    planes = [dict(zip(channels, p.select(channels), strict=True)) for p in (first, second)]
    mask = _read_mask(args, name, first)
    tolerance = compare_limits.tolerance(args, "max") or compare_limits.tolerance(args, "warn")
    comparison = compare_planes(
        *planes,
        peak=args.peak,
        mask=mask,
        flip=kind,
        max_difference=None if tolerance is None else tolerance[0],
        max_relative_difference=None if tolerance is None else tolerance[1],
        percentiles=compare_limits.wanted_percentiles(args) or None,
        labels=paths,
    )
    values, truth = (list(p.values()) for p in planes)

    def outliers(absolute: float, relative: float) -> int:
        return count_outliers(values, truth, mask, absolute, relative)

    failures, warnings = (
        compare_limits.exceeded(args, level, comparison, outliers)
        for level in compare_limits.LEVELS
    )
    if picture is not None:
        from ..difference import planes_picture
        from ..image_write import write_png

        shown = planes_picture(values, truth, mask=mask, signed=args.signed, limit=args.diff_limit)
        write_png(picture, shown)
    return Result(
        name,
        paths,
        comparison,
        left_out=tuple(tuple(c for c in p.planes if c not in channels) for p in (first, second)),
        unlike=unlike,
        failures=tuple(failures.values()),
        warnings=(*(f"differ in {text}" for text in unlike), *warnings.values()),
    )


def _read_both(args: argparse.Namespace, paths: tuple[str, str]) -> "tuple[Planes, Planes]":
    # OpenEXR and OpenImageIO let other threads run while they read
    from concurrent.futures import ThreadPoolExecutor

    from ..image import MAX_PIXELS, read_planes

    limit = MAX_PIXELS if args.max_pixels is None else args.max_pixels
    with ThreadPoolExecutor(2) as pool:
        jobs = [pool.submit(read_planes, p, args.encoding, limit) for p in paths]
        return jobs[0].result(), jobs[1].result()


def _unlike(a: "Planes", b: "Planes") -> tuple[str, ...]:
    """What two files of one size differ in beside their values.

    A file without windows shows all its pixels, from (0, 0) on.
    """
    from ..image import unapplied

    found = []
    windows = [_windows(p) for p in (a, b)]
    _check_data_windows(a, b)
    if windows[0][0] != windows[1][0]:  # one of them by default
        found.append(f"data window, {_corners(windows[0][0])} and {_corners(windows[1][0])}")
    if windows[0][1] != windows[1][1]:
        found.append(f"display window, {_corners(windows[0][1])} and {_corners(windows[1][1])}")
    for key, default in (("chromaticities", REC709), ("pixelAspectRatio", (1.0,))):
        values = [_numbers(p.metadata.get(key, default)) for p in (a, b)]
        if len(values[0]) != len(values[1]) or any(
            abs(x - y) > 1e-5 for x, y in zip(*values, strict=True)
        ):
            texts = [" ".join(f"{x:.6g}" for x in v) for v in values]
            found.append(f"{key}, {texts[0]} and {texts[1]}")
    for key in ("envmap", "whiteLuminance"):
        texts = [str(p.metadata.get(key, "none")) for p in (a, b)]
        if texts[0] != texts[1]:
            found.append(f"{key}, {texts[0]} and {texts[1]}")
    said = [[t for t in unapplied(p.metadata) if not t.startswith("chroma")] for p in (a, b)]
    if said[0] != said[1]:  # of Radiance files
        found.append("header, " + " and ".join(", ".join(t) or "nothing said" for t in said))
    return (*found, *_unlike_exposure(a, b))


def _unlike_exposure(a: "Planes", b: "Planes") -> list[str]:
    # pictures that glossy writes for display say by how many stops; radiance is at 0
    stops = [recorded(p.metadata) for p in (a, b)]
    if stops[0] == stops[1]:
        return []
    if None not in stops:
        text = f"differ in exposure, {stops[0]:g} and {stops[1]:g} stops; write both with one"
        raise ValueError(f"{a.name}, {b.name}: {text} --exposure")
    said = stops[0] if stops[1] is None else stops[1]
    other = a if stops[0] is None else b
    if not said or other.metadata["sample_type"].startswith("uint"):
        return []
    return [f"exposure, {said:g} stops and radiance"]


def _windows(planes: "Planes") -> list[list[int]]:
    height, width = planes.shape
    whole = [0, 0, width - 1, height - 1]
    return [
        [int(n) for n in _numbers(planes.metadata.get(key, whole))]
        for key in ("dataWindow", "displayWindow")
    ]


def _check_data_windows(a: "Planes", b: "Planes") -> None:
    stored = [_windows(p)[0] for p in (a, b) if "dataWindow" in p.metadata]
    if len(stored) == 2 and stored[0] != stored[1]:
        corners = " and ".join(_corners(w) for w in stored)
        raise ValueError(
            f"{a.name}, {b.name}: differ in data window, {corners}, so pixels do not correspond"
        )


def _numbers(value: Any) -> list[float]:
    import numpy as np

    try:
        return [float(x) for x in np.concatenate([np.ravel(v) for v in np.atleast_1d(value)])]
    except (TypeError, ValueError):  # not what it should be: unlike any that is
        return []


def _corners(window: list[int]) -> str:
    return f"({window[0]}, {window[1]}) to ({window[2]}, {window[3]})"


def _read_mask(
    args: argparse.Namespace, name: str | None, image: "Planes"
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
    if source.shape != image.shape:
        sizes = " and ".join(f"{s[1]} x {s[0]}" for s in (source.shape, image.shape))
        raise ValueError(f"{path}: differs in size from the images, {sizes}")
    _check_data_windows(source, image)
    names = tuple(source.planes)
    kept = np.zeros(image.shape, dtype=np.bool_)
    for plane in source.select(colour_channels(names) or names):
        if np.isnan(plane).any():
            raise ValueError(f"{path}: holds NaN, so it is not a mask")
        kept |= plane != 0
    if not kept.any():
        raise ValueError(f"{path}: is black, so no pixel is compared")
    return kept


def _channels(wanted: str | None, a: "Planes", reference: "Planes") -> list[str]:
    from ..image import colour_channels

    if wanted is not None and wanted.strip().lower() != "all":
        names = [n.strip() for n in wanted.split(",")]
        if "" in names or len(set(names)) != len(names):
            raise ValueError(f"--channels: must be different names with commas, got {wanted!r}")
        a.select(names), reference.select(names)
        return names
    lists = " and ".join(", ".join(p.planes) for p in (a, reference))
    if wanted is None:
        colours = [colour_channels(tuple(p.planes)) for p in (a, reference)]
        if colours[0] != colours[1]:
            raise ValueError(f"{a.name}, {reference.name}: differ in channels, {lists}")
        if colours[0] is not None:
            return list(colours[0])
    if set(a.planes) != set(reference.planes):
        if wanted is None:
            lists += "; choose with --channels"
        else:  # of many layers only what is not in both
            lists = " and ".join(
                f"{', '.join(names)} only in {p.name}"
                for p, other in ((a, reference), (reference, a))
                if (names := [n for n in p.planes if n not in other.planes])
            )
        raise ValueError(f"{a.name}, {reference.name}: differ in channels, {lists}")
    return list(a.planes)
