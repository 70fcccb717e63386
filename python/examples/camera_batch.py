"""Cameras for training: camera_batch.py FILE.scree FOLDER makes cameras of poses (camera to world) and intrinsics, the
form of data sets, and writes colour, depth and triangle ids as blocks of N x H x W."""

import math
import pathlib
import sys

import numpy as np
import scree

WIDTH, HEIGHT, FOCAL, NEAR = 96, 64, 90.0, 0.01  # pixels, pixels, pixels, units


def projection():
    """An OpenGL projection with the far plane at infinity."""
    out = np.zeros((4, 4))
    out[0, 0] = 2 * FOCAL / WIDTH
    out[1, 1] = 2 * FOCAL / HEIGHT
    out[2, 2], out[2, 3], out[3, 2] = -1, -2 * NEAR, -1
    return out


def pose(eye, target):
    """Camera to world: x right, y up, -z the direction of view."""
    back = (eye - target) / np.linalg.norm(eye - target)
    right = np.cross([0, 1, 0], back)
    right /= np.linalg.norm(right)
    out = np.eye(4)
    out[:3, 0], out[:3, 1], out[:3, 2], out[:3, 3] = right, np.cross(back, right), back, eye
    return out


path, folder = sys.argv[1], pathlib.Path(sys.argv[2])
scene = scree.open(path).load()
low, high = np.array(scene.stats["box_min"]), np.array(scene.stats["box_max"])
middle, radius = (low + high) / 2, 1.2 * np.linalg.norm(high - low)
angles = np.linspace(0, 2 * math.pi, 12, endpoint=False)
poses = [pose(middle + radius * np.array([math.sin(a), 0.5, math.cos(a)]), middle) for a in angles]

cameras = [scree.matrices(np.linalg.inv(world), projection()) for world in poses]
view = scene.view().draw_batch(cameras, WIDTH, HEIGHT, layers=["color", "depth", "triangle"])
for layer in ("color", "depth", "triangle"):
    # On a GPU torch.from_dlpack(view.share(layer)) is the block in its memory, without a copy.
    block = view.read(layer)
    np.save(folder / f"{layer}.npy", block)
    print(f"{layer}: {' x '.join(map(str, block.shape))}, {block.dtype}")
