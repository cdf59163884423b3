"""``glossy compare`` of folders: nothing that they hold goes unsaid."""

import json
import os
import pathlib
from typing import Any

import numpy as np
import pytest

from glossy import cli, image
from glossy.commands import compare_folders

PIXELS = np.random.default_rng(11).random((20, 30, 3)).astype(np.float32)
Captured = pytest.CaptureFixture[str]


@pytest.fixture
def folders(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> pathlib.Path:
    """Folders x and y of three images, one of them in a subfolder, the second pair the worst."""
    monkeypatch.chdir(tmp_path)
    for name, error in (("one.exr", 0.1), ("two.hdr", 0.4), ("sub/three.exr", 0.2)):
        for side, offset in (("x", error), ("y", 0.0)):
            (tmp_path / side / name).parent.mkdir(parents=True, exist_ok=True)
            image.write_image(f"{side}/{name}", PIXELS + offset)
    return tmp_path


def compare(*arguments: str) -> int:
    return cli.main(["compare", *arguments])


def listed(capsys: Captured, code: int, *arguments: str) -> dict[str, dict[str, Any]]:
    """The rows by name, and that text and JSON agree on what they list."""
    assert compare("x", "y", *arguments) == code
    text = capsys.readouterr()
    assert compare("x", "y", *arguments, "--json") == code
    said = capsys.readouterr()
    assert said.err == text.err
    out = json.loads(said.out)
    assert out["within_limits"] is (code == 0)
    assert len(text.out.splitlines()) == 1 + len(out["files"])
    rows = {row["name"]: row for row in out["files"]}
    for name, row in rows.items():
        assert name in text.out
        assert row["within_limits"] is not bool(row["failures"] or row.get("error"))
    errors = [row["error"] for row in out["files"] if "error" in row]
    assert [line for line in text.err.splitlines() if "--max" not in line] == [
        f"glossy compare: {error}" for error in errors
    ]
    return rows


@pytest.mark.usefixtures("folders")
def test_subfolders_are_compared_and_listed_worst_first(capsys: Captured) -> None:
    rows = listed(capsys, 1, "--max-rms", "0.15", "--diff", "pictures")
    assert list(rows) == ["two.hdr", "sub/three.exr", "one.exr"]
    assert [row["within_limits"] for row in rows.values()] == [False, False, True]
    assert sorted(os.listdir("pictures")) == ["one.exr.png", "sub", "two.hdr.png"]
    assert os.listdir("pictures/sub") == ["three.exr.png"]
    assert compare("x", "y", "--max-rms", "0.15", "--peak", "4") == 1
    printed = capsys.readouterr()
    assert "psnr (peak 4)" in printed.out.splitlines()[0]
    assert printed.out.splitlines()[2].endswith("sub/three.exr  outside the limits")
    assert printed.err.count("--max-rms") == 2
    assert "x/sub/three.exr" in printed.err
    assert list(listed(capsys, 0)) == list(rows)


def test_whatever_cannot_be_compared_is_named_and_the_rest_is_compared(
    folders: pathlib.Path, capsys: Captured
) -> None:
    (folders / "y" / "two.hdr").unlink()
    for side in "xy":
        (folders / side / "notes.json").write_text("{}")
        (folders / side / "link.exr").symlink_to("nowhere.exr")
        (folders / side / "again.exr").symlink_to("again.exr")
        (folders / side / "up").symlink_to("..")
    broken = PIXELS.copy()
    broken[3, 4, 1] = np.nan
    for side in "xy":
        image.write_image(f"{side}/nan.exr", broken)
        image.write_image(f"{side}/size.exr", PIXELS[: 19 if side == "x" else 20])
    (folders / "x" / "cut.exr").write_bytes((folders / "y" / "one.exr").read_bytes()[:900])
    (folders / "y" / "cut.exr").write_bytes((folders / "y" / "one.exr").read_bytes())
    (folders / "y" / "sub" / "more.png").write_bytes(b"")
    (folders / "x" / "plain").write_bytes(b"")
    os.mkfifo(folders / "x" / "pipe.exr")
    os.mkfifo(folders / "y" / "pipe.exr")
    rows = listed(capsys, 2, "--max-rms", "0.15")
    errors = {name: row["error"] for name, row in rows.items() if "error" in row}
    words = {
        "two.hdr": "x/two.hdr: has no counterpart in y",
        "sub/more.png": "y/sub/more.png: has no counterpart in x",
        "notes.json": "x/notes.json: has a suffix that is not read",
        "plain": "x/plain: has a suffix that is not read",
        "link.exr": "x/link.exr: is a link to nothing",
        "again.exr": "x/again.exr: is a link to nothing",
        "up/x": "x/up/x: is a link to a folder that it lies in",
        "nan.exr": "x/nan.exr: must be finite, got 1 NaN",
        "size.exr": "x/size.exr, y/size.exr: differ in size, 30 x 19 and 30 x 20",
        "cut.exr": "x/cut.exr: cannot be read",
        "pipe.exr": "pipe.exr: is not a regular file",
    }
    for name, word in words.items():
        assert word in errors[name], name
    assert [name for name in rows if name not in errors] == ["sub/three.exr", "one.exr"]
    assert rows["sub/three.exr"]["failures"]
    assert rows["one.exr"]["rms"] == pytest.approx(0.1)


def test_links_are_followed_but_not_in_a_circle(folders: pathlib.Path, capsys: Captured) -> None:
    for side in "xy":
        (folders / side / "linked").symlink_to("sub")
    assert "linked/three.exr" in listed(capsys, 0)
    (folders / "x" / "sub" / "back").symlink_to("..")
    rows = listed(capsys, 2)
    assert "x/sub/back: is a link to a folder that it lies in" in rows["sub/back"]["error"]
    assert "x/linked/back: is a link" in rows["linked/back"]["error"]


def test_what_is_left_out(folders: pathlib.Path, capsys: Captured) -> None:
    """Hidden names, what systems drop, and what --ignore names, of files and of folders."""
    for name in (".DS_Store", "Thumbs.db", "desktop.ini", ".hidden.exr", "log.txt", "sub/a.txt"):
        (folders / "x" / name).write_text("no image")
    for name in (".git", "__MACOSX", "old"):
        (folders / "x" / name).mkdir()
        (folders / "x" / name / "one.exr").write_text("no image")
    assert set(listed(capsys, 2, "--ignore", "old", "--ignore", "sub/*.txt")) == {
        "one.exr", "two.hdr", "sub/three.exr", "log.txt",
    }  # fmt: skip
    assert len(listed(capsys, 0, "--ignore", "old", "--ignore", "*.txt")) == 3


def test_suffixes_may_differ_in_case(folders: pathlib.Path, capsys: Captured) -> None:
    (folders / "x" / "one.exr").rename(folders / "x" / "one.EXR")
    (folders / "y" / "two.hdr").rename(folders / "y" / "two.HDR")
    rows = listed(capsys, 0)
    assert set(rows) == {"one.EXR", "two.hdr", "sub/three.exr"}
    assert rows["two.hdr"]["reference"] == "y/two.HDR"
    (folders / "y" / "one.Exr").write_bytes((folders / "y" / "one.exr").read_bytes())
    rows = listed(capsys, 2)  # one.EXR could be either
    assert {name for name in rows if "error" in rows[name]} == {"one.EXR", "one.exr", "one.Exr"}


def test_an_unreadable_subfolder_is_named(
    folders: pathlib.Path, capsys: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = os.scandir

    def scandir(path: str) -> Any:
        if path == "x/sub":
            raise PermissionError(13, "Permission denied", path)
        return real(path)

    monkeypatch.setattr(os, "scandir", scandir)
    rows = listed(capsys, 2)
    assert rows["sub"]["error"] == "x/sub: permission denied"
    assert rows["sub/three.exr"]["error"] == "y/sub/three.exr: has no counterpart in x"
    assert folders.is_dir()


def refusal(capfd: Captured, *arguments: str) -> str:
    """The one line that exit code 2 comes with."""
    assert compare(*arguments) == 2
    out = capfd.readouterr()
    assert out.out == ""
    assert out.err.count("\n") == 1
    return out.err


def test_folders_that_cannot_be_compared_at_all(
    folders: pathlib.Path, capfd: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("empty", "hidden"):
        (folders / name).mkdir()
    (folders / "hidden" / ".one.exr").write_text("")
    assert "holds no images" in refusal(capfd, "empty", "hidden")
    image.write_image("a.exr", PIXELS)
    assert "x: is a folder and the other is not" in refusal(capfd, "x", "a.exr")
    assert "nowhere: no such file or directory" in refusal(capfd, "nowhere", "x")
    monkeypatch.setattr(compare_folders, "MOST_FILES", 2)
    assert "x: holds more than 2 files" in refusal(capfd, "x", "y")


def test_pictures_overwrite_no_input_and_no_other(folders: pathlib.Path, capfd: Captured) -> None:
    for place in ("x", "y/", "x/new", "y/sub"):
        assert "is one of the inputs, or inside" in refusal(capfd, "x", "y", "--diff", place)
    image.write_image("p.png", PIXELS)
    assert "must be a folder" in refusal(capfd, "x", "y", "--diff", "p.png")
    before = {p: p.read_bytes() for p in folders.rglob("*.exr")}
    for side in "xy":
        image.write_image(f"{side}/one.exr.png", PIXELS)
    (folders / "d").mkdir()
    (folders / "d" / "two.hdr.png").symlink_to("../x/one.exr")
    assert compare("x", "y", "--encoding", "srgb", "--diff", "d") == 0
    assert {p: p.read_bytes() for p in before} == before
    assert sorted(os.listdir("d")) == [
        "one.exr.png", "one.exr.png.png", "sub", "two.hdr.png", "two.hdr.png.png",
    ]  # fmt: skip


def test_a_folder_of_masks(folders: pathlib.Path, capfd: Captured) -> None:
    for rows, name in enumerate(("one.exr", "sub/three.exr", "two.hdr"), start=1):
        mask = np.zeros((20, 30, 3))
        mask[:rows] = 1.0
        (folders / "masks" / name).parent.mkdir(parents=True, exist_ok=True)
        image.write_image(f"masks/{name}", mask)
    rows_by_name = listed(capfd, 0, "--mask", "masks")
    assert {name: row["pixels"] for name, row in rows_by_name.items()} == {
        "one.exr": 30, "sub/three.exr": 60, "two.hdr": 90,
    }  # fmt: skip
    (folders / "masks" / "sub" / "three.exr").unlink()
    rows_by_name = listed(capfd, 2, "--mask", "masks")
    assert "masks/sub/three.exr: no such file" in rows_by_name["sub/three.exr"]["error"]


def test_names_of_any_bytes_are_printed(folders: pathlib.Path, capfd: Captured) -> None:
    for side in "xy":
        image.write_image(f"{side}/new\nline.exr", PIXELS)
    os.rename(folders / "x" / "one.exr", os.fsencode(folders / "x") + b"/\xff.exr")
    assert compare("x", "y") == 2
    out, err = capfd.readouterr()
    assert "new\\nline.exr" in out
    assert "\\udcff.exr" in out
    assert "x/\\udcff.exr: has no counterpart in y" in err
