// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/output/detect_files.h"

#include "core/constraints/detection/detect.h"
#include "core/io/coloured_ply.h"
#include "core/io/vtk_output.h"

namespace deform::cli {

namespace {

constexpr io::Colour grey{160, 160, 160};

}  // namespace

void write_detected(const Mesh& mesh, const client::Detected& detected, const std::filesystem::path& path) {
  const auto colours = distinct_colours(detected.primitives.size());
  std::vector<double> primitive(mesh.face_count(), 0);
  std::vector<io::Colour> colour(mesh.face_count(), grey);
  for (std::size_t i = 0; i < detected.primitives.size(); ++i) {
    for (const FaceId face : detected.primitives[i].faces) {
      if (face >= mesh.face_count()) {
        throw Error(ErrorCode::data_loss, detected.primitives[i].about.name() + ": face " + std::to_string(face) +
                                              " is out of range, the mesh has " + std::to_string(mesh.face_count()));
      }
      primitive[face] = static_cast<double>(i + 1);
      colour[face] = colours[i];
    }
  }
  if (path.extension() == ".ply") return io::write_coloured_ply(mesh, colour, path);
  if (path.extension() != ".vtp") {
    throw Error(ErrorCode::invalid_argument, path.string() + ": coloured faces are written as .ply or .vtp");
  }
  io::VtkArrays arrays;
  arrays.cells.push_back({"primitive", 1, std::move(primitive), io::VtkArray::Type::int32});
  io::VtkArray channels{"colour", 3, {}, io::VtkArray::Type::uint8};
  for (const auto& c : colour) {
    for (const unsigned char channel : c) channels.values.push_back(channel);
  }
  arrays.cells.push_back(std::move(channels));
  io::write_vtp(mesh, arrays, path);
}

}  // namespace deform::cli
