"""The scenes that come with the package."""

import pathlib

BUILTIN_SCENES = ("room", "showroom", "hall")


def builtin_scene(name: str) -> pathlib.Path | None:
    """The file of a built-in scene, None for another name."""
    if name not in BUILTIN_SCENES:
        return None
    return pathlib.Path(__file__).parent / "data" / f"{name}.toml"
