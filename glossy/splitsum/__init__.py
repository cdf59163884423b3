"""Split-sum shading from a prefiltered chain, and the anisotropic tricks that are built on it."""
