// SPDX-License-Identifier: GPL-3.0-or-later
// A file of the file handler "collated": a byte that says how many parts its folder has, then the file. The parts of what is
// accepted are read as the points of a tetrahedron.
#include "core/io/formats/openfoam/collated_file.h"
#include "core/io/formats/openfoam/openfoam_folder.h"
#include "tests/fuzz/read_and_write_back.h"

namespace {

using deform::io::CollatedFile;
using deform::io::FoamFiles;

void read_points(const FoamFiles::Part& points) {
  FoamFiles files;
  files.points = points;
  files.faces = {"4(3(0 2 1) 3(0 1 3) 3(1 2 3) 3(2 0 3))", "faces"};
  files.owner = {"4{0}", "owner"};
  files.neighbour = {"0()", "neighbour"};
  files.boundary = {"1(a{type patch;nFaces 4;startFace 0;})", "boundary"};
  try {
    const auto mesh = deform::io::parse_openfoam(std::move(files));
    mesh->mesh()->validate();
    deform::fuzz::require(mesh->with_points(mesh->mesh()->points) == points.bytes, "a part is written back as it was read");
  } catch (const deform::Error& error) {
    deform::fuzz::require(error.code() == deform::ErrorCode::invalid_argument, "a refused part is an invalid argument");
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using deform::fuzz::require;
  if (size == 0) return 0;
  const std::size_t count = data[0] % 8;
  const std::string bytes(reinterpret_cast<const char*>(data) + 1, size - 1);
  CollatedFile file;
  try {
    file = CollatedFile({bytes, "points"}, count);
  } catch (const deform::Error& error) {
    require(error.code() == deform::ErrorCode::invalid_argument, "a refused file is an invalid argument");
    return 0;
  }
  require(deform::io::is_collated(bytes), "what is read is of the class");
  std::vector<std::string> parts, longer;
  for (std::size_t i = 0; i < count; ++i) {
    const FoamFiles::Part part = file.part(i, i);
    parts.push_back(part.bytes);
    longer.push_back(part.bytes + std::string(i, ' ') + "(0)" + std::to_string(i));
    read_points(part);
  }
  require(file.with_parts(parts) == bytes, "the same parts give the same bytes");
  const std::string written = file.with_parts(longer);
  const CollatedFile again({written, "points"}, count);
  for (std::size_t i = 0; i < count; ++i) require(again.part(i, i).bytes == longer[i], "written parts read back");
  return 0;
}
