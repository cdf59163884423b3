"""The horizon lines of the thesis's Fig. 4.23: a sphere in a bright room, 4.23 beside 4.24.

    python benchmarks/horizon_lines.py -o docs/images/horizon.png

Left and right: the two estimators with the same pattern and map. Below: radiance over the albedo
in a white map, where nothing but the estimator can change it, for views tilted along the tangent.
"""

import argparse
import math

import matplotlib.figure
import numpy as np

import glossy
from glossy._output import write_figure
from glossy.camera import Sphere, default_camera

LOBE = glossy.Lobe(0.3)
SAMPLES = 9
ESTIMATORS = ("4.23", "4.24")


def main() -> None:
    """Render and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", default="horizon.png")
    args = parser.parse_args()
    points = glossy.surface_points(default_camera(Sphere(), 220, 220), Sphere())
    room = glossy.build_pyramid(glossy.environment("studio", size=256))
    cosine = np.linspace(1.0, 0.01, 4000)
    view = np.stack([np.sqrt(1.0 - cosine**2), 0.0 * cosine, cosine], axis=-1)
    up, side = (np.broadcast_to(v, view.shape) for v in ([0.0, 0.0, 1.0], [1.0, 0.0, 0.0]))
    line = glossy.SurfacePoints(up, side, view)
    white = glossy.build_pyramid(glossy.environment("white", size=8))
    albedo = glossy.Material(reflection=[LOBE]).albedo(view)[0]

    figure = matplotlib.figure.Figure(figsize=(6.4, 5.2), layout="constrained")
    axes = figure.subplot_mosaic([list(ESTIMATORS), ["row", "row"]], height_ratios=[3, 2])
    pictures = {
        e: glossy.shade(points, LOBE, room, "thesis", samples=SAMPLES, estimator=e)
        for e in ESTIMATORS
    }
    brightest = np.percentile(pictures["4.24"][points.coverage], 99.0)
    for e in ESTIMATORS:
        axes[e].imshow(np.clip(pictures[e] / brightest, 0.0, 1.0) ** (1.0 / 2.2))
        axes[e].set(title=f"eq. {e}", xticks=[], yticks=[])
        value = glossy.shade(line, LOBE, white, "thesis", samples=SAMPLES, estimator=e)[:, 0]
        axes["row"].plot(np.degrees(np.arccos(cosine)), value / albedo, label=f"eq. {e}")
    axes["row"].axhline(1.0, color="black", linewidth=0.8)
    axes["row"].set(
        xlabel="angle of the view [degrees]",
        ylabel="white map: radiance / albedo",
        xlim=(0.0, math.degrees(math.acos(0.05))),
        ylim=(0.6, 1.8),
    )
    axes["row"].legend(loc="upper left")
    write_figure(args.output, figure, dpi=90)


if __name__ == "__main__":
    main()
