"""Valid files of text that are mutated: scenes and materials."""

SCENE = b"""material = "mx=.2,my=.075"
background = "black"
[environment]
source = "studio"
size = 64
orientation = "glossy"
negative = "clamp"
[shape]
kind = "sphere"
center = [0, 0.5, 0]
radius = 2
[camera]
position = [0, 1, 9]
target = [0, 0, 0]
fov = 45
width = 30
[method]
name = "importance"
samples = 40
"""
PLANE = b"""material = { kd = 0.1, reflection = [{ mx = 0.2, my = 0.1, r0 = [0.1, 0.2, 0.3] }] }
[shape]
kind = "plane"
point = [0, 0, 0]
normal = [0, 1, 0]
tangent = [1, 0, 0]
[method]
samples = 7
threshold = 0.1
"""
BUFFERED = b"""[gbuffer]
file = "points.npz"
normal = "normal"
encoded = ["view"]
normalise = true
"""
ROOM = b"""background = "black"
[camera]
position = [0, 1.5, 3]
target = [0, 0.8, 0]
fov = 42
width = 8
height = 6
supersampling = 1
[environment]
source = "sky"
size = 8
scale = [1, 1, 1.2]
[method]
name = "regular"
samples = 20
footprint = "jacobian"
[bake]
texel = 0.5
samples = 16
bounces = 2
[capture]
size = 8
supersampling = 1
[[planes]]
point = [0, 0, 0]
normal = [0, 1, 0]
[materials]
plaster = "kd=.7"
paint = { kd = 0.1, reflection = [{ mx = 0.05, r0 = 0.05, alpha = 0.5 }] }
[[objects]]
name = "ball"
shape = { kind = "sphere", radius = 0.5 }
position = [0, 0.5, 0]
scale = [1, 1.2, 1]
rotation = [0, 30, 0]
material = "paint"
method = { samples = 9 }
capture_size = 8
casts_shadow = true
[[objects]]
shape = { kind = "rectangle", size = [4, 4], one_sided = true }
rotation = [-90, 0, 0]
material = "plaster"
checker = { kd = [0.2, 0.2, 0.25], repeat = [8, 8] }
[[objects]]
shape = { kind = "torus", radius = 0.4, tube = 0.2 }
material = { kd = 0.2, transmission = [{ mx = 0.2 }] }
[[objects]]
shape = { kind = "box", size = [1, 2, 3] }
emission = 0.5
[[objects]]
shape = { kind = "mesh", file = "mesh.obj", smooth = true }
material = "mx=.1"
[[lights]]
size = [1, 1]
position = [0, 2.5, 0]
rotation = [90, 0, 0]
radiance = [10, 9, 8]
"""
MATERIAL = b"""kd = [0.1, 0.2, 0.3]
kd_falloff = true
diffuse_transmission = 0.1
[[reflection]]
mx = 0.2
my = 0.075
r0 = [0.04, 0.5, 1]
[[transmission]]
mx = 0.25
alpha = 0.5
"""
JSON = (
    b'{"kd": 0.1, "reflection": [{"mx": 0.2, "my": 0.1, "ks": [1, 0.5, 0.2]}], "transmission": []}'
)
