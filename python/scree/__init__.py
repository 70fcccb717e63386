"""Packs glTF scenes of any size into one small, checked file, and draws them exactly: on a GPU, or on the CPU.

    import scree

    scree.convert("city.glb", "city.scree")
    scene = scree.open("city.scree").load()
    frame = scene.render(1920, 1080, camera=scree.look_at(eye=(40, 30, 60)))
    frame["color"]    # numpy, 1080 x 1920 x 4, uint8

Every error of the library is a `scree.Error`: one line of text, and `status`, the name of its kind.
"""

from __future__ import annotations

import os

from . import _scree
from ._scree import Camera, Error, SharedLayer, __version__

__all__ = ["Camera", "Error", "File", "LAYERS", "Scene", "SharedLayer", "View", "__version__", "around", "cameras_of_path",
           "clipped", "convert", "look_at", "matrices", "open", "path_info"]

LAYERS = ("color", "depth", "triangle", "instance", "samples", "normal", "uv", "linear")


def look_at(eye, target=None, up=(0, 1, 0), fov=45.0) -> Camera:
    """A camera at `eye`, x, y, z in world units, that looks at `target`, else at the middle of the scene's box.

    `up`: the direction that is up in the picture. `fov`: the vertical field of view in degrees, above 0 and below 180.
    """
    return _scree.look_at(tuple(eye), None if target is None else tuple(target), tuple(up), fov)


def around(turn, rise, up=(0, 1, 0), fov=45.0) -> Camera:
    """A camera that shows all of the scene, from `turn` degrees to the right of its front and `rise` degrees above.

    The front is (0, 0), the right (90, 0), the back (180, 0), the top (0, 90). `up` and `fov` as look_at().
    """
    return _scree.around(turn, rise, tuple(up), fov)


def matrices(view, projection, z_near=0.0) -> Camera:
    """A camera as two 4 x 4 matrices, rows first: arrays of float64, or what numpy makes them of.

    `view`: from world to camera, which looks along -z with y up; a rotation and a translation, no scale.
    `projection`: from camera to clip space as OpenGL has it (w = -z, depths from -1 to 1), perspective or orthographic,
    around the middle of the picture. `z_near`, above 0 and in world units, replaces its near plane: for other ranges of
    depth. Raises ValueError for arrays of another shape; draws raise scree.Error for matrices that are no such camera.
    """
    return _scree.matrices(view, projection, z_near)


def clipped(camera, box_min, box_max) -> Camera:
    """The same camera, which draws only what lies in a box, to look inside a building.

    `camera`: as View.draw() takes it. `box_min`, `box_max`: the box's smallest and largest corner, x, y, z in world
    units. Depths, ids, picks and layers are those of a scene that ends there; the camera does not move. In a batch each
    camera may have a box of its own. Draws raise scree.Error for corners that are not finite or in the wrong order.
    """
    return _scree.clipped(camera, tuple(box_min), tuple(box_max))


def cameras_of_path(path, *, fps=None, first=0, count=None) -> list[Camera]:
    """The cameras of a film: of `count` frames from `first` on, None for all that follow, of a path that `scree view` saved.

    `scree render --path` draws the same frames with the same cameras. `fps`: frames per second, in place of the file's.
    Raises scree.Error for a file that is no path, and for a `first` behind its end.
    """
    return _scree.cameras_of_path(os.fspath(path), 0 if fps is None else fps, first, count)


def path_info(path, *, fps=None) -> dict:
    """Of a camera's path: frames, and fps (per second). `fps` and errors as cameras_of_path()."""
    return _scree.path_info(os.fspath(path), 0 if fps is None else fps)


def open(path) -> File:
    """Opens a .scree file and checks its records; no geometry is read. Raises scree.Error for a file that is none."""
    return File(path)


class File:
    """A .scree file. `scenes`, `meshes`, `materials`: a list of dicts each."""

    def __init__(self, path):
        self.path = os.fspath(path)
        self._file = _scree.File(self.path)

    @property
    def bytes(self) -> int:
        """The file's size in bytes."""
        return self._file.bytes

    @property
    def triangles(self) -> int:
        """Stored triangles of all meshes."""
        return self._file.triangles

    @property
    def default_scene(self) -> int:
        """The number of the scene that load() takes where none is named."""
        return self._file.default_scene

    @property
    def scenes(self) -> list[dict]:
        """name, triangles (drawn), instances, cameras."""
        return self._file.scenes

    @property
    def meshes(self) -> list[dict]:
        """name, triangles, vertices, box_min, box_max, max_position_error (in the mesh's units), material, has_..."""
        return self._file.meshes

    @property
    def materials(self) -> list[dict]:
        """name, base_color (linear RGBA), texture (-1: none), double_sided, unlit."""
        return self._file.materials

    def cameras(self, scene: int | None = None) -> list[dict]:
        """The cameras of a scene, None for the default one, a dict each.

        name, node_name, camera (its number), orthographic, fov (degrees, vertical; 0 where orthographic), half_height
        (units, where orthographic), z_near and z_far (units; 0: none), and world: float64, 3 x 4, the node's matrix, rows
        first. Raises scree.Error for a scene that is not there.
        """
        return self._file.cameras(self.default_scene if scene is None else scene)

    def load(self, scene=None, *, backend="auto", gpu=None, threads=0, textures=True, device_memory=0, host_memory=0,
             texture_cache=0, largest=(0, 0, 1), progress=None, gpus=1, texture_memory=0, environment=None,
             light="auto", read="auto", largest_shadows=0) -> Scene:
        """Loads a scene, by name or number, and checks every byte of it.

        `backend`: "cpu", "cuda", or "auto": a GPU where one can be used and takes the scene. `gpu`: its index or UUID.
        `threads`: 0 is one per processor. `textures`: False leaves materials their colour alone. `device_memory`: bytes of
        the GPU that scene and pictures may take; chunks that it does not hold are streamed while frames are drawn.
        `host_memory`: bytes of pinned memory that feed it.
        `texture_cache`: bytes of decoded blocks of JPEG textures. `largest`: width, height and samples of the largest
        frames, which `device_memory` then counts. `progress(stage, done, total)` is called now and then; it returns
        False to stop. `gpus`: how many draw the scene together, from `gpu` on, each with a part of it; None: all.
        `texture_memory`: bytes for pages of KTX2 and DDS textures, which come from the file when pixels show them; 0: 2
        GiB where the CPU draws. On a GPU textures that fit are loaded whole; 0: if the whole file fits, else a quarter
        of its memory for pages. `light`: of its pictures, unless a draw names another: "camera", "environment",
        "scene" for the file's own lights, or "auto": the environment if materials have more than a base colour.
        `environment`: a Radiance picture (.hdr) of all directions, which implies that light; None: a clear sky. `read`:
        how pages are read for a GPU, "mapped", "buffered", "direct" or "auto". `largest_shadows`: the largest `shadow_size`
        of draws, at most 16384, whose map `device_memory` then counts; 0: none.

        Raises scree.Error: no such scene or GPU, damaged data, no memory, or a `progress` that returned False.
        """
        warnings = []
        return Scene(self._file.load(
            scene=None if scene is None else str(scene), backend=backend, gpu=None if gpu is None else str(gpu),
            threads=threads, textures=textures, device_memory=device_memory, host_memory=host_memory,
            texture_cache=texture_cache, largest=tuple(largest), progress=progress, gpus=gpus,
            texture_memory=texture_memory, environment=None if environment is None else os.fspath(environment),
            light=light, read=read, largest_shadows=largest_shadows, warnings=warnings), warnings)

    def render(self, width=1920, height=1080, **options) -> dict:
        """load().render(): for one picture. Whoever draws more keeps the scene.

        `options` and arrays, of height x width by layer, as Scene.render(). Raises as File.load() and View.draw().
        """
        return self.load().render(width, height, **options)


class Scene:
    """A loaded scene. `stats`: triangles, instances, box_min, box_max, on_gpu, why_cpu, streamed, load_ms, lights...

    `warnings`: one line about each thing that cannot be drawn as it is meant.
    """

    def __init__(self, scene, warnings):
        self._scene = scene
        self.warnings = warnings
        self._view = None

    @property
    def stats(self) -> dict:
        """triangles and instances that are drawn, box_min and box_max (world units), on_gpu, gpu, gpu_name, why_cpu, streamed,
        scene (its number), device_bytes, load_ms, lights (of the file), light (which draws take)."""
        return self._scene.stats

    def instances(self) -> dict:
        """Columns of n instances, by instance id, in new numpy arrays.

        mesh, node and material: n int32, numbers in the file (material -1: the default one). first_triangle: n int64, the
        id of its first triangle. world: n x 3 x 4 float64, from the mesh to the world, rows first. Raises MemoryError.
        """
        return self._scene.instances()

    def view(self) -> View:
        """A view of its own: what a thread or a camera that moves should have. Raises scree.Error where memory is missing."""
        return View(self._scene.view(), self._scene.stats)

    def render(self, width=1920, height=1080, *, layers=("color",), **options) -> dict:
        """Draws one frame with a view that the scene keeps. `options`: as View.draw().

        Returns a numpy array of height x width pixels for each of `layers`, of the types and units of View.read(). Raises
        as View.draw() and View.read().
        """
        if self._view is None:
            self._view = self.view()
        self._view.draw(width, height, **options)
        return {layer: self._view.read(layer) for layer in layers}


class View:
    """Draws a scene, frame after frame; its buffers grow to the largest frame and stay."""

    def __init__(self, view, stats):
        self._view = view
        self._gpu = stats["gpu"] if stats["on_gpu"] else -1

    def draw(self, width=1920, height=1080, *, camera=None, samples=1, **shading) -> View:
        """Draws a frame of width x height pixels with `samples` x `samples` each (1, 2 or 4).

        `camera`: look_at(), around(), matrices(), clipped(), one of cameras_of_path(), or the name or number of one of the
        file's; None shows all of the scene.
        `shading`, by default as the scene was loaded, without what is off:
        `show`: texture, color, uv, normal, triangle, cluster, mesh, stage or depth. `light`: "camera", "environment",
        "scene", or False: surface colours alone. `exposure`: in stops, -20 to 20; the camera's light ignores it.
        `blend_layers`: the most layers of blended surfaces, such as glass, behind one another (16); 0: none is drawn.
        `shadows`: True if the file's first directional light casts shadows, under the light "scene" alone, with a map of
        `shadow_size` samples (4096; 64 to 16384) along its longer side, which the view keeps until it needs another one.
        `ssao`, `edl`: True for ambient occlusion and eye-dome lighting, the latter with `edl_strength` (1) and
        `edl_radius` in pixels (1). `background`: linear RGBA (0, 0, 0, 0).

        Raises TypeError for another option or a value of another type, ValueError for another word, scree.Error for
        numbers out of range, a camera that is none, or a failing GPU.
        """
        self._view.draw(width, height, camera, samples, shading)
        return self

    def draw_batch(self, cameras, width, height, *, layers=("color",), samples=1, **shading) -> View:
        """Draws a frame for each of `cameras`, all of width x height pixels, in one call.

        `layers`: which are made, of all but samples and linear. read() and share() then give them with one more,
        first dimension, of cameras; on a GPU they are one block of its memory. Otherwise as draw(). Raises ValueError
        for no camera, and as draw().
        """
        self._view.draw_batch(list(cameras), width, height, list(layers), samples, shading)
        return self

    def draw_batch_to(self, cameras, targets, *, samples=1, stream=None, **shading) -> View:
        """Draws a frame for each of `cameras` into the caller's arrays, without a copy; the view keeps no layer.

        `targets`: an array per layer, of the layers of draw_batch(), which is overwritten: {"depth": array}. Types and
        units are those of read(), shapes have the cameras first: cameras x height x width for depth, triangle and
        instance, with a last dimension of 4 for color, 3 for normal, 2 for uv. The frames have the arrays' width and
        height in pixels, the same in all of them. Rows follow each other without gaps, and the memory begins at a
        multiple of 16 bytes, as new arrays do.
        Where the CPU draws, an array is numpy's or has __dlpack__ (torch's on the CPU). Where a GPU draws, it has
        __cuda_array_interface__ or __dlpack__ (torch, cupy, numba) and lies in the memory of that GPU.
        `stream`: a CUDA stream of that GPU as an int, such as torch.cuda.current_stream().cuda_stream. The drawing begins
        after its earlier work, and its later work begins after the drawing. None: the stream that the arrays name in
        __cuda_array_interface__, else the default stream. Not read where the CPU draws. Otherwise as draw().

        Raises TypeError for an object that is no array, and for another dtype; ValueError for another shape, gaps between
        rows, read-only memory, or memory of another device: each names the array, and nothing is drawn. After a
        scree.Error the arrays hold anything.
        """
        self._view.draw_batch_to(list(cameras), dict(targets), self._gpu, samples, stream, shading)
        return self

    def shade(self, **shading) -> View:
        """Shows the last frame otherwise, without drawing it again; not where chunks are streamed. `shading` as draw().

        Raises as draw(), and scree.Error where there is no frame, or a batch.
        """
        self._view.shade(shading)
        return self

    def read(self, layer="color"):
        """A copy of a layer of the last frame as a numpy array, rows from the top.

        color: height x width x 4 uint8, 8-bit sRGB, alpha linear and not premultiplied. depth: float32, from the eye's
        plane in world units, inf on the background. triangle: int64 ids, -1 on the background. instance: int32, indices
        into Scene.instances(), -1 on the background. samples: uint64, the visibility buffer. normal: height x width x 3
        float32, unit length in world space, of the front even if the back is seen, 0 on the background. uv: height x
        width x 2 float32, texture coordinates as the mesh has them, 0 if it has none. linear: height x width x 4
        float32, the colours in linear light, premultiplied by alpha. If chunks are streamed, normal, uv and linear are missing.

        Raises ValueError for another word, scree.Error where there is no frame or the batch was drawn without the layer.
        """
        return self._view.read(layer)

    def share(self, layer="color") -> SharedLayer:
        """A layer where it was made, without a copy, for from_dlpack() of numpy, torch, cupy or jax.

        height x width x channels, of the types and units of read(), cameras first where it is a batch. On a GPU it lies in
        its memory, but for linear, which is made on the host. What it shows changes with the next draw(); its memory
        stays, and a draw() that needs more takes other memory. Raises as read().
        """
        return self._view.share(layer, -1 if layer == "linear" else self._gpu)

    def pick(self, x: int, y: int) -> dict | None:
        """What lies at a pixel's middle, a dict; None on the background.

        mesh, node, node_instance, instance, triangle (its id), mesh_triangle (in the mesh as stored), source_triangle (in
        the source; -1: not stored), depth (from the eye's plane) and position (x, y, z), both in world units. Raises
        scree.Error for a pixel outside, and where there is no frame, or a batch.
        """
        return self._view.pick(x, y)

    @property
    def stats(self) -> dict:
        """Of the last frame or batch: width, height, samples, instances, triangles and clusters (drawn), draw_ms, gpu_ms,
        streamed_bytes, cameras (0: no batch), blended_layers, samples_with_more_layers, shadow_ms (drawing the map of
        shadows; 0 if an earlier one was kept). Raises scree.Error without a frame.
        """
        return self._view.stats


def convert(input, output=None, *, position_bits=16, float32=False, max_error=0.0, encoding="clustered", zstd=0,
            textures="keep", jpeg_quality=90, normals=False, source_ids=False, replace=False, keep_going=False,
            drop_nonfinite=False, allow_outside=False, exclude=None, threads=0, memory=2 << 30, progress=None) -> dict:
    """Packs a .gltf or .glb into a .scree file, in bounded memory; `output` None is `input` with the extension .scree.

    `position_bits`: an axis of a mesh, 8 to 24; `float32` keeps positions as they are; `max_error`, above 0, picks the
    step of each mesh instead, in its own units. `encoding`: "clustered" or "indexed". `zstd`: 1 to 22; 0: only pages of
    blocks of textures, at level 3; -1: no page. `textures`: "keep", "raw", or "jpeg", which has the `jpeg_quality` 1 to 100.
    True for these: `normals` stores all of them, else those that are not the faces'. `source_ids` stores each triangle's
    number in the source. `replace`: an output that is there. `keep_going`: a damaged image becomes grey.
    `drop_nonfinite` leaves out triangles with a position that is not finite. `allow_outside` reads files outside the
    source's folder. `exclude`: a regular expression; nodes with such names are left out, and those below them.
    `threads`: 0 is one per processor. `memory`: bytes that the process may take. `progress` as File.load().

    Returns input_bytes, output_bytes, triangles, meshes, position_error (the largest found, an axis in a mesh's own
    units), seconds and warnings. Raises scree.Error; nothing is left of the output then.
    """
    return _scree.convert(
        os.fspath(input), None if output is None else os.fspath(output), position_bits=position_bits, float32=float32,
        max_error=max_error, encoding=encoding, zstd=zstd, textures=textures, jpeg_quality=jpeg_quality, normals=normals,
        source_ids=source_ids, replace=replace, keep_going=keep_going, drop_nonfinite=drop_nonfinite,
        allow_outside=allow_outside, exclude=exclude, threads=threads, memory=memory, progress=progress)
