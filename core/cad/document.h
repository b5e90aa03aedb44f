// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Quantity_ColorRGBA.hxx>
#include <TopoDS_Shape.hxx>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "core/cad/model.h"

namespace deform::cad {

/// Name and colour of a face.
struct FaceMark {
  int face = 0;  ///< in its part, from 0
  std::string name;
  std::optional<Quantity_ColorRGBA> colour;
};

/// A part of an assembly where it stands, in the unit of the file; nothing in it has a location of its own.
struct Part {
  TopoDS_Shape shape;
  std::string name;
  std::optional<Quantity_ColorRGBA> colour;
  std::vector<FaceMark> faces;
  std::string place;                       ///< name of the place where it stands in its assembly, such as "wheel:2"; empty: none
  std::vector<std::string> solid_names{};  ///< of several solids in one part, in their order; empty: none has one
};

/// What a CAD file holds. A part that stands in several places is there as often.
struct Document {
  std::vector<Part> parts;
  std::string name;  ///< of the assembly; empty where there is one part
  std::vector<std::string> notes;
  std::string derivation;  ///< see derivation.h, to be written; empty: none
};

/// How much of a model is mended when it is read. healed: what OpenCASCADE mends in STEP files, and more where that is not valid,
/// which takes as long as checking them. mended: the first alone. as_it_stands: nothing, but what STEP files do not say is found:
/// tolerances of edges, from their gaps, and the sides of seams; degenerate edges are missing.
enum class Reading { healed, mended, as_it_stands };

/// Reads STEP with the names and colours of parts and faces, IGES (sewn) with those of faces and BREP without. Edges get curves
/// in space where they have none. Throws Error(not_found, invalid_argument) naming the file.
Document read_document(const std::filesystem::path& path, Reading how = Reading::healed);

/// Writes .step or .stp with names and colours, or .brep, in the unit that was read last; an assembly of several parts has one
/// level. Throws Error(invalid_argument) for another extension, Error(internal) when the file cannot be written.
void write_document(const Document& document, const std::filesystem::path& path);

int face_count(const TopoDS_Shape& shape);

/// All parts as one model, with their entities numbered.
Model model_of(const Document& document, const std::string& name);

/// Whether write_document() knows the extension.
bool can_be_written(const std::filesystem::path& path);

}  // namespace deform::cad
