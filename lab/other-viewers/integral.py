#!/usr/bin/env python3
"""Integrates the light of a panorama that a rough metal reflects, to judge the pictures of viewers.

    integral.py PANORAMA.hdr

Prints sRGB codes for the surfaces in docs/viewers.md. `once`: appendix B of glTF 2.0 (GGX, Smith, Schlick), light that
is reflected once. `often`: including light that a rough surface reflects several times, such that a white surface loses
none. `matt`: a matt surface of the same colour. Summing over the texels of the panorama is the only approximation.
"""
import math
import sys


def read_panorama(path):
    """(direction, solid angle, colour) of every texel; -z in the middle, y up. Run-length coded files only."""
    data = open(path, "rb").read()
    at = data.index(b"\n\n") + 2
    end = data.index(b"\n", at)
    _, height, _, width = data[at:end].split()
    height, width, at = int(height), int(width), end + 1
    texels = []
    for y in range(height):
        if data[at:at + 2] != b"\2\2":
            raise SystemExit(f"integral.py: {path}: only run-length coded pictures")
        at += 4
        row = bytearray()
        while len(row) < 4 * width:
            count = data[at]
            if count > 128:
                row += data[at + 1:at + 2] * (count - 128)
                at += 2
            else:
                row += data[at + 1:at + 1 + count]
                at += 1 + count
        latitude = (y + 0.5) / height * math.pi
        angle = 2 * math.pi / width * math.pi / height * math.sin(latitude)
        for x in range(width):
            longitude = ((x + 0.5) / width - 0.5) * 2 * math.pi
            direction = (math.sin(latitude) * math.sin(longitude), math.cos(latitude), -math.sin(latitude) * math.cos(longitude))
            scale = 2.0 ** (row[3 * width + x] - 136)
            texels.append((direction, angle, [row[c * width + x] * scale for c in range(3)]))
    return texels


def linear(code):
    return code / 255 / 12.92 if code <= 10 else ((code / 255 + 0.055) / 1.055) ** 2.4


def srgb(values):
    return [round(255 * (12.92 * v if v <= 0.0031308 else 1.055 * min(v, 1) ** (1 / 2.4) - 0.055)) for v in values]


def unit(v):
    length = math.sqrt(sum(c * c for c in v))
    return [c / length for c in v]


def dot(a, b):
    return sum(x * y for x, y in zip(a, b))


def reflect(texels, normal, viewer, color, roughness):
    square = roughness ** 4
    n_v = dot(normal, viewer)
    once, arriving, white = [0.0] * 3, [0.0] * 3, 0.0
    for direction, angle, light in texels:
        n_l = dot(normal, direction)
        if n_l <= 0:
            continue
        half = unit([a + b for a, b in zip(direction, viewer)])
        n_h = dot(normal, half)
        spread = square / (math.pi * (n_h * n_h * (square - 1) + 1) ** 2)
        seen = 1
        for c in (n_l, n_v):
            seen /= c + math.sqrt(c * c * (1 - square) + square)
        share = angle * n_l * spread * seen
        grazing = (1 - dot(viewer, half)) ** 5
        white += share
        for c in range(3):
            once[c] += light[c] * share * (color[c] + (1 - color[c]) * grazing)
            arriving[c] += light[c] * angle * n_l / math.pi
    often = [a + (1 - white) * b * c for a, b, c in zip(once, arriving, color)]
    return srgb(once), srgb(often), srgb([a * c for a, c in zip(arriving, color)])


def to_viewer(towards_eye, x, y):
    """The direction from a pixel's surface to the eye, for the cameras of run.mjs."""
    pixel = math.tan(math.radians(15)) / 240
    right = unit((towards_eye[2], 0, -towards_eye[0]))
    up = [towards_eye[1] * right[2], towards_eye[2] * right[0] - towards_eye[0] * right[2], -towards_eye[1] * right[0]]
    return unit([e + (320 - x) * pixel * r + (y - 240) * pixel * u for e, r, u in zip(towards_eye, right, up)])


def main():
    texels = read_panorama(sys.argv[1])
    front, corner = [0, 0, 1], unit((1, 0.6, 1.2))
    # Pixels of the lowest row of balls, from the left, and the first coordinates of their normals (--show normal).
    balls = [(285, 0.059), (342, 0.004), (399, -0.051), (455, -0.153), (513, -0.161)]
    cases = [("Anisotropy Strength Test, white, roughness %.2f" % ((i + 2) / 6), unit((n_x, 0.137, 0.99)), [1, 1, 1], (i + 2) / 6,
              to_viewer(front, x, 394)) for i, (x, n_x) in enumerate(balls)]
    cases.append(("Texture Coordinate Test, grey 0.5, roughness 1", front, [0.5] * 3, 1, front))
    cases.append(("Multi UV Test, left side, roughness 1", front, [linear(c) for c in (255, 247, 153)], 1,
                  to_viewer(corner, 214, 344)))
    for name, normal, color, roughness, viewer in cases:
        once, often, matt = reflect(texels, normal, viewer, color, roughness)
        print(f"{name}: once {once}, often {often}, matt {matt}")


if len(sys.argv) != 2:
    raise SystemExit("integral.py: integral.py PANORAMA.hdr")
main()
