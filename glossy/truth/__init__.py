"""The machinery of the ground truth: cells, quadrature, Monte Carlo. It imports only the core.

Nothing here may import the pyramid, the footprint or the shading: the truth shares no
approximation with what it judges.
"""
