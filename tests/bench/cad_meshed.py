#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs cad_bench on a folder of CAD models and has gmsh mesh all that it wrote, with the gmsh module of this Python.

usage: cad_meshed.py CAD_BENCH FOLDER      exit code 1 when a limit is missed, or a face gets no triangles
"""

import os
import subprocess
import sys
import tempfile

import gmsh


def fault_of(path):
    """What is wrong with the mesh of a model, or nothing."""
    gmsh.clear()
    gmsh.model.occ.importShapes(path)
    gmsh.model.occ.synchronize()
    low_x, low_y, low_z, high_x, high_y, high_z = gmsh.model.getBoundingBox(-1, -1)
    diagonal = ((high_x - low_x) ** 2 + (high_y - low_y) ** 2 + (high_z - low_z) ** 2) ** 0.5
    gmsh.option.setNumber("Mesh.MeshSizeMax", diagonal / 20)
    gmsh.model.mesh.generate(2)
    empty = [tag for _, tag in gmsh.model.getEntities(2) if not any(len(ids) for ids in gmsh.model.mesh.getElements(2, tag)[1])]
    return f"no triangles on faces {empty}" if empty else ""


def main():
    bench, models = sys.argv[1:]
    with tempfile.TemporaryDirectory() as folder:
        missed = subprocess.run([bench, models, "--keep", folder], check=False).returncode
        gmsh.initialize()
        gmsh.option.setNumber("General.Terminal", 0)
        meshed = 0
        for name in sorted(os.listdir(folder)):
            if not any(map_name in name for map_name in ("_shear.", "_twist.", "_stretch.")):
                continue  # an input
            try:
                fault = fault_of(os.path.join(folder, name))
            except Exception as error:  # gmsh throws these themselves
                fault = str(error)
            if fault:
                missed = 1
                print(f"{name}: {fault}")
            meshed += 1
    print(f"gmsh meshed {meshed} models")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
