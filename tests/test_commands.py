"""The rendering commands: exit codes, one-line errors, JSON, and what they write."""

import json
import pathlib
import signal
import subprocess
import sys
import time
from typing import Any

import numpy as np
import pytest
from processes import interruptible

from glossy.cli import main
from glossy.image import read_image, read_planes

SMALL = ["--size", "16", "--width", "12", "--height", "10"]


def run(capsys: pytest.CaptureFixture[str], *args: str) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of a command."""
    try:
        code = main(list(args))
    except SystemExit as stop:
        code = int(stop.code or 0)
    said = capsys.readouterr()
    return code, said.out, said.err


def report(capsys: pytest.CaptureFixture[str], *args: str) -> dict[str, Any]:
    """The JSON of a command that must succeed."""
    code, out, err = run(capsys, *args, "--json")
    assert (code, err) == (0, "")
    value: dict[str, Any] = json.loads(out)
    assert value["schema"] == 1
    assert value["command"] == args[0]
    return value


@pytest.mark.parametrize("command", ["render", "reference", "trace", "study"])
def test_help_has_an_example(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = run(capsys, command, "--help")
    assert code == 0
    assert f"examples:\n  glossy {command} " in out


def test_render_writes_linear_exr(
    tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = str(tmp_path / "a.exr")
    value = report(capsys, "render", *SMALL, "--samples", "20", "--threshold", ".2", "-o", out)
    assert (value["width"], value["height"], value["samples"]) == (12, 10, [19])
    assert value["options"] == {"threshold": 0.2}
    assert read_image(out).rgb().shape == (10, 12, 3)
    assert [p.name for p in tmp_path.iterdir()] == ["a.exr"]


@pytest.mark.parametrize("suffix", ["png", "hdr"])
def test_render_writes_other_formats(
    suffix: str, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / f"a.{suffix}"
    code, text, err = run(capsys, "render", *SMALL, "-o", str(out))
    assert (code, err) == (0, "")
    assert "samples: 19" in text
    assert read_image(out, encoding="srgb").rgb().max() > 0.0


def test_a_scene_file_is_overridden_by_arguments(
    tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = tmp_path / "s.toml"
    scene.write_text(
        '[environment]\nsource = "white"\nsize = 8\n[camera]\nwidth = 9\nheight = 9\n'
        '[method]\nname = "importance"\nsamples = 5\nbias = 0.5\n'
    )
    out = str(tmp_path / "a.exr")
    value = report(capsys, "render", str(scene), "-o", out)
    assert (value["environment"], value["size"], value["samples"]) == ("white", 8, [5])
    assert (value["method"], value["options"], value["width"]) == ("importance", {"bias": 0.5}, 9)
    value = report(
        capsys, "render", str(scene), "--samples", "6", "--bias", "0", "--width", "7",
        "--env", "studio", "-o", out,
    )  # fmt: skip
    assert (value["environment"], value["samples"], value["width"]) == ("studio", [6], 7)
    assert (value["options"], value["height"], value["size"]) == ({"bias": 0.0}, 9, 8)


def test_reference_writes_its_error_beside_the_picture(
    tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "t.exr"
    value = report(capsys, "reference", *SMALL, "--tolerance", "1e-2", "-o", str(out))
    planes = read_planes(out).planes
    assert set(planes) == {"R", "G", "B", "error.R", "error.G", "error.B"}
    assert value["error_kind"] == "bound"
    assert 0.0 < value["relative_rms_error"] < 1e-2
    rms = np.sqrt(np.mean([np.sum(planes[f"error.{c}"] ** 2) for c in "RGB"]) / value["covered"])
    assert value["rms_error"] == pytest.approx(rms, rel=1e-5)  # the file is float32


def test_trace_of_the_thesis_method(capsys: pytest.CaptureFixture[str]) -> None:
    options = ["--method", "thesis", "--estimator", "4.23", "--kind", "ring", "--samples", "9"]
    value = report(capsys, "trace", *SMALL, "--pixel", "5,4", *options)
    assert len(value["taps"]) == 9
    kept = [tap for tap in value["taps"] if tap["kept"]]
    total = np.sum([tap["pdf_wi"] for tap in kept])
    assert np.allclose(value["normaliser"], [[total] * 3], rtol=1e-6)
    assert np.allclose([tap["share"][0] for tap in kept], [t["pdf_wi"] / total for t in kept],
                       rtol=1e-5)  # fmt: skip


def test_trace_lists_every_tap(capsys: pytest.CaptureFixture[str]) -> None:
    value = report(capsys, "trace", *SMALL, "--pixel", "5,4", "--samples", "14")
    assert value["pixel"] == [5, 4]
    assert len(value["taps"]) == 14
    total = np.sum([tap["contribution"] for tap in value["taps"]], axis=0)
    assert np.allclose(total, value["radiance"], rtol=1e-5)  # float32 sums
    code, text, _ = run(capsys, "trace", *SMALL, "--pixel", "5,4")
    assert code == 0
    assert "difference of sum and pixel" in text


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["render", "--method", "magic", "-o", "a.exr"], "method: must be one of"),
        (["render", "-o", "a.gif"], "--output: must end in .exr"),
        (["render", "-o", "absent/a.exr"], "--output: no folder"),
        (["render", "--env", "nowhere", "-o", "a.exr"], "environment: must be a file"),
        (["render", "--material", "mx=-1", "-o", "a.exr"], "mx: must be in"),
        (["render", "--samples", "0", "-o", "a.exr"], "samples: must be at least 1"),
        (["render", "--threshold", "2", "-o", "a.exr"], "threshold: must be in"),
        (["render", "--footprint", "huge", "-o", "a.exr"], "footprint: must be one of"),
        (["render", "--filter", "sinc", "-o", "a.exr"], "filter: must be one of"),
        (["render", "--method", "importance", "--threshold", ".1", "-o", "a.exr"], "no option"),
        (["render", "--width", "0", "-o", "a.exr"], "width: must be"),
        (["render", "absent.toml", "-o", "a.exr"], "absent.toml: no such"),
        (["render", "--gbuffer", "absent.npz", "-o", "a.exr"], "absent.npz: no such"),
        (["render", "--gbuffer", "g.npz", "--shape", "plane", "-o", "a.exr"], "no meaning"),
        (["reference", "--tolerance", "-1", "-o", "a.exr"], "tolerance"),
        (["trace", "--pixel", "3"], "--pixel: must be X,Y"),
        (["trace", "--pixel", "900,3"], "pixel: must be inside"),
        (["study", "--methods", "regular/mine", "-o", "s"], "must be one of paper"),
        (["study", "--methods", "importance/paper", "-o", "s"], "no option of method"),
        (["study", "--samples", "7,x", "-o", "s"], "samples: must be whole numbers"),
        (["study", "--samples", "7,7", "-o", "s"], "samples: must be at least one, each once"),
        (["study", "--material", "kd=1", "-o", "s"], "material: must have a glossy lobe"),
        (["study", "--samples", "0", "-o", "s"], "samples: must be at least 1"),
        (["study", "--repeats", "0", "-o", "s"], "repeats: must be at least 1"),
        (["study", "--reference-tolerance", "0", "-o", "s"], "reference tolerance: must be"),
        (["study", "--filter", "sinc", "-o", "s"], "filter: must be one of"),
        (["study", "--size", "12", "-o", "s"], "power of two"),
        (["study", "--width", "1", "--shape", "plane", "-o", "s"], "less than two pixels"),
        (["study", "--env", "nowhere", "-o", "s"], "environment: must be a file"),
        (["render", "--material", "nowhere", "-o", "a.exr"], "material"),
        (["trace", "--material", "mx=.2,colour=1", "--pixel", "1,1"], "colour"),
        (["trace", "--pixel=-1,3"], "pixel: must be inside"),
        (["trace", "--pixel", "-1,3"], "pixel: must be inside"),
        (["trace", "--pixel", "0,0"], "pixel: must see the surface"),
        (["reference", "--samples", "64", "-o", "absent/t.exr"], "--output: no folder"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(
    args: list[str],
    words: str,
    tmp_path: pathlib.Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, err = run(capsys, *args[:1], "--size", "16", *args[1:])
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    assert err.startswith(f"glossy {args[0]}: ")
    assert words in err
    assert not list(tmp_path.iterdir())


def test_a_missing_output_is_the_parsers_error(capsys: pytest.CaptureFixture[str]) -> None:
    code, _, err = run(capsys, "render")
    assert code == 2
    assert "-o/--output" in err


def test_study_command(tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "out"
    args = [
        "study", "--env", "studio", "--size", "16", "--width", "10", "--material", "mx=.2",
        "--methods", "regular/paper,importance", "--samples", "7,14", "--repeats", "1",
        "-o", str(folder),
    ]  # fmt: skip
    code, out, err = run(capsys, *args)
    assert (code, err) == (0, "")
    assert "iso m=0.2: RMS error / RMS of the truth [%]" in out
    assert "The paper's claims in these runs" in out
    first = json.loads((folder / "study.json").read_text())
    again = report(capsys, *args, "--resume")
    assert again["cells"] == first["cells"]
    assert len(again["sessions"]) == 2
    code, _, err = run(capsys, *args)
    assert code == 2
    assert "--resume continues it" in err


@pytest.mark.parametrize("command", ["render", "reference", "trace", "study"])
def test_a_bad_scene_file_names_the_file_and_the_dotted_key(
    command: str, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = tmp_path / "s.toml"
    rest = ["--pixel", "1,1"] if command == "trace" else ["-o", str(tmp_path / "o.exr")]
    for text, words in (
        ("[camera]\nfocus = 3\n", "camera.focus: unknown key"),
        ("[environment]\nsource = 3\n", "source: must be a name or a path, got 3"),
        ("[shape\n", ""),
    ):
        scene.write_text(text)
        code, out, err = run(capsys, command, str(scene), *rest)
        assert (code, out, err.count("\n")) == (2, "", 1)
        assert err.startswith(f"glossy {command}: {scene}: {words}")
    assert [p.name for p in tmp_path.iterdir()] == ["s.toml"]


@pytest.mark.parametrize("command", ["render", "reference", "study"])
def test_an_output_in_the_way_of_a_file_is_refused(
    command: str, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("mine")
    code, out, err = run(capsys, command, *SMALL, "-o", str(tmp_path / "file" / "o.exr"))
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert (tmp_path / "file").read_text() == "mine"


@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGKILL])
def test_an_interrupted_study_is_one_line_and_keeps_its_cells(
    sent: signal.Signals, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A real signal to a real process, once a cell is there; --resume then finishes."""
    folder = tmp_path / "out"
    args = [
        "study", "--env", "studio", "--size", "16", "--width", "12", "--material", "mx=.2",
        "--methods", "regular/paper,importance", "--samples", "7,14", "--repeats", "40",
        "-o", str(folder),
    ]  # fmt: skip
    program = interruptible(*args)
    with subprocess.Popen(program, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        while process.poll() is None and not list(folder.glob("cells/[!.]*.json")):
            time.sleep(0.005)
        process.send_signal(sent)
        out, err = process.communicate(timeout=120)
    polite = sent == signal.SIGINT
    said = b"glossy study: interrupted\n" if polite else b""
    assert (process.returncode, out, err) == (130 if polite else -sent, b"", said)
    kept = {path: path.read_bytes() for path in folder.glob("cells/[!.]*")}
    assert 1 <= len(kept) < 8
    value = report(capsys, *args, "--resume")
    assert len(value["cells"]) == 8
    assert all(path.read_bytes() == content for path, content in kept.items())
    assert sum(cell["session"] == 0 for cell in value["cells"]) == len(kept)


def test_a_reader_that_goes_away_ends_the_command_quietly() -> None:
    program = [sys.executable, "-m", "glossy.cli", "pattern", "--mx", ".1", "--format", "json"]
    with subprocess.Popen(program, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as started:
        assert started.stdout is not None
        assert started.stderr is not None
        started.stdout.close()  # long before it writes
        said = started.stderr.read()
    assert (started.returncode, said) == (128 + signal.SIGPIPE, b"")


def test_tracing_auto_is_tracing_what_it_chose(capsys: pytest.CaptureFixture[str]) -> None:
    at = [*SMALL, "--pixel", "5,4", "--material", "mx=.2,my=.075"]
    value = report(capsys, "trace", *at, "--method", "auto", "--max-error", ".1")
    assert value["method"] == "auto"
    assert value["difference"] < 1e-5 * max(value["radiance"])
    (part,), (row,) = value["parts"], value["plan"]["lobes"]
    assert (part["method"], part["options"]["samples"]) == (row["method"], row["samples"])
    direct = [*at, "--method", row["method"], "--samples", str(row["samples"])]
    if "footprint" in part["options"]:
        direct += ["--footprint", part["options"]["footprint"]]
    alone = report(capsys, "trace", *direct)
    assert part["taps"] == alone["taps"]
    code, text, _ = run(capsys, "trace", *at, "--method", "auto")
    assert code == 0
    assert "lobes 0 of the material:" in text
