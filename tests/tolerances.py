"""Named tolerances, each with its reason."""

ROUNDOFF = 1e-12
"""float64: a few thousand operations at 2.2e-16."""

SINGLE = 4e-6
"""float32: a few dozen operations at 6e-8."""

INTERSECTION = 1e-6
"""float64: sphere hits near the silhouette cancel in a square root, sqrt(2.2e-16) times 40."""
