#!/usr/bin/python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Renders the README's picture: the example at rest and deformed, coloured by displacement.

usage: xvfb-run -a docs/render_example.py AHMED.obj OUT.obj PICTURE.png      (`deform sample --points 2500` and the example)
needs: python3-vtk9, python3-numpy, xvfb
"""
import sys

import numpy as np
from vtkmodules.vtkCommonColor import vtkNamedColors
from vtkmodules.vtkFiltersCore import vtkPolyDataNormals
from vtkmodules.vtkIOGeometry import vtkOBJReader
from vtkmodules.vtkIOImage import vtkPNGWriter
from vtkmodules.vtkRenderingAnnotation import vtkScalarBarActor
from vtkmodules.vtkRenderingCore import (vtkActor, vtkColorTransferFunction, vtkPolyDataMapper, vtkRenderer, vtkRenderWindow,
                                         vtkTextActor, vtkWindowToImageFilter)
import vtkmodules.vtkRenderingFreeType  # noqa: F401
import vtkmodules.vtkRenderingOpenGL2  # noqa: F401
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy


def read(path):
    reader = vtkOBJReader()
    reader.SetFileName(path)
    reader.Update()
    return reader.GetOutput()


def millimetres(rest, deformed):
    apart = vtk_to_numpy(deformed.GetPoints().GetData()).astype(float) - vtk_to_numpy(rest.GetPoints().GetData())
    return 1000 * np.linalg.norm(apart, axis=1)


def colours(most):
    table = vtkColorTransferFunction()
    for at, colour in ((0, (0.88, 0.89, 0.91)), (0.25, (0.62, 0.78, 0.90)), (0.6, (0.25, 0.55, 0.80)), (1, (0.05, 0.24, 0.52))):
        table.AddRGBPoint(at * most, *colour)
    return table


def panel(window, mesh, values, table, place, title):
    array = numpy_to_vtk(values, deep=True)
    array.SetName("displacement")
    mesh.GetPointData().SetScalars(array)
    normals = vtkPolyDataNormals()
    normals.SetInputData(mesh)
    normals.SetFeatureAngle(20)
    mapper = vtkPolyDataMapper()
    mapper.SetInputConnection(normals.GetOutputPort())
    mapper.SetLookupTable(table)
    mapper.SetScalarRange(*table.GetRange())
    actor = vtkActor()
    actor.SetMapper(mapper)
    actor.GetProperty().SetAmbient(0.25)
    actor.GetProperty().SetDiffuse(0.8)
    if mesh.GetNumberOfCells() < 30000:
        actor.GetProperty().EdgeVisibilityOn()
        actor.GetProperty().SetEdgeColor(0.6, 0.63, 0.67)
        actor.GetProperty().SetLineWidth(0.5)
    scene = vtkRenderer()
    scene.SetViewport(*place)
    scene.SetBackground(vtkNamedColors().GetColor3d("white"))
    scene.AddActor(actor)
    text = vtkTextActor()
    text.SetInput(title)
    text.GetTextProperty().SetColor(0.2, 0.2, 0.2)
    text.GetTextProperty().SetFontSize(20)
    text.SetPosition(24, 20)
    scene.AddActor2D(text)
    window.AddRenderer(scene)
    camera = scene.GetActiveCamera()
    camera.SetFocalPoint(0.58, 0, 0.13)
    camera.SetPosition(1.75, -1.9, 0.95)
    camera.SetViewUp(0, 0, 1)
    camera.SetViewAngle(19)
    scene.ResetCameraClippingRange()
    return scene


def main():
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    rest, deformed = read(sys.argv[1]), read(sys.argv[2])
    values = millimetres(rest, deformed)
    table = colours(values.max())
    window = vtkRenderWindow()
    window.SetOffScreenRendering(1)
    window.SetMultiSamples(8)
    window.SetSize(1400, 420)
    panel(window, rest, np.zeros_like(values), table, (0, 0, 0.47, 1), "the registered mesh")
    scene = panel(window, deformed, values, table, (0.47, 0, 1, 1), "roof_up = 0.03, slant_turn = 0.1: how far each point moved")
    bar = vtkScalarBarActor()
    bar.SetLookupTable(table)
    bar.SetTitle("mm")
    bar.SetNumberOfLabels(4)
    bar.SetLabelFormat("%.0f")
    bar.SetMaximumWidthInPixels(70)
    bar.SetPosition(0.91, 0.22)
    bar.SetHeight(0.55)
    bar.UnconstrainedFontSizeOn()
    for text in (bar.GetTitleTextProperty(), bar.GetLabelTextProperty()):
        text.SetColor(0.2, 0.2, 0.2)
        text.SetFontSize(16)
        text.ItalicOff()
        text.BoldOff()
        text.ShadowOff()
    scene.AddActor2D(bar)
    window.Render()
    image = vtkWindowToImageFilter()
    image.SetInput(window)
    writer = vtkPNGWriter()
    writer.SetInputConnection(image.GetOutputPort())
    writer.SetFileName(sys.argv[3])
    writer.SetCompressionLevel(9)
    writer.Write()


if __name__ == "__main__":
    main()
