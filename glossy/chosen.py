"""Materials that the thesis names and shows without printing their parameters, chosen by us.

Reflectances at normal incidence follow from refractive indices, r0 = ((n - 1)/(n + 1))^2: 0.04 for
the 1.5 of lacquers, plastics and glass, 0.053 for the 1.6 of a porcelain glaze; chromium's are
those of its measured indices. Roughness is chosen by eye, in the order the thesis describes: its
chrome needs the most samples, its porcelain the fewest. alpha = 0.5 keeps sharp lobes from
darkening towards the rim, with r + t <= 1 up to the angles that ``energy`` reports.
"""

import dataclasses

from .brdf import Lobe, Material


@dataclasses.dataclass(frozen=True)
class ChosenMaterial:
    """A material of our choice, and why it is as it is."""

    name: str
    material: Material
    reason: str


CHROMIUM = (0.549, 0.556, 0.554)

CHOSEN = {
    c.name: c
    for c in (
        ChosenMaterial(
            "chrome", Material(reflection=[Lobe(0.16, r0=CHROMIUM, alpha=0.4)]),
            "satin chrome: chromium's reflectance, and a lobe wide enough to need 15 samples",
        ),
        ChosenMaterial(
            "lacquer",
            Material((0.36, 0.03, 0.025), [Lobe(0.03, r0=0.04, alpha=0.5)], kd_falloff=True),
            "red paint under a clear coat of index 1.5, smooth but not a mirror",
        ),
        ChosenMaterial(
            "plastic",
            Material((0.08, 0.22, 0.48), [Lobe(0.05, r0=0.04, alpha=0.5)], kd_falloff=True),
            "blue, moulded: index 1.5, a highlight a few degrees wide",
        ),
        ChosenMaterial(
            "porcelain",
            Material((0.76, 0.74, 0.70), [Lobe(0.012, r0=0.053, alpha=0.5)], kd_falloff=True),
            "white body under a glaze of index 1.6, the sharpest of the three insulators",
        ),
        ChosenMaterial(
            "frosted-glass",
            Material(reflection=[Lobe(0.16, r0=0.04)], transmission=[Lobe(0.25, ks=0.92, r0=0.04)]),
            "a pane etched on one side: blurred both ways, more so where light passes both faces",
        ),
        ChosenMaterial(
            "glass",
            Material(reflection=[Lobe(0.004, r0=0.077, alpha=0.5)],
                     transmission=[Lobe(0.004, ks=0.98, r0=0.077, alpha=0.5)]),
            "a clear pane: two faces of 0.04 reflect 0.077 together, 2 % is absorbed",
        ),
        ChosenMaterial(
            "varnish",
            Material((0.30, 0.17, 0.08), [Lobe(0.022, r0=0.04, alpha=0.5)], kd_falloff=True),
            "brown wood under varnish of index 1.5",
        ),
        ChosenMaterial(
            "polished-floor",
            Material((0.42, 0.38, 0.32), [Lobe(0.04, r0=0.045, alpha=0.5)], kd_falloff=True),
            "stone or sealed parquet, index 1.54, finely scratched by feet",
        ),
        ChosenMaterial(
            "rubber",
            Material(0.045, [Lobe(0.35, ks=0.6, r0=0.042)], kd_falloff=True),
            "black, index 1.52; a broad lobe, partly lost in the texture",
        ),
        ChosenMaterial(
            "leather",
            Material((0.17, 0.085, 0.045), [Lobe(0.24, ks=0.8, r0=0.042)], kd_falloff=True),
            "brown, waxed: broad by its grain",
        ),
        ChosenMaterial(
            "car-paint",
            Material((0.01, 0.03, 0.09), [Lobe(0.28, ks=(0.12, 0.25, 0.6), r0=0.5),
                                          Lobe(0.008, r0=0.04, alpha=0.5)], kd_falloff=True),
            "blue metallic: flakes in a wide coloured lobe, a clear coat of index 1.5 above them",
        ),
    )
}  # fmt: skip
