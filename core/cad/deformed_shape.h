// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <TopoDS_Shape.hxx>

#include "core/cad/model.h"
#include "core/cad/refitting.h"

namespace deform::cad {

/// A shape of the model with the geometry of a finished refitting: the topology and the orientation of everything are those of
/// the original, and so are the curves in (u, v) except on reshaped faces. The tolerance of each edge is 1.2 times the largest
/// distance of its curve from its curves on the faces, at 23 parameters or more, and at least that of the original; that of a
/// vertex reaches the ends of its edges.
struct DeformedShape {
  TopoDS_Shape shape;
  double largest_gap = 0;  ///< between curves of edges and those on faces, model units
};
DeformedShape deformed_shape(const TopoDS_Shape& part, const Model& model, const Refitting& refitting, double tolerance);

/// Sets tolerances from the gaps between the curves of edges and those on faces, and returns the largest gap.
double set_tolerances(const TopoDS_Shape& shape);

/// Doubles the tolerances of its edges and vertices.
void widen(const TopoDS_Shape& shape);

/// What BRepCheck finds wrong, by name, or nothing: "face 3: UnorientableShape; edge 5: ...", the first few.
std::string faults_of(const TopoDS_Shape& shape);

}  // namespace deform::cad
