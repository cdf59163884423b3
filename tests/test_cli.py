"""The command line itself: help, loudness, pipes, inputs kept, where results come from."""

import hashlib
import json
import os
import pathlib
import shlex
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

import glossy
from glossy import cli
from glossy.commands import talk
from glossy.image import read_image, read_planes

SMALL = ["--size", "16", "--width", "12", "--height", "10"]
HUGE = "1" + "0" * 400


def run(capsys: pytest.CaptureFixture[str], *args: str) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of a command."""
    try:
        code = cli.main(list(args))
    except SystemExit as stop:
        code = int(stop.code or 0)
    said = capsys.readouterr()
    return code, said.out, said.err


def program(*args: str, stdin: bytes = b"", **more: Any) -> "subprocess.CompletedProcess[bytes]":
    """A command in a process of its own, with bytes through its pipes."""
    words = [sys.executable, "-m", "glossy", *args]
    return subprocess.run(words, input=stdin, capture_output=True, check=False, **more)


# --- help, versions, errors -----------------------------------------------------------------------


def test_alone_it_prints_its_help(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, err = run(capsys)
    assert (code, err) == (0, "")
    assert all(name in out for name in cli.COMMANDS)
    assert run(capsys, "--help")[1] == out
    assert run(capsys, "help")[1] == out


@pytest.mark.parametrize("command", cli.COMMANDS)
def test_every_command_has_help_json_and_loudness(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, _ = run(capsys, "help", command)
    assert code == 0
    assert out == run(capsys, command, "--help")[1]
    assert max(map(len, out.splitlines())) <= 110
    assert all(name in out for name in ("--json", "--quiet", "--verbose"))


def test_what_a_command_takes_is_what_its_help_names(capsys: pytest.CaptureFixture[str]) -> None:
    assert "room, showroom or hall" in run(capsys, "render", "--help")[1]
    for command in ("trace", "plan", "study"):
        said = " ".join(run(capsys, command, "--help")[1].split())
        assert "of one shape, without [[objects]]" in said
    said = " ".join(run(capsys, "plan", "--help")[1].split())
    assert "a material of Kurt lobes" in said
    said = " ".join(run(capsys, "trace", "--help")[1].split())
    assert "regular, importance, thesis, lattice, and auto" in said


def test_the_version_as_text_and_as_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(capsys, "--version") == (0, f"glossy {glossy.__version__}\n", "")
    for words in (("--version", "--json"), ("--json", "--version")):
        code, out, err = run(capsys, *words)
        assert (code, err) == (0, "")
        made = {"schema": 1, "command": "version", "version": glossy.__version__}
        assert json.loads(out) == made


@pytest.mark.parametrize(
    "words",
    [
        ["magic"],
        ["render"],
        ["render", "--samples", "many", "-o", "a.exr"],
        ["render", "--samples", HUGE * 20, "-o", "a.exr"],
        ["render", "--samples", HUGE, "-o", "a.exr"],
        ["render", "--size", HUGE, "-o", "a.exr"],
        ["render", "--bias", "1e999", "-o", "a.exr"],
        ["render", "--material", f"mx={HUGE}", "-o", "a.exr"],
        ["render", "--supersampling", "0", "-o", "a.exr"],
        ["render", "--gbuffer", "absent\n.npz", "-o", "a.exr"],
        ["render", "x" * 5000, "-o", "a.exr"],
        ["fit", "/dev/zero", "--format", "text"],
        ["render", "--material", "/dev/zero", "-o", "a.exr"],
        ["help", "magic"],
    ],
    ids=lambda words: " ".join(words)[:40],
)
def test_an_error_is_one_line(
    words: list[str],
    tmp_path: pathlib.Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, err = run(capsys, *words)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert err.startswith("glossy")
    assert len(err) < 1200
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("words", [["material"], ["pattern", "--mx", ".1"]])
def test_a_full_disk_behind_standard_output_is_one_line(words: list[str]) -> None:
    with open("/dev/full", "wb") as full:
        done = subprocess.run(
            [sys.executable, "-m", "glossy", *words],
            stdout=full,
            stderr=subprocess.PIPE,
            check=False,
        )
    assert done.returncode == 2
    assert done.stderr == f"glossy {words[0]}: [Errno 28] No space left on device\n".encode()


def test_a_picture_that_standard_output_cannot_take_is_one_line_more() -> None:
    command = shlex.join([sys.executable, "-m", "glossy", "-q", "render", *SMALL, "-o", "-"])
    for place, words in ((">&-", "--output: - is standard output, which is closed"),
                         (">/dev/full", "[Errno 28] No space left on device")):  # fmt: skip
        done = subprocess.run(["sh", "-c", f"{command} {place}"], capture_output=True, check=False)
        assert done.returncode == 2
        assert done.stderr.decode().splitlines()[-1].startswith(f"glossy render: {words}")
        assert b"Traceback" not in done.stderr
    done = subprocess.run(["sh", "-c", f"{command} -v 2>&-"], capture_output=True, check=False)
    assert (done.returncode, done.stdout[:4]) == (0, b"\x76\x2f\x31\x01")


# --- how much is said -----------------------------------------------------------------------------


@pytest.mark.parametrize("before", [True, False])
def test_quiet_leaves_results_that_were_asked_for(
    before: bool, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = str(tmp_path / "a.exr")

    def quietly(*words: str) -> tuple[int, str, str]:
        return run(capsys, *(["-q", *words] if before else [*words, "--quiet"]))

    assert quietly("render", *SMALL, "-o", out) == (0, "", "")
    code, text, err = quietly("render", *SMALL, "--json", "-o", out)
    assert (code, err) == (0, "")
    assert json.loads(text)["output"] == out
    assert quietly("compare", out, out) == (0, "", "")
    assert quietly("material", "white-foil")[1].startswith("name: white-foil")
    code, text, err = quietly("render", *SMALL, "-o", str(tmp_path / "a.gif"))
    assert (code, text, err.count("\n")) == (2, "", 1)


def test_verbose_says_versions_and_where_an_error_arose(
    tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, _, err = run(capsys, "--verbose", "render", *SMALL, "-o", str(tmp_path / "a.exr"))
    assert code == 0
    assert f"glossy {glossy.__version__}, Python " in err
    code, _, err = run(capsys, "render", *SMALL, "-v", "-o", str(tmp_path / "a.gif"))
    assert code == 2
    assert err.startswith("Traceback")
    assert err.splitlines()[-1].startswith("glossy render: --output: must end in")


def test_words_after_two_dashes_are_no_options() -> None:
    assert talk.split_words(["a", "-q", "--", "-v"]) == (["a", "--", "-v"], talk.QUIET)
    assert talk.split_words(["-q", "a", "-v"]) == (["a"], talk.VERBOSE)


@pytest.mark.parametrize(("terminal", "level"), [(True, 1), (False, 1), (True, 0), (False, 2)])
def test_that_kernels_compile_is_said_once_and_to_a_terminal(
    terminal: bool,
    level: int,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    numba = pytest.importorskip("numba")
    monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal, raising=False)
    with talk.telling("render", level):
        for k in range(2):
            numba.njit(eval(f"lambda x: x + {k}"))(1)
    said = capsys.readouterr().err
    assert said.count("compiling kernels") == int(level == 2 or (terminal and level == 1))


# --- pipes ----------------------------------------------------------------------------------------


def test_a_picture_goes_through_pipes(tmp_path: pathlib.Path) -> None:
    scene = b'material = "mx=.2"\n[environment]\nsource = "studio"\nsize = 16\n'
    size = ["--width", "12", "--height", "10"]
    (tmp_path / "s.toml").write_bytes(scene)
    done = program("render", "-", *size, "-o", "-", "--json", stdin=scene, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    (tmp_path / "piped.exr").write_bytes(done.stdout)
    report = json.loads(done.stderr)
    assert report["output"] == "-"
    assert list(report["provenance"]["inputs"]) == ["-"]
    assert (
        cli.main(["-q", "render", str(tmp_path / "s.toml"), *size, "-o", str(tmp_path / "f.exr")])
        == 0
    )
    piped, filed = (read_planes(tmp_path / name) for name in ("piped.exr", "f.exr"))
    assert all(np.array_equal(piped.planes[c], filed.planes[c]) for c in "RGB")
    assert piped.metadata["commandLine"] == "glossy " + shlex.join(
        ["render", "-", *size, "-o", "-", "--json"]
    )

    turned = program("environment", "-", "--size", "8", "-o", "-", "--output-format", "png",
                     stdin=_map_file(tmp_path).read_bytes(), cwd=tmp_path)  # fmt: skip
    assert turned.returncode == 0, turned.stderr
    assert turned.stdout.startswith(b"\x89PNG")
    assert turned.stderr.startswith(b"-: latlong, 32 x 16")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["f.exr", "map.hdr", "piped.exr", "s.toml"]


def _map_file(folder: pathlib.Path) -> pathlib.Path:
    path = folder / "map.hdr"
    glossy.write_image(path, np.full((16, 32, 3), 0.5, dtype=np.float32))
    return path


def test_a_material_goes_through_pipes() -> None:
    done = program("material", "-", "--json", stdin=b"kd = 0.25\n")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["parameters"]["kd"] == 0.25
    done = program("material", "-", "--json", stdin=b'{"kd": 0.5}')
    assert json.loads(done.stdout)["parameters"]["kd"] == 0.5
    done = program("material", "-", stdin=b"kd = .25\n")
    assert (done.returncode, done.stderr[:39]) == (2, b"glossy material: -: must be TOML, got I")
    done = program("pattern", "--mx", ".1", "--samples", "7", "-q", "-o", "-", "--format", "csv")
    assert (done.returncode, done.stderr) == (0, b"")
    assert done.stdout.count(b"\n") >= 7


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["render", "-", "--env", "-", "-o", "a.exr"], "scene, env: standard input can be read"),
        (["render", "-", "-o", "a.exr"], "scene: standard input is empty"),
        (["environment", "white", "--layout", "faces", "-o", "-"], "--output: - is one file"),
        (["study", "-o", "-"], "--output: - is one file"),
        (["study", "--env", "-", "-o", "s"], "env: a study reads its files again"),
        (["render", "--output-format", "png", "-o", "a.png"], "--output-format: is for -o -"),
    ],
)  # fmt: skip
def test_what_no_pipe_can_carry_is_refused(
    words: list[str], text: str, tmp_path: pathlib.Path
) -> None:
    done = program(*words, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, b"")
    assert done.stderr.decode().startswith(f"glossy {words[0]}: {text}")
    assert not list(tmp_path.iterdir())


# --- what is not overwritten ----------------------------------------------------------------------


def _inputs(folder: pathlib.Path) -> None:
    _map_file(folder)
    faces = folder / "faces"
    faces.mkdir()
    for name in ("px", "nx", "py", "ny", "pz", "nz"):
        glossy.write_image(faces / f"{name}.exr", np.full((4, 4, 3), 0.5, dtype=np.float32))
    (folder / "m.toml").write_text("kd = 0.5\n[[reflection]]\nmx = 0.2\n")
    (folder / "s.toml").write_text(
        'material = "m.toml"\n[environment]\nsource = "map.hdr"\nsize = 4\n'
    )
    glossy.write_image(folder / "shown.png", np.full((4, 4, 3), 0.5), exposure=1.0)
    os.link(folder / "map.hdr", folder / "hard.hdr")
    (folder / "soft.hdr").symlink_to("map.hdr")


OVER = [
    ["render", "--env", "map.hdr", "-o", "map.hdr"],
    ["render", "--env", "map.hdr", "-o", "./faces/../map.hdr"],
    ["render", "--env", "map.hdr", "-o", "hard.hdr"],
    ["render", "--env", "map.hdr", "-o", "soft.hdr"],
    ["render", "--env", "soft.hdr", "-o", "map.hdr"],
    ["render", "s.toml", "-o", "map.hdr"],
    ["reference", "s.toml", "-o", "map.hdr"],
    ["render", "--env", "faces", "-o", "faces/ny.exr"],
    ["render", "--env", "faces/*.exr", "-o", "faces/ny.exr"],
    ["environment", "map.hdr", "-o", "map.hdr"],
    ["render", "--env", "white", "--exposure", "like:shown.png", "-o", "shown.png"],
    ["environment", "faces", "--layout", "faces", "-o", "faces"],
    ["pattern", "--material", "m.toml", "-o", "m.toml"],
    ["fit", "m.toml", "--format", "text", "-o", "m.toml"],
]


@pytest.mark.parametrize("words", OVER, ids=" ".join)
def test_an_input_is_not_overwritten(
    words: list[str],
    tmp_path: pathlib.Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    _inputs(tmp_path)
    monkeypatch.chdir(tmp_path)
    before = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}
    size = ["--width", "8", "--height", "8"] if words[0] in ("render", "reference") else []
    code, out, err = run(capsys, *words, *size)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert "is read by this command; --force overwrites it" in err
    assert {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()} == before


@pytest.mark.skipif(sys.platform == "win32", reason="no FIFOs")
@pytest.mark.parametrize(
    "words",
    [
        ["stability", "-o", "x.md"],
        ["stability", "--plot", "x.png"],
        ["render", "-o", "x.exr", "--force"],
        ["reference", "-o", "x.hdr"],
        ["environment", "sky", "-o", "x.exr"],
        ["pattern", "--mx", ".1", "-o", "x.json"],
        ["pattern", "--mx", ".1", "--plot", "x.png"],
        ["fit", "m.toml", "-o", "x.toml"],
    ],
    ids=" ".join,
)
def test_what_is_no_regular_file_is_refused_before_the_work(
    words: list[str],
    tmp_path: pathlib.Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    from glossy.stability import checks

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(checks, "run", None)
    name = next(word for word in words if word.startswith("x."))
    os.mkfifo(name)
    code, out, err = run(capsys, *words)
    assert (code, out) == (2, "")
    assert err == f"glossy {words[0]}: {name}: is not a regular file and is not replaced\n"


def test_a_folder_that_cannot_be_written_is_refused_before_the_work(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from glossy.stability import checks

    monkeypatch.setattr(checks, "run", None)
    monkeypatch.setattr(os, "access", lambda *_: False)  # whoever runs the tests
    code, out, err = run(capsys, "stability", "-o", str(tmp_path / "x.md"))
    assert (code, out) == (2, "")
    assert err == f"glossy stability: --output: folder {str(tmp_path)!r} cannot be written\n"


def test_force_overwrites_an_input_and_other_files_need_none(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    _inputs(tmp_path)
    monkeypatch.chdir(tmp_path)
    before = (tmp_path / "map.hdr").read_bytes()
    command = ["environment", "map.hdr", "--size", "4", "--layout", "latlong"]
    assert run(capsys, *command, "-o", "new.hdr")[0] == 0
    assert run(capsys, *command, "-o", "new.hdr")[0] == 0
    assert (tmp_path / "map.hdr").read_bytes() == before
    assert run(capsys, *command, "-o", "map.hdr", "--force")[0] == 0
    assert (tmp_path / "map.hdr").read_bytes() == (tmp_path / "new.hdr").read_bytes()


def test_two_outputs_are_two_files(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    code, _, err = run(capsys, "pattern", "--mx", ".1", "-o", "a.png", "--plot", "./a.png")
    assert code == 2
    assert "--output, --plot: are the same file" in err


# --- where a result comes from --------------------------------------------------------------------


def test_an_exr_says_what_made_it(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    _inputs(tmp_path)
    monkeypatch.chdir(tmp_path)
    size = ["--width", "8", "--height", "8"]
    command = ["render", "s.toml", *size, "--bias", ".5", "--samples", "7", "-o", "a b.exr"]
    code, out, _ = run(capsys, *command, "--json")
    assert code == 0
    first = pathlib.Path("a b.exr").read_bytes()
    assert run(capsys, *command, "--json")[0] == 0
    assert pathlib.Path("a b.exr").read_bytes() == first
    header = read_planes("a b.exr").metadata
    assert header["software"] == f"glossy {glossy.__version__}"
    assert header["commandLine"] == shlex.join(["glossy", *command, "--json"])
    assert header["method"] == "regular"
    assert json.loads(header["options"]) == {"bias": 0.5, "samples": [7]}
    digests = {
        name: hashlib.sha256(pathlib.Path(name).read_bytes()).hexdigest()
        for name in ("s.toml", "map.hdr", "m.toml")
    }
    assert json.loads(header["inputs"]) == digests
    assert header["material"] == "m.toml"
    environment = json.loads(header["environment"])
    cube = glossy.read_environment("map.hdr", size=4)
    assert environment == {
        "source": "map.hdr", "size": 4, "sha256": hashlib.sha256(cube.faces.tobytes()).hexdigest()
    }  # fmt: skip
    assert str(tmp_path) not in json.dumps({k: str(v) for k, v in header.items()})
    found = json.loads(out)["provenance"]
    assert found["inputs"] == digests
    assert found["command_line"] == header["commandLine"]
    assert (found["method"], found["environment"]) == ("regular", environment)


@pytest.mark.parametrize(
    ("words", "method"),
    [
        (["reference", *SMALL, "--tolerance", "1e-2"], "texels"),
        (["render", *SMALL, "--converge", "--passes", "1"], "regular"),
        (["environment", "axes", "--size", "8"], None),
        (["environment", "axes", "--size", "8", "--layout", "faces"], None),
    ],
    ids=["reference", "converge", "cross", "faces"],
)
def test_every_command_that_writes_exr_says_what_made_it(
    words: list[str],
    method: str | None,
    tmp_path: pathlib.Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run(capsys, *words, "-o", str(tmp_path / "a.exr"))[0] == 0
    files = list(tmp_path.iterdir())
    assert len(files) in (1, 6)
    for file in files:
        header = read_planes(file).metadata
        assert header["commandLine"] == shlex.join(
            ["glossy", *words, "-o", str(tmp_path / "a.exr")]
        )
        assert header.get("method") == method
        assert len(json.loads(header["environment"])["sha256"]) == 64
    if words[0] == "reference" or method == "regular":
        assert header["errorKind"] in ("bound", "standard")


def test_a_scene_of_objects_names_its_built_in_map(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    text = '[environment]\nsource = "white"\nsize = 4\n[[objects]]\nmaterial = "mx=.3"\n'
    pathlib.Path("s.toml").write_text(f'{text}shape = {{ kind = "sphere" }}\n')
    size = ["--width", "6", "--height", "4", "--supersampling", "1"]
    assert run(capsys, "render", "s.toml", *size, "-o", "a.exr")[0] == 0
    found = json.loads(read_planes("a.exr").metadata["environment"])
    digest = hashlib.sha256(glossy.environment("white", size=4).faces.tobytes()).hexdigest()
    assert found == {"source": "white", "size": 4, "sha256": digest}


# --- rays a pixel ---------------------------------------------------------------------------------


def test_supersampling_of_one_shape_averages_its_rays(
    tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fine, coarse = str(tmp_path / "fine.exr"), str(tmp_path / "coarse.exr")
    for command in (["render"], ["reference", "--estimator", "qmc", "--samples", "16"]):
        common = [*command, "--env", "studio", "--size", "16", "--material", "mx=.2,kd=.3"]
        assert run(capsys, *common, "--width", "24", "--height", "20", "-o", fine)[0] == 0
        size = ["--width", "12", "--height", "10", "--supersampling", "2"]
        assert run(capsys, *common, *size, "-o", coarse)[0] == 0
        rays = read_image(fine).rgb().astype(np.float64).reshape(10, 2, 12, 2, 3)
        np.testing.assert_allclose(read_image(coarse).rgb(), rays.mean(axis=(1, 3)), rtol=1e-6)
    planes = {p: read_planes(p).planes for p in (fine, coarse)}
    rays = planes[fine]["error.G"].astype(np.float64).reshape(10, 2, 12, 2)
    expected = np.sqrt(np.square(rays).mean(axis=(1, 3))) / 2.0
    np.testing.assert_allclose(planes[coarse]["error.G"], expected, rtol=1e-5)


def test_supersampling_and_refinement(
    tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = str(tmp_path / "a.exr")
    words = ["render", *SMALL, "--supersampling", "2", "--converge", "--passes", "1", "-o", out]
    assert run(capsys, *words)[0] == 0
    planes = read_planes(out).planes
    assert {p.shape for p in planes.values()} == {(10, 12)}
    assert set(planes) >= {"R", "estimate.G", "error.B"}
