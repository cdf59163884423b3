"""Named tolerances, each with its reason."""

ROUNDOFF = 1e-12
"""float64: a few thousand operations at 2.2e-16."""

SINGLE = 4e-6
"""float32: a few dozen operations at 6e-8."""

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
