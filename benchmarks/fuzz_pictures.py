"""Small valid pictures of every kind that the readers take, and some that they refuse."""

import io
import pathlib
import sys
from typing import Any

import numpy as np
from PIL import Image

sys.path.insert(0, str(pathlib.Path(__file__).parents[1] / "tests"))
import picture_files

COMPRESSIONS = (
    "none",
    "rle",
    "zips",
    "zip",
    "piz",
    "pxr24",
    "b44",
    "b44a",
    "dwaa",
    "dwab",
    "htj2k",
)
FORMATS = {
    "png": ("uint8", "uint16"), "tif": ("uint8", "uint16", "half", "float", "double"),
    "jpg": ("uint8",), "gif": ("uint8",),
    "bmp": ("uint8",), "tga": ("uint8",), "pfm": ("float",), "pnm": ("uint8",), "dpx": ("uint16",),
    "sgi": ("uint8",), "ico": ("uint8",), "iff": ("uint8",), "rla": ("uint8", "float"),
    "fits": ("float",), "zfile": ("float",), "jxl": ("uint8",),
}  # fmt: skip


def _write(path: pathlib.Path, specs: list[Any], pixels: Any, mips: bool = False) -> bytes | None:
    import OpenImageIO as oiio  # noqa: N813

    out = oiio.ImageOutput.create(str(path))
    if out is None:
        return None
    opened = out.open(str(path), tuple(specs)) if len(specs) > 1 else out.open(str(path), specs[0])
    for k, spec in enumerate(specs):
        if not opened:
            break
        if k and len(specs) > 1:
            out.open(str(path), spec, "AppendSubimage")
        if spec.deep:
            deep = oiio.DeepData()
            deep.init(spec)
            for pixel in range(spec.width * spec.height):
                deep.set_samples(pixel, pixel % 3)
            opened = out.write_deep_image(deep)
        else:
            opened = out.write_image(pixels[: spec.height, : spec.width])
    while mips and opened and max(specs[0].width, specs[0].height) > 1:
        width, height = (max(n // 2, 1) for n in (specs[0].width, specs[0].height))
        specs[0].width, specs[0].height = width, height
        specs[0].full_width, specs[0].full_height = width, height
        opened = out.open(str(path), specs[0], "AppendMIPLevel")
        opened = opened and out.write_image(np.ascontiguousarray(pixels[:height, :width]))
    out.geterror()
    out.close()
    data = path.read_bytes() if opened and path.exists() else None
    return data or None


def pictures(folder: pathlib.Path) -> dict[str, bytes]:
    """Contents of files by name; a kind that the library does not write is left out."""
    import OpenImageIO as oiio  # noqa: N813

    rng = np.random.default_rng(0)
    pixels = rng.random((8, 16, 3), dtype=np.float32)
    found: dict[str, bytes | None] = {}

    def spec(kind: str = "half", tile: int = 0, **more: Any) -> Any:
        made = oiio.ImageSpec(16, 8, 3, kind)
        if tile:
            made.tile_width = made.tile_height = tile
        for name, value in more.items():
            made.attribute(name.replace("levelmode", "openexr:levelmode"), value)
        return made

    def write(name: str, *specs: Any, mips: bool = False) -> None:
        found[name] = _write(folder / name, list(specs), pixels, mips)

    for packing in COMPRESSIONS:
        write(f"{packing}.exr", spec(compression=packing))
    write("tiled.exr", spec(tile=4, compression="zip"))
    write("tiledpiz.exr", spec("float", tile=8, compression="piz"))
    write("mip.exr", spec(tile=4, compression="none", textureformat="Plain Texture"), mips=True)
    write("ripped.exr", spec(tile=4, compression="rle", levelmode=2))
    write("parts.exr", spec(name="one"), spec(name="two"))
    deep = spec(compression="zips")
    deep.deep = True
    write("deep.exr", deep)
    plain = pixels.astype(np.float32)
    found["bytes.exr"] = picture_files.rgb_exr(plain)
    entries = (
        ("owner", "string", b"me\xe9"), ("envmap", "envmap", b"\0"), ("p", "preview", bytes(8)),
        ("chromaticities", "chromaticities", np.arange(8, dtype="<f4").tobytes()),
        ("v", "stringvector", b"\1\0\0\0a"), ("k", "keycode", bytes(28)), ("b", "box2f", bytes(16)),
        ("expTime", "float", bytes(4)), ("q", "unknown", b"abc"),
    )  # fmt: skip
    extra = b"".join(picture_files.attribute(n.encode(), k.encode(), d) for n, k, d in entries)
    window = (2, 1, 17, 8)
    found["entries.exr"] = picture_files.rgb_exr(plain, data=window, extra=extra)
    found["window.exr"] = picture_files.rgb_exr(plain, data=window, display=(0, 0, 15, 7))
    for suffix, kinds in FORMATS.items():
        for kind in kinds:
            write(f"{kind}.{suffix}", spec(kind))
    write("tiled.tif", spec("uint8", tile=16))
    write("lzw.tif", spec("uint8", compression="lzw"))
    write("text.png", spec("uint8", Software="me", Copyright="you", Orientation=6))
    for name in ("a.webp", "a.jp2"):  # which the other library writes
        packed = io.BytesIO()
        Image.fromarray((255 * pixels).astype(np.uint8)).save(
            packed, "WEBP" if name == "a.webp" else "JPEG2000", lossless=True
        )
        found[name] = packed.getvalue()
    quads = rng.integers(0, 256, (8, 16, 4), dtype=np.uint8)
    quads[:, 4:12] = quads[:, 4:5]  # runs
    lines = ("FORMAT=32-bit_rle_rgbe", "EXPOSURE=2.5", "COLORCORR= 1 2 3", "GAMMA=1", "VIEW= -vtv",
             "PRIMARIES=0.64 0.33 0.3 0.6 0.15 0.06 0.3127 0.329", "# words")  # fmt: skip
    for coding in ("flat", "old", "new", "mixed"):
        found[f"{coding}.hdr"] = picture_files.radiance_bytes(quads, lines, coding)
    found["turned.hdr"] = picture_files.radiance_bytes(quads, coding="new", size="+X {} -Y {}")
    return {name: data for name, data in found.items() if data}
