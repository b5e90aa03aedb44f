# SPDX-License-Identifier: GPL-3.0-or-later
"""What other programs read of CGNS and Exodus files before and after their points were moved: VTK's readers see the moved points and
everything else unchanged; cgnsdiff, cgnscheck and ncdump see nothing but coordinates. What is not installed is left out, and says so.
"""

import os
import re
import shutil
import subprocess
import sys
import unittest

import test_independent_readers as readers
from test_independent_readers import DISPLACE_MESH, NotInstalled, Reading, library, shared_files


def output_of(program, *arguments, status=(0,)):
    if shutil.which(program) is None:
        raise NotInstalled(program)
    done = subprocess.run([program, *arguments], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=300, check=False)
    if done.returncode not in status:
        raise AssertionError(f"{program} {arguments}: {done.returncode}\n{done.stdout}")
    return done.stdout


def leaves(data):
    """The grids of a tree of blocks, by their place in it."""
    if data is None:
        return
    if not data.IsA("vtkMultiBlockDataSet"):
        yield "", data
        return
    for number in range(data.GetNumberOfBlocks()):
        for place, leaf in leaves(data.GetBlock(number)):
            yield f"{number}/{place}", leaf


def reading_of(data):
    numpy, convert = library("numpy"), library("vtkmodules.util.numpy_support").vtk_to_numpy
    points, rest = None, {}
    for place, grid in leaves(data):
        here = convert(grid.GetPoints().GetData())
        if points is None or len(here) > len(points):
            points = here
        if grid.GetNumberOfCells() > 0:
            rest[place + " cells"] = convert(grid.GetCells().GetConnectivityArray())
            rest[place + " types"] = convert(grid.GetCellTypesArray())
    return Reading(points.astype(float), numpy.float64, rest)


def exodus_with_vtk(path):
    reader = library("vtkmodules.vtkIOExodus").vtkExodusIIReader()
    reader.SetFileName(path)
    reader.UpdateInformation()
    reader.SetSqueezePoints(False)
    reader.Update()
    return reading_of(reader.GetOutput())


def cgns_with_vtk(path):
    reader = library("vtkmodules.vtkIOCGNSReader").vtkCGNSReader()
    reader.SetFileName(path)
    reader.UpdateInformation()
    reader.EnableAllBases()
    reader.DoublePrecisionMeshOn()
    reader.Update()
    return reading_of(reader.GetOutput())


def with_ncdump(path):
    """Coordinates are the points, all other lines of the text form are the rest."""
    numpy = library("numpy")
    kind = output_of("ncdump", "-k", path).strip()
    header, data = output_of("ncdump", "-p", "9,17", path).split("\ndata:\n")
    header = header.split("\n", 1)[1]  # the first line has the name of the file
    arrays, rest = {}, {"header": [kind, header]}
    for name, values in re.findall(r"^ (\w+) =\s(.*?) ;$", data, re.DOTALL | re.MULTILINE):
        if re.fullmatch("coord[xyz]?", name):
            arrays[name] = numpy.array([float(value) for value in values.split(",")])
        else:
            rest[name] = [values]
    if "coord" in arrays:
        axes = list(arrays["coord"].reshape(3, -1))
    else:
        axes = [arrays[name] for name in sorted(arrays)]
    single = re.search(r"float coord[xyz]?\(", header)
    return Reading(numpy.column_stack(axes), numpy.float32 if single else numpy.float64, rest)


class ContainerReaders(readers.IndependentReaders):
    test_shared_files = None  # those of the base class

    def each(self, pattern, check):
        missing = set()
        found = list(shared_files(pattern))
        self.assertTrue(found)
        for path in found:
            with self.subTest(file=path):
                try:
                    check(path)
                except NotInstalled as what:
                    missing.add(str(what))
        if missing:
            self.skipTest("not installed, so they are not asked: " + ", ".join(sorted(missing)))

    def test_exodus_with_vtk(self):
        self.each("*.e", lambda path: self.check(path, exodus_with_vtk))

    def test_exodus_with_ncdump(self):
        self.each("*.e", lambda path: self.check(path, with_ncdump))

    def test_cgns_with_vtk(self):
        self.each("*.cgns", lambda path: self.check(path, cgns_with_vtk))

    def test_cgns_nodes(self):
        self.each("*.cgns", self.compare_nodes)

    def compare_nodes(self, path):
        written = self.path("written.cgns")
        subprocess.run([DISPLACE_MESH, path, written], check=True, timeout=300)
        differences = output_of("cgnsdiff", "-d", path, written, status=(0, 1)).splitlines()
        self.assertGreaterEqual(len(differences), 2)
        for line in differences:
            self.assertRegex(line, r"/GridCoordinates/Coordinate[XYZ] : data values differ$")
        self.assertEqual(os.path.getsize(path), os.path.getsize(written))
        said = output_of("cgnscheck", written).replace(written, path)
        self.assertEqual(said, output_of("cgnscheck", path))
        self.assertNotIn("ERROR", said)


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], "-v", *sys.argv[1:]])
