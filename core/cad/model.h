// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <TopTools_IndexedMapOfShape.hxx>
#include <TopoDS_Edge.hxx>
#include <TopoDS_Face.hxx>
#include <TopoDS_Shape.hxx>
#include <TopoDS_Vertex.hxx>
#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "core/base/types.h"

namespace deform::cad {

/// Edge of a face as its wires run, with the face taken forwards.
struct Coedge {
  int edge = 0;   ///< from 0
  int sense = 1;  ///< 1 along the edge, -1 against it
  bool seam = false;
};

/// Red, green, blue (sRGB) and opacity, each from 0 to 1.
using FaceColour = std::array<double, 4>;

/// A CAD model with its entities numbered from 0 in the order in which they are found; messages number them from 1.
struct Model {
  TopoDS_Shape shape;
  TopTools_IndexedMapOfShape solids, faces, wires, edges, vertices;
  std::vector<std::vector<Coedge>> coedges;  ///< of each face, wire after wire
  std::string name;                          ///< of the file
  double diagonal = 0;
  double unit = 0;         ///< of length in the file, metres; 0: it names none that is known
  double scale = 1;        ///< what lengths in the file were multiplied by
  std::string derivation;  ///< see derivation.h; empty: not by cad-apply
  std::vector<std::string> notes;
  bool numbered = true;                                 ///< entities have the numbers of the file; false: some were merged
  std::vector<std::string> face_names;                  ///< in the file, by face; empty: it names none
  std::vector<std::optional<FaceColour>> face_colours;  ///< in the file, by face; empty: none has one

  int face_count() const { return faces.Extent(); }
  int edge_count() const { return edges.Extent(); }
  int vertex_count() const { return vertices.Extent(); }
  TopoDS_Face face(int f) const;  ///< forwards
  int face_sense(int f) const;    ///< 1: the normal of the surface points out of the solid
  TopoDS_Edge edge(int e) const;  ///< forwards
  TopoDS_Vertex vertex(int v) const;
  std::string face_name(int f) const;  ///< "face 12 (cylinder)"
};

std::string surface_type(const TopoDS_Face& face);  ///< "plane", "cylinder", "cone", "sphere", "torus", ...

/// Numbers the entities of a shape. Throws Error(invalid_argument) when it has no faces.
Model make_model(const TopoDS_Shape& shape, const std::string& name);

/// Reads STEP, IGES (sewn, closed sheets as solids) and BREP in the unit of the file, which is noted, and multiplies by `scale`.
/// Throws Error(not_found, invalid_argument) naming the file.
Model read_model(const std::filesystem::path& path, double scale);

/// The shape in a STEP, IGES (sewn) or BREP file, by its extension, as it is; the unit is noted in the model, whose name messages
/// give. Throws Error(invalid_argument).
TopoDS_Shape read_shape(const std::filesystem::path& path, Model& model);

/// With it lines of a BREP file begin that stand after the first and are for us.
constexpr const char* brep_note = "# ";

/// Keeps OpenCASCADE from printing.
void silence_messages();

/// Reads and writes in this unit from now on, by its name in STEP and IGES files, and notes it in the model; an unknown one
/// counts as millimetres.
void keep_unit(const std::string& unit, Model& model);

/// The shape, healed when it is not valid, which is noted in the model.
TopoDS_Shape healed(const TopoDS_Shape& shape, Model& model);

/// The model with neighbouring faces on one surface, and edges on one curve, merged. A merged face keeps the name and the colour
/// that all of its parts have.
Model unified(const Model& model);

}  // namespace deform::cad
