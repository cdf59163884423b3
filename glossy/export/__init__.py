"""Patterns as tables, and whole methods as shader functions.

``tables`` writes one pattern as JSON, CSV or constants of a shading language; ``shader`` a
material's method as functions of GLSL, HLSL or WGSL. Each method that can be a shader is one module
with one template, written in WGSL; ``languages`` turns that into the other two.
"""
