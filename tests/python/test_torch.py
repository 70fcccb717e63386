"""The Python package with PyTorch on a GPU: test_torch.py DATA_FOLDER. Exits with 77 if torch finds no CUDA GPU."""

import gc
import pathlib
import sys
import tempfile
import unittest

try:
    import torch
except ImportError:
    torch = None

DATA = None
BATCH_LAYERS = ("color", "depth", "triangle", "instance", "normal", "uv")


class Torch(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.temporary = tempfile.TemporaryDirectory()
        path = pathlib.Path(cls.temporary.name) / "scene.scree"
        scree.convert(DATA / "two_instances.gltf", path)
        cls.file = scree.open(path)
        cls.scene = cls.file.load(backend="cuda", gpu=0)
        cls.gpu = torch.device("cuda", 0)
        cls.cameras = [scree.around(30 * i, 10) for i in range(6)]

    @classmethod
    def tearDownClass(cls):
        cls.temporary.cleanup()

    def test_the_gpus_layers_are_the_cpus(self):
        cpu = self.file.load(backend="cpu").view().draw(70, 50, samples=2)
        gpu = self.scene.view().draw(70, 50, samples=2)
        for layer in scree.LAYERS:
            expected, drawn = cpu.read(layer), gpu.read(layer)
            if layer == "linear":  # shading's functions round differently, by far less than an 8-bit step
                self.assertLess(float(abs(drawn - expected).max()), 1e-3)
            else:
                self.assertTrue((drawn == expected).all(), layer)

    def test_shared_layers_are_tensors_without_a_copy(self):
        view = self.scene.view().draw(70, 50)
        for layer in scree.LAYERS:
            tensor, again = torch.from_dlpack(view.share(layer)), torch.from_dlpack(view.share(layer))
            self.assertEqual(tensor.data_ptr(), again.data_ptr(), layer)
            self.assertEqual(tensor.is_cuda, layer != "linear", layer)
            expected = view.read(layer)
            self.assertEqual(tuple(tensor.shape), expected.shape, layer)
            self.assertEqual(str(tensor.dtype), f"torch.{expected.dtype}", layer)
            self.assertTrue((tensor.cpu().numpy() == expected).all(), layer)

    def test_tensors_keep_their_memory(self):
        view = self.scene.view().draw(40, 30)
        tensor, expected = torch.from_dlpack(view.share("depth")), view.read("depth")
        view.draw(900, 700)  # needs more memory than the tensor's block
        torch.from_dlpack(view.share("depth"))
        del view
        gc.collect()
        torch.cuda.synchronize()
        self.assertTrue((tensor.cpu().numpy() == expected).all())

    def test_a_shared_batch_is_one_block(self):
        view = self.scene.view().draw_batch(self.cameras, 33, 21, layers=BATCH_LAYERS)
        single = self.scene.view()
        for layer in BATCH_LAYERS:
            block = torch.from_dlpack(view.share(layer))
            self.assertTrue(block.is_cuda and block.is_contiguous(), layer)
            self.assertEqual(len(block), len(self.cameras), layer)
            for number, camera in enumerate(self.cameras):
                one = single.draw(33, 21, camera=camera).read(layer)
                self.assertTrue((block[number].cpu().numpy() == one).all(), layer)

    def test_shared_layers_wait_for_the_frame_on_torchs_stream(self):
        view = self.scene.view()
        stream = torch.cuda.Stream(self.gpu)
        for camera in self.cameras:
            view.draw(640, 480, camera=camera)
            with torch.cuda.stream(stream):
                copy = torch.from_dlpack(view.share("depth")).clone()
            stream.synchronize()
            self.assertTrue((copy.cpu().numpy() == view.read("depth")).all())

    def tensors(self, width, height):
        shapes = {"color": (torch.uint8, 4), "depth": (torch.float32,), "triangle": (torch.int64,),
                  "instance": (torch.int32,), "normal": (torch.float32, 3), "uv": (torch.float32, 2)}
        return {layer: torch.zeros((len(self.cameras), height, width, *channels), dtype=dtype, device=self.gpu)
                for layer, (dtype, *channels) in shapes.items()}

    def test_batches_into_tensors(self):
        owner = self.scene.view().draw_batch(self.cameras, 36, 20, layers=BATCH_LAYERS, samples=2)
        for stream in (torch.cuda.default_stream(self.gpu), torch.cuda.Stream(self.gpu)):
            with torch.cuda.stream(stream):
                targets = self.tensors(36, 20)
                # A long product, after which the tensors are overwritten. The batch must come later on the same stream.
                big = torch.ones((4096, 4096), device=self.gpu)
                for _ in range(20):
                    big = big @ big * 1e-4
                for tensor in targets.values():
                    tensor.fill_(7)
                self.scene.view().draw_batch_to(self.cameras, targets, samples=2, stream=stream.cuda_stream)
                read = {layer: tensor.clone() for layer, tensor in targets.items()}
            stream.synchronize()
            for layer in BATCH_LAYERS:
                self.assertTrue((read[layer].cpu().numpy() == owner.read(layer)).all(), layer)

    def test_tensors_that_cannot_be_written_are_refused(self):
        view = self.scene.view()
        depth = torch.full((len(self.cameras), 20, 36), 5.0, device=self.gpu)
        for tensor, error, text in (
                (depth.cpu(), ValueError, "host memory, but GPU 0 draws"),
                (depth.double(), TypeError, "dtype float64, expected float32"),
                (depth[:, :, ::2], ValueError, "not contiguous"),
                (depth[1:], ValueError, "for 6 cameras"),
                (depth.flatten()[1:1 + 6 * 19 * 36].view(6, 19, 36), ValueError, "16 bytes"),
                (depth.clone().requires_grad_(), Exception, "grad")):
            with self.subTest(text), self.assertRaisesRegex(error, text):
                view.draw_batch_to(self.cameras, {"depth": tensor})
        self.assertTrue(bool((depth == 5).all()))

    def test_depths_go_into_a_training_step(self):
        view = self.scene.view().draw_batch(self.cameras, 32, 32, layers=["depth", "instance"])
        depth, instance = (torch.from_dlpack(view.share(layer)) for layer in ("depth", "instance"))
        seen = instance >= 0
        scale = torch.ones((), device=self.gpu, requires_grad=True)
        loss = ((scale * depth[seen] - 2 * depth[seen]) ** 2).mean()
        loss.backward()
        expected = -2 * (depth[seen] ** 2).mean()
        self.assertTrue(torch.allclose(scale.grad, expected))


if __name__ == "__main__":
    DATA = pathlib.Path(sys.argv.pop(1))
    if torch is None or not torch.cuda.is_available():
        print("skipped: torch finds no CUDA GPU")
        sys.exit(77)
    import scree
    unittest.main()
