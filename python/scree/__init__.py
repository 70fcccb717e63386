"""Packs glTF scenes of any size into one small, checked file, and draws them exactly, on a GPU or on the CPU.

    import scree

    scree.convert("city.glb", "city.scree")
    scene = scree.open("city.scree").load()
    frame = scene.render(1920, 1080, camera=scree.look_at(eye=(40, 30, 60)))
    frame["color"]    # numpy, 1080 x 1920 x 4, uint8

Every error of the library is a `scree.Error`, with one line of text and `status`, the name of its kind.
"""

from __future__ import annotations

import operator
import os
import threading

from . import _scree
from ._scree import Camera, Error, SharedLayer, __version__

__all__ = ["Camera", "Error", "File", "LAYERS", "Scene", "SharedLayer", "View", "__version__", "around", "cameras_of_path",
           "clipped", "convert", "look_at", "matrices", "open", "path_info"]

LAYERS = ("color", "depth", "triangle", "instance", "samples", "normal", "uv", "linear")


def _bytes(name, text):
    """A path or a name for the library: any text, but without a zero byte, at which C would end it."""
    data = os.fsencode(text)
    if not data or b"\0" in data:
        raise ValueError(f"{name}: {text!r} {'has a zero byte' if data else 'is empty'}")
    return data


def _whole(name, value, least=0, most=2**32 - 1):
    try:
        number = operator.index(value)
    except TypeError:
        raise TypeError(f"{name}: {value!r} is no whole number") from None
    if not least <= number <= most:
        raise ValueError(f"{name}: {number}, expected {least} to {most}")
    return number


def _vector(name, value):
    try:
        x, y, z = (float(number) for number in value)
    except (TypeError, ValueError):
        raise TypeError(f"{name}: {value!r}, expected three numbers") from None
    return x, y, z


def _fov(value):
    if not 1e-9 <= value < 180:
        raise ValueError(f"fov: {value}, expected at least 1e-9 and below 180")
    return value


def _camera(camera):
    return _bytes("camera", camera) if isinstance(camera, str) else camera


def look_at(eye, target=None, up=None, fov=45.0) -> Camera:
    """A camera at `eye` (x, y, z in world units) that looks at `target` (None: the middle of the scene's box).

    `up`: the direction that is up in the picture; None: y, or -z if the camera looks along y. `fov`: the vertical field of
    view in degrees, above 0 and below 180.
    """
    return _scree.look_at(_vector("eye", eye), None if target is None else _vector("target", target),
                          (0, 0, 0) if up is None else _vector("up", up), _fov(fov))


def around(turn, rise, up=None, fov=45.0) -> Camera:
    """A camera that shows the whole scene, from `turn` degrees to the right of its front and `rise` degrees above it.

    The front is (0, 0), the right (90, 0), the back (180, 0), the top (0, 90). `up` and `fov`: as for look_at().
    """
    return _scree.around(turn, rise, (0, 0, 0) if up is None else _vector("up", up), _fov(fov))


def matrices(view, projection, z_near=0.0) -> Camera:
    """A camera of two row-major 4 x 4 matrices: arrays of float64, or values that numpy converts to such arrays.

    `view`: from world to camera space, where the camera looks along -z with y up; a rotation and a translation, no scale.
    `projection`: from camera space to OpenGL's clip space (w = -z, depths from -1 to 1), perspective or orthographic,
    around the middle of the picture. `z_near`, if above 0: the near plane in world units, instead of the projection's;
    for projections with another range of depths. Raises ValueError for arrays of another shape. A draw raises scree.Error
    for matrices that are not such a camera.
    """
    return _scree.matrices(view, projection, z_near)


def clipped(camera, box_min, box_max) -> Camera:
    """The same camera, limited to the part of the scene in a box, for example to look inside a building.

    `camera`: as for View.draw(). `box_min`, `box_max`: the box's smallest and largest corner (x, y, z in world units).
    All layers and picks are as if the scene ended at the box; the camera does not move. In a batch each camera may have
    a box of its own. A draw raises scree.Error for corners that are not finite or in the wrong order.
    """
    return _scree.clipped(_camera(camera), _vector("box_min", box_min), _vector("box_max", box_max))


def cameras_of_path(path, *, fps=None, first=0, count=None) -> list[Camera]:
    """The cameras of a camera path that `scree view` saved: of `count` frames (None: all) from frame `first` on.

    `scree render --path` draws the same frames with the same cameras. `fps`: frames per second, instead of the file's.
    Raises scree.Error for a file that is no camera path, and for a `first` behind the path's end.
    """
    return _scree.cameras_of_path(_bytes("path", path), 0 if fps is None else fps, _whole("first", first, most=2**64 - 1),
                                  None if count is None else _whole("count", count, most=2**64 - 1))


def path_info(path, *, fps=None) -> dict:
    """A dict of a camera path: frames (their number) and fps (per second). `fps` and errors: as for cameras_of_path()."""
    return _scree.path_info(_bytes("path", path), 0 if fps is None else fps)


def open(path) -> File:
    """Opens a .scree file and checks its records, but reads no geometry. Raises scree.Error if it is no .scree file."""
    return File(path)


class File:
    """A .scree file. `scenes`, `meshes` and `materials` are lists of dicts."""

    def __init__(self, path):
        self.path = os.fspath(path)
        self._file = _scree.File(_bytes("path", path))

    @property
    def bytes(self) -> int:
        """The file's size in bytes."""
        return self._file.bytes

    @property
    def triangles(self) -> int:
        """The number of stored triangles, in all meshes."""
        return self._file.triangles

    @property
    def default_scene(self) -> int:
        """The number of the scene that load() takes by default."""
        return self._file.default_scene

    @property
    def scenes(self) -> list[dict]:
        """A dict per scene: name, triangles (drawn, of all instances), instances, cameras."""
        return self._file.scenes

    @property
    def meshes(self) -> list[dict]:
        """A dict per mesh (glTF primitive): name, triangles, vertices, box_min, box_max, max_position_error (in the mesh's
        own units, as the box), material (-1: the default material), has_uv, has_color, has_normal."""
        return self._file.meshes

    @property
    def materials(self) -> list[dict]:
        """A dict per material: name, base_color (linear RGBA), texture (-1: none), double_sided, unlit."""
        return self._file.materials

    def cameras(self, scene: int | None = None) -> list[dict]:
        """The cameras of a scene (None: the default scene), a dict each.

        The keys are name, node_name, camera (its number), orthographic, fov (degrees, vertical; 0 if orthographic),
        half_height (units; 0 if perspective), z_near and z_far (units; 0: none), and world (float64, 3 x 4, row by row:
        the node's matrix). Raises scree.Error for a scene that the file lacks.
        """
        return self._file.cameras(self.default_scene if scene is None else _whole("scene", scene))

    def load(self, scene=None, *, backend="auto", gpu=None, threads=0, textures=True, device_memory=0, host_memory=0,
             texture_cache=0, largest=(0, 0, 1), progress=None, gpus=1, texture_memory=0, environment=None,
             light="auto", read="auto", largest_shadows=0) -> Scene:
        """Loads a scene, by name or number (None: the default scene), and checks every byte of it.

        - `backend`: "cpu", "cuda", or "auto": a GPU if one can draw the scene, else the CPU.
        - `gpu`: the GPU's index or UUID. `gpus`: the number of GPUs that draw the scene together, from `gpu` on, each with
          a part of the picture or of the scene; None: all.
        - `threads`: 0 is one per processor.
        - `textures`: False loads none; materials then have only their base colour.
        - `device_memory`: the most bytes of GPU memory for scene and pictures. Chunks that do not fit are streamed while frames
          are drawn. 0: the free memory.
        - `host_memory`: the most bytes of pinned host memory, for copies to the GPU, and for chunks and pages of textures that
          the GPU's memory does not hold. 0: no limit, and such chunks and pages are read from the file.
        - `largest`: width, height and samples of the largest frames, whose memory `device_memory` then includes.
        - `largest_shadows`: the largest `shadow_size` of draws, at most 16384, whose maps `device_memory` then includes; 0: none.
        - `texture_cache`: bytes of decoded blocks of JPEG textures. 0: 64 MiB, on a GPU 256 MiB.
        - `texture_memory`: the most bytes for pages of KTX2, DDS and JPEG textures, which are read when pixels show them. On a GPU,
          textures that fit are loaded whole. 0: on the CPU 2 GiB; on a GPU all textures are loaded if the whole file fits, else
          pages and geometry share its memory.
        - `light`: the light of draws that name no other: "camera", "environment", "scene" (the file's own lights), or
          "auto": the environment if materials have more than a base colour, else the camera.
        - `environment`: a Radiance picture (.hdr) of all directions, as the light "environment", which it implies. None: a clear
          sky.
        - `read`: how pages are read for a GPU: "mapped", "buffered", "direct" or "auto".
        - `progress(stage, done, total)` is called now and then; loading stops if it returns False.

        Raises scree.Error: no such scene or GPU, damaged data, no memory, or `progress` returned False.
        """
        warnings = []
        width, height, samples = largest
        return Scene(self._file.load(
            scene=None if scene is None else _bytes("scene", str(scene)), backend=backend,
            gpu=None if gpu is None else _bytes("gpu", str(gpu)), threads=_whole("threads", threads),
            textures=bool(textures), device_memory=_whole("device_memory", device_memory, most=2**64 - 1),
            host_memory=_whole("host_memory", host_memory, most=2**64 - 1),
            texture_cache=_whole("texture_cache", texture_cache, most=2**64 - 1),
            largest=(_whole("largest", width), _whole("largest", height), _whole("largest", samples)),
            progress=progress, gpus=None if gpus is None else _whole("gpus", gpus),
            texture_memory=_whole("texture_memory", texture_memory, most=2**64 - 1),
            environment=None if environment is None else _bytes("environment", environment), light=light, read=read,
            largest_shadows=_whole("largest_shadows", largest_shadows), warnings=warnings), warnings)

    def render(self, width=1920, height=1080, **options) -> dict:
        """Calls load().render(), for a single picture. For several pictures, load the scene once.

        `options` and the returned arrays (height x width by layer): as for Scene.render(). Raises the errors of load() and of
        Scene.render().
        """
        return self.load().render(width, height, **options)


class Scene:
    """A loaded scene. `stats`: triangles, instances, box_min, box_max, on_gpu, why_cpu, streamed, load_ms, lights...

    `warnings`: lines about the scene, such as a damaged texture.
    """

    def __init__(self, scene, warnings):
        self._scene = scene
        self.warnings = warnings
        self._view = None
        self._lock = threading.Lock()

    @property
    def stats(self) -> dict:
        """A dict: triangles and instances of the scene, box_min and box_max (world units), on_gpu, gpu, gpu_name, why_cpu,
        streamed, scene (its number), device_bytes, load_ms, lights (the number of the file's lights), light (that of draws that
        name no other)."""
        return self._scene.stats

    def instances(self) -> dict:
        """A dict of new numpy arrays, each with an element per instance, in the order of instance ids.

        For n instances they are mesh, node and material (n int32, indices in the file; material -1: the default material),
        first_triangle (n int64, the id of the first triangle) and world (n x 3 x 4 float64, row by row, from mesh to world).
        Raises MemoryError.
        """
        return self._scene.instances()

    def view(self) -> View:
        """A new view. Each thread and each moving camera should have its own. Raises scree.Error if memory is short."""
        return View(self._scene.view(), self._scene.stats)

    def render(self, width=1920, height=1080, *, layers=("color",), **options) -> dict:
        """Draws one frame with a view that the scene keeps. `options`: as for View.draw().

        Returns a dict with a numpy array of height x width pixels for each of `layers`, of the types and units of
        View.read(). Raises the errors of View.draw() and View.read().
        """
        with self._lock:
            if self._view is None:
                self._view = self.view()
            self._view.draw(width, height, **options)
            return {layer: self._view.read(layer) for layer in layers}


class View:
    """Draws frames of a scene. Its buffers grow to the largest frame and never shrink.

    draw() and read() are two calls, so threads that draw different frames need a view each.
    """

    def __init__(self, view, stats):
        self._view = view
        self._gpu = stats["gpu"] if stats["on_gpu"] else -1

    def draw(self, width=1920, height=1080, *, camera=None, samples=1, **shading) -> View:
        """Draws a frame of width x height pixels with `samples` x `samples` samples each (1, 2 or 4).

        `camera`: look_at(), around(), matrices(), clipped(), a camera of cameras_of_path(), or the name or number of a
        camera of the file; None shows the whole scene. Options of `shading` and their defaults:
        - `show` ("texture"): texture, color, uv, normal, triangle, cluster, mesh, stage or depth.
        - `light` ("auto": as the scene was loaded): "camera", "environment", "scene", or False for surface colours alone.
        - `exposure` (0): stops, -20 to 20; without effect on the light "camera".
        - `blend_layers` (16): the most layers of blended surfaces, such as glass, per sample; 0: none is drawn.
        - `shadows` (False): whether the file's first directional light casts shadows, only under the light "scene". A map has
          `shadow_size` (4096; 64 to 16384) samples along its longer side. If the camera looks far into the scene, four maps of
          half the side take its place. The view keeps each map until it needs another.
        - `ssao` (False): ambient occlusion.
        - `edl` (False): eye-dome lighting, with `edl_strength` (1, at most 100) and `edl_radius` (1, at most 64 pixels).
        - `background` (0, 0, 0, 0): linear RGBA.

        Raises TypeError for an unknown option or a value of another type, such as a negative number of layers; ValueError for an
        unknown word or a size of 0; scree.Error for numbers out of range, an invalid or missing camera, or a GPU that fails.
        """
        self._view.draw(_whole("width", width, 1), _whole("height", height, 1), _camera(camera),
                        _whole("samples", samples, 1), shading)
        return self

    def draw_batch(self, cameras, width, height, *, layers=("color",), samples=1, **shading) -> View:
        """Draws a frame for each of `cameras`, all of width x height pixels, in one call.

        `layers`: the layers to make; all except samples and linear can be made. The arrays of read() and share() then
        have the cameras as an additional first dimension; on a GPU each array is one block of the GPU's memory.
        Other arguments and errors: as for draw(). Raises ValueError for no cameras, too.
        """
        self._view.draw_batch([_camera(camera) for camera in cameras], _whole("width", width, 1), _whole("height", height, 1),
                              list(layers), _whole("samples", samples, 1), shading)
        return self

    def draw_batch_to(self, cameras, targets, *, samples=1, stream=None, **shading) -> View:
        """Draws a frame for each of `cameras` into the caller's arrays, without a copy; the view keeps no layer.

        `targets`: an array for each layer, which is overwritten, such as {"depth": array}; layers as for draw_batch().
        Types and units are as for read(). Shapes begin with the cameras: cameras x height x width for depth, triangle and
        instance, with one more dimension for color (4), normal (3) and uv (2). All arrays have the same width and height,
        which are the size of the frames in pixels. Rows follow each other without gaps, and the memory begins at a
        multiple of 16 bytes, as in new arrays.
        If the CPU draws, an array is a numpy array or has __dlpack__ (such as a CPU tensor of torch). If a GPU draws, it has
        __cuda_array_interface__ or __dlpack__ (torch, cupy, numba) and lies in the memory of that GPU.
        `stream`: a CUDA stream of that GPU as an int, such as torch.cuda.current_stream().cuda_stream. Drawing begins
        after the earlier work of the stream, and later work of the stream begins after drawing. None: the stream that the
        arrays name in __cuda_array_interface__, else the default stream. Ignored if the CPU draws. Other arguments: as for
        draw().

        Raises TypeError for an object that is no array, and for another dtype; ValueError for another shape, gaps between
        rows, read-only memory, or memory of another device. Both name the array, and nothing is drawn. Other errors: as
        for draw(). After a scree.Error the arrays' contents are unspecified.
        """
        self._view.draw_batch_to([_camera(camera) for camera in cameras], dict(targets), self._gpu,
                                 _whole("samples", samples, 1), stream, shading)
        return self

    def shade(self, **shading) -> View:
        """Shades the last frame again, without drawing it. Not possible if chunks are streamed. `shading`: as for draw().

        Raises the errors of draw(), and scree.Error without a frame or after a batch.
        """
        self._view.shade(shading)
        return self

    def read(self, layer="color"):
        """A copy of a layer of the last frame as a numpy array, rows from the top.

        - color: height x width x 4 uint8, 8-bit sRGB, alpha linear and not premultiplied.
        - depth: height x width float32, from the eye's plane in world units, inf on the background.
        - triangle: height x width int64 ids, -1 on the background.
        - instance: height x width int32, indices into Scene.instances(), -1 on the background.
        - samples: uint64, the visibility buffer, of height * samples x width * samples.
        - normal: height x width x 3 float32, unit length in world space, of the front even where the back is visible, 0 on
          the background.
        - uv: height x width x 2 float32, the mesh's texture coordinates, 0 on the background and if the mesh has none.
        - linear: height x width x 4 float32, the colours in linear light, premultiplied by alpha.

        If chunks are streamed, normal, uv and linear are missing. Raises ValueError for an unknown layer, and scree.Error
        without a frame or if the batch was drawn without the layer.
        """
        return self._view.read(layer)

    def share(self, layer="color") -> SharedLayer:
        """A layer in the memory where it was made, for from_dlpack() of numpy, torch, cupy or jax. No copy is made.

        The shape is height x width x channels, of the types and units of read(); in a batch the cameras are the first
        dimension. If a GPU draws, the layer lies in its memory, except linear, which is made on the host. The next draw()
        overwrites the layer. The memory stays valid: a draw() that needs more memory allocates new memory. Raises ValueError for
        an unknown layer, and scree.Error without a frame; from_dlpack() raises the other errors of read().
        """
        return self._view.share(layer, -1 if layer == "linear" else self._gpu)

    def pick(self, x: int, y: int) -> dict | None:
        """A dict about the surface at the middle of a pixel; None on the background.

        The keys are mesh, node, node_instance, instance, triangle (its id), mesh_triangle (its number in the mesh as stored),
        source_triangle (its number in the source; -1: not stored), depth (from the eye's plane) and position (x, y, z), both in
        world units. Raises scree.Error for a pixel outside of the frame, without a frame, and after a batch.
        """
        return self._view.pick(_whole("x", x), _whole("y", y))

    @property
    def stats(self) -> dict:
        """A dict of the last frame or batch: width, height, samples, instances, triangles and clusters (drawn), draw_ms,
        gpu_ms, streamed_bytes, cameras (0: no batch), blended_layers, samples_with_more_layers, shadow_ms (for the maps of
        shadows; 0 if earlier maps were kept). Raises scree.Error without a frame.
        """
        return self._view.stats


def convert(input, output=None, *, position_bits=16, float32=False, max_error=0.0, encoding="clustered", zstd=0,
            textures="keep", jpeg_quality=90, normals=False, source_ids=False, replace=False, keep_going=False,
            drop_nonfinite=False, allow_outside=False, exclude=None, threads=0, memory=2 << 30, progress=None) -> dict:
    """Packs `input`, a .gltf or .glb, into a .scree file, in bounded memory.

    - `output`: the .scree file. None: `input` with the extension .scree.
    - `position_bits`: bits per axis, 8 to 24. `max_error`, if above 0: the largest error per axis in a mesh's own units,
      instead of `position_bits`. `float32`: True keeps positions as they are.
    - `encoding`: "clustered" or "indexed".
    - `zstd`: level 1 to 22. 0: only pages of textures' blocks are compressed, at level 1. -1: no page is compressed.
    - `textures`: "keep", "raw" or "jpeg". `jpeg_quality`: 1 to 100, for "jpeg".
    - `normals`: True stores all normals, False leaves out normals that equal the faces'.
    - `source_ids`: True stores each triangle's number in the source.
    - `replace`: True replaces an existing output. `keep_going`: True makes a damaged image grey.
    - `drop_nonfinite`: True leaves out triangles with a position that is not finite.
    - `allow_outside`: True reads files outside the source's folder.
    - `exclude`: a regular expression; nodes with such names and all nodes below them are left out.
    - `threads`: 0 is one per processor. `memory`: bytes that the process may take. `progress`: as for File.load().

    Returns a dict with input_bytes, output_bytes, triangles, meshes, position_error (the largest found, per axis in a
    mesh's own units), seconds and warnings. Raises TypeError and ValueError for arguments of another type or out of range, and
    scree.Error; both leave no new file.
    """
    return _scree.convert(
        _bytes("input", input), None if output is None else _bytes("output", output),
        position_bits=_whole("position_bits", position_bits, 8, 24), float32=bool(float32), max_error=max_error,
        encoding=encoding, zstd=_whole("zstd", zstd, -1, 22), textures=textures,
        jpeg_quality=_whole("jpeg_quality", jpeg_quality, 1, 100), normals=bool(normals), source_ids=bool(source_ids),
        replace=bool(replace), keep_going=bool(keep_going), drop_nonfinite=bool(drop_nonfinite),
        allow_outside=bool(allow_outside), exclude=None if exclude is None else _bytes("exclude", exclude),
        threads=_whole("threads", threads), memory=_whole("memory", memory, most=2**64 - 1), progress=progress)
