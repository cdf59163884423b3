"""Shaders run in software: OpenGL through moderngl, WebGPU through wgpu, both on a CPU renderer."""

import importlib
import importlib.util
import math
import pathlib
from typing import Any

import numpy as np
import numpy.typing as npt

import glossy

Array = npt.NDArray[np.float32]

BENCHMARKS = pathlib.Path(__file__).parent.parent / "benchmarks"
SOFTWARE = ("llvmpipe", "softpipe", "swiftshader", "lavapipe")

FRAGMENT = """#version 330
uniform samplerCube env;
uniform sampler2D normals;
uniform sampler2D tangents;
uniform sampler2D views;
out vec4 colour;
{functions}
void main() {{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec3 n = texelFetch(normals, pixel, 0).xyz;
    vec3 t = texelFetch(tangents, pixel, 0).xyz;
    vec3 v = texelFetch(views, pixel, 0).xyz;
    colour = vec4({call}, 1.0);
}}
"""

WGSL = """
@group(0) @binding(0) var environment: texture_cube<f32>;
@group(0) @binding(1) var trilinear: sampler;
@group(0) @binding(2) var<storage, read> vectors: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> colours: array<vec4<f32>>;
{functions}
@compute @workgroup_size(64) fn main(@builtin(global_invocation_id) id: vec3<u32>) {{
    let at: u32 = 3u * id.x;
    let n: vec3<f32> = vectors[at].xyz;
    let t: vec3<f32> = vectors[at + 1u].xyz;
    let v: vec3<f32> = vectors[at + 2u].xyz;
    colours[id.x] = vec4<f32>(glossyRadiance(environment, trilinear, n, t, v), 1.0);
}}
"""

HLSL = """
[[vk::binding(0)]] TextureCube<float4> environment;
[[vk::binding(1)]] SamplerState trilinear;
[[vk::binding(2)]] StructuredBuffer<float4> vectors;
[[vk::binding(3)]] RWStructuredBuffer<float4> colours;
{functions}
[numthreads(64, 1, 1)] void main(uint3 id : SV_DispatchThreadID) {{
    uint at = 3u * id.x;
    float3 n = vectors[at].xyz;
    float3 t = vectors[at + 1u].xyz;
    float3 v = vectors[at + 2u].xyz;
    colours[id.x] = float4(glossyRadiance(environment, trilinear, n, t, v), 1.0);
}}
"""


def _vectors(points: glossy.SurfacePoints) -> list[Array]:
    return [v.astype(np.float32) for v in (points.normal, points.tangent, points.view)]


def draw(source: str, vectors: list[Array], pyramid: glossy.Pyramid) -> Array:
    """One full-screen pass of a fragment shader, (H, W, 3) from the bottom row up.

    ``vectors``: normals, tangents and views (H, W, 3), for a shader that reads them.
    """
    spec = importlib.util.spec_from_file_location("llvmpipe", BENCHMARKS / "llvmpipe.py")
    assert spec is not None
    assert spec.loader is not None
    llvmpipe: Any = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(llvmpipe)
    picture = llvmpipe.Pass(list(pyramid.levels), tuple(vectors), source)
    if not any(name in picture.renderer.lower() for name in SOFTWARE):
        raise RuntimeError(f"{picture.renderer} is no software renderer")
    picture.run()
    seen: Array = picture.read().copy()
    picture.release()
    return seen


def opengl(
    functions: str,
    points: glossy.SurfacePoints,
    pyramid: glossy.Pyramid,
    call: str = "glossyRadiance(env, n, t, v)",
) -> Array:
    """The picture (H, W, 3) of exported GLSL at the points (H, W)."""
    return draw(FRAGMENT.format(functions=functions, call=call), _vectors(points), pyramid)


def missing_opengl() -> str | None:
    """Why there is no software OpenGL here, or None."""
    if importlib.util.find_spec("moderngl") is None:
        return "moderngl is not installed"
    point = glossy.SurfacePoints([[[0.0, 0.0, 1.0]]], [[[1.0, 0.0, 0.0]]], [[[0.0, 0.0, 1.0]]])
    dot = glossy.Pyramid([np.ones((6, 1, 1, 3), dtype=np.float32)])
    try:
        opengl("", point, dot, "textureLod(env, n + t + v, 0.0).rgb")
    except Exception as error:  # moderngl raises its own, ctypes OSError, a real GPU fails above
        return f"no software OpenGL: {error}"
    return None


class WebGPU:
    """A software adapter; ``run`` takes WGSL text, or SPIR-V of the same bindings.

    ``seamless`` is False where the adapter stops at the edges of a face: over OpenGL, wgpu does not
    ask for more.
    """

    def __init__(self) -> None:
        self.wgpu: Any = importlib.import_module("wgpu")
        adapters = self.wgpu.gpu.enumerate_adapters_sync()
        software = [a for a in adapters if a.info["adapter_type"] == "CPU"]
        software.sort(key=lambda a: a.info["backend_type"] != "Vulkan")
        if not software:
            raise RuntimeError(f"no software adapter among {[a.summary for a in adapters]}")
        self.device: Any = software[0].request_device_sync()
        self.seamless = software[0].info["backend_type"] == "Vulkan"

    def _environment(self, pyramid: glossy.Pyramid) -> Any:
        """The cube map, half floats: software adapters need not filter float32."""
        usage, n = self.wgpu.TextureUsage, pyramid.size
        texture = self.device.create_texture(
            size=(n, n, 6),
            mip_level_count=len(pyramid.levels),
            format="rgba16float",
            usage=usage.TEXTURE_BINDING | usage.COPY_DST,
        )
        for k, level in enumerate(pyramid.levels):
            size = level.shape[1]
            texels = np.ones((6, size, size, 4), dtype=np.float16)
            texels[..., :3] = level
            self.device.queue.write_texture(
                {"texture": texture, "mip_level": k},
                texels.tobytes(),
                {"bytes_per_row": 8 * size, "rows_per_image": size},
                (size, size, 6),
            )
        return texture.create_view(dimension="cube")

    def compile(self, code: str | bytes) -> Any:
        """The pipeline of a shader; invalid code raises."""
        module = self.device.create_shader_module(code=code)
        return self.device.create_compute_pipeline(
            layout="auto", compute={"module": module, "entry_point": "main"}
        )

    def run(
        self, code: str | bytes, points: glossy.SurfacePoints, pyramid: glossy.Pyramid
    ) -> Array:
        """The picture (H, W, 3) of ``code`` at the points; a multiple of 64 of them."""
        rows = np.ones((math.prod(points.shape), 3, 4), dtype=np.float32)
        rows[..., :3] = np.stack([v.reshape(-1, 3) for v in _vectors(points)], axis=1)
        linear = dict.fromkeys(("mag_filter", "min_filter", "mipmap_filter"), "linear")
        usage = self.wgpu.BufferUsage
        source = self.device.create_buffer_with_data(data=rows.tobytes(), usage=usage.STORAGE)
        target = self.device.create_buffer(
            size=16 * len(rows), usage=usage.STORAGE | usage.COPY_SRC
        )
        pipeline = self.compile(code)
        resources = (
            self._environment(pyramid),
            self.device.create_sampler(**linear),
            {"buffer": source},
            {"buffer": target},
        )
        group = self.device.create_bind_group(
            layout=pipeline.get_bind_group_layout(0),
            entries=[{"binding": k, "resource": r} for k, r in enumerate(resources)],
        )
        encoder = self.device.create_command_encoder()
        step = encoder.begin_compute_pass()
        step.set_pipeline(pipeline)
        step.set_bind_group(0, group)
        step.dispatch_workgroups(len(rows) // 64)
        step.end()
        self.device.queue.submit([encoder.finish()])
        seen = np.frombuffer(self.device.queue.read_buffer(target), dtype=np.float32)
        return seen.reshape(*points.shape, 4)[..., :3]
