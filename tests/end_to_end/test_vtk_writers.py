# SPDX-License-Identifier: GPL-3.0-or-later
"""What VTK writes in all of its ways is read, and what comes out VTK reads again: points moved, everything else as it was."""

import itertools
import os
import unittest

import test_independent_readers as readers
from test_independent_readers import NotInstalled, library, with_vtk

CELLS = (10, 11, 12, 13, 14, 24, 25, 26, 27, 29, 32)
SURFACES = (5, 8, 9, 22, 23, 28, 34)
HEXAHEDRON = ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))


def add_data(vtk, data, count):
    """Reals, integers, bytes, strings and several components, enough of them for more than one compressed block."""
    for kind, name, components in ((vtk.vtkDoubleArray, "real", 1), (vtk.vtkFloatArray, "vector a", 3), (vtk.vtkIntArray, "part", 1),
                                   (vtk.vtkUnsignedCharArray, "bytes", 1), (vtk.vtkIdTypeArray, "ids", 1)):
        array = kind()
        array.SetName(name)
        array.SetNumberOfComponents(components)
        for number in range(count):
            for _ in range(components):
                array.InsertNextValue(number * 7 % 3 if name == "part" else number % 200)
        data.AddArray(array)


def points_of(vtk, coordinates, scalar):
    points = vtk.vtkPoints()
    points.SetDataType(scalar)
    for point in coordinates:
        points.InsertNextPoint(point)
    return points


def grid(vtk, scalar, copies=1, polyhedra=False):
    """One cell of each type beside the other, and a surface cell of each type."""
    coordinates, cells = [], []
    for number, kind in enumerate((CELLS + SURFACES) * copies):
        cell = vtk.vtkGenericCell()
        cell.SetCellType(kind)
        where = cell.GetParametricCoords()
        first = len(coordinates)
        for i in range(cell.GetNumberOfPoints()):
            x, y, z = where[3 * i:3 * i + 3]
            coordinates.append((x + 2 * number + 0.1 * y, y + 0.01 * number, z + 0.2 * x))
        cells.append((kind, range(first, len(coordinates))))
    data = vtk.vtkUnstructuredGrid()
    data.SetPoints(points_of(vtk, coordinates, scalar))
    for kind, nodes in cells:
        quadratic = kind > 20
        if polyhedra and quadratic:
            continue
        nodes = list(nodes)
        if polyhedra and kind == 12:
            stream = [6, *itertools.chain.from_iterable((4, *(nodes[k] for k in face)) for face in HEXAHEDRON)]
            kind, nodes = 42, stream
        ids = vtk.vtkIdList()
        for node in nodes:
            ids.InsertNextId(node)
        data.InsertNextCell(kind, ids)
    add_data(vtk, data.GetPointData(), data.GetNumberOfPoints())
    add_data(vtk, data.GetCellData(), data.GetNumberOfCells())
    add_strings(vtk, data)
    return data


def add_strings(vtk, data):
    strings = vtk.vtkStringArray()
    strings.SetName("names")
    for text in ("one two", "", "x" * 70):
        strings.InsertNextValue(text)
    data.GetFieldData().AddArray(strings)


def surface(vtk, scalar):
    """Vertices, lines, polygons and strips."""
    source = vtk.vtkSphereSource()
    source.SetOutputPointsPrecision(1 if scalar == vtk.VTK_DOUBLE else 0)
    stripper = vtk.vtkStripper()
    stripper.SetInputConnection(source.GetOutputPort())
    stripper.Update()
    both = vtk.vtkPolyData()
    both.DeepCopy(stripper.GetOutput())
    both.SetPolys(source.GetOutput().GetPolys())
    for set_cells in (both.SetVerts, both.SetLines):
        cells = vtk.vtkCellArray()
        cells.InsertNextCell(3)
        for node in (4, 7, 9):
            cells.InsertCellPoint(node)
        set_cells(cells)
    both.GetPointData().Initialize()
    add_data(vtk, both.GetPointData(), both.GetNumberOfPoints())
    add_data(vtk, both.GetCellData(), both.GetNumberOfCells())
    add_strings(vtk, both)
    return both


class VtkWriters(readers.IndependentReaders):
    test_shared_files = None  # of the base

    def setUp(self):
        super().setUp()
        try:
            self.vtk = library("vtk")
            library("vtk.util.numpy_support")
        except NotInstalled as missing:
            self.skipTest(f"{missing} is not installed, so its files are not tried")

    def scalars(self):
        return self.vtk.VTK_DOUBLE, self.vtk.VTK_FLOAT

    def write(self, writer, data, name):
        writer.SetFileName(self.path(name))
        writer.SetInputData(data)
        self.assertEqual(writer.Write(), 1)
        self.check(self.path(name), with_vtk)

    def xml_ways(self, make):
        """Every form, compression, header and byte order."""
        writers = [("ascii", lambda w: w.SetDataModeToAscii())]
        writers.append(("binary", lambda w: w.SetDataModeToBinary()))
        writers.append(("appended", lambda w: (w.SetDataModeToAppended(), w.EncodeAppendedDataOn())))
        writers.append(("raw", lambda w: (w.SetDataModeToAppended(), w.EncodeAppendedDataOff())))
        for (form, set_form), packed, wide, big in itertools.product(writers, (0, 1), (0, 1), (0, 1)):
            writer = make()
            set_form(writer)
            writer.SetCompressorTypeToZLib() if packed else writer.SetCompressorTypeToNone()
            writer.SetHeaderTypeToUInt64() if wide else writer.SetHeaderTypeToUInt32()
            writer.SetByteOrderToBigEndian() if big else writer.SetByteOrderToLittleEndian()
            writer.SetBlockSize(1024)
            yield f"{form} zlib={packed} wide={wide} big={big}", writer

    def test_unstructured_xml(self):
        for scalar in self.scalars():
            for way, writer in self.xml_ways(self.vtk.vtkXMLUnstructuredGridWriter):
                with self.subTest(scalar=scalar, way=way):
                    self.write(writer, grid(self.vtk, scalar, copies=3), "a.vtu")

    def test_polyhedra_xml(self):
        for way, writer in self.xml_ways(self.vtk.vtkXMLUnstructuredGridWriter):
            with self.subTest(way=way):
                self.write(writer, grid(self.vtk, self.vtk.VTK_DOUBLE, polyhedra=True), "a.vtu")

    def test_surfaces_xml(self):
        for scalar in self.scalars():
            for way, writer in self.xml_ways(self.vtk.vtkXMLPolyDataWriter):
                with self.subTest(scalar=scalar, way=way):
                    self.write(writer, surface(self.vtk, scalar), "a.vtp")

    def test_legacy(self):
        vtk = self.vtk
        for scalar, version, binary in itertools.product(self.scalars(), (42, 51), (False, True)):
            lattice = vtk.vtkStructuredGrid()
            lattice.SetDimensions(4, 3, 2)
            lattice.SetPoints(points_of(vtk, [(i, j + 0.1 * i, k) for k in range(2) for j in range(3) for i in range(4)], scalar))
            add_data(vtk, lattice.GetCellData(), 6)
            for name, data, writer in (("grid", grid(vtk, scalar), vtk.vtkUnstructuredGridWriter()),
                                       ("polyhedra", grid(vtk, scalar, polyhedra=True), vtk.vtkUnstructuredGridWriter()),
                                       ("surface", surface(vtk, scalar), vtk.vtkPolyDataWriter()),
                                       ("lattice", lattice, vtk.vtkStructuredGridWriter())):
                with self.subTest(data=name, scalar=scalar, version=version, binary=binary):
                    writer.SetFileVersion(version)
                    writer.SetFileTypeToBinary() if binary else writer.SetFileTypeToASCII()
                    self.write(writer, data, "a.vtk")


if __name__ == "__main__":
    unittest.main(argv=[os.path.basename(__file__), "-v"])
