#!/usr/bin/env python3
"""Compares the output of cmake/reference.py with --help, parsed here in a simpler way: check_reference.py PROGRAM MADE SOURCE

Every subcommand and option of --help must be in the man pages, in the completion of bash, zsh and fish, and in
docs/options.md. Bash must complete each of them, and choices. A second run must make the same bytes.
"""
import gzip
import os
import re
import shutil
import subprocess
import sys
import tempfile

program, made, source = (os.path.abspath(word) for word in sys.argv[1:4])
failures = []


def check(holds, message):
    if not holds:
        failures.append(message)


def read(*path):
    with open(os.path.join(made, *path), "rb") as file:
        return file.read()


def run(*words, text=None, folder=None):
    return subprocess.run(words, input=text, cwd=folder, stdout=subprocess.PIPE, text=True, check=True).stdout


def names_in(text):
    """The options -x and --long at the beginning of help lines."""
    return [name for head in re.findall(r"^  (-[^ ]+(?:, --[\w-]+)?)", text, re.MULTILINE) for name in re.split(r",\s*", head)]


def complete(*words, folder=None):
    """Bash's completions of the last of these words, in the folder."""
    script = ('source "$0"; COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); _scree; printf "%s\\n" "${COMPREPLY[@]}"')
    return run("bash", "-c", script, os.path.join(made, "bash", "scree"), *words, folder=folder).splitlines()


top = run(program, "--help")
commands = re.findall(r"^  (\w+) ", top[top.lower().index("subcommands:"):], re.MULTILINE)
check(len(commands) >= 7, f"--help names only {commands}")
zsh = read("zsh", "_scree").decode()
fish = read("fish", "scree.fish").decode()
with open(os.path.join(source, "docs", "options.md"), encoding="utf-8") as page:
    markdown = page.read()

check(set(commands) <= set(complete("scree", "")), "bash does not complete every subcommand")
options = 0
for command in [None, *commands]:
    words = [command] if command else []
    title = " ".join(["scree", *words])
    names = names_in(run(program, *words, "--help"))
    options += len(names)
    check(len(names) >= 2, f"{title} --help names only {names}")
    man = gzip.decompress(read("man1", title.replace(" ", "-") + ".1.gz")).decode()
    check(f"## {title}\n" in markdown, f"docs/options.md has no section {title}")
    section = markdown.partition(f"\n## {title}\n")[2].partition("\n## ")[0]
    if command:
        start = zsh.find(f"\n        {command})\n")
        zsh_part = zsh[start:zsh.find(";;", start)] if start >= 0 else ""
        fish_part = "\n".join(line for line in fish.splitlines() if f"from {command}'" in line)
        check(re.search(rf"'{command}:.+'", zsh) is not None, f"zsh: no subcommand {command}")
        check(f" -a {command} " in fish, f"fish: no subcommand {command}")
        check(re.search(rf"^\\fB{command}\\fR$", gzip.decompress(read("man1", "scree.1.gz")).decode(), re.MULTILINE) is not None,
              f"scree.1 has no {command}")
    else:
        zsh_part = zsh[:zsh.index("case $state")]
        fish_part = "\n".join(line for line in fish.splitlines() if "-n __fish_use_subcommand" in line)
    offered = complete("scree", *words, "-")
    for name in names:
        check("\\fB" + name.replace("-", "\\-") + "\\fR" in man, f"the man page of {title} has no {name}")
        check(re.search(rf"`{name}[` ]", section) is not None, f"docs/options.md has no {title} {name}")
        check(re.search(rf"(?<![\w-]){name}(?![\w-])", zsh_part) is not None, f"zsh: no {title} {name}")
        flag = f" -l {name[2:]} " if name.startswith("--") else f" -s {name[1:]} "
        check(flag in fish_part, f"fish: no {title} {name}")
        check(name in offered, f"bash does not complete {title} {name}")
    lines = man.splitlines()
    check(lines[0].startswith(".TH ") and lines[0].endswith('" "User Commands"') and lines[1] == ".SH NAME",
          f"the man page of {title} begins with {lines[:2]}")
    if shutil.which("groff"):
        printed = [line for line in run("groff", "-man", "-Tascii", "-P-cbou", text=man).splitlines() if line]
        check("User Commands" in printed[0] and printed[1] == "NAME", f"the man page of {title} is printed as {printed[:2]}")
check(options > 90, f"only {options} options were found in --help")
check(complete("scree", "synth", "--order", "b") == ["block"], "bash does not complete the choices of synth --order")

with tempfile.TemporaryDirectory() as folder:
    for name in ("my city.scree", "a[b].scree", "ab.scree"):
        open(os.path.join(folder, name), "wb").close()
    for words in (["render"], ["render", "x.scree", "--environment"]):
        for start, name in (("my", "my city.scree"), ("a[", "a[b].scree"), ("*", "")):
            offered = complete("scree", *words, start, folder=folder)
            check(offered == [name], f"bash completes {words} {start} by {offered}, not by {name}")

with tempfile.TemporaryDirectory() as again:
    run(sys.executable, os.path.join(source, "cmake", "reference.py"), program, "--install", again)
    for folder, _, files in os.walk(again):
        for name in files:
            path = os.path.join(folder, name)
            with open(path, "rb") as file:
                check(file.read() == read(os.path.relpath(path, again)), f"a second run makes another {name}")
up_to_date = subprocess.run([sys.executable, os.path.join(source, "cmake", "reference.py"), program, "--check",
                             os.path.join(source, "docs", "options.md")], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
check(up_to_date.returncode == 0, up_to_date.stdout)

for failure in failures:
    print(f"check_reference.py: {failure}", file=sys.stderr)
print(f"{len(commands)} subcommands, {options} names of options, {len(failures)} failures")
sys.exit(1 if failures else 0)
