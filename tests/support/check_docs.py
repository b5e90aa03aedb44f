#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks that README.md, CONTRIBUTING.md and docs/ agree with the programs, the wire contract and the files of the repository.

usage: check_docs.py ROOT DEFORM DEFORMD      (the root of the repository and the two built programs)
prints FILE:LINE: what is wrong; exit code 1 when anything is

- A code block under a line `<!-- from PATH -->` stands in that file, word for word (the whole block, indentation aside).
- Every option of `deform COMMAND` and `deformd` that the text names is in the program's --help.
- A table under `<!-- options of deform COMMAND -->` or `<!-- options of deformd -->` names all options of that --help in its first
  column, and their defaults in its second one. A page with `<!-- options of deform -->` has a heading for every command.
- A table under `<!-- fields of MESSAGE -->` names all fields of that message of proto/deform/v1, one under `<!-- values of ENUM -->` all of
  its values, but for the one that stands for the default. (That the defaults of fields are right is tested against a server.)
- A table under `<!-- enumerators of ENUM in HEADER -->` names all of them in its first column, or their numbers where they have some.
- The keys of a YAML block are fields of the contract.
- Every path, every link to a file and every link to a heading leads somewhere; NAME in a path stands for any. Every page of docs/ is
  reached by links from README.md.
"""
import pathlib
import re
import subprocess
import sys
import textwrap

FROM = re.compile(r"^<!-- from (\S+) -->$")
TABLE = re.compile(r"^<!-- (options|fields|values|enumerators) of ([\w -]+?)(?: at [\w.]+| in (?P<header>[\w./]+))? -->$")
CELL = re.compile(r"^\| `([^`]*)`(?: \| (?:`([^`]*)`)?)?")
COMMAND = re.compile(r"(?<![\w/.-])(deformd?)(?=[ `])([^`|#;&\n]*)")
LINK = re.compile(r"\]\((?!https?:)([^)\s]+)\)")
PATH = re.compile(r"`((?:core|server|client|proto|deploy|tests|docs|\.ci)/[\w./-]*)`")
HEADING = re.compile(r"^#+ (.*)$")
OPTION = re.compile(r"^ +(?:-\w,)?((?:--[\w-]+,?)+)(?:\{\w+\})?(.*)$")
KEY = re.compile(r"(?:^|[{,]|- )\s*(\w+):(?=\s|$)")


def documents(root):
    return [path for path in (root / "README.md", root / "CONTRIBUTING.md", *sorted(root.glob("docs/**/*.md"))) if path.is_file()]


def read_blocks(lines):
    """(line number of the opening fence, language, source named above it or None, text) of every fenced block."""
    blocks, opened = [], None
    for number, line in enumerate(lines, 1):
        if not line.lstrip().startswith("```"):
            continue
        if opened is None:
            opened = number
            continue
        above = FROM.match(lines[opened - 2]) if opened >= 2 else None
        language = lines[opened - 1].strip().lstrip("`")
        blocks.append((opened, language, above[1] if above else None, "\n".join(lines[opened:number - 1])))
        opened = None
    return blocks


def read_tables(lines):
    """(line number, what is listed, of what, rows) of every marked table; a row is (line number, name, default or None). Enumerators are
    of (name, header)."""
    tables = []
    for number, line in enumerate(lines, 1):
        marked = TABLE.match(line)
        if not marked:
            continue
        rows = []
        for at, row in enumerate(lines[number:], number + 1):
            if not row.startswith("|"):
                break
            cell = CELL.match(row)
            if cell:
                rows.append((at, cell[1], cell[2]))
        tables.append((number, marked[1], (marked[2], marked["header"]) if marked["header"] else marked[2], rows))
    return tables


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

    def options(self, *words):
        """The options of a command: (names, default or None)."""
        for line in (self.help(*words) or "").splitlines():
            option = OPTION.match(line)
            if option and "--help" not in option[1]:
                default = re.search(r"=(\S+)", re.split(r"  | \(", option[2], 1)[0])
                yield option[1].rstrip(",").split(","), default[1] if default else None

    def commands(self, *words):
        """The commands that deform, or one of its commands, has."""
        _, _, listed = (self.help(*words or ("deform",)) or "").partition("\nSubcommands:\n")
        return re.findall(r"^  ([\w-]+)", listed.split("\n\n")[0], re.M)

    def complaints(self, program, rest):
        words = rest.split()
        asked = [program]
        if program == "deform":
            skip = False
            for word in words:
                if skip or word.startswith("-"):
                    skip = word in ("--server", "--timeout")
                elif re.fullmatch(r"[a-z-]+", word) and (len(asked) == 1 or word in self.commands(*asked)):
                    asked.append(word)
                else:
                    break
        elif words and words[0] == "store":
            asked.append("store")
        text = self.help(*asked)
        if text is None:
            yield f"`{' '.join(asked)} --help` fails"
            return
        text += self.help(program)
        for option in re.findall(r"(?<!\S)(--[a-z][a-z-]*)", rest):
            if not re.search(re.escape(option) + r"(?![\w-])", text):
                yield f"{option} is not in `{' '.join(asked)} --help`"


class Contract:
    """Names in the messages and enums of proto/deform/v1."""

    def __init__(self, root):
        self.fields, self.values = {}, {}
        for path in sorted(root.glob("proto/deform/v1/*.proto")):
            self.read(re.sub(r"//.*", "", path.read_text()))

    def read(self, text):
        scopes = []
        for word in re.finditer(r"(message|enum|oneof|service|rpc)\s+(\w+)[^{};]*\{|(\w+)\s*=\s*\d+\s*(?:\[[^\]]*\])?;|\{|\}", text):
            if word[1]:
                names = self.fields if word[1] == "message" else self.values if word[1] == "enum" else {}
                # The fields of a oneof are those of its message.
                scopes.append(scopes[-1] if word[1] == "oneof" else names.setdefault(word[2], []))
            elif word[3]:
                scopes[-1].append(word[3])
            elif word[0] == "{":
                scopes.append([])
            else:
                scopes.pop()

    def names(self, kind, owner):
        """Names that a table must have, or None."""
        if kind == "fields":
            return self.fields.get(owner)
        return [name for name in self.values[owner] if not name.endswith("_DEFAULT")] if owner in self.values else None


def enumerators(root, name, header):
    """Names of a C++ enumeration, or their numbers where they are given; None when it is not there."""
    path = root / header
    text = re.sub(r"//.*", "", path.read_text()) if path.is_file() else ""
    found = re.search(r"\benum (?:class )?" + name + r"\b[^{;]*\{([^}]*)\}", text)
    if not found:
        return None
    items = [item.strip() for item in found[1].split(",") if item.strip()]
    return [item.partition("=")[2].strip() or item for item in items]


def check_blocks(root, lines, contract):
    known = {name for names in contract.fields.values() for name in names}
    known |= {"file", "set"}  # of a setup file: where a list of ids stands (client/setup/id_files.h)
    for number, language, source, block in read_blocks(lines):
        if source is not None:
            if not (root / source).is_file():
                yield number, f"there is no {source}"
            elif not stands_in(block, (root / source).read_text()):
                yield number, f"this block does not stand in {source}"
        if language == "yaml":
            for at, line in enumerate(block.splitlines(), number + 1):
                for key in KEY.findall(line.partition("#")[0]):
                    if key not in known:
                        yield at, f"{key} is no field of proto/deform/v1"


def check_options(number, words, rows, programs):
    options = list(programs.options(*words))
    names = [name for _, name, _ in rows]
    if not options:
        yield number, f"`{' '.join(words)} --help` lists no options"
    for group, _ in options:
        if not any(name.split()[0] in group for name in names):
            yield number, f"{group[0]} is missing"
    for at, name, default in rows:
        found = [value for group, value in options if name.split()[0] in group]
        if not found:
            yield at, f"{name} is not in `{' '.join(words)} --help`"
        elif found[0] != default:
            yield at, f"{name}: {default} is not the default that `{' '.join(words)} --help` gives, {found[0]}"


def check_tables(root, lines, programs, contract):
    for number, kind, owner, rows in read_tables(lines):
        if kind == "options":
            yield from check_options(number, owner.split(), rows, programs)
            continue
        if kind == "enumerators":
            owner, place = owner if isinstance(owner, tuple) else (owner, "")
            wanted = enumerators(root, owner, place)
        else:
            place = "proto/deform/v1"
            wanted = contract.names(kind, owner)
        if wanted is None:
            yield number, f"there is no {owner} in {place}"
            continue
        named = [name for _, name, _ in rows]
        yield from ((number, f"{name} of {owner} is missing") for name in wanted if name not in named)
        yield from ((at, f"{owner} has no {name}") for at, name, _ in rows if name not in wanted)


def check_commands(lines, programs):
    """A page on the command line has all commands."""
    marked = {owner for _, kind, owner, _ in read_tables(lines) if kind == "options"}
    if "deform" not in marked:
        return
    for command in programs.commands():
        if f"### deform {command}" not in lines:
            yield 1, f"there is no heading \"deform {command}\""
        elif f"deform {command}" not in marked and list(programs.options("deform", command)):
            yield lines.index(f"### deform {command}") + 1, f"there is no table of the options of deform {command}"


def anchors(path):
    """The names that GitHub gives the headings of a page."""
    found, fenced = set(), False
    for line in path.read_text().splitlines():
        fenced ^= line.lstrip().startswith("```")
        heading = None if fenced else HEADING.match(line)
        if heading:
            found.add(re.sub(r"[^\w\- ]", "", heading[1].lower()).replace(" ", "-"))
    return found


def check_links(root, page, line):
    for link in LINK.findall(line):
        target, _, anchor = link.partition("#")
        path = page.parent / target if target else page
        if not path.exists():
            yield f"there is no {target}"
        elif anchor and anchor not in anchors(path):
            yield f"there is no heading #{anchor} in {target or 'this page'}"
    for path in PATH.findall(line):
        if "NAME" not in path and not (root / path).exists():
            yield f"there is no {path}"


def check_lines(root, page, lines, programs):
    for number, line in enumerate(lines, 1):
        for program, rest in COMMAND.findall("" if line.startswith(("<!--", "#")) else line):
            for why in programs.complaints(program, rest):
                yield number, why
        for why in check_links(root, page, line):
            yield number, why


def unreached(root):
    """Pages that no way of links leads to."""
    waiting, reached = [root / "README.md"], set()
    while waiting:
        page = waiting.pop().resolve()
        if page in reached or page.suffix != ".md" or not page.is_file():
            continue
        reached.add(page)
        waiting += [page.parent / link.partition("#")[0] for link in LINK.findall(page.read_text())]
    return [page for page in documents(root) if page.resolve() not in reached]


def problems(root, deform, deformd):
    programs, contract = Programs(deform, deformd), Contract(root)
    found = [f"{page.relative_to(root)}:1: no page that README.md leads to has a link to it" for page in unreached(root)]
    for page in documents(root):
        lines = page.read_text().splitlines()
        for number, why in [*check_blocks(root, lines, contract), *check_tables(root, lines, programs, contract), *check_commands(lines, programs),
                            *check_lines(root, page, lines, programs)]:
            found.append(f"{page.relative_to(root)}:{number}: {why}")
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
