"""Partial environment maps: an environment cut into regions, one filtered map for each.

``regions`` cuts the cube map, ``maps`` holds the masked pyramids and their sum under visibility.
"""
