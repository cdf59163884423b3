"""Prefiltered environment maps: radially symmetric lobes, and stacks of maps filtered with them.

Built on the core, which does not know of it.
"""
