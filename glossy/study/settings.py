"""What a study measures: cases, methods, budgets, thresholds; and on what machine."""

import dataclasses
import functools
import hashlib
import json
import os
import pathlib
import platform
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from .. import _check
from .._threads import threads

if TYPE_CHECKING:
    from ..brdf import Material

METHODS = ("regular/paper", "regular/thesis", "regular/jacobian", "importance")
BUDGETS = (7, 14, 20, 30, 50, 100, 270)
VARIANTS = {
    "regular": "normalisation",
    "thesis": "estimator",
    "split-sum": "equivalent",
    "bent": "bend",
    "auto": "max_error",
}
"""Which option of a method its variant is."""
PREPARED = {"pem": "filter", "prefiltered": "mode"}
"""Which option of a method's preparation its variant is; the plan's own is not for these."""
LOBES = ("mx=.1", "mx=.15", "mx=.2,my=.075")
SCHEDULE = ((20, 0.2), (50, 0.1))  # largest budget of each threshold; above: FINE_THRESHOLD
FINE_THRESHOLD = 0.01


def threshold_for(budget: int) -> float:
    """The paper's thresholds: 0.2 at 14 and 17 samples, 0.1 at 30, 0.01 at 270.

    In between: 0.2 up to 20, 0.1 up to 50, 0.01 above.
    """
    return next((value for top, value in SCHEDULE if budget <= top), FINE_THRESHOLD)


@dataclasses.dataclass(frozen=True)
class MethodSpec:
    """A method with its footprint and variant, written ``name/footprint/variant``.

    What the variant is: ``VARIANTS``, ``PREPARED``. Without a footprint: ``name/variant``.
    """

    name: str
    footprint: str | None = None
    variant: str | None = None

    @property
    def label(self) -> str:
        """The text that ``parse_method`` reads back."""
        return "/".join(p for p in (self.name, self.footprint, self.variant) if p)

    @property
    def options(self) -> dict[str, Any]:
        """Options of ``shade`` that the spec fixes."""
        named = {"footprint": self.footprint}
        if self.name not in PREPARED:
            named[VARIANTS.get(self.name, "variant")] = self.variant
        if self.name == "auto" and self.variant is not None:
            return {"max_error": float(self.variant)}
        return {k: v for k, v in named.items() if v is not None}

    @property
    def preparation(self) -> dict[str, str]:
        """Options of the method's preparation that the spec fixes."""
        own = self.variant is not None and self.name in PREPARED
        return {PREPARED[self.name]: str(self.variant)} if own else {}


def parse_method(text: str) -> MethodSpec:
    """A method from ``name``, ``name/footprint``, ``name/footprint/variant`` or ``name/variant``.

    Raises
    ------
    ValueError
        For an unknown name, or an option the method does not have or does not know.
    """
    from .. import methods
    from ..footprint import FOOTPRINTS
    from ..pem.shade import FOOTPRINTS as PEM_FOOTPRINTS
    from ..prefiltered.approximate import MODES
    from ..pyramid import FILTERS
    from ..shading import NORMALISATIONS
    from ..splitsum.shade import BENDS, EQUIVALENTS
    from ..thesis import ESTIMATORS

    parts = text.strip().split("/")
    if len(parts) > 3:
        raise _check.fail("methods", "must be name[/footprint[/variant]]", text)
    spec = MethodSpec(*parts)
    if len(parts) == 2 and "footprint" not in methods.options(spec.name):
        spec = MethodSpec(spec.name, None, parts[1])
    if spec.name == "auto" and spec.variant is not None:
        _check_error(text, spec.variant)
        return spec
    methods.check_options(spec.name, spec.options)
    if spec.footprint is not None:
        known = PEM_FOOTPRINTS if spec.name == "pem" else FOOTPRINTS
        _check.choice(f"methods: {text}", spec.footprint, known)
    if spec.preparation:
        modes = MODES if spec.name == "prefiltered" else FILTERS
        _check.choice(f"methods: {text}", spec.variant, modes)
    elif spec.variant is not None:
        variants = {
            "normalisation": NORMALISATIONS,
            "estimator": ESTIMATORS,
            "equivalent": EQUIVALENTS,
            "bend": BENDS,
        }
        _check.choice(f"methods: {text}", spec.variant, variants[VARIANTS[spec.name]])
    return spec


def _check_error(text: str, variant: str) -> None:
    rule = "must be auto/X with an error X in (0, 1)"
    try:
        error = float(variant)
    except ValueError:
        raise _check.fail("methods", rule, text) from None
    if not 0.0 < error < 1.0:
        raise _check.fail("methods", rule, text)


@dataclasses.dataclass(frozen=True)
class Case:
    """A material under study; its diffuse part is left out."""

    name: str
    material: "Material"

    @property
    def widths(self) -> list[float]:
        """(mx, my) of the first lobe."""
        return list(self.material.lobes[0].widths)

    @property
    def kind(self) -> str:
        """Name of the group: "aniso" if any lobe is, else "iso"."""
        return "aniso" if any(a != b for a, b in (x.widths for x in self.material.lobes)) else "iso"

    @property
    def slug(self) -> str:
        """The name as a file name."""
        return re.sub(r"[^A-Za-z0-9.]+", "-", self.name).strip("-")


def case_of(material: "Material", name: str | None = None) -> Case:
    """A case without the diffuse part; named after its first lobe unless ``name`` is given.

    Raises
    ------
    ValueError
        If the material has no glossy lobe.
    """
    if not material.sided_lobes():
        raise _check.fail("material", "must have a glossy lobe with ks > 0", material)
    if name is None:
        mx, my = material.lobes[0].widths
        name = f"iso m={mx:g}" if mx == my else f"aniso ({mx:g}, {my:g})"
        if len(material.lobes) > 1:
            name += f" and {len(material.lobes) - 1} more"
    return Case(name, dataclasses.replace(material, kd=0.0))


def restored_case(described: dict[str, Any]) -> Case:
    """The case that ``Plan.describe`` describes.

    Raises
    ------
    ValueError
        If its material cannot be made of what is written there.
    """
    from ..brdf import Lobe, Material

    name, material = described["name"], dict(described["material"])
    try:
        for side in ("reflection", "transmission"):
            material[side] = [Lobe(**lobe) for lobe in material[side]]
        case = Case(name, Material(**material))
        same = _plain(dataclasses.asdict(case.material)) == described["material"]
    except (TypeError, KeyError):
        same = False
    if not same:
        raise ValueError(f"cases: the material of {name!r} must be named again: --material")
    return case


def _plain(value: Any) -> Any:
    return json.loads(json.dumps(value))


def default_cases() -> list[Case]:
    """The paper's three lobes, F = 1 and alpha = 0."""
    from ..materials import parse_material

    return [case_of(parse_material(text)) for text in LOBES]


@dataclasses.dataclass(frozen=True)
class Plan:
    """A whole study. ``tolerance``: asked of the truth; ``subset``: pixels of the bias search.

    ``baseline``: case, method and budget, all of the plan, whose time is the unit of the others';
    None: the first case and method, the smallest budget.
    """

    cases: Sequence[Case]
    methods: Sequence[MethodSpec]
    budgets: Sequence[int] = BUDGETS
    filter: str = "gauss6"
    storage: str = "rgba32f"
    tolerance: float = 1e-3
    repeats: int = 3
    subset: int = 1200
    baseline: tuple[str, str, int] | None = None

    def __post_init__(self) -> None:
        for budget in self.budgets:
            _check.count("samples", budget)
        _check.positive("reference tolerance", self.tolerance)
        _check.count("repeats", self.repeats)
        named: dict[str, list[Any]] = {
            "cases": [case.name for case in self.cases],
            "methods": [method.label for method in self.methods],
            "samples": list(self.budgets),
        }
        for name, items in named.items():
            if not items or len(set(items)) != len(items):
                raise _check.fail(name, "must be at least one, each once", items)

    @property
    def reference(self) -> tuple[str, str, int]:
        """Case, method and budget of the baseline."""
        first = self.cases[0].name, self.methods[0].label, min(self.budgets)
        return first if self.baseline is None else self.baseline

    @property
    def preparation(self) -> dict[str, str]:
        """Options of the pyramid, and of other preparations that have them."""
        return {"filter": self.filter, "storage": self.storage}

    def describe(self) -> dict[str, Any]:
        """The plan, fit for JSON; two studies with the same description measure the same."""
        return {
            "cases": [
                {"name": c.name, "material": dataclasses.asdict(c.material)} for c in self.cases
            ],
            "methods": [m.label for m in self.methods],
            "budgets": list(self.budgets),
            "thresholds": {str(b): threshold_for(b) for b in self.budgets},
            **self.preparation,
            "reference_tolerance": self.tolerance,
            "repeats": self.repeats,
            "bias_search_pixels": self.subset,
            "baseline": list(self.reference),
        }


def digest(*parts: Any) -> str:
    """A short SHA-256 of arrays and JSON values."""
    total = hashlib.sha256()
    for part in parts:
        data = part.tobytes() if hasattr(part, "tobytes") else json.dumps(part).encode()
        total.update(data)
    return total.hexdigest()[:16]


@functools.cache
def cpu_model() -> str:
    """Name of this machine's processor."""
    try:
        for line in pathlib.Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def machine() -> dict[str, Any]:
    """Versions, processor and threads of this run."""
    import numba
    import numpy as np

    from .._version import __version__

    return {
        "glossy": __version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "numba": numba.__version__,
        "system": platform.platform(),
        "cpu": cpu_model(),
        "cores": os.cpu_count(),
        "threads": threads(),
    }
