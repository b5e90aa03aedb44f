#pragma once

#include <string>

#include "core/io/mesh_file.h"

namespace deform::io {

/// The format by the extension in any case, a final .gz not counted; `points` is a file of OpenFOAM. Throws
/// Error(invalid_argument) for any other.
Format format_of(const std::string& name);

/// "OBJ", "OFF", "PLY", "STL", "OpenFOAM", "Medit", "CGNS", "Exodus", "SU2", "VTK", "VTU", "VTP", "Gmsh", "Abaqus", "Nastran".
const char* to_string(Format format);

/// Whether the name ends in .gz.
bool has_gzip_extension(const std::string& name);

}  // namespace deform::io
