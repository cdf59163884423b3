"""README is true: its example runs, its commands parse, its links lead somewhere."""

import contextlib
import io
import pathlib
import re
import shlex
import shutil

import pytest

from glossy.cli import build_parser, main

ROOT = pathlib.Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")), ROOT / "benchmarks/README.md"]


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)


def commands() -> list[str]:
    lines = [line for block in blocks("sh") for line in block.splitlines()]
    return [line.split("#")[0].strip() for line in lines if line.startswith("glossy ")]


def test_the_example_runs() -> None:
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        exec(compile(blocks("python")[0], "README.md", "exec"), {})
    assert "sum of taps" in said.getvalue()


@pytest.mark.parametrize("line", commands())
def test_the_commands_parse(line: str) -> None:
    args = build_parser().parse_args(shlex.split(line)[1:])
    assert callable(args.run)


SLOW = ("render room", "render hall", "--converge", "glossy fit", "stability", "study")
"""Lines with tests of their own: scenes of objects, fits, and what takes minutes."""

WHOLE = ("compare", "pattern", "environment", "material", "trace", "plan")
"""Commands that run as printed; the others make a smaller picture of a smaller map."""


def run_lines(lines: list[str]) -> dict[str, str]:
    """What each line of the shell's block says, one after another in the working folder."""
    said = {}
    for line in lines:
        words = shlex.split(line)[1:]
        if words[0] not in WHOLE:
            words += ["--size", "64", "--width", "48", "--height", "48"]
        out, err = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            code = main(words)
        assert (line, code, err.getvalue()) == (line, 0, "")
        said[line] = out.getvalue()
    return said


def test_the_shell_lines_run_one_after_another(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lines = [line for line in commands() if not any(part in line for part in SLOW)]
    assert len(lines) >= 9
    monkeypatch.chdir(tmp_path)
    make = ["environment", "studio", "--size", "64", "--layout", "latlong", "-o", "room.hdr"]
    assert main(["-q", *make]) == 0
    run_lines(lines)
    written = {word for line in lines for word in shlex.split(line) if word.endswith(".exr")}
    assert {p.name for p in tmp_path.iterdir()} >= written


def test_the_first_shell_lines_pass_on_a_real_map(
    real_data: pathlib.Path, tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On the map where the printed regular method misses the printed limit by most."""
    lines = [line for line in commands() if " room.hdr " in f"{line} " or "compare" in line][:4]
    assert [shlex.split(line)[1] for line in lines] == ["render", "reference", "compare", "render"]
    monkeypatch.chdir(tmp_path)
    shutil.copyfile(real_data / "env" / "studio_small_03_1k.hdr", "room.hdr")
    run_lines(lines)
    assert main(["-q", *shlex.split(lines[2].replace("shaded", "paper"))[1:]]) == 1


def test_the_example_has_ten_lines() -> None:
    lines = [x for x in blocks("python")[0].splitlines() if x.strip()]
    assert len(lines) <= 10


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_links_lead_somewhere(page: pathlib.Path) -> None:
    text = page.read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)#]+)[^)]*\)", text):
        if not target.startswith(("http:", "https:")):
            assert (page.parent / target).exists(), target


@pytest.mark.parametrize("command", ["render", "reference", "compare", "study", "trace", "pattern",
                                     "environment"])  # fmt: skip
def test_every_command_has_help_with_an_example(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stop:
        build_parser().parse_args([command, "--help"])
    assert stop.value.code == 0
    said = capsys.readouterr().out
    assert f"glossy {command} " in said.split("example", 1)[1]
