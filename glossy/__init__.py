"""Glossy rendering from environment maps: the real-time methods and their ground truth.

Public names are loaded on first use, so that ``import glossy`` stays cheap and image comparison
never loads a compiler.
"""

import importlib
import sys
import types
from typing import TYPE_CHECKING, Any

from ._version import __version__

if TYPE_CHECKING:
    from .brdf import Lobe, Material
    from .camera import Camera, Plane, Sphere, surface_points
    from .converge import Convergence, converge
    from .cubemap import CubeMap
    from .difference import difference_picture
    from .energy import Energy, energy
    from .environment import environment, read_environment
    from .export.shader import export_shader
    from .frames import SurfacePoints
    from .gbuffer import read_gbuffer
    from .image import Image, read_image, write_exr, write_image
    from .irradiance import irradiance, irradiance_map
    from .lattice.table import lattice_taps
    from .materials import material, material_names
    from .measured.fit import fit_table
    from .measured.material import MeasuredMaterial, measured_material
    from .measured.read import read_measured
    from .measured.table import MeasuredTable
    from .metrics import (
        Comparison,
        bias,
        compare,
        log_rms,
        mae,
        psnr,
        relative_mse,
        relative_rms,
        rms,
    )
    from .pattern import Pattern, importance_pattern, pattern_for_budget, regular_pattern
    from .pem.maps import PartialMaps, partial_maps
    from .pem.regions import Regions, regions
    from .planes import BoundingPlanes
    from .planning.plan import plan
    from .prefiltered.filter import filter_map
    from .prefiltered.maps import PrefilteredMaps, prefilter
    from .pyramid import Pyramid, build_pyramid
    from .reference import Truth, reference, reference_passes
    from .scene import load_scene
    from .shading import shade
    from .splitsum.chain import split_sum_chain
    from .taps import tap_level, tap_width
    from .thesis_pattern import thesis_pattern
    from .trace import trace

_WHERE = {
    "Convergence": "converge",
    "converge": "converge",
    "BoundingPlanes": "planes",
    "Camera": "camera",
    "Comparison": "metrics",
    "CubeMap": "cubemap",
    "Energy": "energy",
    "Image": "image",
    "Lobe": "brdf",
    "Material": "brdf",
    "MeasuredMaterial": "measured.material",
    "MeasuredTable": "measured.table",
    "Pattern": "pattern",
    "PartialMaps": "pem.maps",
    "Plane": "camera",
    "Pyramid": "pyramid",
    "Regions": "pem.regions",
    "Sphere": "camera",
    "SurfacePoints": "frames",
    "Truth": "reference",
    "bias": "metrics",
    "build_pyramid": "pyramid",
    "compare": "metrics",
    "difference_picture": "difference",
    "energy": "energy",
    "environment": "environment",
    "fit_table": "measured.fit",
    "export_shader": "export.shader",
    "importance_pattern": "pattern",
    "irradiance": "irradiance",
    "irradiance_map": "irradiance",
    "lattice_taps": "lattice.table",
    "load_scene": "scene",
    "log_rms": "metrics",
    "mae": "metrics",
    "material": "materials",
    "material_names": "materials",
    "measured_material": "measured.material",
    "partial_maps": "pem.maps",
    "filter_map": "prefiltered.filter",
    "PrefilteredMaps": "prefiltered.maps",
    "prefilter": "prefiltered.maps",
    "pattern_for_budget": "pattern",
    "plan": "planning.plan",
    "psnr": "metrics",
    "read_environment": "environment",
    "read_gbuffer": "gbuffer",
    "read_image": "image",
    "read_measured": "measured.read",
    "reference": "reference",
    "reference_passes": "reference",
    "regions": "pem.regions",
    "regular_pattern": "pattern",
    "relative_mse": "metrics",
    "relative_rms": "metrics",
    "rms": "metrics",
    "shade": "shading",
    "split_sum_chain": "splitsum.chain",
    "surface_points": "camera",
    "tap_level": "taps",
    "tap_width": "taps",
    "thesis_pattern": "thesis_pattern",
    "trace": "trace",
    "write_exr": "image",
    "write_image": "image",
}

__all__ = [
    "BoundingPlanes",
    "Camera",
    "Comparison",
    "Convergence",
    "CubeMap",
    "Energy",
    "Image",
    "Lobe",
    "Material",
    "MeasuredMaterial",
    "MeasuredTable",
    "PartialMaps",
    "Pattern",
    "Plane",
    "PrefilteredMaps",
    "Pyramid",
    "Regions",
    "Sphere",
    "SurfacePoints",
    "Truth",
    "__version__",
    "bias",
    "build_pyramid",
    "compare",
    "converge",
    "difference_picture",
    "energy",
    "environment",
    "export_shader",
    "filter_map",
    "fit_table",
    "importance_pattern",
    "irradiance",
    "irradiance_map",
    "lattice_taps",
    "load_scene",
    "log_rms",
    "mae",
    "material",
    "material_names",
    "measured_material",
    "partial_maps",
    "pattern_for_budget",
    "plan",
    "prefilter",
    "psnr",
    "read_environment",
    "read_gbuffer",
    "read_image",
    "read_measured",
    "reference",
    "reference_passes",
    "regions",
    "regular_pattern",
    "relative_mse",
    "relative_rms",
    "rms",
    "shade",
    "split_sum_chain",
    "surface_points",
    "tap_level",
    "tap_width",
    "thesis_pattern",
    "trace",
    "write_exr",
    "write_image",
]


class _Package(types.ModuleType):
    """Keeps a public function in place when the submodule of the same name is imported."""

    def __setattr__(self, name: str, value: object) -> None:
        if isinstance(value, types.ModuleType) and name in _WHERE:
            value = getattr(value, name, value)
        super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package


def __getattr__(name: str) -> Any:
    if name not in _WHERE:
        raise AttributeError(f"module 'glossy' has no attribute {name!r}")
    return getattr(importlib.import_module(f".{_WHERE[name]}", __name__), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *_WHERE])
