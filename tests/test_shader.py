"""Exported shaders: run in software they give the picture of ``glossy.shade``.

What a machine lacks (moderngl and a software OpenGL, wgpu and a software adapter, glslang) is
reported as a skipped test with its reason.
"""

import pathlib
import re
import shlex
import shutil
import subprocess
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import software_gpu
from tolerances import SHADER

import glossy
from glossy import cli
from glossy.export.languages import LANGUAGES
from glossy.export.shader import EXPORTS

Array = npt.NDArray[Any]

PAGE = (pathlib.Path(__file__).parent.parent / "docs/shaders.md").read_text(encoding="utf-8")

RGB_LOBE = glossy.Lobe(0.2, 0.075, ks=(0.9, 0.6, 0.3), r0=(0.9, 0.5, 0.1), alpha=0.4)
WHITE = glossy.Lobe(0.15)
THROUGH = glossy.Material(transmission=[glossy.Lobe(0.25, 0.17, ks=0.67, r0=0.25, alpha=0.6)])
FOIL = glossy.Material(0.0, [glossy.Lobe(0.12, ks=0.8, r0=0.03), WHITE], THROUGH.transmission)
TABLE = glossy.Pattern(
    glossy.importance_pattern(WHITE, 5).half_vectors, cell=[0.01, 0.02, 0.03, 0.04, 0.05]
)
ROOM = glossy.BoundingPlanes.box([-1, -1, -1], [1, 1, 1], footprint="projected")

CASES: dict[str, tuple[glossy.Material | glossy.Lobe, str, dict[str, Any]]] = {
    "paper": (WHITE, "regular", {}),
    "projected": (RGB_LOBE, "regular", {"normalisation": "projected", "samples": 30}),
    "thesis footprint": (RGB_LOBE, "regular", {"footprint": "thesis", "bias": -0.75}),
    "jacobian footprint": (RGB_LOBE, "regular", {"footprint": "jacobian", "threshold": 0.2}),
    "wide lobe": (glossy.Lobe(0.6, alpha=1.0), "regular", {"threshold": 0.01}),
    "sharp lobe": (glossy.Lobe(1e-5, 1e-3, r0=0.04), "regular", {}),
    "two lobes and transmission": (FOIL, "regular", {"samples": 14}),
    "transmission": (THROUGH, "importance", {"samples": 9}),
    "importance": (RGB_LOBE, "importance", {"samples": 12, "bias": 0.5}),
    "thesis": (RGB_LOBE, "thesis", {"samples": 7, "bias": -0.5}),
    "thesis 4.23": (WHITE, "thesis", {"estimator": "4.23", "kind": "multi-ring"}),
    "thesis 4.24": (FOIL, "thesis", {"estimator": "4.24", "footprint": "jacobian"}),
    "lattice": (RGB_LOBE, "lattice", {"samples": 9, "bias": -0.25}),
    "lattice, white": (glossy.Lobe(0.02, 0.3), "lattice", {"samples": 8}),
    "lattice, round": (FOIL, "lattice", {"samples": 7}),
    "lattice, one": (WHITE, "lattice", {"samples": 3}),
    "table with its cells": (WHITE, "regular", {"pattern": TABLE, "footprint": "jacobian"}),
}


def unit(v: Array) -> Array:
    return np.asarray(v / np.linalg.norm(v, axis=-1, keepdims=True))


@pytest.fixture(scope="module")
def points() -> glossy.SurfacePoints:
    """Random frames and views, from behind, along the normal and grazing ones included."""
    random = np.random.default_rng(7)
    n, t, v = (unit(random.normal(size=(32, 32, 3))) for _ in range(3))
    v[0] = n[0]
    grazing = unit(np.cross(n[1], v[1]))
    v[1] = unit(grazing + np.linspace(1e-3, 0.1, 32)[:, None] * n[1])
    with pytest.warns(UserWarning, match="look into the surface"):
        return glossy.SurfacePoints(n, unit(t - np.sum(t * n, -1, keepdims=True) * n), v)


@pytest.fixture(scope="module")
def pyramid() -> glossy.Pyramid:
    """Half floats: what every texture format holds without change."""
    cube = glossy.environment("spots", size=32)
    return glossy.build_pyramid(cube, filter="gauss6", storage="rgba16f")


@pytest.fixture(scope="module")
def opengl() -> Any:
    reason = software_gpu.missing_opengl()
    if reason is not None:
        pytest.skip(reason)
    return software_gpu


@pytest.fixture(scope="module")
def webgpu() -> software_gpu.WebGPU:
    pytest.importorskip("wgpu", reason="wgpu is not installed")
    try:
        return software_gpu.WebGPU()
    except Exception as error:  # wgpu's own classes, RuntimeError, OSError
        pytest.skip(f"no software WebGPU: {error}")


@pytest.fixture(scope="module")
def glslang() -> str:
    found = shutil.which("glslangValidator")
    if found is None:
        pytest.skip("glslangValidator is not installed")
    return found


def export(case: str, language: str) -> str:
    material, method, options = CASES[case]
    return glossy.export_shader(material, language, method, **options)


def shaded(case: str, points: glossy.SurfacePoints, pyramid: glossy.Pyramid) -> Array:
    material, method, options = CASES[case]
    return glossy.shade(points, material, pyramid, method=method, **options)


def compiled(glslang: str, stage: str, source: str, folder: pathlib.Path, *flags: str) -> bytes:
    """SPIR-V of a source."""
    (folder / "source").write_text(source)
    out = folder / "out.spv"
    command = [glslang, *flags, "-S", stage, str(folder / "source"), "-o", str(out)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout
    return out.read_bytes()


@pytest.mark.parametrize("case", CASES)
def test_glsl_gives_the_picture(
    case: str, opengl: Any, points: glossy.SurfacePoints, pyramid: glossy.Pyramid
) -> None:
    expected = shaded(case, points, pyramid)
    assert expected.max() > 0.1
    seen = opengl.opengl(export(case, "glsl"), points, pyramid)
    assert glossy.relative_rms(seen, expected) < SHADER


def test_the_page_s_shader_gives_the_picture_of_glossy_render(
    opengl: Any, tmp_path: pathlib.Path
) -> None:
    """The text of docs/shaders.md with the output of ``glossy pattern``; rows from below in GL."""
    source = re.search(r"```glsl\n(.*?)```", PAGE, flags=re.DOTALL)
    assert source
    shader, picture = str(tmp_path / "glossy.glsl"), str(tmp_path / "render.exr")
    material = ["--material", "mx=.2,my=.075,r0=.6,alpha=.2", "--samples", "20"]
    scene = ["--env", "spots", "--size", "32"]
    assert cli.main(["pattern", *material, "--format", "glsl", "-o", shader]) == 0
    assert cli.main(["render", *scene, *material, "-o", picture]) == 0
    head, _, main = source[1].partition("// here: the output of glossy pattern --format glsl\n")
    text = head + pathlib.Path(shader).read_text() + main
    cube = glossy.build_pyramid(glossy.environment("spots", size=32))
    nothing = [np.zeros((256, 256, 3), dtype=np.float32)] * 3
    seen = opengl.draw(text, nothing, cube)[::-1]
    assert glossy.relative_rms(seen, glossy.read_image(picture).pixels) < SHADER


@pytest.mark.parametrize("blend", [0.0, 0.5])
def test_bounding_planes_turn_the_lookups(
    blend: float, opengl: Any, points: glossy.SurfacePoints, pyramid: glossy.Pyramid
) -> None:
    """Positions that the shader computes from the normal, in a box that is not about the origin."""
    room = glossy.BoundingPlanes.box([-1, -2, -1.5], [2, 1, 1], centre=[0.2, -0.3, 0], blend=blend)
    position = 0.5 * points.normal + np.array([0.25, 0.125, -0.25])
    with pytest.warns(UserWarning, match="look into the surface"):
        placed = glossy.SurfacePoints(points.normal, points.tangent, points.view, position=position)
    expected = glossy.shade(placed, FOIL, pyramid, parallax=room)
    assert glossy.relative_rms(glossy.shade(points, FOIL, pyramid), expected) > 0.1
    text = glossy.export_shader(FOIL, parallax=room)
    call = "glossyRadiance(env, n, t, v, 0.5 * n + vec3(0.25, 0.125, -0.25))"
    assert glossy.relative_rms(opengl.opengl(text, points, pyramid, call), expected) < SHADER


def test_two_shaders_stand_side_by_side(
    opengl: Any, points: glossy.SurfacePoints, pyramid: glossy.Pyramid
) -> None:
    text = "".join(
        glossy.export_shader(lobe, "glsl", method, name=name)
        for lobe, method, name in ((RGB_LOBE, "regular", "first"), (WHITE, "importance", "second"))
    )
    call = "firstRadiance(env, n, t, v) + secondRadiance(env, n, t, v)"
    both = glossy.shade(points, RGB_LOBE, pyramid)
    both += glossy.shade(points, WHITE, pyramid, method="importance")
    assert glossy.relative_rms(opengl.opengl(text, points, pyramid, call), both) < SHADER


@pytest.mark.parametrize("case", CASES)
def test_wgsl_is_valid_and_gives_the_picture(
    case: str, webgpu: Any, points: glossy.SurfacePoints, pyramid: glossy.Pyramid
) -> None:
    code = software_gpu.WGSL.format(functions=export(case, "wgsl"))
    if case.startswith("lattice") and case != "lattice, one":
        webgpu.device.create_shader_module(code=code)  # naga copies the tables at every use:
        return  # a minute and more in lavapipe's compiler
    if not webgpu.seamless:
        webgpu.compile(code)
        pytest.skip("valid; not run: wgpu over OpenGL does not filter across the faces' edges")
    seen = webgpu.run(code, points, pyramid)
    assert glossy.relative_rms(seen, shaded(case, points, pyramid)) < SHADER


@pytest.mark.parametrize("case", CASES)
def test_hlsl_compiles(case: str, glslang: str, tmp_path: pathlib.Path) -> None:
    source = software_gpu.HLSL.format(functions=export(case, "hlsl"))
    assert compiled(glslang, "comp", source, tmp_path, "-D", "-V", "-e", "main")


@pytest.mark.parametrize("case", ["two lobes and transmission", "importance"])
def test_hlsl_gives_the_picture(
    case: str,
    glslang: str,
    webgpu: Any,
    points: glossy.SurfacePoints,
    pyramid: glossy.Pyramid,
    tmp_path: pathlib.Path,
) -> None:
    source = software_gpu.HLSL.format(functions=export(case, "hlsl"))
    binary = compiled(glslang, "comp", source, tmp_path, "-D", "-V", "-e", "main")
    if not webgpu.seamless:
        pytest.skip("not run: wgpu over OpenGL does not filter across the faces' edges")
    seen = webgpu.run(binary, points, pyramid)
    assert glossy.relative_rms(seen, shaded(case, points, pyramid)) < SHADER


@pytest.mark.parametrize("version", ["330", "300 es", "450"])
def test_glsl_compiles_from_3_30_and_es_3_00_on(
    version: str, glslang: str, tmp_path: pathlib.Path
) -> None:
    precision = "precision highp float;" if "es" in version else ""
    source = software_gpu.FRAGMENT.replace("330", f"{version}\n{precision}").format(
        functions=export("two lobes and transmission", "glsl"), call="glossyRadiance(env, n, t, v)"
    )
    (tmp_path / "shader.frag").write_text(source)
    done = subprocess.run([glslang, str(tmp_path / "shader.frag")], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_constants_are_the_patterns(language: str) -> None:
    pattern = glossy.pattern_for_budget(RGB_LOBE, 20, 0.2)
    text = glossy.export_shader(RGB_LOBE, language, pattern=pattern)
    table = re.search(r"GLOSSY1_TAPS\b.*?\n(.*?)\n[)}];", text, flags=re.DOTALL)
    assert table
    rows = [re.sub(r".*\((.*)\),?", r"\1", line).split(",") for line in table[1].splitlines()]
    taps = np.array(rows, dtype=np.float32)
    np.testing.assert_array_equal(taps[:, :3], pattern.half_vectors.astype(np.float32))
    density = RGB_LOBE.pdf(2 * taps[:, 2:3] * taps[:, :3] - [0, 0, 1], [0, 0, 1]) * 4
    np.testing.assert_allclose(taps[:, 3], density, rtol=1e-5)
    for name, value in (
        ("PDF", pattern.pdf_constant),
        ("PDF_PROJECTED", pattern.projected_pdf_constant),
    ):
        number = re.search(rf"GLOSSY1_{name}\b.*?= ([\d.e+-]+);", text)
        assert number
        assert np.float32(float(number[1])) == np.float32(value)


@pytest.mark.parametrize("language", LANGUAGES)
def test_nothing_is_paid_for_that_the_material_does_not_have(language: str) -> None:
    bare = glossy.export_shader(WHITE, language, footprint="jacobian")
    for word in ("Fresnel", "pow(", "LobeArea", "Lobe2", "ALPHA", "- normal"):
        assert word not in bare
    text = glossy.export_shader(FOIL, language)
    assert "diffuse part left out" not in text
    assert "diffuse part left out" in glossy.export_shader(glossy.material("white-foil"), language)
    for word in ("Fresnel(", "FresnelRest(", "LobeArea(", "Lobe3(", "- normal"):
        assert word in text


@pytest.mark.parametrize("method", EXPORTS)
@pytest.mark.parametrize("language", LANGUAGES)
def test_the_text_is_tidy(language: str, method: str) -> None:
    text = glossy.export_shader(FOIL, language, method)
    assert "$" not in text
    assert text.isascii()
    if language != "wgsl":
        code = re.sub("//.*", "", text)
        assert not re.search(r"\b(let|var|fn|f32|i32|textureSampleLevel)\b|->|vec\d<|: ", code)
    assert text.endswith("}\n")
    assert not re.search(r"[ \t]$", text, flags=re.MULTILINE)
    assert max(map(len, text.splitlines())) <= 102
    assert all(f"({k})" in text for k in range(1, 8))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"language": "metal"}, "language: must be one of glsl, hlsl, wgsl, got 'metal'"),
        ({"method": "magic"}, "method: must be one of regular, importance, thesis"),
        ({"name": "gl_"}, "name: must be letters and digits, a letter first, got 'gl_'"),
        ({"footprint": "x"}, "footprint: must be one of paper, thesis, jacobian"),
        ({"normalisation": "x"}, "normalisation: must be one of paper, projected"),
        ({"bias": np.inf}, "bias: must be finite"),
        ({"kernel": "plain"}, "kernel: is no option of method 'regular' as a shader"),
        ({"method": "importance", "threshold": 0.1}, "threshold: is no option of method"),
        ({"material": glossy.Material(0.5)}, "material: must have a glossy lobe with ks > 0"),
        ({"method": "lattice", "pattern": TABLE}, "pattern: is no option of method 'lattice'"),
        ({"method": "lattice", "filter": "x"}, "filter: must be one of box, gauss4, gauss6"),
        ({"parallax": ROOM}, "parallax: must have footprint 'thesis' as a shader"),
        ({"parallax": glossy.BoundingPlanes([0, 0, 0], [])}, "parallax: must have planes"),
        ({"pattern": [TABLE, TABLE]}, "pattern: must be a Pattern or 1"),
        ({"pattern": glossy.Pattern([[0, 0, 1]]), "footprint": "jacobian"}, "pattern: must have a"),
        ({"material": glossy.Lobe(0.1, ks=1e39)}, "shader: must hold numbers of single precision"),
        (
            {"material": glossy.Lobe(1e-3), "pattern": glossy.Pattern([[0.1, 0, np.sqrt(0.99)]])},
            "pattern: must have a density that single precision holds",
        ),
    ],
)
def test_refusals(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)) as error:
        glossy.export_shader(**{"material": WHITE, **arguments})
    assert "\n" not in str(error.value)


def test_a_file_is_written_whole_or_not_at_all(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "shader.wgsl"
    text = glossy.export_shader(WHITE, "wgsl", path=path)
    assert path.read_text() == text
    with pytest.raises(ValueError, match="bias"):
        glossy.export_shader(WHITE, "wgsl", path=tmp_path / "other.wgsl", bias=np.nan)
    assert list(tmp_path.iterdir()) == [path]


def test_the_command_exports_the_lattice(capsys: pytest.CaptureFixture[str]) -> None:
    line = "pattern --mx .1 --method lattice --samples 5 --filter round --format wgsl"
    assert cli.main(line.split()) == 0
    expected = glossy.export_shader(glossy.Lobe(0.1), "wgsl", "lattice", samples=5, filter="round")
    assert capsys.readouterr().out == expected


def test_the_command_exports_the_whole_material(
    tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = "--material white-foil --samples 7 --footprint thesis --bias -0.5 --name foil"
    assert cli.main(["pattern", *line.split(), "-o", str(tmp_path / "foil.hlsl")]) == 0
    assert capsys.readouterr().out.endswith("foil.hlsl: 7 + 7 half vectors, hlsl\n")
    foil = glossy.material("white-foil")
    expected = glossy.export_shader(
        foil, "hlsl", samples=7, footprint="thesis", bias=-0.5, name="foil"
    )
    assert (tmp_path / "foil.hlsl").read_text() == expected


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("", "--mx: give it, or --material"),
        ("--mx .1 --material miro-5", "--material: give it or --mx and --my, not both"),
        ("--material white-foil", "--material: json holds the pattern of one lobe, white-foil has"),
        (
            "--material white-foil --format glsl --plot p.png",
            "--material: --plot draws the pattern of one lobe, white-foil has 2",
        ),
        ("--material kd=.5 --format glsl", "--material: must have a glossy lobe, kd=.5 has none"),
        ("--mx .1 --bias .5", "--bias: has no meaning with --format json"),
        ("--mx .1 --elongation 2", "--elongation: has no meaning with --method regular"),
        (
            "--mx .1 --method lattice --format glsl --elongation 2",
            "--elongation: has no meaning with --format glsl",
        ),
        ("--mx .1 --method lattice --kind line", "--kind: has no meaning with --method lattice"),
        ("--method lattice --elongation .5", "elongation: must be"),
        ("--mx .1 --format glsl --name 3d", "name: must be letters and digits, a letter first"),
        (
            "--mx .1 --method importance --format glsl --footprint paper",
            "footprint: is no option of method 'importance' as a shader",
        ),
    ],
)
def test_bad_input_is_one_line(line: str, message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["pattern", *line.split()]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"glossy pattern: {message}")
    assert err.count("\n") == 1


@pytest.mark.parametrize("line", re.findall(r"^glossy .*", PAGE, flags=re.MULTILINE))
def test_the_page_s_commands_parse(line: str) -> None:
    args = cli.build_parser().parse_args(shlex.split(line)[1:])
    assert callable(args.run)
