#!/usr/bin/env python3
"""Writes the small glTF models of this folder. Needs Python 3 only; the same files every time.

    python3 tests/data/make_models.py            writes beside itself
    python3 tests/data/make_models.py --check    fails where a file differs from what it would write
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
    """A baseline JPEG, 4:4:4, of flat 8 x 8 blocks: `colors` are (r, g, b) a block, rows from the top."""
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
        """rows: tuples (or numbers), tightly packed but for the 4-byte alignment of vertex elements glTF asks for."""
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


def two_instances():
    m = Model("two_instances")
    mesh = m.mesh({"attributes": {"POSITION": m.positions(TETRAHEDRON)},
                   "indices": m.accessor(TETRAHEDRON_INDICES, UBYTE)}, name="tetrahedron")
    m.node(name="left", mesh=mesh, translation=[-2, 0, 0])
    m.node(name="right", mesh=mesh, translation=[2, 0, 0], rotation=[0, 0, math.sqrt(0.5), math.sqrt(0.5)],
           scale=[1, 2, 0.5])
    m.save_gltf()


textured_cube()
two_instances()


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
