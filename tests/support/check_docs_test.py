#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""check_docs.py finds what it is there to find: one small page per row, against two programs that only know --help."""
import pathlib
import tempfile
import unittest

import check_docs

HELP = {
    "deform": "Options:\n  -h,--help       Print this\n  --server TEXT=127.0.0.1:50051 (Env:SERVER)\n                  where\n\n"
              "Subcommands:\n  apply           Deform\n  status          How it is\n\nText --server=x",
    "deform apply": "  -h,--help  Print this\n  --set TEXT   a value, as in --set a=1\n  -o,--output TEXT REQUIRED\n"
                    "  --keep,--no-keep{false}  go on\n  --path TEXT:{a,b}=a\n",
    "deform status": "  -h,--help  Print this\n",
    "deformd": "  --address HOST:PORT=127.0.0.1:50051  where to listen\n  --insecure  no encryption\n  --workers N=0\n    requests\n",
    "deformd store": "  --data-dir PATH=data\n",
}
SOURCE = "int main() {\n  call(1);\n\n  call(2);\n}\n"
HEADER = "enum class Colour {\n  red,  ///< warm, or so\n  green\n};\nenum Code : int { ok = 0, stopped = 130 };\n"
PROTO = ("message Box {\n  repeated double min = 1;  // not this = 7;\n  message Inner {\n    bool deep = 1;\n  }\n  oneof kind {\n"
         "    Inner a = 2;\n  }\n  reserved 4;\n}\nenum Kind {\n  KIND_DEFAULT = 0;\n  ROUND = 1;\n}\n"
         "service S {\n  rpc Call(Box) returns (stream Box);\n}\n")
APPLY = ("<!-- options of deform apply -->\n| option | default |\n|---|---|\n| `--set` | | value |\n| `--output` | |\n| `--no-keep` | off |\n")
SERVER = "<!-- options of deformd -->\n| option | default |\n|---|---|\n| `--address HOST:PORT` | `127.0.0.1:50051` |\n| `--workers N` | `0` | at once |\n"
ALL = ("<!-- options of deform -->\n| `--server` | `127.0.0.1:50051` |\n\n### deform apply\n\n" + APPLY + "| `--path` | `a` |\n")

GOOD = [
    "<!-- from core/a.cpp -->\n```cpp\ncall(1);\n\ncall(2);\n```",
    "```cpp\nanything()\n```",
    "```yaml\nmin: [1]   # comment: x\ninner: {deep: true}\n```".replace("inner", "a"),
    "`deform --server HOST:PORT apply setup.yaml --set a=1`",
    "deformd --address 127.0.0.1:0 --insecure &",
    "deformd store check --data-dir data",
    SERVER + "| `--insecure` | off |",
    APPLY + "| `--path` | `a` | how |",
    ALL + "\n### deform status\n",
    "<!-- fields of Box -->\n| field |\n|---|\n| `min` | least |\n| `a` | |",
    "<!-- fields of Box at method.box -->\n| `min` | `1` |\n| `a` | |",
    "<!-- values of Kind -->\n| `ROUND` | round |",
    "<!-- enumerators of Colour in core/a.h -->\n| colour |\n|---|\n| `red` | |\n| `green` | |",
    "<!-- enumerators of Code in core/a.h -->\n| `0` | |\n| `130` | |",
    "[a](core/a.cpp), `core/`, `core/NAME.cpp`, [web](https://example.org/x)",
    "# The `heading`, one\n\n[it](#the-heading-one), [there](docs/page.md#over-there), ![picture](core/a.cpp)",
]
BAD = [
    ("<!-- from core/a.cpp -->\n```cpp\ncall(1);\ncall(2);\n```", 2, "does not stand in"),
    ("<!-- from core/b.cpp -->\n```cpp\ncall(1);\n```", 2, "there is no core/b.cpp"),
    ("```yaml\nmin: {max: 1}\n```", 2, "max is no field"),
    ("text\n`deform apply s.yaml --sett a=1`", 2, "--sett is not in"),
    ("`deform fly`", 1, "fails"),
    ("deformd --work 3", 1, "--work is not in"),
    (SERVER, 1, "--insecure is missing"),
    (SERVER.replace("`0`", "`2`") + "| `--insecure` | off |", 5, "not the default"),
    (SERVER + "| `--insecure` | off |\n| `--more` | |", 7, "--more is not in"),
    (APPLY, 1, "--path is missing"),
    (APPLY + "| `--path` | | how |", 7, "not the default"),
    (ALL, 1, 'no heading "deform status"'),
    (ALL.replace("options of deform apply", "some") + "\n### deform status\n", 4, "no table"),
    ("<!-- fields of Box -->\n| `min` | |", 1, "a of Box is missing"),
    ("<!-- fields of Box -->\n| `min` | |\n| `a` | |\n| `deep` | |", 4, "Box has no deep"),
    ("<!-- fields of Ball -->\n| `min` | |", 1, "there is no Ball"),
    ("<!-- values of Kind -->\n| value |", 1, "ROUND of Kind is missing"),
    ("<!-- enumerators of Colour in core/a.h -->\n| `red` | |", 1, "green of Colour is missing"),
    ("<!-- enumerators of Code in core/a.h -->\n| `0` | |\n| `130` | |\n| `7` | |", 4, "Code has no 7"),
    ("<!-- enumerators of Shape in core/a.h -->\n| `0` | |", 1, "there is no Shape in core/a.h"),
    ("[a](core/b.cpp)", 1, "there is no core/b.cpp"),
    ("`core/b.cpp`", 1, "there is no core/b.cpp"),
    ("[it](#nothing)", 1, "no heading #nothing"),
    ("[there](docs/page.md#nothing)", 1, "no heading #nothing"),
]


class Docs(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.root = pathlib.Path(folder.name)
        for name in ("core", "docs", "proto/deform/v1"):
            (self.root / name).mkdir(parents=True)
        (self.root / "core/a.cpp").write_text(SOURCE)
        (self.root / "core/a.h").write_text(HEADER)
        (self.root / "proto/deform/v1/a.proto").write_text(PROTO)
        (self.root / "docs/page.md").write_text("## Over there\n")
        for name in ("deform", "deformd"):
            cases = "".join(f'"{words}") cat <<"END" ;;\n{text}\nEND\n' for words, text in HELP.items())
            (self.root / name).write_text(f'#!/bin/sh\nfor last; do :; done\n[ "$last" = --help ] || exit 2\n'
                                          f'words={name}\n[ $# -lt 2 ] || words="$words $1"\n'
                                          f'case "$words" in\n{cases}*) exit 2 ;;\nesac\n')
            (self.root / name).chmod(0o755)

    def check(self, text, page="README.md"):
        (self.root / page).write_text(text + "\n[page](docs/page.md)\n" if page == "README.md" else text + "\n")
        return check_docs.problems(self.root, self.root / "deform", self.root / "deformd")

    def test_what_is_right_is_not_reported(self):
        for text in GOOD:
            with self.subTest(text=text):
                self.assertEqual(self.check(text), [])

    def test_what_is_wrong_is_reported_once(self):
        for text, line, why in BAD:
            with self.subTest(text=text):
                found = self.check(text)
                self.assertEqual(len(found), 1, found)
                self.assertTrue(found[0].startswith(f"README.md:{line}: "), found[0])
                self.assertIn(why, found[0])

    def test_pages_in_folders_are_checked_and_their_links_start_there(self):
        (self.root / "README.md").write_text("[a](docs/methods/a.md) [page](docs/page.md)")
        (self.root / "docs/methods").mkdir()
        self.assertEqual(self.check("[up](../page.md#over-there)", "docs/methods/a.md"), [])
        found = self.check("[up](page.md)", "docs/methods/a.md")
        self.assertEqual(found, ["docs/methods/a.md:1: there is no page.md"])

    def test_pages_that_nothing_leads_to_are_reported(self):
        self.assertEqual(self.check(""), [])
        (self.root / "docs/alone.md").write_text("[there](page.md)")
        self.assertEqual([line.partition(": ")[0] for line in self.check("")], ["docs/alone.md:1"])


if __name__ == "__main__":
    unittest.main()
