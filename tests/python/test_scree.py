"""The Python package: test_scree.py DATA_FOLDER EXAMPLES_FOLDER"""

import ast
import ctypes
import gc
import inspect
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import threading
import time
import unittest
import weakref

import numpy as np
import scree

DATA = EXAMPLES = None


class CudaArray:
    """An object with the CUDA Array Interface of `array`; `words` replace entries of it."""

    def __init__(self, array, **words):
        self.array = array
        self.__cuda_array_interface__ = {"shape": array.shape, "typestr": array.dtype.str, "version": 3,
                                         "data": (array.ctypes.data, False), **words}


class DlpackArray:
    """A numpy array with only the DLPack methods, as before DLPack 1.0."""

    def __init__(self, array, device=(1, 0)):
        self.array = array
        self.device = device

    def __dlpack__(self, stream=None):
        self.stream = stream
        return self.array.__dlpack__()

    def __dlpack_device__(self):
        return self.device


class VersionedArray:
    """A small float32 array in a capsule of DLPack 1.0, or of another version and with flags."""

    class Tensor(ctypes.Structure):
        _fields_ = [("major", ctypes.c_uint32), ("minor", ctypes.c_uint32), ("context", ctypes.c_void_p),
                    ("deleter", ctypes.c_void_p), ("flags", ctypes.c_uint64), ("data", ctypes.c_void_p),
                    ("device_type", ctypes.c_int32), ("device", ctypes.c_int32), ("dimensions", ctypes.c_int32),
                    ("code", ctypes.c_uint8), ("bits", ctypes.c_uint8), ("lanes", ctypes.c_uint16),
                    ("shape", ctypes.c_void_p), ("strides", ctypes.c_void_p), ("offset", ctypes.c_uint64)]

    def __init__(self, array, major=1, flags=0, offset=0):
        self.array = array
        self.shape = (ctypes.c_int64 * array.ndim)(*array.shape)
        self.tensor = self.Tensor(major=major, flags=flags, data=array.ctypes.data - offset, device_type=1, code=2, bits=32,
                                  lanes=1, dimensions=array.ndim, shape=ctypes.addressof(self.shape), offset=offset)

    def __dlpack__(self, *, max_version):
        assert max_version == (1, 0)
        make = ctypes.pythonapi.PyCapsule_New
        make.restype, make.argtypes = ctypes.py_object, [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p]
        return make(ctypes.addressof(self.tensor), b"dltensor_versioned", None)

    def __dlpack_device__(self):
        return (1, 0)


def is_public(name, member):
    """Whether a class's member belongs to its interface, unlike members of every Python or pybind11 class."""
    dunders = ("__init__", "__dlpack__", "__dlpack_device__")
    if name.startswith("_"):
        return name in dunders and (inspect.isfunction(member) or name != "__init__")
    return True


def public_names(body):
    """The public names of a stub: functions, classes and annotated names; with _ only special methods."""
    names = {node.name for node in body if isinstance(node, (ast.FunctionDef, ast.ClassDef))}
    names |= {node.target.id for node in body if isinstance(node, ast.AnnAssign)}
    return {name for name in names if not name.startswith("_") or name.startswith("__")}


def arguments_of_stub(node):
    """(positional, keyword-only) names; optional ones end with =."""
    given = node.args
    positional = [argument.arg for argument in given.args]
    optional = len(positional) - len(given.defaults)
    positional = [name + ("=" if i >= optional else "") for i, name in enumerate(positional)]
    named = [argument.arg + ("=" if default is not None else "") for argument, default in zip(given.kwonlyargs, given.kw_defaults)]
    if given.kwarg is not None:
        named.append("**" + given.kwarg.arg)
    return positional, named


def arguments_of(function, shading):
    """The same for an existing function. **shading stands for the options of shading."""
    try:
        signature = inspect.signature(function)
    except ValueError:  # a pybind11 function: its docstring begins with the signature
        line = re.sub(r": [\w.\[\], ]+?(?= = |, \*|, \w+:|\))", "", function.__doc__.splitlines()[0].partition(" ->")[0])
        return arguments_of_stub(ast.parse(f"def {line}: ...").body[0])
    positional, named = [], []
    for name, parameter in signature.parameters.items():
        text = name + ("=" if parameter.default is not parameter.empty else "")
        if parameter.kind == parameter.POSITIONAL_OR_KEYWORD:
            positional.append(text)
        elif parameter.kind == parameter.KEYWORD_ONLY:
            named.append(text)
        else:
            assert parameter.kind == parameter.VAR_KEYWORD, name
            named += [option + "=" for option in shading] if name == "shading" else ["**" + name]
    return positional, named


class Package(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.temporary = tempfile.TemporaryDirectory()
        cls.folder = pathlib.Path(cls.temporary.name)
        cls.path = cls.folder / "scene.scree"
        cls.report = scree.convert(DATA / "two_instances.gltf", cls.path)
        cls.file = scree.open(cls.path)
        cls.scene = cls.file.load(backend="cpu")

    @classmethod
    def tearDownClass(cls):
        cls.temporary.cleanup()

    def test_convert(self):
        self.assertEqual(self.report["output_bytes"], self.path.stat().st_size)
        self.assertEqual(self.report["warnings"], [])
        with self.assertRaises(scree.Error) as caught:
            scree.convert(DATA / "two_instances.gltf", self.path)
        self.assertEqual(caught.exception.status, "SCREE_ERROR_FILE")
        again = self.folder / "again.scree"
        scree.convert(DATA / "two_instances.gltf", again)
        self.assertEqual(again.read_bytes(), self.path.read_bytes())

    def test_records(self):
        self.assertEqual(self.file.bytes, self.path.stat().st_size)
        self.assertEqual(sum(mesh["triangles"] for mesh in self.file.meshes), self.file.triangles)
        self.assertEqual(len(self.file.scenes), 1)
        self.assertEqual(self.file.scenes[0]["triangles"], self.scene.stats["triangles"])
        self.assertIsInstance(self.file.cameras(), list)
        instances = self.scene.instances()
        self.assertEqual(len(instances["mesh"]), self.scene.stats["instances"])
        self.assertEqual(instances["world"].shape, (self.scene.stats["instances"], 3, 4))

    def test_layers(self):
        frame = self.scene.render(70, 50, layers=scree.LAYERS, samples=1)
        self.assertEqual(frame["color"].shape, (50, 70, 4))
        self.assertEqual(frame["color"].dtype, np.uint8)
        self.assertEqual(frame["depth"].dtype, np.float32)
        self.assertEqual(frame["triangle"].dtype, np.int64)
        self.assertEqual(frame["instance"].dtype, np.int32)
        seen = frame["instance"] >= 0
        self.assertTrue(seen.any() and not seen.all())
        self.assertTrue((np.isfinite(frame["depth"]) == seen).all())
        self.assertTrue(((frame["triangle"] >= 0) == seen).all())
        self.assertTrue(((frame["samples"] & np.uint64((1 << 36) - 1)).astype(np.int64)[seen]
                         == frame["triangle"][seen]).all())
        first = self.scene.instances()["first_triangle"][frame["instance"][seen]]
        self.assertTrue((first <= frame["triangle"][seen]).all())
        self.assertEqual(frame["normal"].shape, (50, 70, 3))
        self.assertEqual(frame["uv"].shape, (50, 70, 2))
        self.assertEqual(frame["uv"].dtype, np.float32)
        lengths = np.linalg.norm(frame["normal"], axis=2)
        self.assertTrue(np.allclose(lengths, seen, atol=1e-6))
        self.assertTrue((frame["uv"][~seen] == 0).all())
        batch = self.scene.view().draw_batch([None, None], 70, 50, layers=["normal", "uv"])
        self.assertTrue((batch.read("normal")[1] == frame["normal"]).all())
        self.assertEqual(np.from_dlpack(batch.share("uv")).shape, (2, 50, 70, 2))

    def test_share_is_no_copy(self):
        view = self.scene.view().draw(40, 30)
        shared = view.share("depth")
        self.assertEqual(shared.__dlpack_device__(), (1, 0))
        self.assertEqual(shared.shape, (30, 40))
        self.assertEqual(shared.dtype, np.float32)
        array, other = np.from_dlpack(shared), np.from_dlpack(view.share("depth"))
        self.assertEqual(array.ctypes.data, other.ctypes.data)
        self.assertTrue((array == view.read("depth")).all())
        del view, shared, other
        gc.collect()
        self.assertTrue(np.isfinite(array).any())  # the array keeps the view
        view = self.scene.view().draw(8, 8)
        small = [np.from_dlpack(view.share(layer)) for layer in scree.LAYERS]
        before = [array.copy() for array in small]
        view.draw(900, 700, samples=2)  # needs more memory than the arrays' blocks
        for layer, array, expected in zip(scree.LAYERS, small, before):
            np.from_dlpack(view.share(layer))
            self.assertTrue((array == expected).all(), layer)
        view.draw_batch([None] * 3, 900, 700, layers=["color"])
        del view
        gc.collect()
        self.assertTrue(all((array == expected).all() for array, expected in zip(small, before)))
        capsule = self.scene.view().draw(8, 8).share("color").__dlpack__()
        del capsule  # no consumer took it

    def test_share_takes_the_words_of_the_protocol(self):
        shared = self.scene.view().draw(8, 8).share("color")
        self.assertTrue(shared.__dlpack__(stream=None, max_version=(1, 0), dl_device=(1, 0), copy=False))
        for words in ({"copy": True}, {"dl_device": (2, 0)}):
            with self.assertRaises(BufferError):
                shared.__dlpack__(**words)
        with self.assertRaises(TypeError):
            shared.__dlpack__(colour=True)

    def test_cameras(self):
        view = self.scene.view()
        view.draw(60, 60, camera=scree.look_at((0, 0, 9), (0, 0, 0), fov=45))
        looked = view.read("triangle")
        world_to_camera = np.eye(4)
        world_to_camera[2, 3] = -9
        projection = np.zeros((4, 4))
        projection[0, 0] = projection[1, 1] = 1 / np.tan(np.radians(22.5))
        projection[2, 2], projection[2, 3], projection[3, 2] = -1, -0.02, -1
        view.draw(60, 60, camera=scree.matrices(world_to_camera, projection))
        self.assertTrue((looked == view.read("triangle")).all())
        with self.assertRaises(ValueError):
            scree.matrices(np.eye(3), projection)
        with self.assertRaises(scree.Error) as caught:
            view.draw(60, 60, camera="nobody")
        self.assertEqual(caught.exception.status, "SCREE_ERROR_ARGUMENT")
        self.assertIn("nobody", str(caught.exception))

    def test_batch(self):
        cameras = [scree.look_at((4 * np.sin(a), 2, 4 * np.cos(a))) for a in np.linspace(0, 6, 7)] + [None]
        view = self.scene.view().draw_batch(cameras, 33, 21, layers=["color", "depth", "instance"], samples=2)
        single = self.scene.view()
        self.assertEqual(view.read("color").shape, (8, 21, 33, 4))
        self.assertEqual(np.from_dlpack(view.share("depth")).shape, (8, 21, 33))
        for number, camera in enumerate(cameras):
            single.draw(33, 21, camera=camera, samples=2)
            for layer in ("color", "depth", "instance"):
                self.assertTrue((view.read(layer)[number] == single.read(layer)).all())
        with self.assertRaises(scree.Error):
            view.read("triangle")
        with self.assertRaises(ValueError):
            view.draw_batch([], 8, 8)

    def test_batch_into_arrays(self):
        cameras = [scree.look_at((4 * np.sin(a), 2, 4 * np.cos(a))) for a in np.linspace(0, 6, 7)] + [None]
        layers = [layer for layer in scree.LAYERS if layer not in ("samples", "linear")]
        expected = self.scene.view().draw_batch(cameras, 36, 20, layers=layers, samples=2, show="normal")
        expected = {layer: expected.read(layer) for layer in layers}
        view = self.scene.view()
        # Parts of larger arrays, whose other parts stay unchanged.
        blocks = {layer: np.full((10, *array.shape[1:]), 77, array.dtype) for layer, array in expected.items()}
        drawn = view.draw_batch_to(cameras, {layer: block[1:9] for layer, block in blocks.items()}, samples=2, stream=5,
                                   show="normal")
        for layer, block in blocks.items():
            self.assertTrue((block[1:9] == expected[layer]).all(), layer)
            self.assertTrue((block[[0, 9]] == 77).all(), layer)
        self.assertIs(drawn, view)
        self.assertEqual((view.stats["width"], view.stats["height"], view.stats["cameras"]), (36, 20, 8))
        with self.assertRaises(scree.Error):  # the view keeps no layer
            view.read("depth")
        # The stride of a dimension with one element is ignored.
        one = np.lib.stride_tricks.as_strided(np.zeros((20, 36), np.float32), (1, 20, 36), (4, 144, 4))
        view.draw_batch_to(cameras[:1], {"depth": one}, samples=2)
        self.assertTrue((one[0] == expected["depth"][0]).all())

    def test_batch_into_dlpack(self):
        cameras = [None, scree.around(90, 10)]
        expected = self.scene.view().draw_batch(cameras, 36, 20, layers=["depth"]).read("depth")
        for made in (DlpackArray, lambda array: DlpackArray(array, (3, 0)), VersionedArray,
                     lambda array: VersionedArray(array, offset=48)):
            depth = np.zeros((2, 20, 36), np.float32)
            before = sys.getrefcount(depth)
            given = made(depth)
            self.scene.view().draw_batch_to(cameras, {"depth": given})
            self.assertTrue((depth == expected).all())
            del given
            self.assertEqual(sys.getrefcount(depth), before)
        for made, error, text in ((lambda array: VersionedArray(array, flags=1), ValueError, "read-only"),
                                  (lambda array: VersionedArray(array, major=2), BufferError, "DLPack version 2"),
                                  (lambda array: DlpackArray(array, (2, 0)), ValueError, "GPU 0, but the CPU draws"),
                                  (lambda array: DlpackArray(array, (7, 0)), ValueError, "DLPack device 7"),
                                  (lambda array: DlpackArray(array[:, ::2]), ValueError, "not contiguous"),
                                  (lambda array: DlpackArray(array.astype(np.float64)), TypeError,
                                   "dtype float64, expected float32")):
            depth = np.full((2, 20, 36), 3, np.float32)
            with self.assertRaisesRegex(error, text):
                self.scene.view().draw_batch_to(cameras, {"depth": made(depth)})
            self.assertTrue((depth == 3).all())
        other = DlpackArray(depth, (2, 0))
        for stream, seen in ((None, 1), (0, 1), (2, 2), (1 << 40, 1 << 40)):
            with self.assertRaisesRegex(ValueError, "the CPU draws"):
                self.scene.view().draw_batch_to(cameras, {"depth": other}, stream=stream)
            self.assertEqual(other.stream, seen)

    def test_batch_refuses_arrays(self):
        cameras = [None, None, None]
        view = self.scene.view()
        depth = np.full((3, 20, 36), 5, np.float32)
        locked = depth.copy()
        locked.flags.writeable = False
        bytes_ = np.zeros(depth.nbytes + 16, np.uint8)
        odd = bytes_[4 - bytes_.ctypes.data % 16:][:depth.nbytes].view(np.float32).reshape(depth.shape)
        one = np.zeros((1, 20, 36), np.float32)
        for targets, error, text in (
                ({}, ValueError, "at least one layer"),
                ({"colour": depth}, ValueError, "'colour' is not one of color, "),
                ({"samples": depth}, ValueError, "no such layer"),
                ({"linear": depth}, ValueError, "no such layer"),
                ({"depth": [1, 2]}, TypeError, r"^targets\['depth'\]: list is no numpy array"),
                ({"depth": depth.astype(np.float64)}, TypeError, r"^targets\['depth'\]: dtype float64, expected float32$"),
                ({"depth": depth.astype(">f4")}, TypeError, "dtype >f4, expected float32"),
                ({"depth": depth[0]}, ValueError, r"shape \(20, 36\), expected \(3, height, width\) for 3 cameras"),
                ({"depth": depth[:2]}, ValueError, r"shape \(2, 20, 36\)"),
                ({"depth": depth[:, :0]}, ValueError, r"shape \(3, 0, 36\) has no pixels"),
                ({"uv": np.zeros((3, 2, 20, 36), np.float32)}, ValueError, r"expected \(3, height, width, 2\)"),
                ({"depth": depth, "instance": np.zeros((3, 36, 20), np.int32)}, ValueError,
                 r"^targets\['instance'\]: 36 x 20 pixels, but targets\['depth'\] has 20 x 36"),
                ({"depth": depth[:, ::2]}, ValueError, r"^targets\['depth'\]: not contiguous"),
                ({"depth": np.asfortranarray(depth)}, ValueError, "not contiguous"),
                ({"depth": np.broadcast_to(one, depth.shape)}, ValueError, "not contiguous"),
                ({"depth": locked}, ValueError, r"^targets\['depth'\]: read-only$"),
                ({"depth": odd}, ValueError, "multiple of 16 bytes"),
                ({"depth": CudaArray(depth)}, ValueError, r"^targets\['depth'\]: it lies in GPU memory, but the CPU draws$"),
                ({"depth": CudaArray(depth, typestr="<f8")}, TypeError, "dtype float64"),
                ({"depth": CudaArray(depth, shape=(3, 20))}, ValueError, "shape"),
                ({"depth": CudaArray(depth, strides=None)}, ValueError, "the CPU draws"),
                ({"depth": CudaArray(depth, strides=(2880, 144, 4))}, ValueError, "the CPU draws"),
                ({"depth": CudaArray(depth, strides=(2880, 4, 80))}, ValueError, "not contiguous"),
                ({"depth": CudaArray(depth, strides=(2880, 144, 3))}, ValueError, "not contiguous"),
                ({"depth": CudaArray(depth, data=(depth.ctypes.data, True))}, ValueError, "read-only"),
                ({"depth": CudaArray(depth, data=(depth.ctypes.data + 4, False))}, ValueError, "16 bytes")):
            with self.subTest(text), self.assertRaisesRegex(error, text):
                view.draw_batch_to(cameras, targets)
        for stream, error in ((-1, ValueError), (1.5, TypeError), ("1", TypeError)):
            with self.assertRaisesRegex(error, "^stream: "):
                view.draw_batch_to(cameras, {"depth": depth}, stream=stream)
        with self.assertRaises(ValueError):
            view.draw_batch_to([], {"depth": depth[:0]})
        with self.assertRaises(TypeError):
            view.draw_batch_to(cameras, {"depth": depth}, glow=1)
        with self.assertRaises(scree.Error):
            view.draw_batch_to(cameras, {"depth": depth}, samples=3)
        self.assertTrue((depth == 5).all())

        class Fails:
            @property
            def __cuda_array_interface__(self):
                raise RuntimeError("requires grad")

        with self.assertRaisesRegex(RuntimeError, "requires grad"):
            view.draw_batch_to(cameras, {"depth": Fails()})

    def test_batch_into_a_gpus_memory(self):
        try:
            scene = self.file.load(backend="cuda")
        except scree.Error as error:
            self.skipTest(str(error))
        cameras = [scree.look_at((4 * np.sin(a), 2, 4 * np.cos(a))) for a in np.linspace(0, 6, 5)]
        owner, view = scene.view(), scene.view()
        for layer in scree.LAYERS:
            if layer in ("samples", "linear"):
                continue
            expected = owner.draw_batch(cameras, 36, 20, layers=[layer]).read(layer)
            # Memory of another view serves as the caller's memory.
            shared = owner.draw_batch([None] * 5, 36, 20, layers=[layer]).share(layer)
            view.draw_batch_to(cameras, {layer: shared}, stream=0)
            self.assertTrue((owner.read(layer) == expected).all(), layer)

            owner.draw_batch([None] * 5, 36, 20, layers=[layer])
            pointer = ctypes.pythonapi.PyCapsule_GetPointer
            pointer.restype, pointer.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
            capsule = shared.__dlpack__()
            address = ctypes.c_void_p.from_address(pointer(capsule, b"dltensor")).value
            view.draw_batch_to(cameras, {layer: CudaArray(expected, data=(address, False), stream=1)})
            self.assertTrue((owner.read(layer) == expected).all(), layer)
        host = np.zeros((5, 20, 36), np.float32)
        with self.assertRaisesRegex(ValueError, "host memory, but GPU 0 draws"):
            view.draw_batch_to(cameras, {"depth": host})
        with self.assertRaisesRegex(ValueError, "the memory of GPU 1, but GPU 0 draws"):
            view.draw_batch_to(cameras, {"depth": DlpackArray(host, (2, 1))})
        shared = owner.draw_batch(cameras, 36, 20, layers=["depth", "instance"])
        address = [ctypes.c_void_p.from_address(pointer(capsule, b"dltensor")).value
                   for capsule in (shared.share("depth").__dlpack__(), shared.share("instance").__dlpack__())]
        two = {"depth": CudaArray(host, data=(address[0], False), stream=1),
               "instance": CudaArray(host.astype(np.int32), data=(address[1], False), stream=2)}
        with self.assertRaisesRegex(ValueError, "another CUDA stream"):
            view.draw_batch_to(cameras, two)
        view.draw_batch_to(cameras, two, stream=2)

    def test_other_threads_run_while_a_batch_is_drawn(self):
        ticks, done = [], threading.Event()

        def tick():
            while not done.wait(0.001):
                ticks.append(time.perf_counter())

        thread = threading.Thread(target=tick)
        thread.start()
        color = np.zeros((8, 512, 512, 4), np.uint8)
        view = self.scene.view()
        begin = time.perf_counter()
        view.draw_batch_to([None] * 8, {"color": color}, samples=4)
        end = time.perf_counter()
        done.set()
        thread.join()
        self.assertGreater(sum(begin < moment < end for moment in ticks), 5)

    def test_pick_and_stats(self):
        view = self.scene.view().draw(64, 64)
        instance = view.read("instance")
        y, x = np.argwhere(instance >= 0)[0]
        picked = view.pick(int(x), int(y))
        self.assertEqual(picked["instance"], instance[y, x])
        self.assertAlmostEqual(picked["depth"], view.read("depth")[y, x], delta=1e-5)
        self.assertIsNone(view.pick(0, 0))
        self.assertEqual(view.stats["width"], 64)
        with self.assertRaises(scree.Error):
            view.pick(64, 0)

    def test_blended_layers(self):
        path = self.folder / "glass.scree"
        scree.convert(DATA / "glass.glb", path)
        view = scree.open(path).load(backend="cpu").view().draw(32, 24, camera=scree.look_at((0, 0, 4)))
        self.assertEqual(view.stats["blended_layers"], 0)
        view.read()
        self.assertEqual(view.stats["blended_layers"], 16)
        self.assertGreater(view.stats["samples_with_more_layers"], 0)

    def test_light(self):
        path = self.folder / "materials.scree"
        scree.convert(DATA / "materials.gltf", path)
        hdr = self.folder / "sky.hdr"
        hdr.write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n" + bytes([90, 100, 110, 128, 20, 10, 0, 127]))
        file = scree.open(path)
        scene = file.load(backend="cpu", light="environment", environment=hdr, texture_memory=1 << 20)
        self.assertEqual(scene.stats["light"], "environment")
        self.assertEqual(scene.stats["lights"], 0)
        self.assertEqual(scene.warnings, [])
        view = scene.view().draw(40, 30, camera=scree.around(20, 10))
        lit = view.read()
        self.assertTrue((view.shade(exposure=-3).read() != lit).any())
        self.assertTrue((view.shade(light="camera").read() != lit).any())
        self.assertTrue((view.shade(light="environment").read() == lit).all())
        self.assertTrue((view.shade(edl=True, edl_strength=9.0, edl_radius=2).read() != lit).any())
        linear = view.shade().read("linear")
        self.assertEqual(linear.shape, (30, 40, 4))
        self.assertTrue((np.from_dlpack(view.share("linear")) == linear).all())
        self.assertTrue((np.abs(linear[..., 3] - lit[..., 3] / 255) <= 0.5 / 255 + 1e-6).all())
        for words in ({"light": "scene"}, {"exposure": 21}, {"blend_layers": 70000}):
            with self.assertRaises(scree.Error):
                view.shade(**words)
        with self.assertRaises(TypeError):
            view.shade(glow=1)
        with self.assertRaises(ValueError):
            view.shade(light="moon")
        with self.assertRaises(scree.Error):
            file.load(backend="cpu", light="scene")
        with self.assertRaises(scree.Error):
            file.load(backend="cpu", environment=self.folder / "missing.hdr")

    def test_shadows(self):
        path = self.folder / "sun.scree"
        scree.convert(DATA / "sun.glb", path)
        scene = scree.open(path).load(backend="cpu", light="scene", largest_shadows=300)
        camera = scree.around(30, 40)
        view = scene.view().draw(60, 40, camera=camera)
        lit = view.read()
        self.assertEqual(view.stats["shadow_ms"], 0)
        shadowed = view.draw(60, 40, camera=camera, shadows=True, shadow_size=300).read()
        self.assertGreater(view.stats["shadow_ms"], 0)
        self.assertTrue((shadowed <= lit).all())
        self.assertGreater((shadowed < lit).any(axis=2).sum(), 20)
        self.assertTrue((view.shade().read() == lit).all())
        self.assertTrue((view.shade(shadows=True, shadow_size=300).read() == shadowed).all())
        self.assertEqual(view.stats["shadow_ms"], 0)  # the map was kept
        both = view.draw_batch([camera, camera], 60, 40, shadows=True, shadow_size=300).read()
        self.assertTrue((both == shadowed).all())
        for words in ({"shadow_size": 63}, {"shadows": True, "light": "camera"}):
            with self.assertRaises(scree.Error):
                view.draw(60, 40, **words)
        with self.assertRaises(TypeError):
            view.draw(60, 40, shadows=True, shadow_size=-1)
        with self.assertRaises(scree.Error):
            scree.open(path).load(backend="cpu", largest_shadows=16385)

    def test_blended_surfaces_are_left_out(self):
        path = self.folder / "clear.scree"
        scree.convert(DATA / "glass.glb", path)
        view = scree.open(path).load(backend="cpu").view().draw(32, 24, camera=scree.look_at((0, 0, 4)))
        for layers in (0, 1, 3):
            view.shade(blend_layers=layers).read()
            self.assertEqual(view.stats["blended_layers"], layers)

    def test_shade(self):
        view = self.scene.view().draw(32, 32, show="normal")
        normal = view.read()
        triangle = view.shade(show="triangle").read()
        self.assertTrue((normal != triangle).any())
        self.assertTrue((view.shade(show="normal").read() == normal).all())

    def test_misuse(self):
        with self.assertRaises(scree.Error) as caught:
            scree.open(self.folder / "missing.scree")
        self.assertEqual(caught.exception.status, "SCREE_ERROR_FILE")
        self.assertIsInstance(caught.exception, RuntimeError)
        view = self.scene.view()
        with self.assertRaises(scree.Error) as caught:
            view.read("color")
        self.assertEqual(caught.exception.status, "SCREE_ERROR_NO_FRAME")
        with self.assertRaises(ValueError):
            view.draw(8, 8, show="nothing")
        with self.assertRaises(ValueError):
            view.read("colour")
        with self.assertRaises(scree.Error):
            view.draw(8, 8, samples=3)
        for call, error, text in (
                (lambda: view.draw(-1, 8), ValueError, "width: -1, expected 1 to 4294967295"),
                (lambda: view.draw(8, 8.5), TypeError, "height: 8.5 is no whole number"),
                (lambda: view.draw(8, 8, edl_radius=0), ValueError, "edl_radius: 0, expected 1 to 64"),
                (lambda: view.draw(8, 8, shadow_size=0), ValueError, "shadow_size: 0, expected 64 to 16384"),
                (lambda: view.draw(8, 8, camera="in\0side"), ValueError, "camera: .* has a zero byte"),
                (lambda: self.file.load(threads=-1), ValueError, "threads: -1, expected 0 to 4294967295"),
                (lambda: scree.open("a\0b"), ValueError, "path: 'a.x00b' has a zero byte"),
                (lambda: scree.look_at((1, 2)), TypeError, r"eye: \(1, 2\), expected three numbers"),
                (lambda: scree.look_at((1, 2, 3), fov=0), ValueError, "fov: 0, expected at least 1e-9 and below 180"),
                (lambda: scree.convert("a.glb", jpeg_quality=0), ValueError, "jpeg_quality: 0, expected 1 to 100"),
                (lambda: view.draw_batch_to([None], {1: np.zeros(1)}), TypeError, "targets: the key 1"),
                (lambda: view.draw_batch_to([None], {"depth": np.zeros(1)}, stream=2**63), ValueError, f"stream: {2**63}")):
            with self.subTest(text), self.assertRaisesRegex(error, text):
                call()
        with self.assertRaises(scree.Error):
            self.file.load("nowhere", backend="cpu")

    def test_progress(self):
        heard = []
        self.file.load(backend="cpu", progress=lambda *step: heard.append(step))
        self.assertEqual(heard[0][0], "geometry")
        with self.assertRaises(scree.Error) as caught:
            self.file.load(backend="cpu", progress=lambda *step: False)
        self.assertEqual(caught.exception.status, "SCREE_ERROR_CANCELLED")

        def fails(stage, done, total):
            raise KeyError(stage)

        with self.assertRaises(KeyError):
            self.file.load(backend="cpu", progress=fails)
        with self.assertRaises(KeyError):
            scree.convert(DATA / "grid.glb", self.folder / "none.scree", progress=fails)
        self.assertFalse((self.folder / "none.scree").exists())

    def test_threads(self):
        cameras = [scree.look_at((4 * np.sin(a), 2, 4 * np.cos(a))) for a in np.linspace(0, 6, 16)]
        expected = [self.scene.render(40, 40, camera=camera)["color"] for camera in cameras]
        wrong = []

        def draw(first):
            view = self.scene.view()
            for number in range(first, len(cameras), 2):
                if (view.draw(40, 40, camera=cameras[number]).read() != expected[number]).any():
                    wrong.append(number)

        threads = [threading.Thread(target=draw, args=(i % 2,)) for i in range(8)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertEqual(wrong, [])

    def test_frames_of_one_scene_by_threads(self):
        """render() of several threads gives each its own picture, although all use the scene's view."""
        cameras = [scree.look_at((4 * np.sin(a), 2, 4 * np.cos(a))) for a in np.linspace(0, 6, 4)]
        expected = [self.scene.render(40, 40, camera=camera)["color"] for camera in cameras]
        wrong = []

        def draw(number):
            for _ in range(20):
                if (self.scene.render(40, 40, camera=cameras[number])["color"] != expected[number]).any():
                    wrong.append(number)

        threads = [threading.Thread(target=draw, args=(i,)) for i in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertEqual(wrong, [])

    def test_the_process_ends_while_threads_draw(self):
        code = """
import sys, threading, time, scree
scene = scree.open(sys.argv[1]).load(backend="cpu", threads=1)
def draw():
    view = scene.view()
    while True:
        view.draw(16, 16).read("depth")
for _ in range(4):
    threading.Thread(target=draw, daemon=True).start()
time.sleep(0.2)
"""
        for _ in range(3):
            ended = subprocess.run([sys.executable, "-c", code, self.path], capture_output=True, text=True, timeout=60)
            self.assertEqual((ended.returncode, ended.stderr), (0, ""))

    def test_names_that_are_not_utf8(self):
        """Names in files and of files may be any bytes."""
        text = (DATA / "two_instances.gltf").read_bytes()
        source = self.folder / "bytes.gltf"
        source.write_bytes(text)
        for file in DATA.glob("*.bin"):
            (self.folder / file.name).write_bytes(file.read_bytes())
        output = os.fsencode(self.folder) + b"/\xff.scree"
        scree.convert(source, output)
        self.assertEqual(scree.open(output).triangles, self.file.triangles)
        name = next(name for name in os.listdir(self.folder) if name.endswith("ff.scree") or "\udcff" in name)
        self.assertEqual(scree.open(self.folder / name).triangles, self.file.triangles)
        with self.assertRaisesRegex(scree.Error, r"missing.\\xff"):
            scree.open(os.fsencode(self.folder) + b"/missing-\xff")
        with self.assertRaises(scree.Error):
            scree.open("\u00e9" * 2000)

    def test_up_is_chosen(self):
        """Straight down, -z is up, as in scree render."""
        down = self.scene.render(40, 40, camera=scree.look_at((0, 10, 0), (0, 5, 0)))["color"]
        chosen = self.scene.render(40, 40, camera=scree.look_at((0, 10, 0), (0, 5, 0), up=(0, 0, -1)))["color"]
        self.assertTrue((down == chosen).all())
        with self.assertRaises(scree.Error):
            self.scene.render(40, 40, camera=scree.look_at((0, 10, 0), (0, 5, 0), up=(0, 1, 0)))

    def test_no_strength_is_no_effect(self):
        plain = self.scene.render(40, 40)["color"]
        self.assertTrue((self.scene.render(40, 40, edl=True, edl_strength=0)["color"] == plain).all())
        self.assertTrue((self.scene.render(40, 40, edl=True)["color"] != plain).any())

    def test_scene_outlives_its_file(self):
        file = scree.open(self.path)
        gone = weakref.ref(file)
        scene = file.load(backend="cpu")
        del file
        gc.collect()
        self.assertIsNone(gone())
        self.assertEqual(scene.render(8, 8)["color"].shape, (8, 8, 4))

    def test_clipped(self):
        view, single = self.scene.view(), self.scene.view()
        low, high = np.array(self.scene.stats["box_min"]), np.array(self.scene.stats["box_max"])
        camera = scree.around(40, 25)
        whole = view.draw(60, 40, camera=camera).read("triangle")
        self.assertTrue((view.draw(60, 40, camera=scree.clipped(camera, low - 1, high + 1)).read("triangle") == whole).all())
        boxes = [(low, (low + high) / 2), ((low + high) / 2, high), (high + 1, high + 2)]
        cameras = [scree.clipped(camera, *box) for box in boxes] + [scree.clipped(None, *boxes[0]), camera]
        pictures = [view.draw(60, 40, camera=camera).read("triangle") for camera in cameras]
        self.assertTrue((pictures[0] != whole).any() and (pictures[0] >= 0).any())
        self.assertTrue((pictures[2] == -1).all())
        self.assertTrue((single.draw_batch(cameras, 60, 40, layers=["triangle"]).read("triangle") == np.array(pictures)).all())
        for box in (((0, 0, np.nan), (1, 1, 1)), ((0, 2, 0), (1, 1, 1))):
            with self.assertRaises(scree.Error) as caught:
                view.draw(8, 8, camera=scree.clipped(camera, *box))
            self.assertEqual(caught.exception.status, "SCREE_ERROR_ARGUMENT")
        with self.assertRaises(TypeError):
            scree.clipped(camera, (0, 0), (1, 1, 1))

    def test_path(self):
        film = self.folder / "film.json"
        film.write_text('{"format": "scree camera path", "version": 1, "fps": 4, "keys": ['
                        '{"t": 0, "eye": [4, 2, 6], "target": [0, 0, 0]}, {"t": 2, "eye": [6, 3, 0], "target": [0, 0, 0]}]}')
        self.assertEqual(scree.path_info(film), {"frames": 9, "fps": 4.0})
        self.assertEqual(scree.path_info(film, fps=30), {"frames": 61, "fps": 30.0})
        cameras = scree.cameras_of_path(film)
        self.assertEqual(len(cameras), 9)
        view = self.scene.view()
        drawn = view.draw_batch(cameras, 40, 30, layers=["depth"]).read("depth")
        self.assertTrue((view.draw(40, 30, camera=scree.look_at((4, 2, 6), (0, 0, 0))).read("depth") == drawn[0]).all())
        part = scree.cameras_of_path(film, first=7, count=100)
        self.assertEqual(len(part), 2)
        self.assertTrue((view.draw(40, 30, camera=part[1]).read("depth") == drawn[8]).all())
        self.assertEqual(len(scree.cameras_of_path(film, fps=1, first=1, count=1)), 1)
        self.assertEqual(scree.cameras_of_path(film, first=9), [])
        for words, status in (({"first": 10}, "SCREE_ERROR_ARGUMENT"), ({"fps": -1}, "SCREE_ERROR_ARGUMENT")):
            with self.assertRaises(scree.Error) as caught:
                scree.cameras_of_path(film, **words)
            self.assertEqual(caught.exception.status, status)
        with self.assertRaises(scree.Error) as caught:
            scree.cameras_of_path(self.path)
        self.assertEqual(caught.exception.status, "SCREE_ERROR_DATA")
        with self.assertRaises(ValueError):
            scree.cameras_of_path(film, first=-1)

    def test_shading_of_another_type(self):
        view = self.scene.view().draw(8, 8)
        for words, text in (({"exposure": "a"}, "exposure: 'a' is of another type"), ({"edl_radius": -1}, "edl_radius: -1"),
                            ({"background": (0, 0, 0)}, r"background: \(0, 0, 0\)"), ({"show": 3}, "show: 3")):
            with self.assertRaisesRegex(TypeError, text):
                view.shade(**words)

    def test_stubs_are_the_module(self):
        """The stubs list the public names, arguments and properties that the built module has, and no other."""
        stubs = ast.parse(pathlib.Path(scree.__file__).with_name("__init__.pyi").read_text())
        self.assertEqual(public_names(stubs.body), set(scree.__all__))
        visible = {name for name, value in vars(scree).items()
                   if not name.startswith("_") and not inspect.ismodule(value) and name != "annotations"}
        self.assertEqual(visible | {"__version__"}, set(scree.__all__))
        with self.assertRaises(TypeError) as caught:
            self.scene.view().draw(8, 8).shade(glow=1)
        shading = str(caught.exception).partition(" is not one of ")[2].split(", ")
        self.assertIn("show", shading)
        objects = {"File": self.file, "Scene": self.scene, "View": self.scene.view(), "Error": scree.Error("text")}
        objects["Error"].status = "SCREE_ERROR_FILE"  # the module sets it
        for node in stubs.body:
            with self.subTest(getattr(node, "name", "")):
                if isinstance(node, ast.FunctionDef):
                    self.assertEqual(arguments_of_stub(node), arguments_of(getattr(scree, node.name), shading))
                if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                    self.check_class(node, getattr(scree, node.name), objects.get(node.name), shading)

    def check_class(self, node, found, value, shading):
        members = {name for name, member in vars(found).items() if is_public(name, member)}
        if value is not None:
            members |= {name for name in vars(value) if not name.startswith("_")}
        if found is scree.Scene or found is scree.View:
            members.discard("__init__")  # made by File.load() and Scene.view()
        self.assertEqual(public_names(node.body), members)
        for member in node.body:
            if not isinstance(member, ast.FunctionDef):
                continue
            there = inspect.getattr_static(found, member.name)
            if [decorator.id for decorator in member.decorator_list] == ["property"]:
                self.assertIsInstance(there, property, member.name)
            else:
                self.assertEqual(arguments_of_stub(member), arguments_of(getattr(found, member.name), shading), member.name)

    def test_documentation(self):
        """Every public name has a docstring, with each argument, and with shapes and errors where arrays pass."""
        stubs = ast.parse(pathlib.Path(scree.__file__).with_name("__init__.pyi").read_text())
        documented = 0
        view = next(node for node in stubs.body if isinstance(node, ast.ClassDef) and node.name == "View")
        self.stub_of_draw = next(node for node in view.body if node.name == "draw")
        for node in stubs.body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                self.assertTrue(getattr(scree, node.name).__doc__, node.name)
                documented += sum(self.check_docstring(member, inspect.getattr_static(getattr(scree, node.name), member.name))
                                  for member in node.body if isinstance(member, ast.FunctionDef) and member.name != "__init__")
            elif isinstance(node, ast.FunctionDef):
                documented += self.check_docstring(node, getattr(scree, node.name))
        self.assertGreater(documented, 30)
        self.assertTrue(scree.__doc__)

    def check_docstring(self, node, found):
        with self.subTest(node.name):
            self.check_text(node, found.__doc__ or "")
        return 1

    def check_text(self, node, text):
        text = text.partition("\n\n")[2] if text.startswith(f"{node.name}(") else text  # the first line has types
        self.assertGreater(len(text), 20, node.name)
        names = {name.strip("*=") for some in arguments_of_stub(node) for name in some}
        names -= {"self", "width", "height", "layer", "scene", "path", "x", "y"}  # self-explanatory names
        if re.search(r"(`shading`|[Oo]ther arguments[a-z\s]*): as for\s+draw", text):
            names -= {name.strip("*=") for some in arguments_of_stub(self.stub_of_draw) for name in some}
        told = set(re.findall(r"`(\w+)`", text))
        if not node.name.startswith("__"):
            self.assertEqual(names - told, set())
        arrays = ("NDArray", "ArrayLike", "_Array", "SharedLayer")
        if any(word in ast.unparse(node) for word in arrays):
            self.assertRegex(text, r"\b\w+ x \w+", node.name)  # a shape
            self.assertRegex(text, r"float32|float64|int32|of the types and units of read|of the types and units of\s+View.read|"
                             r"Types and\s+units are as for read|by layer\): as for Scene.render", node.name)
            self.assertIn("Raises", text, node.name)

    def test_examples(self):
        expected = {
            "depth_map.py": (["depth.npy", "depth.pgm"], []),
            "segmentation.py": (["segmentation.npy"], []),
            "random_views.py": (["views.npy"], ["25"]),
            "turntable.py": (["000.ppm", "003.ppm"], ["4"]),
            "camera_batch.py": (["color.npy", "depth.npy", "triangle.npy"], []),
        }
        self.assertEqual(sorted(path.name for path in EXAMPLES.glob("*.py")), sorted(expected))
        for name, (outputs, words) in expected.items():
            with self.subTest(name), tempfile.TemporaryDirectory() as folder:
                done = subprocess.run([sys.executable, EXAMPLES / name, self.path, folder, *words], text=True,
                                      capture_output=True, timeout=120)
                self.assertEqual(done.returncode, 0, done.stderr)
                self.assertTrue(done.stdout)
                for output in outputs:
                    self.assertGreater((pathlib.Path(folder) / output).stat().st_size, 0)
                if name == "depth_map.py":
                    depth = np.load(pathlib.Path(folder) / "depth.npy")
                    self.assertTrue((depth == self.scene.render(320, 240, layers=["depth"])["depth"]).all())
                if name == "segmentation.py":
                    meshes = np.unique(np.load(pathlib.Path(folder) / "segmentation.npy"))
                    self.assertTrue((meshes >= -1).all() and meshes.max() < len(self.file.meshes))


if __name__ == "__main__":
    DATA, EXAMPLES = pathlib.Path(sys.argv.pop(1)), pathlib.Path(sys.argv.pop(1))
    unittest.main()
