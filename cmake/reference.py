#!/usr/bin/env python3
"""Makes man pages, shell completion and docs/options.md from the program's own --help.

reference.py PROGRAM --install FOLDER    man1/*.1.gz, bash/scree, zsh/_scree and fish/scree.fish in FOLDER
reference.py PROGRAM --markdown FILE     docs/options.md
reference.py PROGRAM --check FILE        exit code 1 if FILE differs from the output of --markdown

The output depends on the help texts only: it has no date, and options are in the order of --help.
"""
import argparse
import dataclasses
import difflib
import gzip
import os
import re
import subprocess
import sys

EXITS = [("0", "Done."), ("1", "A wrong command line."),
         ("2", "A file that cannot be read or written, or too little memory."), ("3", "Bad data."),
         ("4", "A missing or failing GPU.")]
ERRORS = "An error is one line on standard error that names the file and the place."
FILES = ("FILE", "FILES", "TEXT")  # values that are file names; TEXT is the value of positionals


@dataclasses.dataclass
class Entry:
    """One line of "Options:" or "Positionals:"."""
    names: list  # -o, --output; or the positional's name
    value: str  # "" for a flag
    text: str
    default: str = ""
    choices: list = dataclasses.field(default_factory=list)
    required: bool = False
    repeated: bool = False
    needs: list = dataclasses.field(default_factory=list)
    excludes: list = dataclasses.field(default_factory=list)

    def takes_files(self):
        return self.value in FILES and not self.choices


@dataclasses.dataclass
class Page:
    """The help of the program or of one subcommand."""
    name: str
    text: str
    positionals: list
    options: list
    commands: list  # (name, text)


def fail(message):
    print(f"reference.py: {message}", file=sys.stderr)
    sys.exit(1)


def help_of(program, *words):
    done = subprocess.run([program, *words, "--help"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    if done.returncode != 0:
        fail(f"{' '.join([program, *words])} --help ended with exit code {done.returncode}: {done.stderr.strip()}")
    return done.stdout


def rows_of(lines):
    """(head, text) for each entry. CLI11 writes the text from column 30 on; a longer head has a line of its own."""
    rows = []
    for line in lines:
        if line.startswith(" " * 30):
            if not rows:
                fail(f"help has a text without an option: {line.strip()}")
            rows[-1][1].append(line.strip())
        elif re.match(r"  \S", line):
            gap = re.search(r"\S(\s{2,})\S", line)
            if gap and gap.end(1) == 30:
                rows.append((line[:30].strip(), [line[30:].strip()]))
            elif len(line) > 30 and line[29] == " " and not re.search(r"(Needs|Excludes):", line):
                rows.append((line[:29].strip(), [line[30:].strip()]))
            else:
                rows.append((line.strip(), []))
        elif line.strip():
            fail(f"help has a line that is no option: {line}")
    return [(head, " ".join(text)) for head, text in rows]


def entry_of(head, text):
    """Reads "-o,--output TEXT REQUIRED Excludes: --a --b", or "files FILE ..." of a positional."""
    head, _, excludes = head.partition(" Excludes:")
    head, _, needs = head.partition(" Needs:")
    words = re.match(r"(-\w(?:,\s*--[\w-]+)*|--[\w-]+|\w+)(.*)$", head)
    if not words:
        fail(f"help has an option that cannot be read: {head}")
    names = [name.strip() for name in words[1].split(",")]
    value = words[2].strip()
    required = "REQUIRED" in value.split()
    repeated = "..." in value.split()
    value = " ".join(word for word in value.split() if word not in ("REQUIRED", "..."))
    # The default: TEXT=5 in CLI11 2.1, TEXT [5] in 2.4.
    default = ""
    found = re.match(r"(.*?)(?:=(\S+)|\s+\[([^\]-]*)\])$", value)
    if found:
        value, default = found[1], found[2] or found[3]
    choices = []
    found = re.match(r"(\w+):\{(.*)\}$", value)
    if found:
        value, choices = found[1], found[2].split(",")
    found = re.match(r"\w+:(\w+) in \[(\S+) - (\S+)\]$", value)
    if found:
        value = "N"
        text += f"; {found[2]} to {found[3]}"
    return Entry(names, value, text, default, choices, required, repeated, needs.split(), excludes.split())


def parse_help(name, text):
    body, sections, section = [], {}, None
    for line in text.splitlines():
        heading = re.match(r"(positionals|options|subcommands):$", line.strip(), re.IGNORECASE)
        if heading and not line.startswith(" "):
            section = heading[1].lower()
            sections[section] = []
        elif section:
            sections[section].append(line)
        elif line.strip() and not line.startswith("Usage:"):
            body.append(line.strip())
    options = [entry_of(*row) for row in rows_of(sections.get("options", []))]
    if not options:
        fail(f"{name} --help names no options")
    # CLI11 sorts the options that an option excludes by address, so their order changes from run to run.
    order = {option.names[-1]: index for index, option in enumerate(options)}
    for option in options:
        option.excludes.sort(key=lambda other: order.get(other, len(order)))
        option.needs.sort(key=lambda other: order.get(other, len(order)))
    return Page(name, " ".join(body), [entry_of(*row) for row in rows_of(sections.get("positionals", []))], options,
                rows_of(sections.get("subcommands", [])))


def synopsis(page):
    words = [page.name, "[OPTIONS]"] + (["SUBCOMMAND"] if page.commands else [])
    for entry in page.positionals:
        word = entry.names[0] + ("..." if entry.repeated else "")
        words.append(word if entry.required else f"[{word}]")
    return " ".join(words)


def first_clause(text):
    return re.split(r"[:;,.] |\.$", text)[0]


def notes(entry):
    """The sentences behind an option's text: choices, default, required, needs and excludes."""
    out = []
    if entry.choices:
        out.append("One of " + ", ".join(entry.choices) + ".")
    if entry.default:
        out.append(f"Default: {entry.default}.")
    if entry.required:
        out.append("Required.")
    if entry.needs:
        out.append("Only with " + ", ".join(entry.needs) + ".")
    if entry.excludes:
        out.append("Not with " + ", ".join(entry.excludes) + ".")
    return out


def whole_text(entry):
    text = entry.text
    if text and text[-1] not in ".!":
        text += "."
    return " ".join([text, *notes(entry)]).strip()


# Man pages


def roff(text):
    text = text.replace("\\", "\\e").replace("-", "\\-").replace("'", "\\(aq").replace("`", "\\(ga").replace("^", "\\(ha")
    text = text.replace("~", "\\(ti")
    return "\\&" + text if text.startswith(".") else text


def roff_entry(entry, positional=False):
    value = f" \\fI{roff(entry.value)}\\fR" if entry.value and not positional else ""
    head = ", ".join(f"\\fB{roff(name)}\\fR" for name in entry.names) + value
    return [".TP", head, roff(whole_text(entry))]


def man_page(page, pages, version):
    name = page.name.replace(" ", "-")
    lines = [f'.TH {roff(name.upper())} 1 "" "{roff(version)}" "User Commands"', ".SH NAME",
             f"{roff(name)} \\- {roff(first_clause(page.text))}", ".SH SYNOPSIS", f".B {roff(synopsis(page))}", ".SH DESCRIPTION",
             roff(page.text)]
    if page.commands:
        lines.append(".SH SUBCOMMANDS")
        for command, text in page.commands:
            lines += [".TP", f"\\fB{roff(command)}\\fR", roff(text)]
    if page.positionals:
        lines.append(".SH ARGUMENTS")
        for entry in page.positionals:
            lines += roff_entry(entry, positional=True)
    lines.append(".SH OPTIONS")
    for entry in page.options:
        lines += roff_entry(entry)
    lines.append(".SH EXIT STATUS")
    for code, meaning in EXITS:
        lines += [".TP", code, meaning]
    lines += [".PP", ERRORS, ".SH SEE ALSO"]
    others = sorted({other.name.replace(" ", "-") for other in pages})
    lines.append(", ".join(f"\\fB{roff(other)}\\fR(1)" for other in others if other != name))
    return "\n".join(lines) + "\n"


# Shells

# A line per name, so that names with spaces stay whole and names like a[b].scree are no patterns.
BASH_FILES = 'mapfile -t COMPREPLY < <(compgen -f -- "$word")'


def quoted(text):
    return "'" + text.replace("'", "'\\''") + "'"


def bash_file(pages):
    top, commands = pages[0], pages[1:]
    lines = ["# Bash completion of scree, made from its --help.", "_scree() {",
             "  local word=${COMP_WORDS[COMP_CWORD]} previous=${COMP_WORDS[COMP_CWORD-1]} command=${COMP_WORDS[1]} words= values=",
             "  COMPREPLY=()", "  if [ \"$COMP_CWORD\" -eq 1 ]; then command=; fi", "  case $command in"]
    for page in [*commands, top]:
        names = [name for entry in page.options for name in entry.names]
        pattern = page.name.split()[1] if page is not top else "*"
        words = names + ([command for command, _ in page.commands] if page is top else [])
        lines += [f"    {pattern})", f"      words={quoted(' '.join(words))}"]
        cases = []
        for entry in page.options:
            if entry.choices:
                cases.append(f"        {'|'.join(entry.names)}) values={quoted(' '.join(entry.choices))} ;;")
        plain = [name for entry in page.options if entry.value and not entry.choices and not entry.takes_files() for name in
                 entry.names]
        files = [name for entry in page.options if entry.takes_files() for name in entry.names]
        if plain:
            cases.append(f"        {'|'.join(plain)}) return ;;")
        if files:
            cases.append(f"        {'|'.join(files)}) {BASH_FILES}; return ;;")
        if cases:
            lines += ["      case $previous in", *cases, "      esac"]
        lines.append("      ;;")
    lines += ["  esac", "  if [ -n \"$values\" ]; then", "    COMPREPLY=($(compgen -W \"$values\" -- \"$word\"))",
              "  elif [ -z \"$command\" ] || [[ $word == -* ]]; then", "    COMPREPLY=($(compgen -W \"$words\" -- \"$word\"))",
              "  else", f"    {BASH_FILES}", "  fi", "}", "complete -o filenames -F _scree scree"]
    return "\n".join(lines) + "\n"


def zsh_text(text):
    return re.sub(r"([\\\[\]:'])", lambda found: "'\\''" if found[1] == "'" else "\\" + found[1], first_clause(text))


def zsh_spec(entry):
    repeat = "" if len(entry.names) > 1 else "*" if entry.repeated else ""
    if entry.choices:
        value = f":{entry.value}:({' '.join(entry.choices)})"
    elif entry.takes_files():
        value = f":{entry.value}:_files"
    else:
        value = f":{entry.value}: " if entry.value else ""
    text = zsh_text(entry.text)
    if len(entry.names) == 1:
        return f"'{repeat}{entry.names[0]}[{text}]{value}'"
    return f"'({' '.join(entry.names)})'{{{','.join(entry.names)}}}'[{text}]{value}'"


def zsh_file(pages):
    top = pages[0]
    lines = ["#compdef scree", "# Zsh completion of scree, made from its --help.", "_scree() {", "  local curcontext=$curcontext state line",
             "  local -a subcommands", "  subcommands=("]
    lines += [f"    '{command}:{zsh_text(text)}'" for command, text in top.commands]
    lines += ["  )", "  _arguments -C \\"]
    lines += [f"    {zsh_spec(entry)} \\" for entry in top.options]
    lines += ["    '1: :->subcommand' '*:: :->rest'", "  case $state in", "    subcommand) _describe 'subcommand' subcommands ;;",
              "    rest)", "      case $line[1] in"]
    for page in pages[1:]:
        lines += [f"        {page.name.split()[1]})", "          _arguments \\"]
        lines += [f"            {zsh_spec(entry)} \\" for entry in page.options]
        lines += ["            '*:file:_files' ;;"]
    lines += ["      esac ;;", "  esac", "}", "_scree \"$@\""]
    return "\n".join(lines) + "\n"


def fish_file(pages):
    top = pages[0]
    lines = ["# Fish completion of scree, made from its --help."]
    for command, text in top.commands:
        lines.append(f"complete -c scree -f -n __fish_use_subcommand -a {command} -d {fish_quoted(first_clause(text))}")
    for page in pages:
        condition = "__fish_use_subcommand" if page is top else f"'__fish_seen_subcommand_from {page.name.split()[1]}'"
        for entry in page.options:
            words = ["complete -c scree -n", condition]
            words += [f"-s {name[1:]}" if not name.startswith("--") else f"-l {name[2:]}" for name in entry.names]
            if entry.value:
                words.append("-r" if entry.takes_files() else "-x")
            if entry.choices:
                words.append(f"-a {fish_quoted(' '.join(entry.choices))}")
            words.append(f"-d {fish_quoted(first_clause(entry.text))}")
            lines.append(" ".join(words))
    return "\n".join(lines) + "\n"


def fish_quoted(text):
    return "'" + text.replace("\\", "\\\\").replace("'", "\\'") + "'"


# Markdown


def markdown_text(text):
    """Escapes Markdown's special characters, which occur in formulas, patterns and names."""
    return re.sub(r"([\\`*_<>|#\[\]])", r"\\\1", text)


def markdown_entry(entry, positional=False):
    heads = [f"`{name}`" for name in entry.names[:-1]]
    value = f" {entry.value}" if entry.value and not positional else ""
    heads.append(f"`{entry.names[-1]}{value}`")
    return f"- {', '.join(heads)}: {markdown_text(whole_text(entry))}"


def markdown(pages):
    lines = ["# Options", "", "Every option of every subcommand, made from `scree --help` by cmake/reference.py. After a change of an option:", "",
             "    cmake/reference.py build/cuda-release/tools/scree --markdown docs/options.md", "",
             "Exit codes: " + " ".join(f"{code}: {meaning}" for code, meaning in EXITS) + " " + ERRORS]
    for page in pages:
        lines += ["", f"## {page.name}", "", f"    {synopsis(page)}", "", markdown_text(page.text), ""]
        lines += [f"- [`{command}`](#scree-{command}): {markdown_text(first_clause(text))}" for command, text in page.commands]
        lines += [markdown_entry(entry, positional=True) for entry in page.positionals]
        lines += [markdown_entry(entry) for entry in page.options]
    return "\n".join(lines) + "\n"


def write(path, text, packed=False):
    os.makedirs(os.path.dirname(os.path.abspath(path)), exist_ok=True)
    data = text.encode()
    with open(path, "wb") as file:
        if packed:
            with gzip.GzipFile(filename="", mode="wb", compresslevel=9, fileobj=file, mtime=0) as out:
                out.write(data)
        else:
            file.write(data)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("--install", metavar="FOLDER")
    parser.add_argument("--markdown", metavar="FILE")
    parser.add_argument("--check", metavar="FILE")
    asked = parser.parse_args()
    program = os.path.abspath(asked.program)
    pages = [parse_help("scree", help_of(program))]
    pages += [parse_help(f"scree {name}", help_of(program, name)) for name, _ in pages[0].commands]
    versions = subprocess.run([program, "--version"], stdout=subprocess.PIPE, text=True, check=True).stdout
    version = versions.splitlines()[0]  # the program's; the next lines name its compiler and libraries
    if asked.install:
        man = os.path.join(asked.install, "man1")
        for page in pages:
            write(os.path.join(man, page.name.replace(" ", "-") + ".1.gz"), man_page(page, pages, version), packed=True)
        write(os.path.join(asked.install, "bash", "scree"), bash_file(pages))
        write(os.path.join(asked.install, "zsh", "_scree"), zsh_file(pages))
        write(os.path.join(asked.install, "fish", "scree.fish"), fish_file(pages))
    if asked.markdown:
        write(asked.markdown, markdown(pages))
    if asked.check:
        with open(asked.check, encoding="utf-8") as file:
            found = file.read().splitlines()
        differences = list(difflib.unified_diff(found, markdown(pages).splitlines(), asked.check, "scree --help", lineterm="", n=0))
        if differences:
            print("\n".join(differences))
            fail(f"{asked.check} is older than --help: write it again with --markdown")


main()
