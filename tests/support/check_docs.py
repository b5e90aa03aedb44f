#!/usr/bin/env python3
"""Checks that README.md and CONTRIBUTING.md tell the truth.

usage: check_docs.py ROOT DEFORM DEFORMD      (the root of the repository and the two built programs)
prints FILE:LINE: what is wrong; exit code 1 when anything is

- A code block under a line `<!-- from PATH -->` stands in that file, word for word (the whole block, indentation aside).
- Every option of `deform COMMAND` and `deformd` that the text names is in the program's --help, and so is every default value that
  the table of server options gives.
- Every path and every link to a file leads somewhere; NAME in a path stands for any.
"""
import pathlib
import re
import subprocess
import sys
import textwrap

DOCUMENTS = ["README.md", "CONTRIBUTING.md"]
FROM = re.compile(r"^<!-- from (\S+) -->$")
COMMAND = re.compile(r"(?<![\w/.-])(deformd?)(?=[ `])([^`|#;&\n]*)")
DEFAULT_ROW = re.compile(r"^\| `(--[a-z-]+)(?: [A-Z:]+)?` \| `([^`]*)`")
LINK = re.compile(r"\]\((?!https?:)([^)#]+)")
PATH = re.compile(r"`((?:core|server|client|proto|deploy|tests|\.ci)/[\w./-]*)`")


def read_blocks(lines):
    """(line number of the opening fence, source named above it or None, text) of every fenced block."""
    blocks, opened = [], None
    for number, line in enumerate(lines, 1):
        if not line.lstrip().startswith("```"):
            continue
        if opened is None:
            opened = number
            continue
        above = FROM.match(lines[opened - 2]) if opened >= 2 else None
        blocks.append((opened, above[1] if above else None, "\n".join(lines[opened:number - 1])))
        opened = None
    return blocks


def strip(text):
    return "\n".join(line.rstrip() for line in textwrap.dedent(text).strip("\n").splitlines())


def stands_in(block, source):
    """Whether the lines of `block` stand in `source` in a row, indented alike by any amount."""
    wanted, lines = strip(block).splitlines(), source.splitlines()
    return any(strip("\n".join(lines[i:i + len(wanted)])) == "\n".join(wanted) for i in range(len(lines) - len(wanted) + 1))


class Programs:
    """What --help of the two programs says, asked once each."""

    def __init__(self, deform, deformd):
        self.paths = {"deform": deform, "deformd": deformd}
        self.texts = {}

    def help(self, *words):
        if words not in self.texts:
            run = subprocess.run([self.paths[words[0]], *words[1:], "--help"], capture_output=True, text=True, check=False)
            self.texts[words] = run.stdout if run.returncode == 0 else None
        return self.texts[words]

    def complaints(self, program, rest):
        words = rest.split()
        asked = [program]
        if program == "deform":
            skip = False
            for word in words:
                if skip or word.startswith("-"):
                    skip = word in ("--server", "--timeout")
                elif re.fullmatch(r"[a-z]+", word):
                    asked.append(word)
                    break
                else:
                    break
        text = self.help(*asked)
        if text is None:
            yield f"`{' '.join(asked)} --help` fails"
            return
        text += self.help(program)
        for option in re.findall(r"(?<!\S)(--[a-z][a-z-]*)", rest):
            if not re.search(re.escape(option) + r"(?![\w-])", text):
                yield f"{option} is not in `{' '.join(asked)} --help`"


def check_blocks(root, lines):
    for number, source, block in read_blocks(lines):
        if source is None:
            continue
        if not (root / source).is_file():
            yield number, f"there is no {source}"
        elif not stands_in(block, (root / source).read_text()):
            yield number, f"this block does not stand in {source}"


def check_lines(root, lines, programs):
    server_help = " ".join(programs.help("deformd").split())
    for number, line in enumerate(lines, 1):
        for program, rest in COMMAND.findall(line):
            for why in programs.complaints(program, rest):
                yield number, why
        default = DEFAULT_ROW.match(line)
        if default and not re.search(re.escape(default[1]) + r"( \S+=" + re.escape(default[2]) + r" | (?!\S+=))", server_help):
            yield number, f"{default[1]}: {default[2]} is not the default that `deformd --help` gives"
        for path in LINK.findall(line) + PATH.findall(line):
            if "NAME" not in path and not (root / path).exists():
                yield number, f"there is no {path}"


def problems(root, deform, deformd):
    programs, found = Programs(deform, deformd), []
    for name in DOCUMENTS:
        lines = (root / name).read_text().splitlines()
        for number, why in [*check_blocks(root, lines), *check_lines(root, lines, programs)]:
            found.append(f"{name}:{number}: {why}")
    return found


def main():
    if len(sys.argv) != 4:
        print(__doc__, file=sys.stderr)
        return 2
    found = problems(pathlib.Path(sys.argv[1]), sys.argv[2], sys.argv[3])
    for line in found:
        print(line)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
