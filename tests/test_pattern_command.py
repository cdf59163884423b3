"""``glossy pattern`` from the command line."""

import json
import pathlib

import numpy as np
import pytest

import glossy
from glossy import cli
from glossy.commands import pattern as command
from glossy.export.tables import FORMATS


def test_json_to_standard_output(capsys: pytest.CaptureFixture[str]) -> None:
    line = "--mx .2 --my .075 --circles 4 --spacing s1 --threshold .2"
    code = cli.main(["pattern", *line.split()])
    data = json.loads(capsys.readouterr().out)
    expected = glossy.regular_pattern(glossy.Lobe(0.2, 0.075), 4, "s1", 0.2)
    assert code == 0
    assert (data["schema"], data["samples"]) == (1, 17)
    np.testing.assert_array_equal(np.array(data["half_vectors"]), expected.half_vectors)
    assert data["pdf_constant"] == expected.pdf_constant


@pytest.mark.parametrize(
    ("line", "count", "method"),
    [
        ("--mx .15", 19, "regular"),
        ("--mx .15 --samples 30", 30, "regular"),
        ("--mx .15 --circles 2", 14, "regular"),
        ("--mx .15 --method importance", 40, "importance"),
        ("--mx .15 --method importance --samples 7", 7, "importance"),
        ("--mx .15 --method thesis", 7, "thesis"),
        ("--mx .15 --method thesis --kind multi-ring --samples 10 --threshold .02", 10, "thesis"),
    ],
)
def test_counts(line: str, count: int, method: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["pattern", *line.split()]) == 0
    data = json.loads(capsys.readouterr().out)
    assert (len(data["half_vectors"]), data["method"]) == (count, method)
    assert data["widths"] == [0.15, 0.15]


@pytest.mark.parametrize("form", FORMATS)
def test_files_take_the_format_of_their_suffix(
    form: str, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / f"table.{form}"
    assert cli.main(["pattern", "--mx", "0.15", "-o", str(path)]) == 0
    assert capsys.readouterr().out == f"{path}: 19 half vectors, {form}\n"
    pattern = glossy.pattern_for_budget(glossy.Lobe(0.15))
    if form in command.SHADERS:
        expected = glossy.export_shader(glossy.Lobe(0.15), form, pattern=pattern)
    else:
        expected = pattern.export(form)
    assert path.read_text() == expected
    assert list(tmp_path.iterdir()) == [path]
    assert cli.main(["pattern", "--mx", "0.15", "--format", form]) == 0
    assert capsys.readouterr().out == expected


@pytest.mark.parametrize(
    "line",
    [
        "--mx .2 --my .075 --circles 4 --threshold .2",
        "--mx 1 --my .001 --samples 50",
        "--mx .15 --method importance",
        "--mx .15 --circles 1 --spacing s1",
    ],
)
def test_pictures(line: str, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "p.png"
    assert cli.main(["pattern", *line.split(), "--plot", str(path)]) == 0
    assert path.read_bytes().startswith(b"\x89PNG")
    assert capsys.readouterr().err == ""


def test_a_picture_needs_a_lobe(tmp_path: pathlib.Path) -> None:
    with pytest.raises(ValueError, match="pattern: must know its lobe"):
        command.plot(glossy.Pattern([[0, 0, 1]]), tmp_path / "p.png")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("--mx 0", "mx: must be in [1e-05, 10], got 0.0"),
        ("--mx .2 --my 20", "my: must be in [1e-05, 10], got 20.0"),
        ("--mx .2 --circles 3 --samples 9", "--samples: give it or --circles, not both"),
        ("--mx .2 --spacing s1", "--spacing: needs --circles; a budget tries both spacings"),
        ("--mx .2 --threshold 1", "threshold: must be in (0, 1), got 1.0"),
        ("--mx .2 --samples 0", "samples: must be from 1 to 100000, got 0"),
        (
            "--mx .2 --method importance --circles 3",
            "--circles: has no meaning with --method importance",
        ),
        ("--mx .2 --method thesis --spacing s1", "--spacing: has no meaning with --method thesis"),
        ("--mx .2 --kind ring", "--kind: has no meaning with --method regular"),
        ("--mx .2 --plot p.xyz", "plot: must end in .png, .pdf or .svg, got 'p.xyz'"),
        ("--mx .2 -o no/such/folder/p.json", "no/such/folder/p.json: its folder does not exist"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_two(
    line: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["pattern", *line.split()]) == 2
    out, err = capsys.readouterr()
    assert (out, err) == ("", f"glossy pattern: {message}\n")


def test_help_has_an_example(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        cli.main(["pattern", "--help"])
    assert stop.value.code == 0
    assert "glossy pattern --mx 0.2 --my 0.075" in capsys.readouterr().out
