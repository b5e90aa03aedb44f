// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/output/detect_files.h"

#include <sstream>

#include "client/cli/output/format.h"
#include "core/constraints/detection/detect.h"
#include "core/io/coloured_ply.h"
#include "core/io/vtk_output.h"

namespace deform::cli {

namespace {

constexpr io::Colour grey{160, 160, 160};

std::string vector_text(const google::protobuf::RepeatedField<double>& x) {
  std::string text = "[";
  for (int k = 0; k < x.size(); ++k) text += (k == 0 ? "" : ", ") + number_text(x[k]);
  return text + "]";
}

std::string shape_text(const v1::DetectedPrimitive& about) {
  switch (about.kind()) {
    case v1::PRIMITIVE_PLANE:
      return "through " + vector_text(about.point()) + ", normal " + vector_text(about.axis());
    case v1::PRIMITIVE_CYLINDER:
      return "radius " + number_text(about.radius()) + ", axis " + vector_text(about.axis()) + " through " +
             vector_text(about.point());
    case v1::PRIMITIVE_SPHERE:
      return "radius " + number_text(about.radius()) + ", centre " + vector_text(about.point());
    case v1::PRIMITIVE_CONE:
      return "half angle " + number_text(about.half_angle()) + ", axis " + vector_text(about.axis()) + ", apex " +
             vector_text(about.point());
    default:
      return {};
  }
}

std::string shape_text(const v1::DetectedEdge& about) {
  if (about.kind() == v1::EDGE_LINE) return "from " + vector_text(about.point()) + ", direction " + vector_text(about.axis());
  return "radius " + number_text(about.radius()) + ", centre " + vector_text(about.point()) + ", normal " +
         vector_text(about.axis());
}

/// In lines that an editor bears.
void write_ids(const std::vector<PointId>& ids, std::ostream& out) {
  constexpr std::size_t per_line = 16;
  out << "    regions:\n      - ids: [";
  for (std::size_t i = 0; i < ids.size(); ++i) {
    if (i > 0) out << (i % per_line == 0 ? ",\n          " : ", ");
    out << ids[i];
  }
  out << "]\n";
}

template <typename About>
void write_constraint(const About& about, const std::string& extent, const std::vector<PointId>& ids, std::ostream& out) {
  out << "  # " << shape_text(about) << "; " << extent << ", " << ids.size() << " points, rms " << number_text(about.rms())
      << '\n';
  out << "  - name: " << about.name() << "\n    " << about.constraint() << ": {}\n";
  write_ids(ids, out);
}

}  // namespace

std::string detected_setup(const client::Detected& detected, const std::string& geometry) {
  const v1::DetectSummary& summary = detected.summary;
  std::ostringstream out;
  out << "# Found by deform detect with tolerance " << number_text(summary.tolerance()) << ", smallest area "
      << number_text(100 * summary.minimum_area()) << " % of the surface, largest angle " << number_text(summary.maximum_angle())
      << " rad.\n"
      << "# Take out what need not be kept, say what moves and what stays, then: deform prepare FILE\n"
      << "geometry: " << geometry << "\n"
      << "method: {mls: {}}\n"
      << "handles: []  # such as: [{name: top, region: {half_space: {point: [0, 0, 1], normal: [0, 0, 1]}}}]\n"
      << "fixed: []    # such as: [{half_space: {point: [0, 0, 0], normal: [0, 0, -1]}}]\n"
      << "constraints:\n";
  for (const auto& primitive : detected.primitives) {
    write_constraint(primitive.about, number_text(100 * primitive.about.area() / summary.area()) + " % of the surface",
                     primitive.points, out);
  }
  for (const auto& edge : detected.edges) {
    write_constraint(edge.about, "length " + number_text(edge.about.length()), edge.points, out);
  }
  return out.str();
}

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
