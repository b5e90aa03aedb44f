#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""check_references.py finds references that lead out of the repository, and leaves others alone."""
import pathlib
import tempfile
import unittest

import check_references

THESIS = "| section | says |\n|---|---|\n| 3.5 | kernels |\n| 7.2.4 | condition |\n"
GOOD = [
    "// thesis 3.5, figure 3.10",
    "// Thesis 3.5 and 7.2.4 on a ball",
    "// thesis eq. 8.8, thesis figure 9.9 and table 1.2",
    "template <class T> T t1(T1 a, const char* text = \"T00:00\");",
    "// see docs/thesis.md, beside.md and thesis.md",
    "// glob: docs/*.md",
]
BAD = [
    ("// T24: a ball", "T24 is a number"),
    ("TEST(T24, Ball)", "T24 is a number"),
    ("TEST(Ball, T24Moves)", "T24 is a number"),
    ("// thesis 9.1", "thesis 9.1 has no row"),
    ("// Thesis 3.5, 9.2", "thesis 9.2 has no row"),
    ("// METHODS.md says so", "there is no METHODS.md"),
    ("// docs/other.md", "there is no docs/other.md"),
]


class References(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.root = pathlib.Path(folder.name)
        for name in ("core", "docs"):
            (self.root / name).mkdir()
        (self.root / "docs/thesis.md").write_text(THESIS)
        (self.root / "core/beside.md").write_text("")

    def check(self, text):
        (self.root / "core/a.cpp").write_text("\n" + text + "\n")
        return check_references.problems(self.root)

    def test_what_is_right_is_not_reported(self):
        for text in GOOD:
            with self.subTest(text=text):
                self.assertEqual(self.check(text), [])

    def test_what_is_wrong_is_reported_once(self):
        for text, why in BAD:
            with self.subTest(text=text):
                found = self.check(text)
                self.assertEqual(len(found), 1, found)
                self.assertTrue(found[0].startswith("core/a.cpp:2: "), found[0])
                self.assertIn(why, found[0])


if __name__ == "__main__":
    unittest.main()
