"""npz files: whole, damaged, and claiming more than there is."""

import io
import os
import pathlib
import struct
import zipfile
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from glossy import _memory
from glossy._npz import load_npz


@pytest.fixture
def little_memory() -> Iterator[None]:
    _memory.set_limit("1M")
    yield
    _memory.set_limit(None)


def header(text: str, version: int = 1) -> bytes:
    """The head of an npy entry with ``text`` as its dictionary."""
    body = text.encode("latin-1") + b"\n"
    return (
        b"\x93NUMPY"
        + bytes([version, 0])
        + struct.pack("<H" if version == 1 else "<I", len(body))
        + body
    )


def shape(*sizes: int, kind: str = "<f8") -> str:
    return f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {sizes}, }}"


def archive(path: pathlib.Path, method: int = zipfile.ZIP_DEFLATED, **entries: bytes) -> None:
    with zipfile.ZipFile(path, "w", method) as file:
        for name, content in entries.items():
            file.writestr(f"{name}.npy", content)


def test_named_arrays_or_all_of_them(tmp_path: pathlib.Path) -> None:
    file = tmp_path / "a.npz"
    stored: dict[str, Any] = {
        "x": np.arange(6.0).reshape(2, 3),
        "y": np.array([True, False]),
        "z": np.int8(3),
    }
    np.savez_compressed(file, **stored)
    for found, names in ((load_npz(file), ["x", "y", "z"]), (load_npz(file, ("y", "none")), ["y"])):
        assert sorted(found) == names
        for name in names:
            assert np.array_equal(found[name], stored[name])
            assert found[name].dtype == np.asarray(stored[name]).dtype


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\x93NUM",
        header("{'descr': '<f8', "),
        header("("),
        header("x" * 70000, version=2),
        header(shape(3)),
        header(shape(-1)),
        header(shape(10**400)),
        header(shape(2**62, 2**62)),
        header(shape(1, kind="|O")) + b"\0" * 8,
        header(shape(1, kind="<q9")),
        header(shape(1), version=2)[:-1] + b"\x00",
        b"\x93NUMPY\x09\x00" + b"\0" * 90,
    ],
    ids=range(13),
)
def test_broken_headers_are_one_line(content: bytes, tmp_path: pathlib.Path) -> None:
    file = tmp_path / "a.npz"
    archive(file, x=content)
    for names in (None, ["x"]):
        with pytest.raises(ValueError, match=r"a\.npz: not an npz file of number arrays$") as error:
            load_npz(file, names)
        assert "\n" not in str(error.value)


@pytest.mark.parametrize("method", [zipfile.ZIP_STORED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_damage_within_an_entry(method: int, tmp_path: pathlib.Path) -> None:
    """Every compression has errors of its own."""
    file = tmp_path / "a.npz"
    content = io.BytesIO()
    np.save(content, np.random.default_rng(0).random(500))
    archive(file, method, x=content.getvalue())
    whole = bytearray(file.read_bytes())
    assert load_npz(file)["x"].shape == (500,)
    whole[300:400] = b"\xa5" * 100
    file.write_bytes(whole)
    with pytest.raises(ValueError, match="not an npz file"):
        load_npz(file)


def test_other_files_are_refused(tmp_path: pathlib.Path) -> None:
    """An npy named npz, no archive, and what is no regular file, before it is opened."""
    file = tmp_path / "a.npz"
    with file.open("wb") as stream:
        np.save(stream, np.ones(3))
    with pytest.raises(ValueError, match="not an npz file"):
        load_npz(file)
    file.unlink()
    os.mkfifo(file)
    with pytest.raises(OSError, match="is not a regular file"):
        load_npz(file)
    with pytest.raises(OSError, match="no such file"):
        load_npz(tmp_path / "b.npz")


@pytest.mark.usefixtures("little_memory")
def test_memory_is_bounded_by_the_headers_before_anything_is_read(tmp_path: pathlib.Path) -> None:
    """Three arrays of half the limit: any of them is read, all of them are not."""
    file = tmp_path / "a.npz"
    zeros = header(shape(1 << 16)) + bytes(1 << 19)
    archive(file, x=zeros, y=zeros, z=zeros)
    assert file.stat().st_size < 1 << 13
    assert load_npz(file, ["x"])["x"].size == 1 << 16
    with pytest.raises(ValueError, match=r"a\.npz: would take 1\.5 MiB of memory, more than"):
        load_npz(file)
