#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""check_licences.py finds what it is there to find."""
import pathlib
import tempfile
import unittest

import check_floors
import check_licences

APACHE, GPL = "SPDX-License-Identifier: Apache-2.0", "SPDX-License-Identifier: GPL-3.0-or-later"

RIGHT = {
    "client/client.h": f"// {APACHE}\n#pragma once\n",
    "client/cli/a.cpp": f'// {GPL}\n#include "client/client.h"\n',
    "core/io/a.cpp": f'// {APACHE}\n#include "core/mesh/mesh.h"\n#include "deform/v1/setup.pb.h"\n#include <vector>\n',
    "core/deformers/a.cpp": f'// {GPL}\n#include "core/mesh/mesh.h"\n',
    "core/report/page.css": f"/* {APACHE} */\n",
    "proto/deform/v1/a.proto": f"// {APACHE}\n",
    "deploy/start": f"#!/bin/sh\n# {GPL}\n",
    "deploy/notes": "no source\n",
    "deploy/compose.yaml": f"# {GPL}\nservices:\n",
    "deploy/cmake/deform-client.pc.in": f"# {APACHE}\nName: deform-client\n",
    "deploy/cmake/packages.cmake": f"# {GPL}\n",
    "Dockerfile": f"# {GPL}\nFROM debian\n",
    "CMakeLists.txt": f"# {GPL}\n",
}

WRONG = [
    ("client/a.h", "#pragma once\n", "client/a.h:1: "),
    ("client/a.h", f"// {GPL}\n#pragma once\n", "client/a.h:1: "),
    ("server/a.h", f"// {APACHE}\n#pragma once\n", "server/a.h:1: "),
    ("server/a.h", f"#pragma once\n// {GPL}\n", "server/a.h:1: "),
    ("deploy/start", f"#!/bin/sh\n\n# {GPL}\n", "deploy/start:2: "),
    ("tests/a.py", "", "tests/a.py:1: "),
    ("Dockerfile", "FROM debian\n", "Dockerfile:1: "),
    ("deploy/a.yaml", "services:\n", "deploy/a.yaml:1: "),
    ("deploy/cmake/FindCGNS.cmake", f"# {GPL}\n", "deploy/cmake/FindCGNS.cmake:1: "),
    ("deploy/cmake/deform-files.pc.in", "Name: deform-files\n", "deploy/cmake/deform-files.pc.in:1: "),
    ("client/a.cpp", f'// {APACHE}\n#include "core/numerics/sparse/sparse.h"\n', "client/a.cpp:2: "),
    ("core/mesh/a.cpp", f'// {APACHE}\n#include "core/mesh/operators/shell_operators.h"\n', "core/mesh/a.cpp:2: "),
]


def tree(files):
    folder = tempfile.TemporaryDirectory()
    for name, text in {"CMakeLists.txt": RIGHT["CMakeLists.txt"], **files}.items():
        path = pathlib.Path(folder.name) / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return folder


class Licences(unittest.TestCase):
    def test_right(self):
        with tree(RIGHT) as folder:
            self.assertEqual(check_licences.problems(pathlib.Path(folder)), (len(RIGHT) - 1, []))

    def test_wrong(self):
        for name, text, where in WRONG:
            with self.subTest(name=name, text=text), tree({name: text}) as folder:
                found = check_licences.problems(pathlib.Path(folder))[1]
                self.assertEqual(len(found), 1, found)
                self.assertTrue(found[0].startswith(where), found[0])

    def test_write(self):
        bare = {name: text.replace(f"// {APACHE}\n", "").replace(f"# {GPL}\n", "") for name, text in RIGHT.items()}
        bare["client/cli/a.cpp"] = RIGHT["client/cli/a.cpp"].replace(GPL, APACHE)
        with tree(bare) as folder:
            root = pathlib.Path(folder)
            self.assertEqual(check_licences.problems(root, write=True)[1], [])
            self.assertEqual({name: (root / name).read_text() for name in RIGHT}, RIGHT)

    def test_table_of_floors(self):
        self.assertEqual(list(check_licences.check_table(check_floors.FLOORS)), [])
        self.assertEqual(len(list(check_licences.check_table({"core/io": ["core/base", "core/numerics"], "server": ["core/numerics"]}))), 1)


if __name__ == "__main__":
    unittest.main()
