import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Literal, Protocol

import numpy as np
import numpy.typing as npt

__version__: str
LAYERS: tuple[str, ...]

_Layer = Literal["color", "depth", "triangle", "instance", "samples", "normal", "uv", "linear"]
_Show = Literal["texture", "color", "uv", "normal", "triangle", "cluster", "mesh", "stage", "depth"]
_Light = Literal["auto", "camera", "environment", "scene"]
_Progress = Callable[[str, int, int], bool | None]
_Path = str | os.PathLike[str]

class _CudaArray(Protocol):
    @property
    def __cuda_array_interface__(self) -> dict[str, Any]: ...

class _DlpackArray(Protocol):
    def __dlpack__(self, *, stream: Any = ...) -> Any: ...
    def __dlpack_device__(self) -> tuple[Any, int]: ...

_Array = npt.NDArray[Any] | _CudaArray | _DlpackArray

class Error(RuntimeError):
    status: str

class Camera: ...

class SharedLayer:
    def __dlpack__(
        self,
        *,
        stream: int | None = ...,
        max_version: tuple[int, int] | None = ...,
        dl_device: tuple[int, int] | None = ...,
        copy: bool | None = ...,
    ) -> Any: ...
    def __dlpack_device__(self) -> tuple[int, int]: ...
    @property
    def shape(self) -> tuple[int, ...]: ...
    @property
    def dtype(self) -> np.dtype[Any]: ...

def look_at(
    eye: Sequence[float], target: Sequence[float] | None = ..., up: Sequence[float] | None = ..., fov: float = ...
) -> Camera: ...
def around(turn: float, rise: float, up: Sequence[float] | None = ..., fov: float = ...) -> Camera: ...
def matrices(view: npt.ArrayLike, projection: npt.ArrayLike, z_near: float = ...) -> Camera: ...
def clipped(camera: Camera | str | int | None, box_min: Sequence[float], box_max: Sequence[float]) -> Camera: ...
def cameras_of_path(path: _Path, *, fps: float | None = ..., first: int = ..., count: int | None = ...) -> list[Camera]: ...
def path_info(path: _Path, *, fps: float | None = ...) -> dict[str, Any]: ...
def open(path: _Path) -> File: ...

class File:
    path: str
    def __init__(self, path: _Path) -> None: ...
    @property
    def bytes(self) -> int: ...
    @property
    def triangles(self) -> int: ...
    @property
    def default_scene(self) -> int: ...
    @property
    def scenes(self) -> list[dict[str, Any]]: ...
    @property
    def meshes(self) -> list[dict[str, Any]]: ...
    @property
    def materials(self) -> list[dict[str, Any]]: ...
    def cameras(self, scene: int | None = ...) -> list[dict[str, Any]]: ...
    def load(
        self,
        scene: str | int | None = ...,
        *,
        backend: Literal["auto", "cpu", "cuda"] = ...,
        gpu: str | int | None = ...,
        threads: int = ...,
        textures: bool = ...,
        device_memory: int = ...,
        host_memory: int = ...,
        texture_cache: int = ...,
        largest: Sequence[int] = ...,
        progress: _Progress | None = ...,
        gpus: int | None = ...,
        texture_memory: int = ...,
        environment: _Path | None = ...,
        light: _Light = ...,
        read: Literal["auto", "mapped", "buffered", "direct"] = ...,
        largest_shadows: int = ...,
    ) -> Scene: ...
    def render(self, width: int = ..., height: int = ..., **options: Any) -> dict[str, npt.NDArray[Any]]: ...

class Scene:
    warnings: list[str]
    @property
    def stats(self) -> dict[str, Any]: ...
    def instances(self) -> dict[str, npt.NDArray[Any]]: ...
    def view(self) -> View: ...
    def render(
        self, width: int = ..., height: int = ..., *, layers: Iterable[_Layer] = ..., **options: Any
    ) -> dict[str, npt.NDArray[Any]]: ...

class View:
    def draw(
        self,
        width: int = ...,
        height: int = ...,
        *,
        camera: Camera | str | int | None = ...,
        samples: Literal[1, 2, 4] = ...,
        show: _Show = ...,
        light: bool | _Light = ...,
        exposure: float = ...,
        blend_layers: int = ...,
        shadows: bool = ...,
        shadow_size: int = ...,
        ssao: bool = ...,
        edl: bool = ...,
        edl_strength: float = ...,
        edl_radius: int = ...,
        background: Sequence[float] = ...,
    ) -> View: ...
    def draw_batch(
        self,
        cameras: Iterable[Camera | str | int | None],
        width: int,
        height: int,
        *,
        layers: Iterable[_Layer] = ...,
        samples: Literal[1, 2, 4] = ...,
        show: _Show = ...,
        light: bool | _Light = ...,
        exposure: float = ...,
        blend_layers: int = ...,
        shadows: bool = ...,
        shadow_size: int = ...,
        ssao: bool = ...,
        edl: bool = ...,
        edl_strength: float = ...,
        edl_radius: int = ...,
        background: Sequence[float] = ...,
    ) -> View: ...
    def draw_batch_to(
        self,
        cameras: Iterable[Camera | str | int | None],
        targets: Mapping[Literal["color", "depth", "triangle", "instance", "normal", "uv"], _Array],
        *,
        samples: Literal[1, 2, 4] = ...,
        stream: int | None = ...,
        show: _Show = ...,
        light: bool | _Light = ...,
        exposure: float = ...,
        blend_layers: int = ...,
        shadows: bool = ...,
        shadow_size: int = ...,
        ssao: bool = ...,
        edl: bool = ...,
        edl_strength: float = ...,
        edl_radius: int = ...,
        background: Sequence[float] = ...,
    ) -> View: ...
    def shade(
        self,
        *,
        show: _Show = ...,
        light: bool | _Light = ...,
        exposure: float = ...,
        blend_layers: int = ...,
        shadows: bool = ...,
        shadow_size: int = ...,
        ssao: bool = ...,
        edl: bool = ...,
        edl_strength: float = ...,
        edl_radius: int = ...,
        background: Sequence[float] = ...,
    ) -> View: ...
    def read(self, layer: _Layer = ...) -> npt.NDArray[Any]: ...
    def share(self, layer: _Layer = ...) -> SharedLayer: ...
    def pick(self, x: int, y: int) -> dict[str, Any] | None: ...
    @property
    def stats(self) -> dict[str, Any]: ...

def convert(
    input: _Path,
    output: _Path | None = ...,
    *,
    position_bits: int = ...,
    float32: bool = ...,
    max_error: float = ...,
    encoding: Literal["clustered", "indexed"] = ...,
    zstd: int = ...,
    textures: Literal["keep", "raw", "jpeg"] = ...,
    jpeg_quality: int = ...,
    normals: bool = ...,
    source_ids: bool = ...,
    replace: bool = ...,
    keep_going: bool = ...,
    drop_nonfinite: bool = ...,
    allow_outside: bool = ...,
    exclude: str | None = ...,
    threads: int = ...,
    memory: int = ...,
    progress: _Progress | None = ...,
) -> dict[str, Any]: ...
