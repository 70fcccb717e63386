"""Random views: random_views.py FILE.scree FOLDER [COUNT] draws COUNT views (1000) from around the scene into one array."""

import pathlib
import sys
import time

import numpy as np
import scree

path, folder = sys.argv[1], pathlib.Path(sys.argv[2])
count = int(sys.argv[3]) if len(sys.argv) > 3 else 1000
scene = scree.open(path).load()
low, high = np.array(scene.stats["box_min"]), np.array(scene.stats["box_max"])
middle, radius = (low + high) / 2, np.linalg.norm(high - low)

random = np.random.default_rng(1)
views = np.empty((count, 64, 64, 4), np.uint8)
view = scene.view()
start = time.perf_counter()
for picture in views:
    direction = random.normal(size=3)
    direction /= np.linalg.norm(direction)
    view.draw(64, 64, camera=scree.look_at(middle + radius * direction, middle))
    picture[:] = view.read("color")
seconds = time.perf_counter() - start
np.save(folder / "views.npy", views)
print(f"{count} views in {seconds:.2f} s, {count / seconds:.0f} per second")
