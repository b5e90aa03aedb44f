#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Two clones that share a compiler cache and change a precompiled header, each in its own way, get their own."""
import os
import pathlib
import shutil
import subprocess
import tempfile
import unittest

LAUNCHER = pathlib.Path(__file__).resolve().parents[2] / "deploy" / "cmake" / "ccache-launcher"


@unittest.skipUnless(shutil.which("ccache") and shutil.which("g++"), "needs ccache and g++")
class Launcher(unittest.TestCase):
    def setUp(self):
        temporary = tempfile.TemporaryDirectory(prefix="deform-ccache-")
        self.addCleanup(temporary.cleanup)
        self.root = pathlib.Path(temporary.name)

    def run_in(self, clone, *command):
        folder = self.root / clone
        environment = {**os.environ, "CCACHE_DIR": str(self.root / "cache"), "CCACHE_BASEDIR": str(folder), "CCACHE_NOHASHDIR": "true",
                       "CCACHE_SLOPPINESS": "pch_defines,time_macros"}
        environment.pop("CCACHE_DISABLE", None)
        done = subprocess.run(command, cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        self.assertEqual(done.returncode, 0, done.stdout)
        return done.stdout

    def precompile(self, clone, member, before=""):
        folder = self.root / clone
        folder.mkdir(exist_ok=True)
        (folder / "point.h").write_text(f"{before}struct Point {{ int {member}; }};\n")
        (folder / "all.h").write_text(f'#include "{folder}/point.h"\n')
        (folder / "all.cpp").write_text("")
        # As CMake does it.
        self.run_in(clone, str(LAUNCHER), "g++", "-fpch-preprocess", "-x", "c++-header", "-include", str(folder / "all.h"), "-o", "all.h.gch",
                    "-c", "all.cpp")

    def has_member(self, clone, member, before=""):
        (self.root / clone / "use.cpp").write_text(f"{before}int main() {{ return Point().{member}; }}\n")
        self.run_in(clone, str(LAUNCHER), "g++", "-fpch-preprocess", "-include", str(self.root / clone / "all.h"), "-c", "use.cpp", "-o", "use.o")

    def test_a_header_of_an_earlier_build_is_not_its_content(self):
        for clone in ("one", "two"):
            self.precompile(clone, "x")
            self.has_member(clone, "x")
        self.precompile("one", "y")
        self.precompile("two", "z")
        self.has_member("one", "y")
        self.has_member("two", "z")

    def test_a_header_whose_comment_has_changed_is_still_read_once(self):
        for comment in ("old", "new"):
            self.precompile("one", "x", f"#pragma once\n// {comment}\n")
            self.has_member("one", "x", f'#include "point.h"\nint {comment}_use;\n')

    def test_equal_headers_are_compiled_once(self):
        self.precompile("one", "x")
        self.precompile("two", "x")
        self.assertRegex(self.run_in("two", "ccache", "--print-stats"), r"(?m)^(direct|preprocessed)_cache_hit\t1$")


if __name__ == "__main__":
    unittest.main()
