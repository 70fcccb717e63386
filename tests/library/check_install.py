#!/usr/bin/env python3
"""check_install.py BUILD SOURCE MODEL: installs the library's files into a fresh folder, and builds and runs programs
with them there: the programs of consumer/ through CMake and pkg-config, and the examples of docs/library.md."""

import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

build, source, model = (pathlib.Path(word).resolve() for word in sys.argv[1:4])


def run(*words, **options):
    done = subprocess.run([str(word) for word in words], text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, **options)
    if done.returncode != 0:
        sys.exit(f"{' '.join(map(str, words))}: exit {done.returncode}\n{done.stdout}")
    return done.stdout


def flags(environment, *words):
    return run("pkg-config", *words, "scree", env=environment).split()


with tempfile.TemporaryDirectory() as temporary:
    folder = pathlib.Path(temporary)
    prefix, consumer = folder / "prefix", folder / "consumer"
    for component in ("library", "development", "bundled"):
        run("cmake", "--install", build, "--component", component, "--prefix", prefix)
    lib = next(prefix.glob("**/scree.pc")).parent.parent
    environment = {**os.environ, "PKG_CONFIG_PATH": str(lib / "pkgconfig"), "LD_LIBRARY_PATH": str(lib)}

    run("cmake", "-G", "Ninja", "-S", source / "tests/library/consumer", "-B", consumer, f"-DCMAKE_PREFIX_PATH={prefix}")
    run("cmake", "--build", consumer)
    names = ("consumer_c", "consumer_cpp", "consumer_static", "consumer_static_cpp")
    programs = [consumer / name for name in names if (consumer / name).exists()]
    if (lib / "libscree.a").exists() != (len(programs) == 4):
        sys.exit("libscree.a is installed, but the CMake package does not offer it")
    by_hand = folder / "by_hand"
    run("cc", "-std=c99", source / "tests/library/consumer/consumer.c", *flags(environment, "--cflags", "--libs"), "-o", by_hand)
    programs.append(by_hand)
    if (lib / "libscree.a").exists():
        static = folder / "static"
        libraries = ["-Wl,-Bstatic", "-lscree", "-Wl,-Bdynamic"]
        rest = [flag for flag in flags(environment, "--libs", "--static") if flag != "-lscree"]
        run("cc", "-std=c99", source / "tests/library/consumer/consumer.c", *flags(environment, "--cflags"), f"-L{lib}",
            *libraries, *rest, "-o", static)
        programs.append(static)
    lines = {run(program, model, folder, env=environment) for program in programs}
    if len(lines) != 1:
        sys.exit(f"the programs differ: {lines}")
    print(f"{len(programs)} programs: {lines.pop().strip()}")

    # docs/library.md: each block of code is a whole program. It runs in a folder with city.glb,
    # flight.json and, after the first program, city.scree.
    work = folder / "docs"
    work.mkdir()
    shutil.copy(model, work / "city.glb")
    keys = [{"t": 0, "eye": [3, 2, 4], "target": [0, 0, 0]}, {"t": 1, "eye": [4, 2, -3], "target": [0, 0, 0]}]
    (work / "flight.json").write_text(json.dumps({"format": "scree camera path", "version": 1, "keys": keys}))
    text = (source / "docs/library.md").read_text()
    python = build / "python"
    counts = {}
    for number, (language, code) in enumerate(re.findall(r"^```(c|cpp|python)\n(.*?)^```", text, re.S | re.M)):
        counts[language] = counts.get(language, 0) + 1
        path = folder / f"example{number}.{ {'c': 'c', 'cpp': 'cpp', 'python': 'py'}[language] }"
        path.write_text(code)
        if language == "python":
            if not (python / "scree").exists() or not list((python / "scree").glob("_scree*.so")):
                print("the Python examples are left out: the package was not built")
                continue
            interpreter = sys.argv[4] if len(sys.argv) > 4 else sys.executable
            run(interpreter, path, cwd=work, env={**environment, "PYTHONPATH": str(python)})
            continue
        compiler = ["cc", "-std=c99"] if language == "c" else ["c++", "-std=c++17"]
        program = folder / f"example{number}"
        run(*compiler, "-Wall", "-Wextra", "-Werror", path, *flags(environment, "--cflags", "--libs"), "-o", program)
        run(program, cwd=work, env=environment)
    if set(counts) != {"c", "cpp", "python"}:
        sys.exit(f"docs/library.md has examples in {sorted(counts)} alone")
    print(f"examples of docs/library.md: {counts}")
