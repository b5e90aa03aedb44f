#!/usr/bin/env python3
"""House rules that need no compiler. usage: check_sources.py ROOT

Headers have #pragma once; files have at most 450 lines; no marks of unfinished work, no skipped tests, no tabs or trailing blanks.
"""
import os
import re
import sys

FOLDERS = ("core", "server", "client", "proto", "tests", "deploy")
ENDINGS = (".h", ".cpp", ".proto", ".py", ".sh", ".cmake", ".txt")
LIMIT = 450
UNFINISHED = re.compile(r"\b(TO" r"DO\b|FIX" r"ME\b|XX" r"X\b|DIS" r"ABLED_|GTEST_" r"SKIP)")


def check(path, lines):
    if path.endswith(".h") and "#pragma once" not in (line.strip() for line in lines):
        yield 1, "no #pragma once"
    if len(lines) > LIMIT:
        yield LIMIT + 1, f"{len(lines)} lines, at most {LIMIT}: split it by idea"
    for number, line in enumerate(lines, 1):
        if UNFINISHED.search(line):
            yield number, "a mark of unfinished work"
        if "\t" in line or line != line.rstrip():
            yield number, "a tab or a trailing blank"


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    root, files, found = sys.argv[1], 0, 0
    for top in FOLDERS:
        for where, folders, names in os.walk(os.path.join(root, top)):
            folders[:] = sorted(name for name in folders if name != "__pycache__")
            for name in sorted(names):
                if not name.endswith(ENDINGS):
                    continue
                files += 1
                path = os.path.join(where, name)
                with open(path, encoding="utf-8") as source:
                    for number, what in check(name, source.read().splitlines()):
                        found += 1
                        print(f"{os.path.relpath(path, root)}:{number}: {what}")
    if files == 0:
        sys.exit(f"{root}: no sources found")
    print(f"house rules: {files} files, {found} findings")
    sys.exit(1 if found else 0)


if __name__ == "__main__":
    main()
