"""The Python package: test_scree.py DATA_FOLDER EXAMPLES_FOLDER"""

import gc
import pathlib
import subprocess
import sys
import tempfile
import threading
import unittest
import weakref

import numpy as np
import scree

DATA = EXAMPLES = None


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
        view.draw(900, 700, samples=2)  # which needs more memory than they have
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
        with self.assertRaises(TypeError):
            view.draw(-1, 8)
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

    def test_scene_outlives_its_file(self):
        file = scree.open(self.path)
        gone = weakref.ref(file)
        scene = file.load(backend="cpu")
        del file
        gc.collect()
        self.assertIsNone(gone())
        self.assertEqual(scene.render(8, 8)["color"].shape, (8, 8, 4))

    def test_documentation(self):
        for name in ("open", "convert", "look_at", "around", "matrices"):
            self.assertTrue(getattr(scree, name).__doc__)
        for item in (scree.File, scree.Scene, scree.View):
            for name, member in vars(item).items():
                if not name.startswith("_") and callable(member):
                    self.assertTrue(member.__doc__, f"{item.__name__}.{name}")

    def test_stubs_name_what_is_there(self):
        stubs = pathlib.Path(scree.__file__).with_name("__init__.pyi").read_text()
        for name in scree.__all__:
            self.assertRegex(stubs, rf"(class|def) {name}\b")
        for item in (scree.File, scree.Scene, scree.View):
            for name in vars(item):
                if not name.startswith("_"):
                    self.assertIn(f"def {name}(", stubs)

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
