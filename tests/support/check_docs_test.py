#!/usr/bin/env python3
"""check_docs.py finds what it is there to find: one small README per row, against two programs that only know --help."""
import pathlib
import tempfile
import unittest

import check_docs

HELP = {
    "deform": "--server TEXT=127.0.0.1:50051",
    "deform apply": "--set TEXT -o,--output TEXT",
    "deformd": "--address HOST:PORT=127.0.0.1:50051 where to listen --insecure no encryption --workers N=0 requests",
}
SOURCE = "int main() {\n  call(1);\n\n  call(2);\n}\n"

GOOD = [
    "<!-- from core/a.cpp -->\n```cpp\ncall(1);\n\ncall(2);\n```",
    "```cpp\nanything()\n```",
    "`deform --server HOST:PORT apply setup.yaml --set a=1`",
    "deformd --address 127.0.0.1:0 --insecure &",
    "| `--address HOST:PORT` | `127.0.0.1:50051` | where |",
    "[a](core/a.cpp), `core/`, `core/NAME.cpp`, [web](https://example.org/x)",
]
BAD = [
    ("<!-- from core/a.cpp -->\n```cpp\ncall(1);\ncall(2);\n```", 2, "does not stand in"),
    ("<!-- from core/b.cpp -->\n```cpp\ncall(1);\n```", 2, "there is no core/b.cpp"),
    ("text\n`deform apply s.yaml --sett a=1`", 2, "--sett is not in"),
    ("`deform fly`", 1, "fails"),
    ("deformd --work 3", 1, "--work is not in"),
    ("| `--workers N` | `2` | at once |", 1, "not the default"),
    ("[a](core/b.cpp)", 1, "there is no core/b.cpp"),
    ("`core/b.cpp`", 1, "there is no core/b.cpp"),
]


class Docs(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.root = pathlib.Path(folder.name)
        (self.root / "core").mkdir()
        (self.root / "core/a.cpp").write_text(SOURCE)
        for name in ("deform", "deformd"):
            cases = "".join(f'"{words}") echo "{text}" ;;\n' for words, text in HELP.items())
            (self.root / name).write_text(f'#!/bin/sh\nfor last; do :; done\n[ "$last" = --help ] || exit 2\n'
                                          f'words={name}\n[ $# -lt 2 ] || words="$words $1"\n'
                                          f'case "$words" in\n{cases}*) exit 2 ;;\nesac\n')
            (self.root / name).chmod(0o755)

    def check(self, text):
        (self.root / "README.md").write_text(text + "\n")
        (self.root / "CONTRIBUTING.md").write_text("")
        return check_docs.problems(self.root, self.root / "deform", self.root / "deformd")

    def test_good(self):
        for text in GOOD:
            with self.subTest(text=text):
                self.assertEqual(self.check(text), [])

    def test_bad(self):
        for text, line, why in BAD:
            with self.subTest(text=text):
                found = self.check(text)
                self.assertEqual(len(found), 1, found)
                self.assertTrue(found[0].startswith(f"README.md:{line}: "), found[0])
                self.assertIn(why, found[0])


if __name__ == "__main__":
    unittest.main()
