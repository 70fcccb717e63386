#!/usr/bin/env python3
"""Writes the small glTF models of this folder. Needs only Python 3; always writes the same files.

    python3 tests/data/make_models.py            writes beside itself
    python3 tests/data/make_models.py --check    fails if a file differs from its output
"""

import base64
import json
import math
import os
import struct
import sys
import zlib

BYTE, UBYTE, SHORT, USHORT, UINT, FLOAT = 5120, 5121, 5122, 5123, 5125, 5126
FORMAT = {BYTE: "b", UBYTE: "B", SHORT: "h", USHORT: "H", UINT: "I", FLOAT: "f"}
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
FILES = {}


# ---------------------------------------------------------------------------------------------------------------- images

def png(width, height, pixels, channels=3):
    """pixels: rows from the top, `channels` values each."""
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    rows = b"".join(b"\0" + bytes(pixels[y * width * channels:(y + 1) * width * channels]) for y in range(height))
    color_type = {1: 0, 3: 2, 4: 6}[channels]
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, color_type, 0, 0, 0)) +
            chunk(b"IDAT", zlib.compress(rows, 9)) + chunk(b"IEND", b""))


def jpeg(blocks_x, blocks_y, colors):
    """A baseline JPEG, 4:4:4, of flat 8 x 8 blocks: `colors` are (r, g, b) per block, rows from the top."""
    def segment(marker, data):
        return struct.pack(">BBH", 0xff, marker, len(data) + 2) + data
    # DC codes of 4 bits for the categories 0 to 11; the AC table has only "end of block", code 0.
    dc = bytes([0, 0, 0, 12] + [0] * 12) + bytes(range(12))
    ac = bytes([1] + [0] * 15) + b"\0"
    bits = ""
    last = [0, 0, 0]
    for r, g, b in colors:
        y = 0.299 * r + 0.587 * g + 0.114 * b
        planes = (y - 128, (b - y) / 1.772, (r - y) / 1.402)
        for i, plane in enumerate(planes):
            value = round(plane * 8 / 8)  # DC of a flat block is 8 times the sample; the quantiser is 8
            difference = value - last[i]
            last[i] = value
            size = abs(difference).bit_length()
            bits += format(size, "04b")
            if size:
                bits += format(difference if difference > 0 else difference + (1 << size) - 1, "0%db" % size)
            bits += "0"
    bits += "1" * (-len(bits) % 8)
    data = bytes(int(bits[i:i + 8], 2) for i in range(0, len(bits), 8)).replace(b"\xff", b"\xff\0")
    frame = struct.pack(">BHHB", 8, blocks_y * 8, blocks_x * 8, 3) + b"".join(bytes([i + 1, 0x11, 0]) for i in range(3))
    return (b"\xff\xd8" + segment(0xe0, b"JFIF\0\1\1\0\0\1\0\1\0\0") + segment(0xdb, b"\0" + bytes([8] * 64)) +
            segment(0xc0, frame) + segment(0xc4, b"\x00" + dc) + segment(0xc4, b"\x10" + ac) +
            segment(0xda, b"\3\1\0\2\0\3\0\0\x3f\0") + data + b"\xff\xd9")


CHECKER_PNG = png(4, 4, [c for y in range(4) for x in range(4)
                         for c in ((220, 60, 40) if (x + y) % 2 else (250, 230, 200))])
ALPHA_PNG = png(2, 2, [255, 0, 0, 255, 0, 255, 0, 128, 0, 0, 255, 0, 255, 255, 255, 255], 4)
TILES_JPEG = jpeg(2, 2, [(200, 40, 40), (40, 200, 40), (40, 40, 200), (220, 220, 220)])


# ---------------------------------------------------------------------------------------------------------------- models

class Model:
    def __init__(self, name):
        self.name = name
        self.json = {"asset": {"version": "2.0", "generator": "scree tests/data/make_models.py"}}
        self.buffer = bytearray()

    def add(self, section, entry):
        self.json.setdefault(section, []).append(entry)
        return len(self.json[section]) - 1

    def view(self, data, stride=None):
        self.buffer += b"\0" * (-len(self.buffer) % 4)
        entry = {"buffer": 0, "byteOffset": len(self.buffer), "byteLength": len(data)}
        if stride:
            entry["byteStride"] = stride
        self.buffer += data
        return self.add("bufferViews", entry)

    def accessor(self, rows, component=FLOAT, normalized=False, **more):
        """rows: tuples (or numbers), tightly packed except for glTF's 4-byte alignment of vertex elements."""
        rows = [r if isinstance(r, tuple) else (r,) for r in rows]
        width = len(rows[0])
        packed = [struct.pack("<%d%s" % (width, FORMAT[component]), *r) for r in rows]
        size = len(packed[0])
        stride = None
        if width > 1 and size % 4:
            stride = size + 4 - size % 4
            packed = [p + b"\xee" * (stride - size) for p in packed]
        entry = {"bufferView": self.view(b"".join(packed), stride), "componentType": component, "count": len(rows),
                 "type": TYPES[width]}
        if normalized:
            entry["normalized"] = True
        entry.update(more)
        return self.add("accessors", entry)

    def positions(self, rows, component=FLOAT, normalized=False):
        low = [min(r[i] for r in rows) for i in range(3)]
        high = [max(r[i] for r in rows) for i in range(3)]
        if component == FLOAT:
            low, high = ([struct.unpack("<f", struct.pack("<f", v))[0] for v in box] for box in (low, high))
        return self.accessor(rows, component, normalized, min=low, max=high)

    def mesh(self, *primitives, name=None):
        entry = {"primitives": list(primitives)}
        if name:
            entry["name"] = name
        return self.add("meshes", entry)

    def node(self, root=True, **entry):
        index = self.add("nodes", entry)
        if root:
            self.json.setdefault("scenes", [{"nodes": []}])[0]["nodes"].append(index)
            self.json["scene"] = 0
        return index

    def texture(self, image, **sampler):
        entry = {"source": self.add("images", image)}
        if sampler:
            entry["sampler"] = self.add("samplers", sampler)
        return self.add("textures", entry)

    def material(self, name=None, texture=None, color=None, **more):
        pbr = {}
        if texture is not None:
            pbr["baseColorTexture"] = texture if isinstance(texture, dict) else {"index": texture}
        if color:
            pbr["baseColorFactor"] = color
        entry = dict(more)
        if pbr:
            entry["pbrMetallicRoughness"] = pbr
        if name:
            entry["name"] = name
        return self.add("materials", entry)

    def _json(self, uri, length):
        if length:
            self.json["buffers"] = [dict(byteLength=length, **({"uri": uri} if uri else {}))]
        return json.dumps(self.json, separators=(",", ":")).encode()

    def save_gltf(self, bin_name=None, uri=None):
        bin_name = bin_name or self.name + ".bin"
        if self.buffer:
            FILES[bin_name] = bytes(self.buffer)
        text = self._json(uri or bin_name, len(self.buffer))
        FILES[self.name + ".gltf"] = json.dumps(json.loads(text), indent=1).encode() + b"\n"

    def save_data_uri(self):
        uri = "data:application/octet-stream;base64," + base64.b64encode(self.buffer).decode()
        FILES[self.name + ".gltf"] = self._json(uri, len(self.buffer)) + b"\n"

    def save_glb(self):
        text = self._json(None, len(self.buffer))
        text += b" " * (-len(text) % 4)
        data = bytes(self.buffer) + b"\0" * (-len(self.buffer) % 4)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text
        if data:
            chunks += struct.pack("<I4s", len(data), b"BIN\0") + data
        FILES[self.name + ".glb"] = struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def cube_faces():
    """24 vertices, 12 triangles, counter-clockwise from outside; positions, normals, uvs, indices."""
    positions, normals, uvs, indices = [], [], [], []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            u, v = (axis + 1) % 3, (axis + 2) % 3
            base = len(positions)
            for a, b in ((0, 0), (1, 0), (1, 1), (0, 1)):
                p = [0.0] * 3
                p[axis], p[u], p[v] = sign, (2.0 * a - 1) * sign, 2.0 * b - 1
                positions.append(tuple(p))
                n = [0.0] * 3
                n[axis] = sign
                normals.append(tuple(n))
                uvs.append((float(a), 1.0 - b))
            indices += [base, base + 1, base + 2, base, base + 2, base + 3]
    return positions, normals, uvs, indices


TETRAHEDRON = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]
TETRAHEDRON_INDICES = [0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3]
QUAD = [(-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 0.0)]
QUAD_UV = [(0.0, 1.0), (1.0, 1.0), (1.0, 0.0), (0.0, 0.0)]
QUAD_INDICES = [0, 1, 2, 0, 2, 3]


def textured_cube():
    m = Model("textured_cube")
    positions, normals, uvs, indices = cube_faces()
    attributes = {"POSITION": m.positions(positions), "NORMAL": m.accessor(normals), "TEXCOORD_0": m.accessor(uvs)}
    image = {"bufferView": m.view(CHECKER_PNG), "mimeType": "image/png", "name": "checker"}
    material = m.material("checker", m.texture(image, magFilter=9728, minFilter=9987, wrapS=10497, wrapT=33648))
    m.node(name="Cube", mesh=m.mesh({"attributes": attributes, "indices": m.accessor(indices, USHORT),
                                     "material": material}, name="cube"))
    m.save_glb()


def masked():
    """A square with an opaque disc by its alpha, a square with a mask that hides nothing, and a disc that vertex colours cut."""
    m = Model("masked")
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    places = [(0, 2), (1.5, 2), (1.5, 0), (0, 0)]
    attributes = {"POSITION": m.positions(corners), "TEXCOORD_0": m.accessor(places)}
    indices = m.accessor([0, 1, 2, 0, 2, 3], USHORT)
    colors = m.accessor([(1.0, 1.0, 1.0, alpha) for alpha in (1.0, 0.2, 0.2, 1.0)])
    for number, low in enumerate((10, 200, 10)):
        disc = [value for y in range(20) for x in range(20)
                for value in (200, 12 * x, 90, 240 if (x - 9.5) ** 2 + (y - 9.5) ** 2 < 60 else low)]
        image = {"bufferView": m.view(png(20, 20, disc, 4)), "mimeType": "image/png", "name": "disc"}
        material = m.material("disc", m.texture(image, wrapS=33648), alphaMode="MASK", doubleSided=True)
        more = {"COLOR_0": colors} if number == 2 else {}
        m.node(name="Square", translation=[0, 0, number] if number < 2 else [1.25, 0, 0],
               mesh=m.mesh({"attributes": {**attributes, **more}, "indices": indices, "material": material}, name="square"))
    m.save_glb()


def two_instances():
    m = Model("two_instances")
    mesh = m.mesh({"attributes": {"POSITION": m.positions(TETRAHEDRON)},
                   "indices": m.accessor(TETRAHEDRON_INDICES, UBYTE)}, name="tetrahedron")
    m.node(name="left", mesh=mesh, translation=[-2, 0, 0])
    m.node(name="right", mesh=mesh, translation=[2, 0, 0], rotation=[0, 0, math.sqrt(0.5), math.sqrt(0.5)],
           scale=[1, 2, 0.5])
    m.save_gltf()


def index_types():
    """The same tetrahedron with 8, 16 and 32-bit indices and with none."""
    m = Model("index_types")
    positions = m.positions(TETRAHEDRON)
    for i, component in enumerate((UBYTE, USHORT, UINT)):
        mesh = m.mesh({"attributes": {"POSITION": positions},
                       "indices": m.accessor(TETRAHEDRON_INDICES, component)}, name="u%d" % (8 << i))
        m.node(mesh=mesh, translation=[2 * i, 0, 0])
    flat = m.positions([TETRAHEDRON[i] for i in TETRAHEDRON_INDICES])
    m.node(mesh=m.mesh({"attributes": {"POSITION": flat}}, name="none"), translation=[6, 0, 0])
    m.save_glb()


def modes():
    """Lists, strips and fans with and without indices; points and lines, which are left out."""
    m = Model("modes")
    ribbon = [(float(i // 2), float(i % 2), 0.0) for i in range(8)]
    strip = m.positions([(p[0], p[1], 0.0) for p in ribbon])
    disc = [(0.0, 0.0, 0.0)] + [(math.cos(a), math.sin(a), 0.0) for a in (i * math.pi / 4 for i in range(9))]
    fan = m.positions(disc)
    triangles = m.positions(QUAD + [(9.0, 9.0, 9.0)])
    m.node(mesh=m.mesh({"attributes": {"POSITION": strip}, "mode": 5}, name="strip"))
    m.node(mesh=m.mesh({"attributes": {"POSITION": strip}, "mode": 5,
                        "indices": m.accessor([0, 1, 2, 3, 3, 4, 4, 5, 6, 7], USHORT)}, name="strip indexed"))
    m.node(mesh=m.mesh({"attributes": {"POSITION": fan}, "mode": 6}, name="fan"))
    m.node(mesh=m.mesh({"attributes": {"POSITION": fan}, "mode": 6,
                        "indices": m.accessor([0, 2, 4, 6, 8], UBYTE)}, name="fan indexed"))
    m.node(mesh=m.mesh({"attributes": {"POSITION": triangles}, "mode": 4,
                        "indices": m.accessor(QUAD_INDICES, UINT)}, name="list"))
    m.node(mesh=m.mesh({"attributes": {"POSITION": fan}, "mode": 0}, name="points"))
    m.node(mesh=m.mesh(*({"attributes": {"POSITION": fan}, "mode": mode} for mode in (1, 2, 3)), name="lines"))
    m.save_glb()


def interleaved():
    """One buffer view of 40-byte vertices: position, normal, texture coordinates, colour, padding."""
    m = Model("interleaved")
    rows = b"".join(struct.pack("<3f3f2f4B4x", *p, 0, 0, 1, *uv, *c) for p, uv, c in zip(
        QUAD, QUAD_UV, ((255, 0, 0, 255), (0, 255, 0, 255), (0, 0, 255, 255), (255, 255, 255, 128))))
    view = m.view(rows, 40)
    def part(offset, component, kind, **more):
        return m.add("accessors", dict(bufferView=view, byteOffset=offset, componentType=component, count=4, type=kind,
                                       **more))
    attributes = {"POSITION": part(0, FLOAT, "VEC3", min=[-1, -1, 0], max=[1, 1, 0]), "NORMAL": part(12, FLOAT, "VEC3"),
                  "TEXCOORD_0": part(24, FLOAT, "VEC2"), "COLOR_0": part(32, UBYTE, "VEC4", normalized=True)}
    texture = m.texture({"bufferView": m.view(TILES_JPEG), "mimeType": "image/jpeg"}, wrapS=33071, wrapT=33071)
    m.node(mesh=m.mesh({"attributes": attributes, "indices": m.accessor(QUAD_INDICES, USHORT),
                        "material": m.material("tiles", texture)}))
    m.save_glb()


def sparse():
    """Sparse accessors: positions over a base, positions without a base, indices."""
    m = Model("sparse")
    grid = [(float(x), float(y), 0.0) for y in range(3) for x in range(3)]
    quads = [i for y in range(2) for x in range(2)
             for a in [y * 3 + x] for i in (a, a + 1, a + 4, a, a + 4, a + 3)]
    indices = m.accessor(quads, UBYTE)

    def over(accessor, places, component, values, low=None, high=None):
        m.buffer += b"\0" * (-len(m.buffer) % 4)
        index_view = m.view(struct.pack("<%d%s" % (len(places), FORMAT[component]), *places))
        value_view = m.view(values)
        m.json["accessors"][accessor]["sparse"] = {
            "count": len(places), "indices": {"bufferView": index_view, "componentType": component},
            "values": {"bufferView": value_view}}
        if low:
            m.json["accessors"][accessor].update(min=low, max=high)
        return accessor

    raised = over(m.positions(grid), [4, 8], USHORT, struct.pack("<6f", 1, 1, 0.5, 2.5, 2.5, 1), [0, 0, 0],
                  [2.5, 2.5, 1])
    m.node(name="over a base", mesh=m.mesh({"attributes": {"POSITION": raised}, "indices": indices}))
    bare = m.add("accessors", {"componentType": FLOAT, "count": 9, "type": "VEC3"})
    over(bare, [1, 2, 3, 4, 5, 6, 7, 8], UINT, b"".join(struct.pack("<3f", *p) for p in grid[1:]), [0, 0, 0], [2, 2, 0])
    m.node(name="over zeros", mesh=m.mesh({"attributes": {"POSITION": bare}, "indices": indices}), translation=[4, 0, 0])
    turned = over(m.accessor(quads, UBYTE), [22, 23], UBYTE, struct.pack("<2B", 4, 4))
    m.node(name="indices", mesh=m.mesh({"attributes": {"POSITION": m.positions(grid)}, "indices": turned}),
           translation=[8, 0, 0])
    m.save_gltf()


def quantized():
    """Every integer type of KHR_mesh_quantization, plain and normalised."""
    m = Model("quantized")
    m.json["extensionsUsed"] = m.json["extensionsRequired"] = ["KHR_mesh_quantization"]
    texture = m.texture({"bufferView": m.view(CHECKER_PNG), "mimeType": "image/png"})
    material = m.material("checker", texture)
    indices = m.accessor(TETRAHEDRON_INDICES, USHORT)
    limits = {BYTE: 127, UBYTE: 255, SHORT: 32767, USHORT: 65535}
    n = math.sqrt(1 / 3)
    for i, component in enumerate((BYTE, UBYTE, SHORT, USHORT)):
        for normalized in (False, True):
            top = limits[component]
            rows = [tuple(int(v) * top for v in p) for p in TETRAHEDRON]
            if component in (BYTE, SHORT):
                rows[0] = (-top - 1,) * 3  # one step below the symmetric range; normalised, it reads as -1
            signed = component if component in (BYTE, SHORT) else (BYTE if component == UBYTE else SHORT)
            normals = [tuple(round(v * limits[signed]) for v in p)
                       for p in ((-n, -n, -n), (1, 0, 0), (0, 1, 0), (0, 0, 1))]
            uvs = [(0, 0), (top, 0), (0, top), (top, top)] if normalized else [(0, 0), (2, 0), (0, 2), (2, 2)]
            attributes = {"POSITION": m.positions(rows, component, normalized),
                          "NORMAL": m.accessor(normals, signed, True),
                          "TEXCOORD_0": m.accessor(uvs, component, normalized)}
            scale = 1.0 if normalized else 1.0 / top
            m.node(name="%s%s" % (FORMAT[component], "n" if normalized else ""), scale=[scale] * 3,
                   translation=[3 * i, 3 * normalized, 0],
                   mesh=m.mesh({"attributes": attributes, "indices": indices, "material": material}))
    m.save_glb()


def materials():
    """Base-colour textures by file, buffer view and data: URI, samplers, KHR_texture_transform, unlit, alpha modes."""
    m = Model("materials")
    m.json["extensionsUsed"] = ["KHR_texture_transform", "KHR_materials_unlit"]
    FILES["tiles #1 \u00e9.jpg"] = TILES_JPEG
    FILES["checker.png"] = CHECKER_PNG
    checker = m.texture({"uri": "checker.png", "name": "checker"}, magFilter=9728, minFilter=9728)
    tiles = m.texture({"uri": "tiles%20%231%20%C3%A9.jpg"}, wrapS=33071, wrapT=33648, magFilter=9729, minFilter=9986)
    inline = m.texture({"uri": "data:image/png;base64," + base64.b64encode(ALPHA_PNG).decode()})
    again = m.add("textures", {"source": 0, "name": "checker again"})
    attributes = {"POSITION": m.positions(QUAD), "TEXCOORD_0": m.accessor(QUAD_UV),
                  "TEXCOORD_1": m.accessor([(2 * u, 3 * v) for u, v in QUAD_UV])}
    indices = m.accessor(QUAD_INDICES, UBYTE)
    transform = {"offset": [0.25, 0.5], "scale": [2, -3], "rotation": 0.5, "texCoord": 1}
    kinds = [
        m.material("plain", color=[0.8, 0.4, 0.2, 1]),
        m.material("checker", checker),
        m.material("tiles", tiles, doubleSided=True),
        m.material("inline", inline, alphaMode="MASK", alphaCutoff=0.25),
        m.material("transformed", {"index": again, "texCoord": 0,
                                   "extensions": {"KHR_texture_transform": transform}}),
        m.material("second set", {"index": checker, "texCoord": 1}, color=[1, 0.5, 1, 0.5], alphaMode="BLEND"),
        m.material("unlit", checker, extensions={"KHR_materials_unlit": {}}),
        None,
    ]
    m.material("unused", inline)
    for i, material in enumerate(kinds):
        primitive = {"attributes": attributes, "indices": indices}
        if material is not None:
            primitive["material"] = material
        m.node(mesh=m.mesh(primitive), translation=[2.5 * (i % 4), 2.5 * (i // 4), 0])
    m.save_gltf()


def colors():
    """COLOR_0 of every type that glTF allows, one quad each."""
    m = Model("colors")
    positions = m.positions(QUAD)
    indices = m.accessor(QUAD_INDICES, UBYTE)
    corners = [(1, 0, 0, 1), (0, 1, 0, 1), (0, 0, 1, 1), (1, 1, 1, 0)]
    for i, (component, top) in enumerate(((UBYTE, 255), (USHORT, 65535), (FLOAT, 1))):
        for width in (3, 4):
            rows = [tuple((float(v) if component == FLOAT else v * top) for v in c[:width]) for c in corners]
            color = m.accessor(rows, component, component != FLOAT)
            m.node(mesh=m.mesh({"attributes": {"POSITION": positions, "COLOR_0": color}, "indices": indices}),
                   translation=[2.5 * i, 2.5 * (width - 3), 0])
    m.save_glb()


def gpu_instancing():
    m = Model("gpu_instancing")
    m.json["extensionsUsed"] = ["EXT_mesh_gpu_instancing"]
    mesh = m.mesh({"attributes": {"POSITION": m.positions(TETRAHEDRON)},
                   "indices": m.accessor(TETRAHEDRON_INDICES, UBYTE)})
    count = 6
    half = round(math.sqrt(0.5) * 32767)
    attributes = {
        "TRANSLATION": m.accessor([(2.0 * i, 0.0, 0.5 * i) for i in range(count)]),
        "ROTATION": m.accessor([(0, 0, half, half) if i % 2 else (0, 0, 0, 32767) for i in range(count)], SHORT, True),
        "SCALE": m.accessor([(1.0, 1.0 + i, -1.0 if i == 3 else 1.0) for i in range(count)]),
        "_ID": m.accessor([float(i) for i in range(count)]),
    }
    parent = m.node(name="parent", translation=[0, 0, 1], scale=[2, 2, 2])
    m.json["nodes"][parent]["children"] = [m.node(
        root=False, name="all", mesh=mesh, extensions={"EXT_mesh_gpu_instancing": {"attributes": attributes}})]
    moved = {"TRANSLATION": m.accessor([(0.0, -5.0, 0.0), (1.0, -5.0, 0.0)])}
    m.node(name="translations", mesh=mesh, extensions={"EXT_mesh_gpu_instancing": {"attributes": moved}})
    m.save_glb()


def nodes():
    """Trees with children before parents, matrices, negative scales, several scenes, cameras, nodes of no scene."""
    m = Model("nodes")
    mesh = m.mesh({"attributes": {"POSITION": m.positions(TETRAHEDRON)},
                   "indices": m.accessor(TETRAHEDRON_INDICES, UBYTE)}, name="tetrahedron")
    m.mesh({"attributes": {"POSITION": 0}, "indices": 1}, name="never drawn")
    perspective = m.add("cameras", {"type": "perspective", "name": "wide",
                                    "perspective": {"yfov": 1.0, "znear": 0.1, "aspectRatio": 1.5}})
    orthographic = m.add("cameras", {"type": "orthographic", "name": "plan",
                                     "orthographic": {"xmag": 4, "ymag": 3, "znear": 0, "zfar": 100}})
    m.json["nodes"] = [
        {"name": "leaf", "mesh": mesh, "scale": [-1, 1, 1]},
        {"name": "branch", "children": [0, 3], "rotation": [0.5, 0.5, 0.5, 0.5]},
        {"name": "root", "children": [1], "matrix": [0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 10, 20, 30, 1]},
        {"name": "FogCard.001", "mesh": mesh},
        {"name": "eye", "camera": perspective, "translation": [0, 0, 5]},
        {"name": "above", "camera": orthographic, "translation": [0, 8, 0],
         "rotation": [-math.sqrt(0.5), 0, 0, math.sqrt(0.5)]},
        {"name": "flat", "mesh": mesh, "scale": [1, 1, 0]},
        {"name": "empty"},
        {"name": "outside every scene", "mesh": mesh},
    ]
    m.json["scenes"] = [{"name": "first", "nodes": [2, 4]}, {"name": "second", "nodes": [5, 6, 7, 2]}]
    m.json["scene"] = 1
    m.save_gltf()


def multi_primitive():
    """Primitives with different materials, attributes and modes in one mesh, some with nothing to draw; a mesh with only such primitives."""
    m = Model("multi_primitive")
    red, green = m.material("red", color=[1, 0, 0, 1]), m.material("green", color=[0, 1, 0, 1])
    quad = m.positions(QUAD)
    indices = m.accessor(QUAD_INDICES, UBYTE)
    nothing = {"attributes": {"POSITION": m.positions(QUAD[:2])}}
    m.node(name="mixed", mesh=m.mesh(
        {"attributes": {"POSITION": quad}, "indices": indices, "material": red}, nothing,
        {"attributes": {"POSITION": m.positions([(x, y, 1.0) for x, y, z in QUAD]), "NORMAL": m.accessor([(0.0, 0.0, 1.0)] * 4)},
         "indices": indices, "material": green},
        {"attributes": {"NORMAL": m.accessor([(0.0, 0.0, 1.0)] * 3)}, "material": green}))
    m.node(name="nothing to draw", mesh=m.mesh(nothing))
    m.node(name="no mesh")
    m.save_glb()


def left_out():
    """Skins, morph targets, animations, tangents and other attributes that are reported and left out."""
    m = Model("left_out")
    count = 4
    attributes = {"POSITION": m.positions(QUAD), "NORMAL": m.accessor([(0.0, 0.0, 1.0)] * count),
                  "TANGENT": m.accessor([(1.0, 0.0, 0.0, 1.0)] * count), "TEXCOORD_0": m.accessor(QUAD_UV),
                  "TEXCOORD_1": m.accessor(QUAD_UV), "COLOR_0": m.accessor([(1.0, 1.0, 1.0)] * count),
                  "COLOR_1": m.accessor([(1.0, 1.0, 1.0)] * count),
                  "JOINTS_0": m.accessor([(0, 0, 0, 0)] * count, UBYTE), "WEIGHTS_0": m.accessor([(1.0, 0.0, 0.0, 0.0)] * count),
                  "_TEMPERATURE": m.accessor([20.0] * count)}
    moved = m.positions([(0.0, 0.0, 0.5)] * count)
    mesh = m.mesh({"attributes": attributes, "indices": m.accessor(QUAD_INDICES, UBYTE), "targets": [{"POSITION": moved}]})
    m.json["meshes"][mesh]["weights"] = [0.5]
    joint = m.node(name="joint")
    inverse = m.accessor([tuple(float(i % 5 == 0) for i in range(16))])
    m.add("skins", {"joints": [joint], "inverseBindMatrices": inverse})
    m.node(name="skinned", mesh=mesh, skin=0)
    times = m.accessor([0.0, 1.0], min=[0], max=[1])
    values = m.accessor([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)])
    m.add("animations", {"samplers": [{"input": times, "output": values}],
                         "channels": [{"sampler": 0, "target": {"node": joint, "path": "translation"}}]})
    m.save_glb()


def glass():
    """18 blended panes behind one another, one mesh: more layers than are drawn by default."""
    m = Model("glass")
    pane = m.mesh({"attributes": {"POSITION": m.positions(QUAD)}, "indices": m.accessor(QUAD_INDICES, UBYTE),
                   "material": m.material("glass", color=[0.2, 0.8, 0.5, 0.25], alphaMode="BLEND")})
    for i in range(18):
        m.node(name=f"pane {i}", mesh=pane, translation=[0, 0, -i / 32])
    m.save_glb()


def sun():
    """A floor and a box, a ball and a grating on it, an alpha mask, under a sun and a lamp that casts no shadows."""
    m = Model("sun")
    m.json["extensionsUsed"] = ["KHR_lights_punctual"]
    m.json["extensions"] = {"KHR_lights_punctual": {"lights": [
        {"type": "point", "name": "lamp", "color": [0.5, 0.7, 1], "intensity": 12},
        {"type": "directional", "name": "sun", "color": [1, 0.95, 0.85], "intensity": 3}]}}

    def matt(name, color, **more):
        index = m.material(name, color=color, **more)
        m.json["materials"][index]["pbrMetallicRoughness"].update(metallicFactor=0, roughnessFactor=0.8)
        return index
    floor = {"attributes": {"POSITION": m.positions([(x, 0.0, -z) for x, z, _ in QUAD])},
             "indices": m.accessor(QUAD_INDICES, UBYTE), "material": matt("stone", [0.7, 0.68, 0.62, 1])}
    m.node(name="floor", mesh=m.mesh(floor, name="floor"), scale=[4, 1, 4])
    positions, _, _, indices = cube_faces()
    box = {"attributes": {"POSITION": m.positions(positions)}, "indices": m.accessor(indices, USHORT),
           "material": matt("clay", [0.75, 0.35, 0.25, 1])}
    m.node(name="box", mesh=m.mesh(box, name="box"), translation=[-1.5, 0.5, 0.75], scale=[0.5] * 3)
    across, down = 32, 16
    ball = [(math.sin(b) * math.cos(a), math.cos(b), -math.sin(b) * math.sin(a))
            for b in (math.pi * j / down for j in range(down + 1))
            for a in (2 * math.pi * i / across for i in range(across + 1))]
    quads = [i for y in range(down) for x in range(across)
             for a in [y * (across + 1) + x] for i in (a, a + across + 1, a + across + 2, a, a + across + 2, a + 1)]
    ball = {"attributes": {"POSITION": m.positions(ball), "NORMAL": m.accessor(ball)},
            "indices": m.accessor(quads, USHORT), "material": matt("jade", [0.3, 0.6, 0.4, 1])}
    m.node(name="ball", mesh=m.mesh(ball, name="ball"), translation=[0.75, 0.8, 0.5], scale=[0.8] * 3)
    bars = [value for y in range(64) for x in range(64)
            for value in (235, 225, 200, 255 if x % 16 < 4 or y % 16 < 4 else 0)]
    grating = matt("grating", [1, 1, 1, 1], alphaMode="MASK", doubleSided=True)
    image = {"bufferView": m.view(png(64, 64, bars, 4)), "mimeType": "image/png", "name": "bars"}
    m.json["materials"][grating]["pbrMetallicRoughness"]["baseColorTexture"] = {"index": m.texture(image)}
    screen = {"attributes": {"POSITION": m.positions(QUAD), "TEXCOORD_0": m.accessor(QUAD_UV)},
              "indices": m.accessor(QUAD_INDICES, UBYTE), "material": grating}
    m.node(name="screen", mesh=m.mesh(screen, name="screen"), translation=[-0.25, 1, -1.5])
    m.node(name="lamp", translation=[-3, 3, 3], extensions={"KHR_lights_punctual": {"light": 0}})
    turn, rise = math.radians(65), math.radians(-38)  # -z turned down, and around y
    m.node(name="sun", rotation=[math.cos(turn / 2) * math.sin(rise / 2), math.sin(turn / 2) * math.cos(rise / 2),
                                 -math.sin(turn / 2) * math.sin(rise / 2), math.cos(turn / 2) * math.cos(rise / 2)],
           extensions={"KHR_lights_punctual": {"light": 1}})
    m.save_glb()


def data_uri():
    m = Model("data_uri")
    m.node(name="tetrahedron", mesh=m.mesh({"attributes": {"POSITION": m.positions(TETRAHEDRON)},
                                            "indices": m.accessor(TETRAHEDRON_INDICES, UBYTE)}))
    m.save_data_uri()


def grid():
    """A curved, textured, double-sided sheet of 32 x 32 quads: the largest model here, 1089 vertices."""
    m = Model("grid")
    size = 33
    rows = [(x / 8 - 2, y / 8 - 2, 0.25 * math.sin(x / 3) * math.cos(y / 4)) for y in range(size) for x in range(size)]
    quads = [i for y in range(size - 1) for x in range(size - 1)
             for a in [y * size + x] for i in (a, a + 1, a + size + 1, a, a + size + 1, a + size)]
    uvs = [(4 * x / (size - 1), 4 * y / (size - 1)) for y in range(size) for x in range(size)]
    texture = m.texture({"bufferView": m.view(TILES_JPEG), "mimeType": "image/jpeg", "name": "tiles"})
    m.node(name="sheet", mesh=m.mesh({"attributes": {"POSITION": m.positions(rows), "TEXCOORD_0": m.accessor(uvs)},
                                      "indices": m.accessor(quads, USHORT),
                                      "material": m.material("tiles", texture, doubleSided=True)}, name="sheet"))
    m.save_glb()


for make in (textured_cube, masked, two_instances, index_types, modes, interleaved, sparse, quantized, materials,
             colors, gpu_instancing, nodes, multi_primitive, left_out, glass, sun, data_uri, grid):
    make()


def main():
    folder = os.path.dirname(os.path.abspath(__file__))
    different = []
    for name, data in sorted(FILES.items()):
        path = os.path.join(folder, name)
        if "--check" in sys.argv:
            if not os.path.exists(path) or open(path, "rb").read() != data:
                different.append(name)
            continue
        with open(path, "wb") as file:
            file.write(data)
    if different:
        sys.exit("differs: " + ", ".join(different))


main()
