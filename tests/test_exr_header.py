"""OpenEXR headers: what the library's binding does not take, and what they only claim."""

import os
import pathlib
import struct
import subprocess
import sys
import warnings
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt
import OpenEXR
import pytest
from hypothesis import given
from hypothesis import strategies as st
from picture_files import attribute, exr_bytes, rgb_exr, with_attribute

from glossy import _exr_header, _memory, image

PIXELS = np.random.default_rng(3).random((13, 21, 3)).astype(np.float32)
TEXT = st.binary(max_size=40).filter(lambda t: b"\0" not in t)
NAME = st.binary(min_size=1, max_size=60).filter(lambda t: b"\0" not in t)


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    return tmp_path_factory.mktemp("exr") / "a.exr"


@pytest.fixture
def small_memory() -> Iterator[None]:
    _memory.set_limit("64K")
    yield
    _memory.set_limit(None)


@given(NAME, TEXT)
def test_texts_of_any_bytes_are_read(file: pathlib.Path, name: bytes, text: bytes) -> None:
    """OpenEXR's texts have no encoding: UTF-8 where they are, else Latin-1."""
    file.write_bytes(rgb_exr(PIXELS, extra=attribute(b"own " + name, b"string", text)))
    read = image.read_image(file)
    np.testing.assert_array_equal(read.pixels, PIXELS)
    try:
        shown = text.decode()
    except UnicodeDecodeError:
        shown = text.decode("latin-1")
    assert [read.metadata[key] for key in read.metadata if key.startswith("own ")] == [shown]


@given(st.lists(NAME, min_size=1, max_size=4, unique=True))
def test_channels_of_any_names_are_read(file: pathlib.Path, names: list[bytes]) -> None:
    planes = {b"c." + n: PIXELS[..., 0] * (k + 1) for k, n in enumerate(names)}
    file.write_bytes(exr_bytes(planes))
    read = image.read_planes(file).planes
    assert len(read) == len(planes)
    found = sorted(float(p[0, 0]) for p in read.values())
    assert found == sorted(float(p[0, 0]) for p in planes.values())


@pytest.mark.parametrize(
    ("name", "kind", "data"),
    [
        (b"made", b"ownType", b"1234567"),
        (b"keys", b"keycode", b"\1\0\0\0" * 7),
        (b"ids", b"idmanifest", bytes(20)),
        (b"deepImageState", b"deepImageState", b"\1"),
        (b"list", b"stringvector", struct.pack("<i", 1) + b"\xe9"),
        (b"short", b"int", b"\1"),
        (b"envmap", b"envmap", b"\x09"),
        (b"framesPerSecond", b"rational", bytes(8)),
        (b"a name of more than thirty-one characters \xe9", b"float", bytes(4)),
    ],
)
@pytest.mark.parametrize("compression", ["NO", "ZIP", "PIZ", "DWAB"])
def test_attributes_that_the_binding_lacks_are_left_out(
    file: pathlib.Path, name: bytes, kind: bytes, data: bytes, compression: str
) -> None:
    method = getattr(OpenEXR, f"{compression}_COMPRESSION")
    high = np.tile(PIXELS, (25, 1, 1))  # several chunks of any compression
    OpenEXR.File({"compression": method, "type": OpenEXR.scanlineimage}, {"RGB": high}).write(
        str(file)
    )
    plain = image.read_image(file).pixels
    lines = {"NO": 1, "ZIP": 16, "PIZ": 32, "DWAB": 256}[compression]
    odd = with_attribute(file.read_bytes(), -(-325 // lines), attribute(name, kind, data))
    file.write_bytes(odd)
    np.testing.assert_array_equal(image.read_image(file).pixels, plain)


def test_a_name_that_is_not_utf8_is_read_and_written(file: pathlib.Path) -> None:
    odd = os.fsdecode(os.fsencode(file.parent) + b"/caf\xe9.exr")
    pathlib.Path(odd).write_bytes(rgb_exr(PIXELS))
    np.testing.assert_array_equal(image.read_image(odd).pixels, PIXELS)


def test_subsampled_channels_are_what_is_said(file: pathlib.Path) -> None:
    """Luminance and half chroma without compression: less than whole channels would take."""
    luminance = exr_bytes({b"Y": np.ones((2, 400), np.float32)})
    one = b"Y\0" + struct.pack("<i4xii", 2, 1, 1)
    three = (
        b"BY\0" + struct.pack("<i4xii", 2, 2, 2) + b"RY\0" + struct.pack("<i4xii", 2, 2, 2) + one
    )
    size = struct.pack("<i", len(one) + 1), struct.pack("<i", len(three) + 1)
    body = luminance.replace(size[0] + one, size[1] + three) + bytes(1600)
    file.write_bytes(body)
    with pytest.raises(ValueError, match=r"channel BY is subsampled, which is not read"):
        image.read_image(file)


def test_tiles_are_copied_with_their_offsets(file: pathlib.Path) -> None:
    tiles = OpenEXR.TileDescription()
    tiles.xSize, tiles.ySize = 8, 8
    header = {"type": OpenEXR.tiledimage, "tiles": tiles}
    OpenEXR.File(header, {"RGB": PIXELS}).write(str(file))
    odd = attribute(b"a", b"string", b"\xe9")
    file.write_bytes(with_attribute(file.read_bytes(), 6, odd))
    np.testing.assert_array_equal(image.read_image(file).pixels, PIXELS)


CHILD = """
import sys
from glossy.image import read_planes
for path in sys.argv[1:]:
    try:
        print(next(iter(read_planes(path, "linear").planes.values())).shape)
    except ValueError as error:
        print(error)
with open("/proc/self/status") as status:  # ru_maxrss begins with that of the parent
    print(*(line.split()[1] for line in status if line.startswith("VmHWM")))
"""


@pytest.mark.skipif(not os.path.exists("/proc/self/status"), reason="no peak of memory is told")
def test_claims_of_small_files_take_no_memory(tmp_path: pathlib.Path) -> None:
    """Tiles of 6 GB, a tile of 2^64 pixels, 2^24 rows: read or refused within 400 MB."""
    small = rgb_exr(np.ones((6, 12, 3), np.float32))
    OpenEXR.File(
        {"type": OpenEXR.tiledimage, "tiles": OpenEXR.TileDescription()},
        {"RGB": PIXELS[:6, :12].copy()},
    ).write(str(tmp_path / "t.exr"))
    data = (tmp_path / "t.exr").read_bytes()
    at = data.index(b"tiles\0tiledesc\0") + 19
    window = small.index(b"box2i\0") + 10
    files = {
        "tile.exr": data[:at] + struct.pack("<II", 32, 2**24) + data[at + 8 :],
        "huge.exr": data[:at] + struct.pack("<II", 2**32 - 1, 2**32 - 1) + data[at + 8 :],
        "none.exr": data[:at] + struct.pack("<II", 0, 8) + data[at + 8 :],
        "rows.exr": small[:window] + struct.pack("<4i", 0, 0, 11, 2**24 - 1) + small[window + 16 :],
        "wide.exr": small[:window] + struct.pack("<4i", 0, 0, 2**24, 5) + small[window + 16 :],
    }
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    paths = [str(tmp_path / name) for name in files]
    done = subprocess.run(
        [sys.executable, "-c", CHILD, *paths], capture_output=True, text=True, check=True
    )
    *said, peak = done.stdout.splitlines()
    assert said[:2] == ["(6, 12)", "(6, 12)"]
    assert "damaged description of tiles" in said[2]
    assert all("cannot hold" in line for line in said[3:])
    assert len(said) == 5
    assert int(peak) < 400_000  # KiB, of which the libraries take most


@pytest.mark.usefixtures("small_memory")
def test_the_memory_limit_is_asked_before_pixels_are_read(file: pathlib.Path) -> None:
    file.write_bytes(rgb_exr(np.ones((20, 20, 3), np.float32)))
    assert image.read_image(file).pixels.shape == (20, 20, 3)
    file.write_bytes(rgb_exr(np.ones((60, 60, 3), np.float32)))
    with pytest.raises(ValueError, match=r"a\.exr: would take 84\.4 KiB .* limit of 64 KiB"):
        image.read_image(file)


@given(st.integers(1, 70), st.integers(1, 70), st.integers(0, 2), st.integers(0, 1))
def test_chunks_of_levels_are_counted(width: int, height: int, mode: int, up: int) -> None:
    """One level, a chain of halved ones, and every pair of halved widths and heights."""
    count = _exr_header._count_chunks(
        (width, height), 0, struct.pack("<IIB", 16, 9, mode + 16 * up)
    )

    def sizes(n: int) -> list[int]:
        found = [n]
        while found[-1] > 1:
            found.append((found[-1] + up) // 2)
        return found

    w, h = sizes(width), sizes(height)
    if mode == 0:
        levels = [(width, height)]
    elif mode == 1:
        longest = max(len(w), len(h))
        w, h = (v + [1] * (longest - len(v)) for v in (w, h))
        levels = list(zip(w, h, strict=True))
    else:
        levels = [(a, b) for a in w for b in h]
    assert count == sum(-(-a // 16) * -(-b // 9) for a, b in levels)


# windows ------------------------------------------------------------------------------------------

CORNER = st.integers(-4, 6)
SIDE = st.integers(1, 7)


@given(CORNER, CORNER, SIDE, SIDE, CORNER, CORNER, SIDE, SIDE)
def test_pixels_stand_in_the_display_window(
    file: pathlib.Path, x: int, y: int, w: int, h: int, a: int, b: int, wide: int, high: int
) -> None:
    """Against a dictionary of pixels by their coordinates."""
    pixels = PIXELS[:h, :w]
    display = (a, b, a + wide - 1, b + high - 1)
    file.write_bytes(rgb_exr(pixels, data=(x, y, x + w - 1, y + h - 1), display=display))
    stored = {(x + j, y + i): pixels[i, j] for i in range(h) for j in range(w)}
    wanted = [[stored.get((a + j, b + i)) for j in range(wide)] for i in range(high)]
    empty = sum(p is None for row in wanted for p in row)
    np.testing.assert_array_equal(image.read_image(file).pixels, pixels)
    for window, refused in (("display", empty > 0), ("black", empty == wide * high)):
        if refused:
            with pytest.raises(ValueError, match=rf"data window \({x}, {y}\) to .* display window"):
                image.read_image(file, window=window)
            continue
        expected = [[np.zeros(3) if p is None else p for p in row] for row in wanted]
        read = image.read_image(file, window=window)
        np.testing.assert_array_equal(read.pixels, expected)
        assert np.array_equal(read.metadata["dataWindow"], [[a, b], display[2:]])


def test_a_huge_display_window_is_refused(file: pathlib.Path) -> None:
    file.write_bytes(rgb_exr(PIXELS, display=(0, 0, 10**6, 10**6)))
    with pytest.raises(ValueError, match="1000001 x 1000001 with 3 channels is more than"):
        image.read_image(file, window="black")


# chromaticities -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("values", "known"),
    [
        ((0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290), True),
        ((0.6400, 0.3300, 0.3000, 0.6000, 0.1500, 0.0600, 0.31271, 0.32902), True),
        ((0.0,) * 8, True),
        ((0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.077, 0.32168, 0.33767), False),
        ((0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.3127, 0.3290), False),
    ],
)
def test_other_chromaticities_are_warned_of(
    file: pathlib.Path, values: tuple[float, ...], known: bool
) -> None:
    data = attribute(b"chromaticities", b"chromaticities", struct.pack("<8f", *values))
    file.write_bytes(rgb_exr(PIXELS, extra=data))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        pixels: npt.NDArray[np.float32] = image.read_image(file).pixels
    np.testing.assert_array_equal(pixels, PIXELS)
    assert len(caught) == (0 if known else 1)
    assert all("a.exr: chromaticities" in str(c.message) for c in caught)
