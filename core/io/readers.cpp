// SPDX-License-Identifier: Apache-2.0
#include "core/io/readers.h"

#include <algorithm>

#include "core/base/error.h"
#include "core/base/text.h"
#include "core/io/gzip.h"

namespace deform::io {

// Defined in the folders of core/io/formats.
Reader abaqus_reader();
Reader cgns_reader();
Reader exodus_reader();
Reader gmsh_reader();
Reader medit_reader();
Reader nastran_reader();
Reader obj_reader();
Reader off_reader();
Reader openfoam_reader();
Reader ply_reader();
Reader stl_reader();
Reader su2_reader();
Reader vtk_reader();
Reader vtp_reader();
Reader vtu_reader();

const std::vector<Reader>& readers() {
  static const std::vector<Reader> all = {obj_reader(), off_reader(),   ply_reader(),    stl_reader(),     gmsh_reader(),
                                          su2_reader(), cgns_reader(),  exodus_reader(), vtk_reader(),     vtu_reader(),
                                          vtp_reader(), medit_reader(), abaqus_reader(), nastran_reader(), openfoam_reader()};
  return all;
}

const Reader& reader_of(Format format) {
  const auto found = std::find_if(readers().begin(), readers().end(), [&](const Reader& r) { return r.format == format; });
  if (found == readers().end()) throw Error(ErrorCode::internal, "a mesh format without a reader");
  return *found;
}

const Reader* find_reader(const std::string& name) {
  std::string plain("/");
  plain += lower_case(name);
  if (has_gzip_extension(name)) plain.resize(plain.size() - 3);
  for (const Reader& reader : readers()) {
    for (const std::string& extension : reader.extensions) {
      if (plain.ends_with(extension)) return &reader;
    }
  }
  return plain.ends_with("/points") ? &reader_of(Format::openfoam) : nullptr;
}

const Reader& reader_of(const std::string& name) {
  if (const Reader* found = find_reader(name)) return *found;
  std::string known;
  for (const Reader& reader : readers()) {
    for (const std::string& extension : reader.extensions) known += extension + ", ";
  }
  throw Error(ErrorCode::invalid_argument, name + ": unknown mesh format, expected a name that ends in " + known +
                                               "optionally with .gz, or the folder of an OpenFOAM mesh");
}

std::string mesh_file_names() {
  std::string names;
  for (const Reader& reader : readers()) {
    if (!reader.extensions.empty()) names += reader.extensions.front() + ", ";
  }
  return names + "also with .gz, or an OpenFOAM case";
}

}  // namespace deform::io
