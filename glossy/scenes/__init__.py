"""Scenes of objects: geometry, ray casting, baked light, captured cube maps, pictures.

Built on the core, which does not know it: an object is shaded by the core's methods, with a cube
map captured at its place in the scene.
"""
