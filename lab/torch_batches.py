#!/usr/bin/env python3
"""Times batches of cameras. Depths and ids are written to torch tensors, which torch reads on the same stream.

    lab/torch_batches.py FILE.scree [--cameras 1024] [--size 128x128] [--repeats 50] [--library libscree.so]
                         [--nvdiffrast SCENE.gltf]

Needs torch with CUDA and libscree of API version 4. Prints a line of CSV for a run in which torch reads every tensor
(the nearest depth of each view, and the number of its pixels that show a surface), and for one in which it does not.
After each run, pictures of the last batch are compared with views drawn one by one.

--nvdiffrast adds two rows of nvdiffrast's CUDA rasteriser with the same cameras, where that package is installed: with the
vertices transformed for each camera by torch, and without. SCENE.gltf is the scene as `scree synth` writes it (float
positions, indices, one level of nodes with matrices). Both programs must show the same depths, except in a thousandth of the
pixels.
"""
import argparse
import ctypes as c
import json
import math
import pathlib
import random
import sys
import time

import numpy as np
import torch

DEPTH, TRIANGLE, INSTANCE = 1, 2, 3
LOOK_AT = 2
NEAR, FAR = 0.01, 100.0  # planes of nvdiffrast's views, in units of D


def structure(name, *fields):
    """A structure of scree.h with the members that this program uses. Sets `size`."""
    kind = type(name, (c.Structure,), {"_fields_": [("size", c.c_size_t), *fields]})
    return lambda **values: kind(size=c.sizeof(kind), **values)


Stats = structure("scree_scene_stats", ("triangles", c.c_uint64), ("instances", c.c_uint64), ("box_min", c.c_double * 3),
                  ("box_max", c.c_double * 3), ("on_gpu", c.c_uint32), ("gpu", c.c_int32), ("streamed", c.c_uint32),
                  ("scene", c.c_uint32), ("device_bytes", c.c_uint64), ("load_ms", c.c_double), ("gpu_name", c.c_char_p))
Camera = structure("scree_camera", ("kind", c.c_int), ("name", c.c_char_p), ("eye", c.c_double * 3), ("target", c.c_double * 3),
                   ("up", c.c_double * 3), ("fov_degrees", c.c_double))
Draw = structure("scree_draw_options", ("width", c.c_uint32), ("height", c.c_uint32), ("samples", c.c_uint32), ("show", c.c_int))
Target = structure("scree_target", ("data", c.c_void_p), ("bytes", c.c_uint64), ("layer", c.c_int), ("reserved", c.c_uint32))


class Library:
    def __init__(self, path):
        self.calls = c.CDLL(path)
        self.calls.scree_error.restype = c.c_char_p

    def __call__(self, name, *arguments):
        if getattr(self.calls, name)(*arguments) != 0:
            raise SystemExit(f"torch_batches.py: {name}: {self.calls.scree_error().decode()}")


def random_cameras(stats, count):
    """Eyes and targets in the middle eight tenths of the scene's box, as in lab/batch.cpp."""
    numbers = random.Random(1)

    def point():
        return [low + numbers.uniform(0.1, 0.9) * (high - low) for low, high in zip(stats.box_min, stats.box_max)]

    cameras = [Camera(kind=LOOK_AT, eye=(c.c_double * 3)(*point()), target=(c.c_double * 3)(*point()), fov_degrees=70)
               for _ in range(count)]
    return (type(cameras[0]) * count)(*cameras)


def world_geometry(path):
    """Vertices of all instances in world space (count x 4) and their triangles (count x 3)."""
    scene = json.loads(path.read_text())
    data = (path.parent / scene["buffers"][0]["uri"]).read_bytes()

    def values(index):
        accessor = scene["accessors"][index]
        view = scene["bufferViews"][accessor["bufferView"]]
        width = {"SCALAR": 1, "VEC3": 3}[accessor["type"]]
        kind = {5123: np.uint16, 5125: np.uint32, 5126: np.float32}[accessor["componentType"]]
        offset = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        return np.frombuffer(data, kind, accessor["count"] * width, offset).reshape(-1, width)

    def matrix(node):
        return np.array(node.get("matrix", np.eye(4).ravel())).reshape(4, 4).T

    vertices, triangles, count = [], [], 0
    for root in scene["scenes"][scene["scene"]]["nodes"]:
        root = scene["nodes"][root]
        for node in [root] + [scene["nodes"][child] for child in root.get("children", [])]:
            if "mesh" not in node:
                continue
            to_world = matrix(root) if node is root else matrix(root) @ matrix(node)
            for primitive in scene["meshes"][node["mesh"]]["primitives"]:
                positions = values(primitive["attributes"]["POSITION"]).astype(np.float64)
                vertices.append(np.c_[positions, np.ones(len(positions))] @ to_world.T)
                triangles.append(values(primitive["indices"]).reshape(-1, 3).astype(np.int32) + count)
                count += len(positions)
    return np.concatenate(vertices).astype(np.float32), np.concatenate(triangles)


def clip_matrix(camera, aspect):
    """From world to OpenGL's clip space."""
    eye, target = np.array(camera.eye), np.array(camera.target)
    back = (eye - target) / np.linalg.norm(eye - target)
    right = np.cross([0, 1, 0], back)
    right /= np.linalg.norm(right)
    view = np.eye(4)
    view[:3, :3] = right, np.cross(back, right), back
    view[:3, 3] = -view[:3, :3] @ eye
    near, far, scale = NEAR, FAR, 1 / math.tan(math.radians(camera.fov_degrees) / 2)
    projection = np.zeros((4, 4))
    projection[0, 0], projection[1, 1], projection[3, 2] = scale / aspect, scale, -1
    projection[2, 2:] = (far + near) / (near - far), 2 * far * near / (near - far)
    return projection @ view


def median_ms(device, repeats, work):
    """Median, least and most of the repeats' times."""
    times = []
    for _ in range(repeats + 3):
        torch.cuda.synchronize(device)
        start = time.perf_counter()
        work()
        torch.cuda.synchronize(device)
        times.append(1e3 * (time.perf_counter() - start))
    times = sorted(times[3:])
    return times[len(times) // 2], times[0], times[-1]


def time_nvdiffrast(scene, cameras, width, height, device, repeats, depths):
    """Prints the rows of nvdiffrast. `depths`: scree's, as views x height x width."""
    import nvdiffrast.torch as nvdiffrast

    vertices, triangles = (torch.from_numpy(part).to(device) for part in world_geometry(pathlib.Path(scene)))
    matrices = np.stack([clip_matrix(camera, width / height).T for camera in cameras]).astype(np.float32)
    matrices = torch.from_numpy(matrices).to(device)
    context = nvdiffrast.RasterizeCudaContext(device=device)
    state = {}

    def transform():
        state["vertices"] = torch.matmul(vertices, matrices)

    def draw():
        state["image"], _ = nvdiffrast.rasterize(context, state["vertices"], triangles, (height, width), grad_db=False)

    for name, work in (("transform and draw", lambda: (transform(), draw())), ("draw", draw)):
        median, least, most = median_ms(device, repeats, work)
        print(f"nvdiffrast: {name},{len(cameras)},{width},{height},no,{median:.3f},{least:.3f},{most:.3f},"
              f"{1e3 * len(cameras) / median:.0f}")
    # nvdiffrast's rows are in order from the bottom to the top.
    image = state["image"].flip(1).double()
    others = torch.where(image[..., 3] == 0, math.inf, 2 * FAR * NEAR / (FAR + NEAR - image[..., 2] * (FAR - NEAR)))
    # nvdiffrast rounds vertices to a 16th of a pixel, so edges and steep surfaces move by less than a pixel.
    around = torch.nn.functional.max_pool2d(torch.stack((depths, -depths), 1), 3, stride=1, padding=1).double()
    different = (others > 1.005 * around[:, 0]) | (others < -0.995 * around[:, 1])
    # nvdiffrast also draws the backs of triangles, which scree leaves out.
    corners = vertices[triangles[(image[..., 3].long() - 1).clamp(min=0)[different]].long()][..., :3].double()
    normals = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    eyes = torch.tensor([list(camera.eye) for camera in cameras], dtype=torch.float64, device=device)
    is_back = ((eyes[different.nonzero()[:, 0]] - corners[:, 0]) * normals).sum(1) < 0
    wrong = len(is_back) - int(is_back.sum())
    print(f"depths of {depths.numel()} pixels: {int(is_back.sum())} show the back of a triangle, {wrong} others are not among "
          "scree's around the pixel", file=sys.stderr)
    if wrong > depths.numel() / 1000:
        raise SystemExit("torch_batches.py: nvdiffrast draws something else")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file")
    parser.add_argument("--cameras", type=int, default=1024)
    parser.add_argument("--size", default="128x128")
    parser.add_argument("--repeats", type=int, default=50)
    parser.add_argument("--library", default="libscree.so.0")
    parser.add_argument("--nvdiffrast", metavar="SCENE.gltf")
    options = parser.parse_args()
    width, height = map(int, options.size.split("x"))
    count = options.cameras
    scree = Library(options.library)
    file, scene, view, single = (c.c_void_p() for _ in range(4))
    scree("scree_open", options.file.encode(), c.byref(file))
    scree("scree_load", file, None, c.byref(scene))
    for handle in (view, single):
        scree("scree_view_create", scene, c.byref(handle))
    stats = Stats()
    scree("scree_get_scene_stats", scene, c.byref(stats))
    if not stats.on_gpu:
        raise SystemExit("torch_batches.py: no GPU draws the scene")
    cameras = random_cameras(stats, count)
    draw = Draw(width=width, height=height)
    device = torch.device("cuda", stats.gpu)
    shape = (count, height, width)
    layers = {DEPTH: torch.empty(shape, dtype=torch.float32, device=device),
              TRIANGLE: torch.empty(shape, dtype=torch.int64, device=device),
              INSTANCE: torch.empty(shape, dtype=torch.int32, device=device)}
    made = [Target(data=tensor.data_ptr(), bytes=tensor.nbytes, layer=layer) for layer, tensor in layers.items()]
    targets = (type(made[0]) * len(made))(*made)
    stream = torch.cuda.current_stream(device).cuda_stream

    def batch():
        scree("scree_draw_batch_to", view, cameras, count, c.byref(draw), targets, len(made), c.c_void_p(stream))

    def read():
        return torch.stack((layers[DEPTH].amin((1, 2)), (layers[TRIANGLE] >= 0).sum((1, 2)).float(),
                            (layers[INSTANCE] >= 0).sum((1, 2)).float()))

    def check():
        for i in range(0, count, max(1, count // 32)):
            scree("scree_draw", single, c.byref(cameras[i]), c.byref(draw))
            for layer, tensor in layers.items():
                one = torch.empty(shape[1:], dtype=tensor.dtype)
                scree("scree_read", single, layer, c.c_void_p(one.data_ptr()), c.c_uint64(one.nbytes))
                if not torch.equal(one, tensor[i].cpu()):
                    raise SystemExit(f"torch_batches.py: layer {layer} of view {i} differs from a single frame")

    print("device,cameras,width,height,read_by_torch,batch_ms,least_ms,most_ms,views_per_s")
    for reads in (True, False):
        median, least, most = median_ms(device, options.repeats, lambda: (batch(), read()) if reads else batch())
        print(f"{stats.gpu_name.decode()},{count},{width},{height},{'yes' if reads else 'no'},{median:.3f},{least:.3f},"
              f"{most:.3f},{1e3 * count / median:.0f}")
        if reads:
            shown = (layers[TRIANGLE] >= 0).flatten(1).sum(1)
            if not torch.equal(read()[1].long(), shown) or int(shown.sum()) == 0:
                raise SystemExit("torch_batches.py: torch did not read the drawn pictures")
        check()
    if options.nvdiffrast:
        time_nvdiffrast(options.nvdiffrast, cameras, width, height, device, options.repeats, layers[DEPTH])


if __name__ == "__main__":
    sys.exit(main())
