"""Who may import whom, and what may not be loaded early."""

import ast
import pathlib
import subprocess
import sys

import pytest

import glossy

PACKAGE = pathlib.Path(glossy.__file__).parent
MODULES = sorted(p.relative_to(PACKAGE).with_suffix("").as_posix() for p in PACKAGE.rglob("*.py"))

JUDGED = {
    "pyramid", "sampler", "seams", "footprint", "shading", "pattern", "trace", "methods",
    "thesis", "thesis_pattern", "tap_table",
}  # fmt: skip
"""What the ground truth judges and must share nothing with."""

BUILT_ON_IT = (
    "commands/",
    "measured/",
    "pem/",
    "planar/",
    "planning/",
    "prefiltered/",
    "scenes/",
    "study/",
)
"""Subpackages that the core does not know."""

LIGHT = [
    "metrics",
    "image",
    "commands/compare",
    "cli",
    "pattern",
    "thesis_pattern",
    "commands/pattern",
    "export/tables",
    "prefiltered/stack",
]
"""What starts without the compiler."""


def imports(module: str) -> set[str]:
    """Modules of the package that ``module`` names anywhere, functions included."""
    path = PACKAGE / f"{module}.py"
    parent = module.split("/")[:-1]
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = parent[: len(parent) - (node.level - 1)]
            name = [*base, *(node.module.split(".") if node.module else [])]
            found.add("/".join(name))
            found |= {"/".join([*name, alias.name]) for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and (node.module or "").startswith("glossy"):
            found.add("/".join((node.module or "").split(".")[1:]))
    known = found & set(MODULES)
    return known | {m for m in MODULES if m.endswith("/__init__") and m[:-9] in found}


def reachable(module: str) -> set[str]:
    """Everything that ``module`` leads to."""
    seen: set[str] = set()
    todo = [module]
    while todo:
        for name in imports(todo.pop()) - seen:
            seen.add(name)
            todo.append(name)
    return seen


@pytest.mark.parametrize("module", ["reference", *(m for m in MODULES if m.startswith("truth/"))])
def test_the_truth_shares_nothing_with_what_it_judges(module: str) -> None:
    assert not reachable(module) & JUDGED


@pytest.mark.parametrize(
    "module", ["cubemap", "brdf", "pyramid", "pattern", "shading", "footprint", "thesis"]
)
def test_the_core_does_not_know_what_is_built_on_it(module: str) -> None:
    above = {"scene", "render", "cli", "metrics", "image", "reference", "export/shader"}
    forbidden = {m for m in MODULES if m in above or m.startswith(BUILT_ON_IT)}
    assert not reachable(module) & forbidden


@pytest.mark.parametrize("module", [m for m in MODULES if m.startswith("scenes/")])
def test_scenes_do_not_know_what_is_built_on_them(module: str) -> None:
    assert not {m for m in reachable(module) if m.startswith("planar/")}


def test_the_truth_of_planar_reflectors_knows_no_buffer() -> None:
    named = imports("planar/truth") | imports("truth/rays")
    assert not {m for m in named if m.startswith("planar/")}


def test_the_truth_with_shadows_knows_neither_maps_nor_shadow_maps() -> None:
    found, todo = set(), {"pem/truth"}
    while todo:  # packages load their names on use alone
        found |= todo
        todo = {n for m in todo for n in imports(m) if not n.endswith("__init__")} - found
    assert "scenes/intersect" in found
    assert not found & JUDGED
    assert {m for m in found if m.startswith("pem/")} == {"pem/truth"}


@pytest.mark.parametrize("module", MODULES)
def test_only_one_module_decorates_kernels(module: str) -> None:
    text = (PACKAGE / f"{module}.py").read_text()
    assert module == "_jit" or ("njit" not in text and "@jit" not in text)


def run(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout


@pytest.mark.parametrize("module", LIGHT)
def test_light_modules_do_not_load_the_compiler(module: str) -> None:
    name = "glossy." + module.replace("/", ".")
    assert run(f"import sys, {name}; print('numba' in sys.modules)").strip() == "False"


def test_importing_the_package_loads_neither_numpy_nor_the_compiler() -> None:
    code = "import sys, glossy; print({'numpy', 'numba', 'scipy'} & set(sys.modules))"
    assert run(code).strip() == "set()"


def test_every_public_name_resolves() -> None:
    for name in glossy.__all__:
        assert getattr(glossy, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = glossy.nothing


def test_functions_survive_the_import_of_the_module_of_the_same_name() -> None:
    code = "import glossy, glossy.trace, glossy.reference; print(callable(glossy.trace))"
    assert run(code).strip() == "True"
