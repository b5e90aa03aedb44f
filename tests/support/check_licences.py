#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks that every source file names its licence, and that what is under Apache-2.0 includes nothing under the GPL (docs/licenses.md).

usage: check_licences.py [--write] [ROOT]      prints FILE:LINE: what is wrong; exit code 1 when anything is
--write puts the line where it is missing or another is needed.
"""
import os
import pathlib
import re
import sys

import check_floors

GPL, APACHE = "GPL-3.0-or-later", "Apache-2.0"
# The longest row that is a file or holds it decides.
LICENCES = {
    "": GPL,
    "proto": APACHE,
    "proto/convert": GPL,  # links the deformers
    "proto/convert/base": APACHE,
    "proto/convert/mesh": APACHE,
    "core/base": APACHE,
    "core/codec": APACHE,
    "core/compiled": APACHE,
    "core/mesh": APACHE,
    "core/mesh/operators": GPL,
    "core/io": APACHE,
    "core/quality": APACHE,
    "core/measures": APACHE,
    "core/report": APACHE,
    "client": APACHE,
    "client/cli": GPL,  # links the detection of primitives, and with it the solvers
    "tests/consumer": APACHE,
    # Installed with the libraries under Apache-2.0.
    "deploy/cmake/FindCGNS.cmake": APACHE,
    "deploy/cmake/deform-config.cmake.in": APACHE,
    "deploy/cmake/deform-client.pc.in": APACHE,
    "deploy/cmake/deform-files.pc.in": APACHE,
}
FOLDERS = (".ci", "client", "core", "deploy", "docs", "proto", "server", "tests")
COMMENTS = {".h": "// {}", ".cpp": "// {}", ".cpp.in": "// {}", ".proto": "// {}", ".js": "// {}", ".css": "/* {} */",
            ".py": "# {}", ".sh": "# {}", ".cmake": "# {}", ".cmake.in": "# {}", ".pc.in": "# {}", "CMakeLists.txt": "# {}",
            ".yaml": "# {}", ".cfg": "# {}", ".conf": "# {}", ".service": "# {}", "Dockerfile": "# {}"}
MARK = "SPDX-License-Identifier: "


def licence_of(name):
    """The licence of a file or folder, by its path from the root."""
    parts = pathlib.PurePosixPath(name).parts
    for length in range(len(parts), -1, -1):
        folder = "/".join(parts[:length])
        if folder in LICENCES:
            return LICENCES[folder]
    raise AssertionError("LICENCES has a row for everything")


def comment_of(path):
    """How the file writes a line of comment, or None when it is not a source file."""
    for ending, comment in COMMENTS.items():
        if path.name.endswith(ending):
            return comment
    if path.suffix:
        return None
    with open(path, "rb") as file:
        return "# {}" if file.read(2) == b"#!" else None


def sources(root):
    yield from (root / name for name in ("CMakeLists.txt", "Dockerfile"))
    for top in FOLDERS:
        for where, folders, names in os.walk(root / top):
            folders[:] = sorted(name for name in folders if name != "__pycache__")
            yield from (pathlib.Path(where) / name for name in sorted(names))


def check_line(path, wanted, write):
    """The line that names the licence: the first, or the second after that of the interpreter. Gives what is wrong, or None."""
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    place = 1 if lines and lines[0].startswith("#!") else 0
    found = lines[place].rstrip("\n") if len(lines) > place else ""
    if found == wanted:
        return None
    if not write:
        return f'{place + 1}: "{wanted}" was expected here'
    lines[place:place + (MARK in found)] = [wanted + "\n"]
    path.write_text("".join(lines), encoding="utf-8")
    return None


def check_includes(path, name):
    if licence_of(name) == GPL or path.suffix not in check_floors.SOURCES:
        return
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        match = check_floors.INCLUDE.match(line)
        # Headers made from the contract have the licence of the contract.
        if match and match[1] and not match[1].startswith("deform/v1/") and licence_of(match[1]) == GPL:
            yield f"{number}: {name} is under {APACHE}, {match[1]} under {GPL}"


def check_table(floors):
    """What may be included is under a licence that allows it."""
    for folder, below in floors.items():
        for other in below:
            if licence_of(folder) == APACHE and other != "deform/v1" and licence_of(other) == GPL:
                yield f"tests/support/check_floors.py:1: {folder} is under {APACHE} and may include {other}, which is under {GPL}"


def problems(root, write=False):
    found, count = list(check_table(check_floors.FLOORS)), 0
    for path in sources(root):
        comment = path.is_file() and comment_of(path)
        if not comment:
            continue
        count += 1
        name = path.relative_to(root).as_posix()
        why = check_line(path, comment.format(MARK + licence_of(name)), write)
        if why:
            found.append(f"{name}:{why}")
        found.extend(f"{name}:{why}" for why in check_includes(path, name))
    return count, found


def main():
    arguments = [argument for argument in sys.argv[1:] if argument != "--write"]
    root = pathlib.Path(arguments[0]) if arguments else pathlib.Path(__file__).resolve().parents[2]
    count, found = problems(root, write="--write" in sys.argv)
    for line in found:
        print(line)
    print(f"licences: {count} files, {len(found)} findings")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
