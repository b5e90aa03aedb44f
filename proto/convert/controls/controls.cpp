// SPDX-License-Identifier: GPL-3.0-or-later
#include "proto/convert/controls/controls.h"

#include <cstring>

#include "proto/convert/base/fields.h"

namespace deform::convert {

namespace {

Vec3 point_or_origin(const google::protobuf::RepeatedField<double>& numbers, const std::string& path) {
  return numbers.empty() ? Vec3{} : vec3(numbers, path);
}

LatticeFrame frame_of(const v1::Box& message, const std::string& path) {
  const Vec3 low = vec3(message.min(), path + ".min"), high = vec3(message.max(), path + ".max");
  LatticeFrame frame{low, {}};
  for (std::size_t k = 0; k < 3; ++k) {
    if (!(low[k] < high[k])) refuse_field(path, "min must be less than max in every coordinate, so that it has a volume");
    frame.axes[k][k] = high[k] - low[k];
  }
  return frame;
}

LatticeFrame frame_of(const v1::Lattice::Frame& message, const std::string& path) {
  if (message.axes_size() != 9) {
    refuse_field(path + ".axes", "must have nine numbers, three for each axis, but has " + std::to_string(message.axes_size()));
  }
  check_finite(message.axes(), path, ".axes");
  LatticeFrame frame{vec3(message.origin(), path + ".origin"), {}};
  for (int i = 0; i < 9; ++i) frame.axes[static_cast<std::size_t>(i) / 3][static_cast<std::size_t>(i) % 3] = message.axes(i);
  return frame;
}

LatticeBasis lattice_basis(v1::LatticeBasis basis) {
  switch (known(basis, "method.ffd.lattice.basis")) {
    case v1::CLAMPED_CUBIC:
      return LatticeBasis::clamped_cubic;
    case v1::BERNSTEIN:
      return LatticeBasis::bernstein;
    default:
      return LatticeBasis::uniform_cubic;
  }
}

}  // namespace

LatticeOptions lattice_from_proto(const v1::Lattice& message) {
  const std::string path = "method.ffd.lattice";
  LatticeOptions options;
  if (message.has_box()) options.frame = frame_of(message.box(), path + ".box");
  if (message.has_frame()) options.frame = frame_of(message.frame(), path + ".frame");
  if (message.points_size() != 0 && message.points_size() != 3) {
    refuse_field(path + ".points",
                 "must have three numbers, one for each axis, but has " + std::to_string(message.points_size()));
  }
  for (int k = 0; k < message.points_size(); ++k) {
    // Zeros mean "automatic" in the options.
    if (message.points(k) == 0) refuse_field(path + ".points[" + std::to_string(k) + "]", "must not be 0");
    options.points[static_cast<std::size_t>(k)] = message.points(k);
  }
  options.basis = lattice_basis(message.basis());
  const std::string& places = message.control_points();
  if (places.size() % sizeof(Vec3) != 0) {
    refuse_field(path + ".control_points", std::to_string(places.size()) + " bytes are not a multiple of 24");
  }
  options.control_points.resize(places.size() / sizeof(Vec3));
  if (!places.empty()) std::memcpy(options.control_points.data(), places.data(), places.size());
  return options;
}

namespace {

/// The number of motions of a design variable, or of another handle that it moves.
template <typename Message>
int kinds_of_motion(const Message& message) {
  return (message.translate().empty() ? 0 : 1) + (message.has_rotate() ? 1 : 0) + (message.has_scale() ? 1 : 0);
}

template <typename Message>
VariableMotion motion_of(const Message& message, const std::string& path) {
  if (const int kinds = kinds_of_motion(message); kinds != 1) {
    refuse_field(path, "expected exactly one of translate, rotate, scale, got " + std::to_string(kinds));
  }
  if (message.has_rotate()) {
    const std::string field = path + ".rotate";
    const bool degrees = known(message.rotate().unit(), field + ".unit") == v1::DEGREES;
    return Rotation{vec3(message.rotate().axis(), field + ".axis"), point_or_origin(message.rotate().centre(), field + ".centre"),
                    degrees ? AngleUnit::degrees : AngleUnit::radians};
  }
  if (message.has_scale()) {
    const std::string field = path + ".scale";
    return Scaling{point_or_origin(message.scale().centre(), field + ".centre"),
                   point_or_origin(message.scale().axis(), field + ".axis")};
  }
  return Translation{vec3(message.translate(), path + ".translate")};
}

}  // namespace

VariableMotion motion_from_proto(const v1::DesignVariable& message, const std::string& path) { return motion_of(message, path); }

VariableMotion also_from_proto(const v1::DesignVariable& message, int index, const std::string& path) {
  const v1::DrivenHandle& driven = message.also(index);
  if (kinds_of_motion(driven) == 0) return motion_of(message, path);
  return motion_of(driven, path + ".also[" + std::to_string(index) + "]");
}

}  // namespace deform::convert
