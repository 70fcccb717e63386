"""A turntable: turntable.py FILE.scree FOLDER [FRAMES] writes numbered pictures, for ffmpeg -i FOLDER/%03d.ppm."""

import math
import pathlib
import sys

import numpy as np
import scree

path, folder = sys.argv[1], pathlib.Path(sys.argv[2])
frames = int(sys.argv[3]) if len(sys.argv) > 3 else 72
scene = scree.open(path).load()
low, high = np.array(scene.stats["box_min"]), np.array(scene.stats["box_max"])
middle, radius = (low + high) / 2, 1.5 * np.linalg.norm(high - low)

view = scene.view()
for number in range(frames):
    angle = 2 * math.pi * number / frames
    eye = middle + radius * np.array([math.sin(angle), 0.4, math.cos(angle)])
    view.draw(320, 240, camera=scree.look_at(eye, middle, fov=40), samples=2, ssao=True, background=(1, 1, 1, 1))
    color = view.read("color")
    (folder / f"{number:03}.ppm").write_bytes(b"P6\n320 240\n255\n" + color[..., :3].tobytes())
print(f"{frames} pictures of {scene.stats['triangles']} triangles")
