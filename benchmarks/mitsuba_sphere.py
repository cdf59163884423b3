"""The opponent of ``bench_reference``: Mitsuba 3 with the Kurt lobe as a plugin of its own.

Path tracing with multiple importance sampling and multijittered samples, ``llvm_ad_rgb``. The rays
are handed over, one per point, so that both programs see the same points from the same place.
"""

import importlib
import os
import pathlib
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float32]

FOLDERS = ("/usr/lib/x86_64-linux-gnu", "/usr/lib/aarch64-linux-gnu", "/usr/lib64", "/usr/lib")


def load() -> tuple[Any, Any]:
    """Modules mitsuba and drjit, with the newest LLVM that is installed; ImportError without."""
    if "DRJIT_LIBLLVM_PATH" not in os.environ:
        found = [p for f in FOLDERS for p in pathlib.Path(f).glob("libLLVM-[0-9]*.so")]
        if found:
            newest = max(found, key=lambda p: int(p.stem.split("-")[1].split(".")[0]))
            os.environ["DRJIT_LIBLLVM_PATH"] = str(newest)
    mi = importlib.import_module("mitsuba")
    if "llvm_ad_rgb" not in mi.variants():
        raise ImportError("mitsuba has no variant llvm_ad_rgb")
    mi.set_variant("llvm_ad_rgb")
    mi.set_log_level(mi.LogLevel.Error)  # not that sample counts are rounded up
    return mi, importlib.import_module("drjit")


def register(mi: Any, dr: Any) -> None:
    """The plugin "kurt": F = 1, alpha = 0, from mx and my; lobe sampling by slopes."""

    class Kurt(mi.BSDF):  # type: ignore[misc]
        def __init__(self, properties: Any) -> None:
            mi.BSDF.__init__(self, properties)
            self.mx, self.my = float(properties["mx"]), float(properties["my"])
            kinds = mi.BSDFFlags
            self.m_flags = kinds.GlossyReflection | kinds.FrontSide | kinds.Anisotropic
            self.m_components = [self.m_flags]

        def _lobe(self, wi: Any, wo: Any) -> tuple[Any, Any, Any]:
            # exp(q)/(pi mx my), 1/cos^2 of the half vector, |wi + wo|
            h = wi + wo
            x, y = h.x / (h.z * self.mx), h.y / (h.z * self.my)
            squared = dr.squared_norm(h)
            value = dr.exp(-(x * x + y * y)) / (dr.pi * self.mx * self.my)
            return value, squared / (h.z * h.z), dr.sqrt(squared)

        def eval(self, _: Any, si: Any, wo: Any, active: Any = True) -> Any:
            value, tilt, length = self._lobe(si.wi, wo)
            above = active & (si.wi.z > 0) & (wo.z > 0)
            return mi.Color3f(dr.select(above, value * tilt * tilt / (2 * length) * wo.z, 0))

        def pdf(self, _: Any, si: Any, wo: Any, active: Any = True) -> Any:
            value, tilt, length = self._lobe(si.wi, wo)
            above = active & (si.wi.z > 0) & (wo.z > 0)
            return dr.select(above, value * tilt * dr.sqrt(tilt) / (2 * length), 0)

        def sample(self, context: Any, si: Any, _: Any, xi: Any, active: Any = True) -> Any:
            radius = dr.sqrt(-dr.log(dr.maximum(1 - xi.x, 2.0**-25)))
            sine, cosine = dr.sincos(2 * dr.pi * xi.y)
            h = dr.normalize(mi.Vector3f(self.mx * radius * cosine, self.my * radius * sine, 1))
            out = mi.BSDFSample3f()
            out.wo = 2 * dr.dot(si.wi, h) * h - si.wi
            out.eta, out.sampled_component = 1, 0
            out.sampled_type = mi.UInt32(int(mi.BSDFFlags.GlossyReflection))
            out.pdf = self.pdf(context, si, out.wo, active)
            value = self.eval(context, si, out.wo, active)
            return out, dr.select(active & (out.pdf > 0), value / out.pdf, 0)

        def to_string(self) -> str:
            return f"Kurt[mx={self.mx}, my={self.my}]"

    mi.register_bsdf("kurt", Kurt)


class Sphere:
    """The unit sphere with one lobe under a lat-long picture, seen along given rays."""

    def __init__(self, picture: Array, eye: Any, rays: Array, mx: float, my: float) -> None:
        mi, dr = load()
        register(mi, dr)
        turned = mi.ScalarTransform4f().rotate([1, 0, 0], -90)  # its poles on the y axis
        self._mi, self._dr = mi, dr
        self._scene = mi.load_dict(
            {
                "type": "scene",
                "integrator": {"type": "path", "max_depth": 2},
                "sky": {"type": "envmap", "bitmap": mi.Bitmap(np.ascontiguousarray(picture))},
                "sphere": {
                    "type": "sphere",
                    "to_world": turned,
                    "material": {"type": "kurt", "mx": mx, "my": my},
                },
            }
        )
        self._eye, self._count = eye, len(rays)
        self._rays = mi.Float(rays.reshape(-1))

    def radiance(self, samples: int, seed: int) -> Array:
        """Radiance (rays, 3), the mean of ``samples`` paths each (rounded up by the sampler)."""
        mi, dr = self._mi, self._dr
        sampler = mi.load_dict({"type": "multijitter", "sample_count": samples})
        samples = sampler.sample_count()
        sampler.set_samples_per_wavefront(samples)
        sampler.seed(seed, self._count * samples)
        index = dr.arange(mi.UInt32, self._count * samples) // samples
        along = mi.Vector3f(*(dr.gather(mi.Float, self._rays, 3 * index + c) for c in range(3)))
        ray = mi.RayDifferential3f(mi.Ray3f(mi.Point3f(*self._eye), along))
        colour, _, _ = self._scene.integrator().sample(self._scene, sampler, ray)
        means = [dr.block_sum(c, samples) / samples for c in (colour.x, colour.y, colour.z)]
        dr.eval(means)
        return np.stack([np.array(c) for c in means], axis=-1)
