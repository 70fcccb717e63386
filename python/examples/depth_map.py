"""A depth map: depth_map.py FILE.scree FOLDER writes depth.npy (float32, units of the scene) and a picture of it."""

import pathlib
import sys

import numpy as np
import scree

path, folder = sys.argv[1], pathlib.Path(sys.argv[2])
scene = scree.open(path).load()
depth = scene.render(320, 240, layers=["depth"])["depth"]
np.save(folder / "depth.npy", depth)

seen = np.isfinite(depth)
nearest, farthest = depth[seen].min(), depth[seen].max()
print(f"{seen.mean():.0%} of the pixels show something, from {nearest:.3g} to {farthest:.3g} units away")

# Near is white, the background black. PGM files have 16 bits, big-endian.
grey = np.zeros(depth.shape)
grey[seen] = 1 - 0.9 * (depth[seen] - nearest) / max(farthest - nearest, 1e-12)
pixels = (grey * 65535).astype(">u2")
(folder / "depth.pgm").write_bytes(b"P5\n%d %d\n65535\n" % depth.shape[::-1] + pixels.tobytes())
