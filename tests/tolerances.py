"""Named tolerances, each with its reason."""

ROUNDOFF = 1e-12
"""float64: a few thousand operations at 2.2e-16."""

SINGLE = 4e-6
"""float32: a few dozen operations at 6e-8."""

SHADER = 1e-4
"""A shader's picture against shade in float32: a GPU's log2 and texture fractions are its own."""

INTERSECTION = 1e-6
"""float64: sphere hits near the silhouette cancel in a square root, sqrt(2.2e-16) times 40."""

CONVERTED_POWER = 1e-6
"""float32 texels of a converted map: their rounding (6e-8 each) and the joins between faces."""

SUPERSAMPLED_STEPS = 0.01
"""A 48 x 48 sampled twin of a map with steps of up to 1: half a sample on each border it cuts."""

SUPERSAMPLED_LINEAR = 1.5e-3
"""A 32 x 32 sampled twin of a bilinear map, whose columns meet at the poles: midpoint rule."""

ROUND_TRIP = 1.5e-2
"""Smooth map to a cube of 64 and back at H = 64: half a row (1.4 degrees) of slope at the poles."""

MITSUBA_TEXEL = 2e-3
"""A 48 x 48 sampled twin at disc edges of contrast 3000: mean, relative; largest, of the peak."""

RGBE = 4e-3
"""Radiance HDR: eight bits of mantissa shared by three channels of at most 1."""

COVERED_SHARE = 1e-3
"""Share of a texel in a disc by 64 lines across it: kinks where the rim leaves the texel."""

FURNACE = 3e-6
"""A white map against the albedo: the truth's bound of 1e-6 for each of up to three parts."""

IRRADIANCE = 1e-5
"""Bound asked for 1e-4 (the horizon's kink); what is missed is a tenth of it and less."""

CONFORMANCE = 2e-4
"""Radiance integrated by others by sub-texel quadrature, itself converged to some 1e-5."""

CONFORMANCE_SHARP = 1e-3
"""The same for a lobe of a few texels (m = 0.02)."""

CONFORMANCE_CONVERTED = 5e-3
"""The same through a lat-long map converted to a cube map of 512."""

LOBE_PROFILE = 1e-3
"""Prefiltered levels on maps of tiny lights: the lobe ends at exp(-10) and is interpolated in 1024
steps, and its width's local correction is applied to the angle instead of to the slope."""

SPLIT_SUM_HEAD_ON = 0.015
"""Prefiltered lookup at N = V = R on maps of tiny lights: bilinear in levels of 2.5 to 5 texels a
standard deviation, mixed between widths 2^(1/8) apart."""

SPLIT_SUM_SHARP = 0.04
"""The same for lobes below three texels (m N < 3): sampled too coarsely, or mixed with the map."""

ALBEDO_TABLE = 2e-4
"""256 entries in sqrt(cos), linear between them."""

Z_RMS = {"mc": (0.85, 1.2), "qmc": (0.85, 1.45)}
"""RMS of 200 to 400 correlated z-scores; with 16 replicates they follow a t-distribution (1.07),
and on maps with lamps its tails are heavier still."""

LOSSY_EXR = 0.02
"""Smooth values of 0.5 to 2 in half: DWA at its default level loses about 1 %, B44 less."""

SIXTEEN_BITS = 3e-5
"""sRGB in 16 bits: half a step of 1/65535 times the curve's steepest slope, 2.275, with room."""

IRRADIANCE_MAP = 8e-3
"""Irradiance between the centres of a map of 32 texels, at the worst normal of maps with lamps."""

GBUFFER_SINGLE = 1e-4
"""A picture from float32 vectors: 6e-8 of direction over texels of 0.1, contrasts of 100."""

DENSE_TRANSMISSION = 0.01
"""600 filtered taps of a lobe on a map that changes slowly: the blur and the cut tail."""

MIDPOINT_400 = 2e-3
"""Midpoint sums over 400 x 400 cells of a face, lobes of m = 0.2 and the horizon's step."""

Z_MAX = 4.5
"""Largest of a dozen z-scores, t-distributed with 15 degrees of freedom: 1 in 200."""

ROOM_MAP = 5e-3
"""A room's walls through a cube map of 64 texels a face, bilinear, creases at its edges."""

THESIS_TRANSMISSION = 0.15
"""The thesis's estimators renormalise over the samples above the horizon: no limit is the truth."""

PREFILTER_MIDPOINT = 1e-3
"""Nodes one to a texel against 20 midpoints: 4e-4 for a cone, which has a tip; 1e-4 if smooth."""

PREFILTER_PARTS = 1e-3
"""What four times the nodes change, worst for the cut tail of a lobe a fiftieth of a texel wide."""

PREFILTER_NARROW = 2e-3
"""A lobe of a hundredth of a texel at the kinks of the bilinear lookup; 1e-3 in all."""

PREFILTER_WHITE = 1e-6
"""A constant through harmonics and back: interpolation of degree five, three points a degree."""

PREFILTER_MAP = 0.03
"""Bilinear lookup in a slice of 16 texels, lobes of two of its texels and more."""

PREFILTER_ALBEDO = 2e-3
"""Linear interpolation of profiles and weights between 16 elevations, at 40 degrees."""
