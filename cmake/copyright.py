#!/usr/bin/env python3
"""Writes the licences of a built scree: its own, and the licences of the libraries in it, from the distribution's packages.

copyright.py --debian FILE --package NAME [--cuda] [--bundled] [--with LIBRARY]...
    the copyright file of a Debian package, in the machine-readable form (DEP-5)
copyright.py --third-party FILE [--cuda] [--with LIBRARY]...
    the same for the libraries alone, including the shared ones, for the tarball

A package's own /usr/share/doc/PACKAGE/copyright gives holders and licence texts. A package that is not installed, or whose
copyright file cannot be read, is an error: a licence is never left out.
"""
import argparse
import os
import re
import sys

# Libraries that are linked statically or compiled in (cmake/dependencies.cmake). If distributions
# name a package differently, the names are tried in turn. Boost is missing because its licence
# (BSL-1.0) requires no notice with object code.
LIBRARIES = [("zstd", ["libzstd-dev"]), ("xxhash", ["libxxhash-dev"]), ("zlib", ["zlib1g-dev"]), ("libpng", ["libpng-dev"]),
             ("libjpeg-turbo", ["libjpeg62-turbo-dev", "libjpeg-turbo8-dev"]), ("tinygltf", ["libtinygltf-dev"]),
             ("nlohmann-json", ["nlohmann-json3-dev"]), ("cli11", ["libcli11-dev"])]
OPTIONAL = {"webp": ("libwebp", ["libwebp-dev"]), "draco": ("draco", ["libdraco-dev"])}
PYBIND11 = ("pybind11", ["pybind11-dev"])
PACKAGES = ["scree", "libscree0", "libscree-dev", "python3-scree"]
# libscree links shared libraries, but contains code of these libraries' headers.
HEADER_CODE = {"xxhash", "tinygltf", "nlohmann-json", "draco"}
# Packages whose copyright file has the old form ("Copyright:" and "License:" with a text each), and their licence.
OLD_FORM = {"libwebp": "BSD-3-clause"}
# Shared libraries that lie beside the program in the tarball, and with --bundled in the package scree.
BESIDE = [("meshoptimizer", ["libmeshoptimizer-dev"]), ("isa-l", ["libisal-dev"]), ("openexr", ["libopenexr-dev"]),
          ("imath", ["libimath-dev"])]
FORMAT = "https://www.debian.org/doc/packaging-manuals/copyright-format/1.0/"
CUDA = """The CUDA runtime (cudart), in this package: object code of the CUDA Toolkit, which may be distributed as part
of a program under "Attachment A" of the CUDA Toolkit End User License Agreement,
https://docs.nvidia.com/cuda/eula/. All rights in it remain with NVIDIA."""
# Source files of libraries that are not part of the program: packaging, tests, examples, programs and documentation.
NOT_LINKED = re.compile(r"^(debian|tests?|testdata|examples?|tools|fuzz|contrib|doc|docs|cmake|amiga|java|build|release|programs)/|"
                        r"^(xxhsum\.c|zlibWrapper/examples)|/fuzz/|\.(md|txt|yml|cmake|in)$")


def fail(message):
    print(f"copyright.py: {message}", file=sys.stderr)
    sys.exit(1)


def stanzas_of(text):
    """Paragraphs of "Field: value" with values over several lines."""
    stanzas = []
    for paragraph in re.split(r"\n[ \t]*\n", text.strip()):
        fields = {}
        last = None
        for line in paragraph.splitlines():
            if line.startswith("#"):
                continue
            found = re.match(r"([A-Za-z-]+):\s*(.*)$", line)
            if found and not line[0].isspace():
                last = found[1]
                fields[last] = found[2]
            elif last:
                fields[last] += "\n" + line.rstrip()
        stanzas.append(fields)
    return stanzas


def read_package(names):
    for name in names:
        path = f"/usr/share/doc/{name}/copyright"
        if os.path.exists(path):
            with open(path, encoding="utf-8") as file:
                return name, path, file.read()
    fail(f"no package {' or '.join(names)} is installed, so that its licence is not known")


def folded(text):
    """The lines of a value, trimmed, as lines of a field."""
    return "\n".join((" " + line.strip()) if line.strip() else " ." for line in text.splitlines() if line.strip())


def old_stanzas(library, package, path, text):
    found = re.search(r"^Copyright:\n(.*?)^License:\n(.*?)^(?=\S)", text, re.MULTILINE | re.DOTALL)
    if not found:
        fail(f"{path}: expected Copyright: and License: with a text each")
    name = f"{OLD_FORM[library]}~{library}"
    body = "\n".join(f" {line.strip()}" if line.strip() else " ." for line in found[2].strip("\n").splitlines())
    return [f"Files: {library}/*\nCopyright:\n{folded(found[1])}\nLicense: {name}\nComment: In this package, from {package}.",
            f"License: {name}\n{body}"]


def library_stanzas(library, names):
    package, path, text = read_package(names)
    if library in OLD_FORM and not text.startswith("Format:"):
        return old_stanzas(library, package, path, text)
    out = []
    stanzas = stanzas_of(text)
    if "Format" not in stanzas[0]:
        fail(f"{path}: expected the machine-readable form (Format: ...) in its first paragraph")
    used = set()
    bodies = {}
    for fields in stanzas[1:]:
        licence = fields.get("License", "")
        title, _, body = licence.partition("\n")
        title = title.strip()
        if body.strip():
            bodies.setdefault(title.lower(), (title, body))
        if "Files" not in fields:
            continue
        files = [word for word in fields["Files"].split() if not NOT_LINKED.search(word)]
        if not files:
            continue
        if not title or not fields.get("Copyright", "").strip():
            fail(f"{path}: Files: {files[0]} without Copyright or License")
        used.update(word.strip().lower() for word in re.split(r",?\s+(?:and/or|and|or)\s+", title, flags=re.IGNORECASE))
        # Licences of the same name have different texts in different libraries, so the library's name is appended.
        named = re.sub(r"(?i)(,?\s+(?:and/or|and|or)\s+)|([^\s,]+)", lambda m: m[1] or f"{m[2]}~{library}", title)
        out.append(f"Files: {' '.join(f'{library}/{word}' for word in files)}\n"
                   f"Copyright:\n{folded(fields['Copyright'])}\nLicense: {named}")
    if not out:
        fail(f"{path}: no paragraph is about the library's own files")
    out[0] += f"\nComment: In this package, from {package}."
    for name in sorted(used):
        if name not in bodies:
            fail(f"{path}: no text of the licence {name}")
        title, body = bodies[name]
        lines = [line if line.strip() not in ("", ".") else " ." for line in body.strip("\n").splitlines()]
        out.append(f"License: {title}~{library}\n" + "\n".join(" " + line.strip() if line.strip() else " ." for line in lines))
    return out


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--debian", metavar="FILE")
    parser.add_argument("--package", metavar="NAME", choices=PACKAGES, default="scree")
    parser.add_argument("--third-party", metavar="FILE")
    parser.add_argument("--cuda", action="store_true")
    parser.add_argument("--bundled", action="store_true")
    parser.add_argument("--with", dest="optional", metavar="LIBRARY", action="append", choices=[*sorted(OPTIONAL), "pybind11"], default=[])
    asked = parser.parse_args()
    with open(os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "LICENSE"), encoding="utf-8") as file:
        own = file.read()
    found = re.search(r"^Copyright \(c\) (.*)$", own, re.MULTILINE)
    if not own.startswith("MIT License\n") or not found:
        fail("LICENSE: expected the MIT licence and a line Copyright (c)")
    body = own[found.end():].strip()
    parts = [f"Format: {FORMAT}\nUpstream-Name: scree"]
    if asked.debian:
        if asked.cuda and asked.package != "python3-scree":
            parts[0] += "\nComment:\n" + "\n".join(f" {line}" for line in CUDA.splitlines())
        parts.append(f"Files: *\nCopyright: {found[1]}\nLicense: Expat")
        parts.append("License: Expat\n" + "\n".join(f" {line}" if line.strip() else " ." for line in body.splitlines()))
    linked = LIBRARIES + [OPTIONAL[name] for name in asked.optional if name in OPTIONAL]
    if asked.third_party:
        libraries = linked + BESIDE + ([PYBIND11] if "pybind11" in asked.optional else [])
    elif asked.package == "python3-scree":
        libraries = [PYBIND11]
    elif asked.package == "scree":
        libraries = linked + (BESIDE if asked.bundled else [])
    else:
        libraries = [library for library in linked if library[0] in HEADER_CODE]
    for library, names in libraries:
        parts += library_stanzas(library, names)
    if asked.debian:
        with open(asked.debian, "w", encoding="utf-8") as file:
            file.write("\n\n".join(parts) + "\n")
    if asked.third_party:
        parts[0] = ("Third-party software in this folder. scree itself is under the MIT licence (LICENSE). meshoptimizer, ISA-L,\n"
                    "OpenEXR and Imath lie beside the program as shared libraries. The others are part of the program, but for pybind11, which\n"
                    "is part of the Python module. lib/ also has the shared libraries that libscree uses.")
        if asked.cuda:
            parts.insert(1, CUDA)
        with open(asked.third_party, "w", encoding="utf-8") as file:
            file.write("\n\n".join(parts) + "\n")


main()
