#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""mutate.py knows the test programs that there are, and fails when too few mutants are killed."""
import contextlib
import io
import json
import pathlib
import re
import sys
import tempfile
import unittest
from unittest import mock

import mutate

CORE_TESTS = mutate.ROOT / "tests/core"


def mutant(number, killed):
    return {"number": number, "file": "core/base/error.cpp", "line": number, "kind": "constant", "original": "1", "mutated": "2",
            "killed": killed}


class Mutate(unittest.TestCase):
    def test_every_program_of_a_folder_is_run(self):
        for folder in sorted(path.name for path in (mutate.ROOT / "core").iterdir() if path.is_dir()):
            lists = (CORE_TESTS / folder).rglob("CMakeLists.txt")
            there = {name for each in lists for name in re.findall(r"deform_test\((\w+)", each.read_text())}
            self.assertEqual(set(mutate.TESTS[folder]), there - set(mutate.LEFT_OUT), folder)

    def test_too_few_killed_is_a_failure(self):
        with tempfile.TemporaryDirectory() as folder:
            mutants = [mutant(number, "base_test: Some.Test" if number < 17 else None) for number in range(20)]
            (pathlib.Path(folder) / "result.json").write_text(json.dumps(mutants))
            for least, code in (("85", 0), ("85.1", 1), (None, 0)):
                words = ["mutate.py", "--table", "--work", folder, *(["--least", least] if least else [])]
                with mock.patch.object(sys, "argv", words), contextlib.redirect_stdout(io.StringIO()) as said:
                    self.assertEqual(mutate.main(), code, least)
                self.assertEqual("fewer than --least 85.1 %" in said.getvalue(), code == 1, said.getvalue())


if __name__ == "__main__":
    unittest.main()
