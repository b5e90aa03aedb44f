#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""House rules that need no compiler. usage: check_sources.py ROOT

Headers have #pragma once, but for those that are included once per instruction set (-inl.h); files have at most 900 lines (over 450 they
are one idea); nothing at the top but what the project has there; no marks of unfinished work, no skipped tests, no tabs or trailing blanks. The members of one class are defined in one file. A folder with sources says in a README.md what lives in it,
and the large ones have at most 25 pairs of files of their own. Each source of tests has a namespace of its own.
Programs print floating-point numbers by number_digits(), not by std::to_string(), which has six decimals for all of them. Without a
compiler that is told by names: what is declared floating in the file, or in headers and nowhere as anything else.
Comments are sentences with a subject, and data is named by the terms of the field, not by people who act for it.
"""
import os
import re
import subprocess
import sys

TOP = {"client", "core", "deploy", "docs", "proto", "server", "tests", "CHANGELOG.md", "CMakeLists.txt", "CMakePresets.json", "CONTRIBUTING.md",
       "Dockerfile", "LICENSE", "README.md"}
FOLDERS = ("core", "server", "client", "proto", "tests", "deploy")
ENDINGS = (".h", ".cpp", ".proto", ".py", ".sh", ".cmake", ".txt")
LIMIT = 900
UNFINISHED = re.compile(r"\b(TO" r"DO\b|FIX" r"ME\b|XX" r"X\b|DIS" r"ABLED_|GTEST_" r"SKIP)")


def check_top(root):
    """What is tracked beside the folders and files of the project: what a program left where it ran, most of the time."""
    listed = subprocess.run(["git", "-C", root, "ls-files", "-z"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, check=False)
    if listed.returncode != 0:
        return []  # a copy without its history
    tops = {name.split("/")[0] for name in listed.stdout.decode().split("\0") if name}
    return sorted(name for name in tops - TOP if not name.startswith("."))


def check(path, lines):
    if path.endswith(".h") and not path.endswith("-inl.h") and "#pragma once" not in (line.strip() for line in lines):
        yield 1, "no #pragma once"
    if len(lines) > LIMIT:
        yield LIMIT + 1, f"{len(lines)} lines, at most {LIMIT}: split it by idea"
    for number, line in enumerate(lines, 1):
        if UNFINISHED.search(line):
            yield number, "a mark of unfinished work"
        if "\t" in line or line != line.rstrip():
            yield number, "a tab or a trailing blank"
    stem = path[: -len(".cpp")]
    if path.endswith("_test.cpp") and not any(line.startswith("namespace ") and line.endswith(f"::{stem} {{") for line in lines):
        yield 1, f"its tests stand in no namespace {stem}, as those of a program are compiled together"


# Classes whose members stand in several files. A class that leaves this list does not come back.
SCATTERED = set()

CLASS = re.compile(r"^\s*(?:class|struct|union)\s+(?:\w+::)*(\w+)[^;()]*\{", re.M)
NAMESPACE = re.compile(r"^namespace(?: ([\w:]+))? \{$")
NAMESPACE_END = re.compile(r"^\}  // namespace(?: ([\w:]+))?$")
MEMBER = re.compile(r"((?:\w+::)*\w+)::(~?\w+|operator[^\w\s]+|operator [\w:]+)\(")


def members(lines):
    """The number of a line that begins the definition of a member, and its class as it is written there with its namespace."""
    spaces = []
    for number, line in enumerate(lines, 1):
        if found := NAMESPACE.match(line):
            spaces.append(found.group(1))
        elif NAMESPACE_END.match(line) and spaces:
            spaces.pop()
        elif line[:1] not in ("", " ", "#", "/", "}"):
            found = MEMBER.search(line)
            if found and not re.search(r"[=(]", line[:found.start()]):
                yield number, "::".join([space for space in spaces if space] + [found.group(1)])


class Classes:
    """Finds classes whose members are defined in more than one file."""

    def __init__(self):
        self.declared = set()
        self.places = {}  # class -> file -> first line

    def add(self, path, text):
        declared = set(CLASS.findall(text))
        self.declared |= declared
        if not path.endswith(".cpp"):
            return
        for number, name in members(text.splitlines()):
            if name.split("::")[-1] not in declared:  # a class of this file is in no other
                self.places.setdefault(name, {}).setdefault(path, number)

    def findings(self, scattered):
        found = []
        for name, places in sorted(self.places.items()):
            short = name.split("::")[-1]
            if len(places) == 1 or short not in self.declared or name in scattered:
                continue
            first, *others = sorted(places)
            found += [(path, places[path], f"members of {name}, as in {first}: one class stands in one file") for path in others]
        for name in sorted(scattered):
            if len(self.places.get(name, ())) < 2:
                found.append(("tests/support/check_sources.py", 1, f"{name} stands in one file: take it from the list"))
        return found


DESCRIBED = ("core", "server", "client", "proto", "tests")
ROOMY = ("core/deformers", "core/io", "core/numerics", "server", "client/cli")
MOST_PAIRS = 25
LONGEST_README = 25


def check_folder(folder, names, text):
    """What is wrong with a folder that holds these names and this README.md (None where there is none)."""
    sources = {os.path.splitext(name)[0] for name in names if name.endswith((".h", ".cpp"))}
    if folder.startswith(ROOMY) and len(sources) > MOST_PAIRS:
        yield f"{len(sources)} pairs of files, at most {MOST_PAIRS}: make rooms"
    if not folder.startswith(DESCRIBED) or not any(name.endswith((".h", ".cpp", ".proto", ".py", ".sh")) for name in names):
        return
    if text is None:
        yield "no README.md that says what lives here"
    elif not 2 <= len(text.splitlines()) <= LONGEST_README:
        yield f"README.md has {len(text.splitlines())} lines, 2 to {LONGEST_README} say what lives here"


PROGRAMS = ("core", "server", "client")
FLOATING = re.compile(r"\b(?:double|float)\s+&?(\w+)((?:\s*=[^,;(){}]*)?(?:,\s*\w+(?:\s*=[^,;(){}]*)?)*)")
FLOATING_ITEMS = re.compile(r"\b(?:Vec3|Points|(?:std::)?(?:vector|span|array)<(?:const )?(?:double|float|Vec3)[^;{}()]*?>)\s*&?\s*(\w+)")
INTEGRAL = re.compile(r"\b(?:int|unsigned|char|bool|(?:std::)?(?:size_t|u?int\d+_t|string|ptrdiff_t)|PointId|FaceId|CellId|auto)\s+&?(\w+)")
OBVIOUS = re.compile(r"\d\.\d|\de-\d|\b(?:double|float)\b|std::(?:sqrt|hypot|abs\(.*\.|pow|cos|sin|exp|log)\b")


def names_in(text):
    """Names of floating numbers, of sequences of them, and of anything else, that a text declares."""
    numbers = set()
    for found in FLOATING.finditer(text):
        numbers.add(found.group(1))
        numbers.update(re.findall(r",\s*(\w+)", found.group(2)))
    others = set(INTEGRAL.findall(text))
    for bound in re.findall(r"\bauto&?&? \[([^\]]*)\]", text):
        others.update(re.findall(r"\w+", bound))
    return numbers, set(FLOATING_ITEMS.findall(text)), others


def argument(text, start):
    """What stands between the parenthesis that opens before `start` and its end."""
    depth = 1
    for end in range(start, len(text)):
        depth += {"(": 1, ")": -1}.get(text[end], 0)
        if depth == 0:
            return text[start:end]
    return text[start:]


def is_floating(expression, numbers, items):
    if expression.startswith(("static_cast<int", "static_cast<std::", "std::numeric_limits<std::")) or re.search(r"(size|rows|cols|count)\(\)$", expression):
        return False
    if OBVIOUS.search(expression):
        return True
    last = re.search(r"(\w+)((?:\[[^\[\]]*\])*)(\(\))?$", expression.strip())
    return last is not None and (last.group(1) in items if last.group(2) else last.group(1) in numbers)


class FloatingNumbers:
    """Finds std::to_string() of them in the programs."""

    def __init__(self, root):
        self.shared = (set(), set(), set())
        for top in PROGRAMS:
            for where, _, names in os.walk(os.path.join(root, top)):
                for name in names:
                    if name.endswith(".h"):
                        with open(os.path.join(where, name), encoding="utf-8") as header:
                            for known, more in zip(self.shared, names_in(header.read())):
                                known |= more

    def check(self, text):
        own = names_in(text)
        # A name of the file means what the file says; where it says both, nothing is told by the name.
        numbers = (own[0] - own[2]) | (self.shared[0] - self.shared[2] - own[2] - own[1])
        items = (own[1] - own[2]) | (self.shared[1] - self.shared[2] - own[2])
        for found in re.finditer(r"std::to_string\(", text):
            if is_floating(argument(text, found.end()), numbers, items):
                yield text.count("\n", 0, found.start()) + 1, "std::to_string of a floating-point number: use number_digits()"


# Comments and help in all sources, and words of the programs.
OF = re.compile(r'(?://[/!]*<? *|")Of ')
PEOPLE = re.compile(r"\b(told|picked|[Nn]obody (?:looks?|looked|knows|wants))\b")
# Lines of the programs that still have such words. A number falls with them, and a file that leaves the list does not come back.
PEOPLE_LEFT = {
    "server/engine/engine_impl.cpp": 1,
    "server/engine/evaluate_call.cpp": 3,
    "server/engine/evaluate_call.h": 1,
    "server/engine/stored_bases.cpp": 1,
    "server/engine/system_cache.h": 1,
    "server/engine/system_factory.cpp": 9,
}


def check_language(path, lines, left):
    """Words of a file by its path from the root, of which `left` says how many lines may have them."""
    people = []
    for number, line in enumerate(lines, 1):
        if OF.search(line):
            yield number, "a comment that begins with \"Of\": make it a sentence with a subject"
        found = PEOPLE.search(line)
        if found and path.startswith((*PROGRAMS, "proto")):
            people.append((number, f"\"{found.group(1)}\": name data by the terms of the field"))
    allowed = left.get(path, 0)
    if len(people) > allowed:
        yield from people[allowed:]
    elif len(people) < allowed:
        yield 1, f"{len(people)} lines are left of the {allowed} of PEOPLE_LEFT in tests/support/check_sources.py: lower it"


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    root, files, found = sys.argv[1], 0, 0
    floating = FloatingNumbers(root)
    classes = Classes()
    for name in check_top(root):
        found += 1
        print(f"{name}:1: nothing but the project's folders and files stands at the top")
    for top in FOLDERS:
        for where, folders, names in os.walk(os.path.join(root, top)):
            folders[:] = sorted(name for name in folders if name != "__pycache__")
            folder = os.path.relpath(where, root)
            readme = None
            if "README.md" in names:
                with open(os.path.join(where, "README.md"), encoding="utf-8") as file:
                    readme = file.read()
            for what in check_folder(folder, names, readme):
                found += 1
                print(f"{folder}:1: {what}")
            for name in sorted(names):
                if not name.endswith(ENDINGS):
                    continue
                files += 1
                path = os.path.join(where, name)
                with open(path, encoding="utf-8") as source:
                    text = source.read()
                findings = list(check(name, text.splitlines()))
                findings += check_language(os.path.relpath(path, root), text.splitlines(), PEOPLE_LEFT)
                if name.endswith((".h", ".cpp")):
                    classes.add(os.path.relpath(path, root), text)
                    if top in PROGRAMS:
                        findings += floating.check(text)
                for number, what in findings:
                    found += 1
                    print(f"{os.path.relpath(path, root)}:{number}: {what}")
    for path, number, what in classes.findings(SCATTERED):
        found += 1
        print(f"{path}:{number}: {what}")
    if files == 0:
        sys.exit(f"{root}: no sources found")
    print(f"house rules: {files} files, {found} findings")
    sys.exit(1 if found else 0)


if __name__ == "__main__":
    main()
