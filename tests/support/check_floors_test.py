#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""check_floors.py finds what it is there to find: one small tree per row."""
import pathlib
import tempfile
import unittest

import check_floors

REFUSED = [
    ("core/base/a.h", '#include "core/mesh/mesh.h"', "core/mesh is not below it"),
    ("core/mesh/a.cpp", '#include "core/io/obj.h"', "core/io is not below it"),
    ("core/io/a.cpp", '#include "core/deformers/rbf/rbf_system.h"', "core/deformers/rbf is not below it"),
    ("core/codec/a.cpp", '#include "core/numerics/kernels/kernel.h"', "core/numerics is not below it"),
    ("core/deformers/a.cpp", '  #  include "deform/v1/setup.pb.h"', "deform/v1 is not below it"),
    ("core/deformers/a.cpp", "#include <google/protobuf/message.h>", "must not know"),
    ("core/base/a.cpp", "#include <grpcpp/grpcpp.h>", "must not know"),
    ("core/io/a.cpp", "#include <draco/core/encoder_buffer.h>", "must not know"),
    ("server/engine/a.cpp", '#include "core/io/mesh_file.h"', "core/io/mesh_file.h is not below it"),
    ("server/engine/a.cpp", "#include <grpcpp/grpcpp.h>", "must not know"),
    ("server/engine/a.cpp", '#include "server/rpc/service.h"', "server/rpc is not below it"),
    ("server/store/a.cpp", '#include "server/engine/engine.h"', "server/engine is not below it"),
    ("core/deformers/rbf/a.cpp", '#include "core/deformers/energy/energy_system.h"', "core/deformers/energy is not below it"),
    ("core/deformers/rbf/a.cpp", '#include "core/deformers/splitting.h"', "core/deformers is not below it"),
    ("core/quality/a.cpp", '#include "core/io/formats/vtk/vtk_cells.h"', "core/io/formats is not below it"),
    ("server/a.cpp", '#include "client/client.h"', "client is not below it"),
    ("client/a.cpp", '#include "server/engine/engine.h"', "server/engine is not below it"),
    ("client/a.cpp", '#include "core/mesh/mesh.h"', "core/mesh is not below it"),
    ("client/a.cpp", '#include "client/cli/commands/command.h"', "client/cli is not below it"),
    ("server/a.cpp", '#include "a.h"', "start at the root"),
    ("server/a.cpp", '#include "../client/a.h"', "start at the root"),
    ("server/a.cpp", '#include "tests/support/fake_engine.h"', "is on no floor"),
    ("core/cellar/a.cpp", "", "in no row of the table"),
]

ALLOWED = [
    ("core/deformers/a.cpp", '#include "core/numerics/kernels/kernel.h"\n#include <Eigen/Core>\n#include "core/deformers/rbf/rbf_system.h"'),
    ("server/rpc/a.cpp", '#include <grpcpp/grpcpp.h>\n#include "deform/v1/service.pb.h"\n#include "server/engine/engine.h"'),
    ("core/deformers/rbf/a.cpp", '#include "core/deformers/setup.h"\n#include "core/deformers/handles/handle_motion.h"'),
    ("client/cli/a.cpp", '#include "core/io/mesh_file.h"\n#include "client/client.h"'),
    ("core/base/a.cpp", '// #include "core/mesh/mesh.h"'),
]


def check(path, text):
    with tempfile.TemporaryDirectory() as folder:
        file = pathlib.Path(folder) / path
        file.parent.mkdir(parents=True)
        file.write_text(text)
        return check_floors.violations(pathlib.Path(folder))


class Floors(unittest.TestCase):
    def test_refused(self):
        for path, text, why in REFUSED:
            with self.subTest(path=path, text=text):
                found = check(path, text)
                self.assertEqual(len(found), 1)
                self.assertTrue(found[0].startswith(path + ":1: "), found[0])
                self.assertIn(why, found[0])

    def test_allowed(self):
        for path, text in ALLOWED:
            with self.subTest(path=path):
                self.assertEqual(check(path, text), [])


if __name__ == "__main__":
    unittest.main()
