#!/usr/bin/env python3
"""Compares the pictures of ranks on CPUs that share the geometry of a film with those of one process, byte for byte.

    lab/ranks.py PROGRAM [--ranks 1,2,3,5] [--cameras 200] [--size 320x200] [--scenes A:0.05,B:0.3,C:0.01,D:1]

Every scene of `scree synth` is made at its scale and packed into a temporary folder. The cameras stand and look anywhere in
the scene's box and around it. Picture, visibility buffer and depths of each camera are compared. A line per scene and number
of ranks gives the pages, the compared files and those that differ, and the processor time. The exit code is 1 if files differ
or no camera of a scene shows anything.
"""
import argparse
import json
import os
import random
import resource
import subprocess
import sys
import tempfile

OUTPUTS = {"-o": "png", "--depth": "pfm", "--visbuffer": "bin"}


def cameras(box, count):
    """Keys of a path whose eyes and targets lie in the box; every second eye is above or beside it."""
    generator = random.Random(28)
    low, high = box["min"], box["max"]
    middle = [(a + b) / 2 for a, b in zip(low, high)]
    side = max(b - a for a, b in zip(low, high))
    point = lambda: [generator.uniform(a, b) for a, b in zip(low, high)]
    keys = []
    for i in range(count):
        eye = point()
        if i % 2 == 1:
            eye = [m + 1.3 * (e - m) for m, e in zip(middle, eye)]
            eye[1] += generator.uniform(0, 0.4) * side
        keys.append({"eye": eye, "target": point(), "fov": generator.uniform(30, 90)})
    return keys


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("--ranks", default="1,2,3,5")
    parser.add_argument("--cameras", type=int, default=200)
    parser.add_argument("--size", default="320x200")
    parser.add_argument("--scenes", default="A:0.05,B:0.3,C:0.01,D:1")
    asked = parser.parse_args()
    program = os.path.realpath(asked.program)
    environment = dict(os.environ, OMPI_ALLOW_RUN_AS_ROOT="1", OMPI_ALLOW_RUN_AS_ROOT_CONFIRM="1",
                       OMPI_MCA_rmaps_base_oversubscribe="1", OMPI_MCA_hwloc_base_binding_policy="none",
                       OMPI_MCA_mpi_yield_when_idle="1")
    is_good = True
    with tempfile.TemporaryDirectory() as folder:

        def run(*words):
            return subprocess.run(words, cwd=folder, env=environment, check=True, stdout=subprocess.PIPE).stdout

        def contents(name, frame, extension):
            path = os.path.join(folder, f"{name}_{frame}.{extension}")
            with open(path, "rb") as file:
                return file.read()

        for scene, scale in (words.split(":") for words in asked.scenes.split(",")):
            run(program, "synth", scene, "--scale", scale, "-o", "scene.gltf", "-f", "-q")
            run(program, "convert", "scene.gltf", "-o", "scene.scree", "-f", "-q")
            of_scene = json.loads(run(program, "inspect", "scene.scree", "--json"))
            pages = next(table["records"] for table in of_scene["container"]["tables"] if table["name"] == "pages")
            with open(os.path.join(folder, "path.json"), "w") as file:
                keys = cameras(of_scene["scene"]["scenes"][0], asked.cameras)
                json.dump({"format": "scree camera path", "version": 1, "keys": keys}, file)
            film = ["render", "scene.scree", "--path", "path.json", "--size", asked.size, "--backend", "cpu",
                    "--threads", "1", "-f", "-q"]
            run(program, *film, *(word for way, end in OUTPUTS.items() for word in (way, f"one_%d.{end}")))
            seen = sum(set(contents("one", frame, "bin")) != {255} for frame in range(asked.cameras))
            for ranks in asked.ranks.split(","):
                before = resource.getrusage(resource.RUSAGE_CHILDREN)
                run("mpirun", "-n", ranks, program, *film, "--share", "geometry",
                    *(word for way, end in OUTPUTS.items() for word in (way, f"all_%d.{end}")))
                after = resource.getrusage(resource.RUSAGE_CHILDREN)
                different = [(frame, end) for frame in range(asked.cameras) for end in OUTPUTS.values()
                             if contents("all", frame, end) != contents("one", frame, end)]
                is_good = is_good and seen > 0 and not different
                print(f"{scene} at {scale}, {pages} pages, {ranks} ranks: {asked.cameras} cameras, {seen} of which show something; "
                      f"{asked.cameras * len(OUTPUTS)} files, {len(different)} differ {different[:3] or ''}; "
                      f"{after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime:.1f} s of processor time",
                      flush=True)
    sys.exit(0 if is_good else 1)


main()
