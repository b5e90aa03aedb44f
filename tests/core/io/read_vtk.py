#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""What VTK makes of the files that vtk_output_test.cpp wrote into a folder. usage: read_vtk.py FOLDER"""
import os
import sys

try:
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkFiltersCore import vtkTriangleFilter
    from vtkmodules.vtkFiltersGeometry import vtkDataSetSurfaceFilter
    from vtkmodules.vtkIOXML import vtkXMLPolyDataReader, vtkXMLUnstructuredGridReader
except ImportError:
    print("without VTK for Python: only the structure of the files is checked")
    sys.exit(0)
import numpy


def read(folder, name):
    reader = vtkXMLPolyDataReader() if name.endswith(".vtp") else vtkXMLUnstructuredGridReader()
    reader.SetFileName(os.path.join(folder, name))
    reader.Update()
    assert reader.GetErrorCode() == 0, name
    return reader.GetOutput()


def volume_by_surface(grid):
    """Signed: positive when the faces of the cells look outward."""
    surface = vtkDataSetSurfaceFilter()
    surface.SetNonlinearSubdivisionLevel(0)
    surface.SetInputData(grid)
    triangles = vtkTriangleFilter()
    triangles.SetInputConnection(surface.GetOutputPort())
    triangles.Update()
    mesh = triangles.GetOutput()
    points = vtk_to_numpy(mesh.GetPoints().GetData())
    corners = vtk_to_numpy(mesh.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    a, b, c = points[corners[:, 0]], points[corners[:, 1]], points[corners[:, 2]]
    return float(numpy.einsum("ij,ij->", a, numpy.cross(b, c))) / 6


def check_element(folder, name, volume, nodes):
    grid = read(folder, name)
    assert grid.GetNumberOfCells() == 1, name
    cell = grid.GetCell(0)
    assert cell.GetNumberOfPoints() == nodes, (name, cell.GetNumberOfPoints())
    # VTK computes the surface of quadratic cells in single precision.
    assert abs(volume_by_surface(grid) - volume) < 1e-6 * volume, (name, volume_by_surface(grid), volume)
    for i in range(cell.GetNumberOfEdges()):
        ends = [numpy.array(cell.GetEdge(i).GetPoints().GetPoint(k)) for k in range(cell.GetEdge(i).GetNumberOfPoints())]
        if len(ends) == 3:
            assert abs((ends[0] + ends[1]) / 2 - ends[2]).max() < 1e-12, (name, "edge", i)
    if nodes == 13:
        return  # VTK's coordinates of quadratic pyramids are collapsed to the apex
    # The element is affine, so its nodes are an affine map of VTK's own coordinates of them: only in the right order.
    parametric = numpy.array(list(cell.GetParametricCoords())[:3 * nodes]).reshape(-1, 3)
    places = numpy.array([cell.GetPoints().GetPoint(i) for i in range(nodes)])
    system = numpy.hstack([parametric, numpy.ones((nodes, 1))])
    solution = numpy.linalg.lstsq(system, places, rcond=None)[0]
    worst = abs(system @ solution - places).max()
    assert worst < 1e-12, (name, worst)


def main():
    folder = sys.argv[1]
    with open(os.path.join(folder, "elements.txt")) as table:
        for line in table:
            name, volume, nodes = line.split()
            check_element(folder, name, float(volume), int(nodes))

    grid = read(folder, "cells.vtu")
    assert grid.GetNumberOfCells() == 2 and grid.GetNumberOfPoints() == 12
    assert [grid.GetCellType(i) for i in (0, 1)] == [42, 42]
    assert [grid.GetCell(i).GetNumberOfFaces() for i in (0, 1)] == [6, 6]
    assert abs(volume_by_surface(grid) - 2) < 1e-12
    assert list(vtk_to_numpy(grid.GetCellData().GetArray("volume"))) == [1, 1.5]
    moved = vtk_to_numpy(grid.GetPointData().GetArray("displacement"))
    assert moved.shape == (12, 3) and moved[5].tolist() == [15, 16, 17]

    surface = read(folder, "surface.vtp")
    assert (surface.GetNumberOfVerts(), surface.GetNumberOfLines(), surface.GetNumberOfPolys()) == (1, 1, 3)
    assert list(vtk_to_numpy(surface.GetCellData().GetArray("face"))) == [3, 1, 0, 2, 4]
    assert list(vtk_to_numpy(surface.GetCellData().GetArray("face_quality"))) == [3, 1, 0, 2, 4]
    assert [surface.GetCell(i).GetNumberOfPoints() for i in range(5)] == [1, 2, 3, 4, 5]
    curvature = vtk_to_numpy(surface.GetPointData().GetArray('a "name" & <more>'))
    assert numpy.isnan(curvature[0]) and curvature[1] == 0.5
    print("VTK reads them as meant")


if __name__ == "__main__":
    main()
