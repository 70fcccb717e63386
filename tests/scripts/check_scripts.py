#!/usr/bin/env python3
"""Runs parts of scripts/ and cmake/ with stand-ins for the programs that they call: check_scripts.py CMAKE SOURCE"""
import os
import re
import shutil
import subprocess
import sys
import tempfile

cmake, source = (os.path.abspath(word) for word in sys.argv[1:3])
failures = []
checks = 0


def check(holds, message):
    global checks
    checks += 1
    if not holds:
        failures.append(message)


def write(path, text):
    """Writes a file that can be run."""
    os.makedirs(os.path.dirname(path), exist_ok=True)
    with open(path, "w", encoding="utf-8") as file:
        file.write(text)
    os.chmod(path, 0o755)


def run(*words, **variables):
    """Runs a command with these variables besides the environment's. Returns its exit code and its output."""
    done = subprocess.run(words, env={**os.environ, **variables}, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                          text=True)
    return done.returncode, done.stdout


def copy(folder, script):
    """Copies a script to a folder where scripts/setup installs nothing. Returns the copy, and PATH after folder/bin."""
    write(f"{folder}/scripts/setup", "#!/bin/sh\n")
    shutil.copy(f"{source}/scripts/{script}", f"{folder}/scripts/{script}")
    return f"{folder}/scripts/{script}", f"{folder}/bin:{os.environ['PATH']}"


def check_nvcc(folder):
    """cmake/cuda.cmake finds nvcc outside PATH, also in a build folder that was configured without it."""
    write(f"{folder}/find.cmake", f"""cmake_minimum_required(VERSION 3.24)
include("{source}/cmake/cuda.cmake")
set(CMAKE_CUDA_COMPILER NOTFOUND CACHE FILEPATH "")
scree_find_nvcc("{folder}/none" "{folder}/toolkit")
message("CUDACXX=$ENV{{CUDACXX}} compiler=${{CMAKE_CUDA_COMPILER}}.")
""")
    os.mkdir(f"{folder}/path")
    for place, found in ((None, ""), ("toolkit", "toolkit/nvcc"), ("path", "path/nvcc")):
        if place:
            write(f"{folder}/{place}/nvcc", "#!/bin/sh\n")
        output = run(cmake, "-P", f"{folder}/find.cmake", PATH=f"{folder}/path", CUDACXX="", CUDA_PATH="")[1]
        expected = f"CUDACXX={found and f'{folder}/{found}'} compiler=.\n"
        check(output == expected, f"cuda.cmake with nvcc in {place}: expected {expected!r}, found {output!r}")


def check_package(folder):
    """scripts/package tells whether the packages have CUDA, and asks for the licences of bundled libraries."""
    package, path = copy(folder, "package")
    write(f"{folder}/bin/cmake", """#!/bin/sh
if [ "$1" = --build ]; then exit 0; fi
echo "CMAKE_CUDA_COMPILER:FILEPATH=$NVCC" >build/package/CMakeCache.txt
printf '%s\\n' "$@" | sed -n 's/^-D\\(SCREE_BUNDLE_LIBRARIES\\)=/\\1:BOOL=/p' >>build/package/CMakeCache.txt
mkdir -p build/package/python/scree
touch build/package/python/scree/_scree.so
""")
    write(f"{folder}/bin/dpkg-architecture", "#!/bin/sh\n")
    write(f"{folder}/cmake/copyright.py", '#!/bin/sh\necho "copyright.py $*"\n')
    shutil.copytree(f"{source}/cmake/debian", f"{folder}/cmake/debian")
    write(f"{folder}/cmake/debian/rules", "#!/bin/sh\nexit 1\n")
    for nvcc, cuda, told in (("/opt/cuda/bin/nvcc", "ON", "with CUDA, for 75-real;80-real"),
                             ("NOTFOUND", "ON", "without CUDA, because no working nvcc was found\n"),
                             ("NOTFOUND", "OFF", "without CUDA (SCREE_CUDA=OFF)\n")):
        output = run(package, "any", PATH=path, SOURCE_DATE_EPOCH="0", SCREE_CUDA_ARCHITECTURES="", NVCC=nvcc,
                     SCREE_CUDA=cuda)[1]
        check(f"package: any: {told}" in output, f"scripts/package any: expected {told!r}, found {output!r}")
    for kind, bundled in (("any", True), ("deb", False)):
        output = run(package, kind, PATH=path, SOURCE_DATE_EPOCH="0", NVCC="NOTFOUND")[1]
        asked = re.findall(r"^copyright.py .* --package scree\b(?!-)(.*)", output, re.MULTILINE)
        check(len(asked) == 1 and ("--bundled" in asked[0]) == bundled,
              f"scripts/package {kind}: wrong options of copyright.py: {output}")


def check_copyright(folder):
    """cmake/copyright.py includes the libraries beside the program, for the tarball and with --bundled."""
    for options in (["--third-party"], ["--package", "scree", "--bundled", "--debian"]):
        status, output = run(sys.executable, f"{source}/cmake/copyright.py", *options, f"{folder}/out")
        if status != 0 and "is installed" in output:
            print(f"check_scripts.py: skipped: {output.strip()}")
            continue
        check(status == 0, f"copyright.py {options}: {output}")
        with open(f"{folder}/out", encoding="utf-8") as file:
            text = file.read()
        for library in ("meshoptimizer", "openexr", "imath"):
            check(f"\nFiles: {library}/" in text, f"copyright.py {options}: no licence of {library}")


def check_demo(folder):
    """scripts/demo takes an error that nvidia-smi prints on standard output for no GPU."""
    if os.path.exists("/dev/nvidiactl") or os.path.exists("/proc/driver/nvidia"):
        print("check_scripts.py: skipped: scripts/demo, because this machine has a GPU")
        return
    demo, path = copy(folder, "demo")
    write(f"{folder}/scene.gltf", "{}")
    write(f"{folder}/bin/nvcc", "#!/bin/sh\n")
    write(f"{folder}/bin/cmake", '#!/bin/sh\necho "$2" >>presets\nexit 9\n')
    for printed, preset in (("NVIDIA-SMI has failed because version 5.1 is no driver.\\n", "cpu-release"),
                            ("9.0\\n8.6\\n", "cuda-release")):
        write(f"{folder}/bin/nvidia-smi", f"#!/bin/sh\nprintf '{printed}'\n")
        write(f"{folder}/presets", "")
        output = run(demo, f"{folder}/scene.gltf", PATH=path)[1]
        with open(f"{folder}/presets", encoding="utf-8") as file:
            found = file.read()
        check(found == f"{preset}\n", f"scripts/demo: expected {preset}, found {found!r}: {output}")


def check_fuzz(folder):
    """scripts/fuzz refuses unknown targets and numbers below 1, with and without PROGRAMS."""
    fuzz = f"{source}/scripts/fuzz"
    write(f"{folder}/bin/cmake", "#!/bin/sh\nexit 9\n")
    write(f"{folder}/programs/fuzz_gltf", "#!/bin/sh\necho 'stat::number_of_executed_units: 5'\n")
    path = f"{folder}/bin:{os.environ['PATH']}"
    settings = {"PATH": path, "OUT": f"{folder}/out", "SECONDS_EACH": "1"}
    for programs in ("", f"{folder}/programs"):
        settings["PROGRAMS"] = programs
        for variables, targets, start in (({}, ["gltf", "nosuch"], "fuzz: nosuch: expected one of "),
                                          ({"JOBS": "0"}, ["gltf"], "fuzz: JOBS=0: expected a number from 1 on"),
                                          ({"WORKERS": "x"}, [], "fuzz: WORKERS=x: expected a number from 1 on")):
            status, output = run(fuzz, *targets, **{**settings, **variables})
            check(status == 1 and output.startswith(start) and output.count("\n") == 1,
                  f"scripts/fuzz {targets} with {variables}: exit code {status}: {output}")
    for targets in ([], ["gltf"]):
        status, output = run(fuzz, *targets, **settings)
        check((status, output) == (0, "fuzz: gltf.1: 5 inputs, nothing found\n"), f"scripts/fuzz {targets}: {output}")
    status, output = run(fuzz, "gltf", **{**settings, "PROGRAMS": ""})
    check(status == 9, f"scripts/fuzz gltf: expected the exit code of cmake, found {status}: {output}")


for function in (check_nvcc, check_package, check_copyright, check_demo, check_fuzz):
    with tempfile.TemporaryDirectory(dir=os.getcwd()) as temporary:  # TMPDIR may be mounted with noexec
        function(os.path.realpath(temporary))
for failure in failures:
    print(f"check_scripts.py: {failure}", file=sys.stderr)
print(f"{checks} checks, {len(failures)} failures")
sys.exit(1 if failures else 0)
