# SPDX-License-Identifier: GPL-3.0-or-later
"""Other readers see what was written: every shared mesh, its points moved by displace_mesh, is read by meshio and by VTK before and
after. The points must be the moved ones, everything else the same. What is not installed is left out, and says so.

A format is one row of READERS; a reader gives the points and whatever else it knows, as a dictionary of arrays or plain values.
"""

import contextlib
import fnmatch
import gzip
import importlib
import io
import os
import shutil
import subprocess
import sys
import tempfile
import unittest

DISPLACE_MESH = os.environ["DISPLACE_MESH_BIN"]
SHARED_DATA = os.environ["DEFORM_SHARED_DATA"]


class NotInstalled(Exception):
    """Its text is the name of what is missing."""


def library(name):
    try:
        return importlib.import_module(name)
    except ImportError as missing:
        raise NotInstalled(name) from missing


class Reading:
    """Points n x 3, their scalar type as the file has it, and all else by name."""

    def __init__(self, points, scalar, rest):
        self.points, self.scalar, self.rest = points, scalar, rest


def with_meshio(path):
    numpy, meshio = library("numpy"), library("meshio")
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):  # it warns of every marker
        mesh = meshio.read(path)
    points = numpy.asarray(mesh.points)
    rest = {}
    for number, block in enumerate(mesh.cells):
        rest[f"cells {number} {block.type}"] = block.data
        for name, blocks in mesh.cell_data.items():
            rest[f"cell data {number} {name}"] = blocks[number]
    for kind, data in (("point data", mesh.point_data), ("field data", mesh.field_data), ("point sets", mesh.point_sets)):
        rest.update((f"{kind} {name}", values) for name, values in (data or {}).items())
    for name, blocks in (mesh.cell_sets or {}).items():
        rest.update((f"cell sets {name} {number}", block) for number, block in enumerate(blocks) if block is not None)
    scalar = points.dtype.newbyteorder("=").type
    if points.shape[1] == 2:
        points = numpy.column_stack([points, numpy.zeros(len(points))])
    return Reading(points.astype(float), scalar, rest)


def as_su2_lines(path):
    """For meshio takes the index behind a 2D point for a coordinate."""
    numpy = library("numpy")
    with open(path, newline="") as file:
        lines = file.read().split("\n")
    starts = {words[0].split("=")[0]: number for number, words in enumerate(map(str.split, lines)) if words and "=" in words[0]}
    dimension, count = (int(lines[starts[key]].split("=")[1].split()[0]) for key in ("NDIME", "NPOIN"))
    first = starts["NPOIN"] + 1
    table = [line.split() for line in lines[first:first + count]]
    points = numpy.zeros((count, 3))
    points[:, :dimension] = [[float(word) for word in words[:dimension]] for words in table]
    return Reading(points, float, {"others": lines[:first] + lines[first + count:], "indices": [words[dimension:] for words in table]})


def with_vtk(path):
    vtk, support = library("vtk"), library("vtk.util.numpy_support")
    kinds = {".vtu": vtk.vtkXMLUnstructuredGridReader, ".vtp": vtk.vtkXMLPolyDataReader, ".vtk": vtk.vtkDataSetReader}
    reader = kinds[os.path.splitext(path)[1]]()
    reader.SetFileName(path)
    reader.Update()
    data = reader.GetOutputDataObject(0)
    rest = {}

    def add(name, array):
        if isinstance(array, vtk.vtkDataArray):
            rest[name] = support.vtk_to_numpy(array)
        elif array is not None:
            rest[name] = [str(array.GetValue(i)) for i in range(array.GetNumberOfValues())]

    for kind in ("PointData", "CellData", "FieldData"):
        attributes = getattr(data, "Get" + kind)()
        for number in range(attributes.GetNumberOfArrays()):
            add(f"{kind} {number} {attributes.GetArrayName(number)}", attributes.GetAbstractArray(number))
    if isinstance(data, vtk.vtkUnstructuredGrid):
        add("types", data.GetCellTypesArray())
        add("faces", data.GetFaces())
        lists = {"cells": data.GetCells()}
    elif isinstance(data, vtk.vtkPolyData):
        lists = {"vertices": data.GetVerts(), "lines": data.GetLines(), "polygons": data.GetPolys(), "strips": data.GetStrips()}
    else:
        rest["dimensions"] = data.GetDimensions()
        lists = {}
    for name, cells in lists.items():
        add(name + " offsets", cells.GetOffsetsArray())
        add(name, cells.GetConnectivityArray())
    points = support.vtk_to_numpy(data.GetPoints().GetData())
    return Reading(points.astype(float), points.dtype.type, rest)


def run_gmsh(*arguments):
    if shutil.which("gmsh") is None:
        raise NotInstalled("gmsh")
    done = subprocess.run(["gmsh", *arguments], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=300)
    errors = [line for line in done.stdout.splitlines() if line.startswith("Error")]
    if done.returncode != 0 or errors:
        raise AssertionError(f"gmsh {arguments}: {errors or done.stdout}")


def with_gmsh(path):
    """Gmsh writes all it has read to a file that meshio reads: nodes with parameters are too much for meshio."""
    run_gmsh("-check", path)
    copy = path + ".gmsh.msh"
    run_gmsh(path, "-save", "-format", "msh22", "-setnumber", "Mesh.SaveAll", "1", "-o", copy)
    return with_meshio(copy)


# One row per format and reader: names of files, reader.
READERS = [
    ("*.mesh", with_meshio),
    ("*.msh", with_gmsh),
    ("piece.*[!0].msh", with_meshio),  # it takes 4.0 for 4.1
    ("*_p0.msh", with_meshio),
    ("*.inp", with_meshio),
    ("*.su2", as_su2_lines),
    ("[!m]*.su2", with_meshio),  # 3D
    ("*.vtk", with_meshio),
    ("*.vtk", with_vtk),
    ("*.vtu", with_meshio),
    ("*.vtu", with_vtk),
]


# Abaqus reads 20 characters, which hold 13 digits and more.
ROUNDING = {".inp": 1e-13}


def displaced(points):
    """The same as displace_mesh.cpp."""
    numpy = library("numpy")
    low, high = points.min(axis=0), points.max(axis=0)
    size = numpy.sqrt(((high - low)**2).sum())
    u = (points - 0.5 * (low + high)) / size
    bump = 0.02 / (1 + 25 * (u**2).sum(axis=1))
    moved = points.copy()
    moved[:, 0] += size * (0.03 * u[:, 0] + 0.05 * u[:, 1] + bump + 0.01)
    moved[:, 1] += size * (0.04 * u[:, 0] - 0.02 * u[:, 1] - bump)
    if low[2] != high[2]:
        moved[:, 2] += size * (0.02 * u[:, 0] + 0.03 * u[:, 2] + 0.5 * bump)
    return moved


def shared_files(pattern):
    for folder, _, names in os.walk(os.path.join(SHARED_DATA, "B_volume")):
        for name in names:
            if fnmatch.fnmatch(name.lower().removesuffix(".gz"), pattern):
                yield os.path.join(folder, name)


class IndependentReaders(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory(prefix="deform-readers-")
        self.addCleanup(self.folder.cleanup)

    def path(self, name):
        return os.path.join(self.folder.name, name)

    def check(self, original, reader, rounding=None):
        """`original` is not compressed; `rounding` is that of a format which holds no whole doubles, relative to the largest."""
        extension = os.path.splitext(original)[1]
        written = self.path("written" + extension)
        done = subprocess.run([DISPLACE_MESH, original, written], stderr=subprocess.PIPE, text=True, timeout=300)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.compare(reader(original), reader(written), rounding or ROUNDING.get(extension, 0))

    def compare(self, before, after, rounding):
        numpy = library("numpy")
        self.assertEqual(before.scalar, after.scalar)
        expected = displaced(before.points)
        # Sums of a few terms no larger than the coordinates; then the rounding of the file.
        largest = numpy.abs(expected).max()
        error = numpy.abs(after.points - expected).max()
        self.assertLessEqual(error, 8 * numpy.finfo(float).eps * largest + max(rounding, numpy.finfo(before.scalar).eps) * largest)
        self.assertGreater(numpy.abs(before.points - after.points).max(), 0.005 * numpy.ptp(before.points, axis=0).max())
        self.assertEqual(list(before.rest), list(after.rest))
        for name, values in before.rest.items():
            numpy.testing.assert_array_equal(values, after.rest[name], name)

    def test_nastran_in_all_field_formats(self):
        """No shared file is Nastran's, so Gmsh makes them."""
        shared = os.path.join(SHARED_DATA, "B_volume", "param", "bore_tet_p0.msh.gz")
        mesh = self.path("bore.msh")
        with gzip.open(shared) as packed, open(mesh, "wb") as file:
            file.write(packed.read())
        try:
            library("meshio")
            run_gmsh("-version")
        except NotInstalled as what:  # a subtest would count it as its own failure
            self.skipTest(f"not installed: {what}")
        for order in (1, 2):
            for number, rounding in ((0, 1e-5), (1, 1e-5), (2, 1e-12)):  # free, small, large fields
                with self.subTest(order=order, fields=number):
                    plain, deck = self.path("plain.bdf"), self.path("deck.bdf")
                    raise_order = ["-order", str(order)] if order > 1 else []
                    run_gmsh(mesh, *raise_order, "-save", "-format", "bdf", "-setnumber", "Mesh.BdfFieldFormat", str(number), "-o", plain)
                    with open(plain) as file, open(deck, "w") as out:
                        out.write("BEGIN BULK\n" + file.read() + "ENDDATA\n")  # meshio wants them
                    self.check(deck, with_meshio, rounding)
                    self.check(plain, with_gmsh, rounding)

    def test_shared_files(self):
        missing = set()
        for pattern, reader in READERS:
            found = list(shared_files(pattern))
            self.assertTrue(found, pattern)
            for path in found:
                with self.subTest(file=path, reader=reader.__name__):
                    name = os.path.basename(path)
                    plain = self.path(name.removesuffix(".gz"))
                    with open(path, "rb") as packed, open(plain, "wb") as file:
                        content = packed.read()
                        file.write(gzip.decompress(content) if name.endswith(".gz") else content)
                    try:
                        self.check(plain, reader)
                    except NotInstalled as what:
                        missing.add(str(what))
        if missing:
            self.skipTest("not installed, so their readers are not asked: " + ", ".join(sorted(missing)))


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], "-v", *sys.argv[1:]])
