"""Shaders on Mesa's software GPU: OpenGL 4.5 on llvmpipe, float32 cube map, seamless."""

import ctypes
import importlib
import os
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float32]

CUBE_MAP, POSITIVE_X, SEAMLESS = 0x8513, 0x8515, 0x884F
MIN_FILTER, MAG_FILTER, WRAP_S, WRAP_T, MAX_LEVEL = 0x2801, 0x2800, 0x2802, 0x2803, 0x813D
LINEAR, LINEAR_MIPMAP_LINEAR, CLAMP_TO_EDGE = 0x2601, 0x2703, 0x812F
RGBA32F, RGBA, FLOAT = 0x8814, 0x1908, 0x1406

VERTEX = """
#version 330
in vec2 at;
void main() { gl_Position = vec4(at, 0.0, 1.0); }
"""

FRAGMENT = """
#version 330
uniform samplerCube env;
uniform sampler2D normals;
uniform sampler2D tangents;
uniform sampler2D views;
uniform vec4 taps[TAPS];      // half vector, D / (n p_h)
uniform float spread;         // N^2 / (4 n)
uniform vec2 sines;
uniform float r0;
uniform float alpha;
out vec4 colour;
const float PI = 3.14159265358979;
void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec3 n = texelFetch(normals, pixel, 0).xyz;
    vec3 t = texelFetch(tangents, pixel, 0).xyz;
    vec3 v = texelFetch(views, pixel, 0).xyz;
    vec3 b = cross(n, t);
    vec3 o = vec3(dot(v, t), dot(v, b), dot(v, n));
    vec2 s = sines * sqrt(vec2(o.x * o.x + o.z * o.z, o.y * o.y + o.z * o.z));
    vec2 c = 1.0 - 2.0 * s * s;
    vec2 tangent = 2.0 * s * sqrt(1.0 - s * s) / c;
    float area = c.x > 0.0 && c.y > 0.0 ? min(PI * tangent.x * tangent.y, 2.0 * PI) : 2.0 * PI;
    vec3 sum = vec3(0.0);
    for (int k = 0; k < TAPS; k++) {
        vec3 h = taps[k].xyz;
        float u = dot(o, h);
        vec3 i = 2.0 * u * h - o;
        if (i.z > 0.0 && u > 0.0) {
            vec3 w = t * i.x + b * i.y + n * i.z;
            float d = 1.0 / max(abs(w.x), max(abs(w.y), abs(w.z)));
            float level = 0.5 * log2(spread * area * d / u);
            float weight = taps[k].w * i.z;
            GENERAL
            sum += weight * textureLod(env, w, level).rgb;
        }
    }
    colour = vec4(sum, 1.0);
}
"""

FRESNEL = """
            float e = 1.0 - u;
            weight *= (r0 + (1.0 - r0) * (e * e) * (e * e) * e) / pow(i.z * o.z, alpha);
"""


class Pass:
    """One full-screen pass over a G-buffer: ``run`` draws and waits, ``read`` returns the frame.

    ``levels``: faces of every level; ``gbuffer``: normals, tangents and views (H, W, 3), the
    samplers ``normals``, ``tangents``, ``views`` that ``fragment`` may use beside the cube map
    ``env``.
    """

    def __init__(
        self, levels: list[Array], gbuffer: tuple[Array, Array, Array], fragment: str
    ) -> None:
        os.environ["LIBGL_ALWAYS_SOFTWARE"] = "1"
        moderngl: Any = importlib.import_module("moderngl")
        egl = ctypes.CDLL("libEGL.so.1")
        egl.eglGetProcAddress.restype = ctypes.c_void_p
        self._egl = egl
        self.context: Any = moderngl.create_standalone_context(backend="egl")
        height, width = gbuffer[0].shape[:2]
        self._shape = height, width
        self._frame = self.context.simple_framebuffer((width, height), components=4, dtype="f4")
        program = self.context.program(vertex_shader=VERTEX, fragment_shader=fragment)
        self.program = program
        self._cube(levels)
        for unit, (name, data) in enumerate(
            zip(("normals", "tangents", "views"), gbuffer, strict=True), start=1
        ):
            if name not in program:
                continue
            rgba = np.zeros((height, width, 4), dtype=np.float32)
            rgba[..., :3] = data
            texture = self.context.texture((width, height), 4, rgba.tobytes(), dtype="f4")
            texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
            texture.use(unit)
            program[name].value = unit
            setattr(self, f"_{name}", texture)
        program["env"].value = 0
        corners = np.array([-1, -1, 3, -1, -1, 3], dtype=np.float32)
        vertices = self.context.buffer(corners.tobytes())
        self._pass = self.context.vertex_array(program, [(vertices, "2f", "at")])
        self.renderer = str(self.context.info["GL_RENDERER"])

    def _call(self, name: str, *arguments: Any) -> None:
        address = self._egl.eglGetProcAddress(name.encode())
        types = [ctypes.c_void_p if isinstance(a, bytes) else ctypes.c_int for a in arguments]
        ctypes.CFUNCTYPE(None, *types)(address)(*arguments)

    def _cube(self, levels: list[Array]) -> None:
        """Every level explicitly: the library itself writes only the first."""
        n = levels[0].shape[1]
        self._map = self.context.texture_cube((n, n), 4, dtype="f4")
        self._map.use(0)
        self._call("glBindTexture", CUBE_MAP, self._map.glo)
        for at, level in enumerate(levels):
            size = level.shape[1]
            for face in range(6):
                rgba = np.zeros((size, size, 4), dtype=np.float32)
                rgba[..., :3] = level[face]
                self._call(
                    "glTexImage2D", POSITIVE_X + face, at, RGBA32F, size, size, 0, RGBA, FLOAT,
                    rgba.tobytes())  # fmt: skip
        for parameter, value in (
            (MIN_FILTER, LINEAR_MIPMAP_LINEAR),
            (MAG_FILTER, LINEAR),
            (WRAP_S, CLAMP_TO_EDGE),
            (WRAP_T, CLAMP_TO_EDGE),
            (MAX_LEVEL, len(levels) - 1),
        ):
            self._call("glTexParameteri", CUBE_MAP, parameter, value)
        self._call("glEnable", SEAMLESS)

    def run(self) -> None:
        """Draw one frame and wait until it is there."""
        self._frame.use()
        self._pass.render()
        self.context.finish()

    def read(self) -> Array:
        """The frame (H, W, 3)."""
        raw = np.frombuffer(self._frame.read(components=4, dtype="f4"), dtype=np.float32)
        return raw.reshape(*self._shape, 4)[..., :3]

    def release(self) -> None:
        """Give the context back."""
        self.context.release()


class Shader(Pass):
    """The regular method, its numbers as uniforms."""

    def __init__(
        self,
        levels: list[Array],
        gbuffer: tuple[Array, Array, Array],
        taps: Array,
        sines: tuple[float, float],
        r0: float,
        alpha: float,
    ) -> None:
        general = FRESNEL if r0 != 1.0 or alpha != 0.0 else ""
        fragment = FRAGMENT.replace("TAPS", str(len(taps))).replace("GENERAL", general)
        super().__init__(levels, gbuffer, fragment)
        program = self.program
        program["taps"].write(np.ascontiguousarray(taps[:, :4], dtype=np.float32).tobytes())
        program["spread"].value = float(taps[0, 4])
        program["sines"].value = sines
        for name, value in (("r0", r0), ("alpha", alpha)):
            if name in program:
                program[name].value = value
