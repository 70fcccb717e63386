"""A segmentation map: segmentation.py FILE.scree FOLDER writes the mesh index of every pixel, -1 for the background."""

import pathlib
import sys

import numpy as np
import scree

path, folder = sys.argv[1], pathlib.Path(sys.argv[2])
file = scree.open(path)
scene = file.load()
instance = scene.render(320, 240, layers=["instance"])["instance"]

# The layer holds indices into a table. -1, the background, selects the row that is appended at the end.
mesh_of = np.append(scene.instances()["mesh"], -1)
mesh = mesh_of[instance]
np.save(folder / "segmentation.npy", mesh)
for number, pixels in zip(*np.unique(mesh, return_counts=True)):
    name = "background" if number < 0 else f"mesh {number} {file.meshes[number]['name']}"
    print(f"{pixels:6} pixels: {name}")
