#!/usr/bin/env python3
"""Times batches of cameras. Depths and ids are written to torch tensors, which torch reads on the same stream.

    lab/torch_batches.py FILE.scree [--cameras 1024] [--size 128x128] [--repeats 50] [--library libscree.so]

Needs torch with CUDA and libscree of API version 4. Prints a line of CSV for a run in which torch reads every tensor
(the nearest depth of each view, and the number of its pixels that show a surface), and for one in which it does not.
After each run, pictures of the last batch are compared with views drawn one by one.
"""
import argparse
import ctypes as c
import random
import sys
import time

import torch

DEPTH, TRIANGLE, INSTANCE = 1, 2, 3
LOOK_AT = 2


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


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file")
    parser.add_argument("--cameras", type=int, default=1024)
    parser.add_argument("--size", default="128x128")
    parser.add_argument("--repeats", type=int, default=50)
    parser.add_argument("--library", default="libscree.so.0")
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
        times = []
        for _ in range(options.repeats + 3):
            torch.cuda.synchronize(device)
            start = time.perf_counter()
            batch()
            if reads:
                found = read()
            torch.cuda.synchronize(device)
            times.append(1e3 * (time.perf_counter() - start))
        times = sorted(times[3:])
        median = times[len(times) // 2]
        print(f"{stats.gpu_name.decode()},{count},{width},{height},{'yes' if reads else 'no'},{median:.3f},{times[0]:.3f},"
              f"{times[-1]:.3f},{1e3 * count / median:.0f}")
        if reads:
            shown = (layers[TRIANGLE] >= 0).flatten(1).sum(1)
            if not torch.equal(found[1].long(), shown) or int(shown.sum()) == 0:
                raise SystemExit("torch_batches.py: torch did not read the drawn pictures")
        check()


if __name__ == "__main__":
    sys.exit(main())
