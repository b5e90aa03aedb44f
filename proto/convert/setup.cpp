// SPDX-License-Identifier: GPL-3.0-or-later
#include "proto/convert/setup.h"

#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/io/zero_copy_stream_impl_lite.h>

#include <algorithm>

#include "core/base/error.h"
#include "core/codec/geometry_id.h"
#include "proto/convert/base/fields.h"
#include "proto/convert/constraint.h"
#include "proto/convert/mesh/region.h"
#include "proto/convert/method.h"

namespace deform::convert {

namespace {

constexpr std::size_t variables_per_handle = 12;  // an affine map has no more degrees of freedom
constexpr std::size_t most_planes = 3;
constexpr std::size_t most_constraints = 10000;
constexpr std::size_t longest_name = 4096;

Vec3 point_or_origin(const google::protobuf::RepeatedField<double>& numbers, const std::string& path) {
  return numbers.empty() ? Vec3{} : vec3(numbers, path);
}

void check_name(const std::string& name, const std::string& path) {
  if (name.size() > longest_name) refuse_field(path, "longer than " + std::to_string(longest_name) + " bytes");
}

using VariableKind = decltype(DesignVariable::kind);

VariableKind variable_kind(const v1::DesignVariable& message, const std::string& path) {
  const int kinds = (message.translate().empty() ? 0 : 1) + (message.has_rotate() ? 1 : 0) + (message.has_scale() ? 1 : 0);
  if (kinds != 1) {
    refuse_field(path, "expected exactly one of translate, rotate, scale, got " + std::to_string(kinds));
  }
  if (message.has_rotate()) {
    const std::string field = path + ".rotate";
    return DesignVariable::Rotate{vec3(message.rotate().axis(), field + ".axis"),
                                  point_or_origin(message.rotate().centre(), field + ".centre")};
  }
  if (message.has_scale()) {
    const std::string field = path + ".scale";
    return DesignVariable::Scale{point_or_origin(message.scale().centre(), field + ".centre"),
                                 point_or_origin(message.scale().axis(), field + ".axis")};
  }
  return DesignVariable::Translate{vec3(message.translate(), path + ".translate")};
}

DesignVariable variable(const v1::DesignVariable& message, const std::string& path) {
  check_name(message.name(), path + ".name");
  if (message.handle().empty()) refuse_field(path + ".handle", "must not be empty");
  DesignVariable result{message.name(), message.handle(), variable_kind(message, path)};
  if (message.has_lower()) result.lower = finite(message.lower(), path + ".lower");
  if (message.has_upper()) result.upper = finite(message.upper(), path + ".upper");
  return result;
}

SymmetryPlane symmetry_plane(const v1::SymmetryPlane& message, const std::string& path) {
  const bool plane = !message.point().empty() || !message.normal().empty();
  if (plane == message.has_region()) {
    refuse_field(path, std::string("expected either point and normal or a region, got ") + (plane ? "both" : "neither"));
  }
  if (!plane) return {region_from_proto(message.region(), path + ".region")};
  return {SymmetryPlane::Plane{vec3(message.point(), path + ".point"), vec3(message.normal(), path + ".normal")}};
}

void fill_point(google::protobuf::RepeatedField<double>& numbers) {
  if (numbers.empty()) numbers.Resize(3, 0.0);
}

}  // namespace

Setup setup_from_proto(const v1::Setup& message, std::size_t max_handles) {
  const auto check_count = [&](const char* field, int count, std::size_t limit) {
    if (static_cast<std::size_t>(count) > limit) {
      refuse_field(field, std::to_string(count) + " entries are more than the limit of " + std::to_string(limit));
    }
  };
  check_count("handles", message.handles_size(), max_handles);
  check_count("fixed", message.fixed_size(), max_handles);
  check_count("symmetry", message.symmetry_size(), most_planes);
  check_count("variables", message.variables_size(), variables_per_handle * max_handles);

  check_count("constraints", message.constraints_size(), most_constraints);

  Setup setup;
  setup.method = method_from_proto(message.method());
  setup.seed = message.seed();
  for (int i = 0; i < message.handles_size(); ++i) {
    const std::string path = "handles[" + std::to_string(i) + "]";
    check_name(message.handles(i).name(), path + ".name");
    if (!message.handles(i).has_region()) refuse_field(path + ".region", "is missing");
    setup.handles.push_back({message.handles(i).name(), region_from_proto(message.handles(i).region(), path + ".region")});
  }
  for (int i = 0; i < message.fixed_size(); ++i) {
    setup.fixed.push_back(region_from_proto(message.fixed(i), "fixed[" + std::to_string(i) + "]"));
  }
  for (int i = 0; i < message.variables_size(); ++i) {
    setup.variables.push_back(variable(message.variables(i), "variables[" + std::to_string(i) + "]"));
  }
  for (int i = 0; i < message.symmetry_size(); ++i) {
    setup.symmetry.push_back(symmetry_plane(message.symmetry(i), "symmetry[" + std::to_string(i) + "]"));
  }
  for (int i = 0; i < message.constraints_size(); ++i) {
    const std::string path = "constraints[" + std::to_string(i) + "]";
    check_name(message.constraints(i).name(), path + ".name");
    setup.constraints.push_back(constraint_from_proto(message.constraints(i), path));
  }
  setup.constraint_options = constraint_options_from_proto(message.constraint_options());
  return setup;
}

v1::Setup canonical_setup(const v1::Setup& message, const std::string& geometry_id) {
  v1::Setup canonical = message;
  canonical.DiscardUnknownFields();
  canonical.set_geometry(geometry_id);
  canonicalize_method(*canonical.mutable_method());
  for (auto& handle : *canonical.mutable_handles()) canonicalize_region(*handle.mutable_region());
  for (auto& region : *canonical.mutable_fixed()) canonicalize_region(region);
  for (auto& plane : *canonical.mutable_symmetry()) {
    if (plane.has_region()) canonicalize_region(*plane.mutable_region());
  }
  for (auto& constraint : *canonical.mutable_constraints()) canonicalize_constraint(constraint);
  if (canonical.constraints().empty()) {
    canonical.clear_constraint_options();  // ignored
  } else {
    canonicalize_constraint_options(*canonical.mutable_constraint_options());
  }
  for (auto& variable : *canonical.mutable_variables()) {
    if (variable.has_rotate()) fill_point(*variable.mutable_rotate()->mutable_centre());
    if (variable.has_scale()) fill_point(*variable.mutable_scale()->mutable_centre());
  }
  return canonical;
}

std::string system_id(const v1::Setup& canonical) {
  std::string bytes;
  {
    google::protobuf::io::StringOutputStream stream(&bytes);
    google::protobuf::io::CodedOutputStream coded(&stream);
    coded.SetSerializationDeterministic(true);
    canonical.SerializeToCodedStream(&coded);
  }
  constexpr char tag[] = "deform.setup.1";  // with its terminating zero
  codec::Sha256 hash;
  hash.add(tag, sizeof(tag));
  hash.add(bytes.data(), bytes.size());
  return hash.hex();
}

}  // namespace deform::convert
