#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks that comments, names of tests and texts refer only to what is in the repository.

usage: check_references.py ROOT      prints FILE:LINE: what is wrong; exit code 1 when anything is

- No numbers of a list that is kept elsewhere, such as a T and two digits: the thesis is cited by section, equation, figure or table.
- A section of the thesis that is cited ("thesis 3.5") has a row in docs/thesis.md.
- A page that is named (NAME.md) is there: at that path, beside the file, or under its name anywhere.
"""
import pathlib
import re
import sys

FOLDERS = ("core", "server", "client", "proto", "tests", "deploy", "docs", ".ci")
PAGES = ("README.md", "CONTRIBUTING.md", "CMakeLists.txt")
ENDINGS = {".h", ".cpp", ".proto", ".py", ".sh", ".cmake", ".txt", ".md", ".yaml", ""}
NUMBER = re.compile(r"(?<![\w\"'])T\d\d(?=[A-Z]|\b)")
SECTION = re.compile(r"\bthesis(?:' own)?,? (?:section )?((?:\d+\.\d+(?:\.\d+)*)(?:(?:,| and| to) \d+\.\d+(?:\.\d+)*)*)", re.I)
ROW = re.compile(r"^\| (\d+\.\d+(?:\.\d+)*) \|", re.M)
PAGE = re.compile(r"(?<![\w./$*-])(?![A-Z_]+/)((?:[\w-]+/)*[\w-]+\.md)\b")


def files(root):
    yield from (root / name for name in PAGES if (root / name).is_file())
    for folder in FOLDERS:
        for path in sorted((root / folder).rglob("*")):
            if path.is_file() and path.suffix in ENDINGS and "__pycache__" not in path.parts:
                yield path


def is_there(root, path, page, names):
    return (root / page).is_file() or (path.parent / page).is_file() or ("/" not in page and page in names)


def complaints(root, path, text, sections, names):
    for number, line in enumerate(text.splitlines(), 1):
        for found in NUMBER.findall(line):
            yield number, f"{found} is a number of a list that is not here: cite the section of the thesis"
        for cited in SECTION.findall(line):
            for section in re.findall(r"\d+(?:\.\d+)+", cited):
                if section not in sections:
                    yield number, f"thesis {section} has no row in docs/thesis.md"
        for page in PAGE.findall(line):
            if not is_there(root, path, page, names):
                yield number, f"there is no {page}"


def problems(root):
    found = []
    sections = set(ROW.findall((root / "docs/thesis.md").read_text(encoding="utf-8")))
    names = {path.name for path in files(root) if path.suffix == ".md"} | {"CHANGELOG.md"}
    for path in files(root):
        if path.name.startswith("check_"):  # these name what they look for
            continue
        try:
            text = path.read_text(encoding="utf-8")
        except UnicodeDecodeError:
            continue
        found += [f"{path.relative_to(root)}:{number}: {why}" for number, why in complaints(root, path, text, sections, names)]
    return found


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    found = problems(pathlib.Path(sys.argv[1]))
    for line in found:
        print(line)
    sys.exit(1 if found else 0)


if __name__ == "__main__":
    main()
