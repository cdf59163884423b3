"""Measured materials: readers of tables, evaluation between their rows, sampling, photon bounces.

Built on the core, which does not know of it.
"""
