// SPDX-License-Identifier: GPL-3.0-or-later
#include "proto/convert/setup.h"

#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/io/zero_copy_stream_impl_lite.h>

#include <algorithm>

#include "core/base/error.h"
#include "core/codec/geometry_id.h"
#include "proto/convert/base/fields.h"
#include "proto/convert/constraint.h"
#include "proto/convert/controls/controls.h"
#include "proto/convert/mesh/region.h"
#include "proto/convert/method.h"

namespace deform::convert {

namespace {

constexpr std::size_t variables_per_handle = 12;  // an affine map has no more degrees of freedom
constexpr std::size_t most_planes = 3;
constexpr std::size_t most_constraints = 10000;
constexpr std::size_t longest_name = 4096;
constexpr std::size_t most_name_bytes = 640 << 10;  // of all handles: a SystemInfo, which lists them, stays below 1 MiB

std::string indexed(const char* list, int index) { return std::string(list) + "[" + std::to_string(index) + "]"; }

void check_name(const std::string& name, const std::string& path) {
  if (name.size() > longest_name) refuse_field(path, "longer than " + std::to_string(longest_name) + " bytes");
}

DesignVariable variable(const v1::DesignVariable& message, const std::string& path, std::size_t max_handles) {
  check_name(message.name(), path + ".name");
  if (message.handle().empty()) refuse_field(path + ".handle", "must not be empty");
  if (static_cast<std::size_t>(message.also_size()) >= max_handles) {
    refuse_field(path + ".also", std::to_string(message.also_size()) + " entries are more than the limit of " +
                                     std::to_string(max_handles - 1) + ", each moves another handle");
  }
  DesignVariable result{message.name(), message.handle(), motion_from_proto(message, path)};
  for (int i = 0; i < message.also_size(); ++i) {
    if (message.also(i).handle().empty()) refuse_field(path + indexed(".also", i) + ".handle", "must not be empty");
    result.also.push_back({message.also(i).handle(), also_from_proto(message, i, path)});
  }
  if (message.has_lower()) result.lower = finite(message.lower(), path + ".lower");
  if (message.has_upper()) result.upper = finite(message.upper(), path + ".upper");
  return result;
}

SectorOptions sector(const v1::Sector& message, const std::string& path) {
  SectorOptions options;
  if (!message.origin().empty()) options.origin = vec3(message.origin(), path + ".origin");
  options.axis = vec3(message.axis(), path + ".axis");
  options.count = message.count();
  if (message.periodic_size() > 2) {
    refuse_field(path + ".periodic", std::to_string(message.periodic_size()) + " entries are more than the limit of 2");
  }
  for (int i = 0; i < message.periodic_size(); ++i) {
    options.periodic.push_back(region_from_proto(message.periodic(i), path + indexed(".periodic", i)));
  }
  return options;
}

SymmetryPlane symmetry_plane(const v1::SymmetryPlane& message, const std::string& path) {
  const bool plane = !message.point().empty() || !message.normal().empty();
  const int given = (plane ? 1 : 0) + (message.has_region() ? 1 : 0) + (message.has_sector() ? 1 : 0);
  if (given != 1) {
    refuse_field(path, std::string("expected point and normal, a region or a sector, got ") + (given == 0 ? "none" : "several"));
  }
  if (message.has_sector()) return {sector(message.sector(), path + ".sector")};
  if (!plane) return {region_from_proto(message.region(), path + ".region")};
  return {SymmetryPlane::Plane{vec3(message.point(), path + ".point"), vec3(message.normal(), path + ".normal")}};
}

void fill_point(google::protobuf::RepeatedField<double>& numbers) {
  if (numbers.empty()) numbers.Resize(3, 0.0);
}

/// Appends handles of a method, whose fields start with `prefix`, to those of the setup.
void add_handles(const google::protobuf::RepeatedPtrField<v1::Handle>& from, const std::string& prefix, std::size_t stage,
                 Setup& setup, Problems& problems) {
  std::size_t names = 0;
  for (const Handle& handle : setup.handles) names += handle.name.size();
  for (int i = 0; i < from.size(); ++i) {
    const std::string path = prefix + indexed("handles", i);
    names += from[i].name().size();
    if (names > most_name_bytes) {
      problems.check(path + ".name", [&] {
        refuse_field(path + ".name", "those of the handles up to this one take " + std::to_string(names) +
                                         " bytes, all together may take " + std::to_string(most_name_bytes));
      });
      return;
    }
    Handle& handle = setup.handles.emplace_back();
    handle.stage = stage;
    problems.check(path + ".name", [&] {
      check_name(from[i].name(), path + ".name");
      handle.name = from[i].name();
    });
    problems.check(path + ".region", [&] {
      if (!from[i].has_region()) refuse_field(path + ".region", "is missing");
      handle.region = region_from_proto(from[i].region(), path + ".region");
    });
  }
}

void add_fixed(const google::protobuf::RepeatedPtrField<v1::Region>& from, const std::string& prefix, std::vector<Region>& fixed,
               Problems& problems) {
  for (int i = 0; i < from.size(); ++i) {
    const std::string path = prefix + indexed("fixed", i);
    Region& region = fixed.emplace_back();
    problems.check(path, [&] { region = region_from_proto(from[i], path); });
  }
}

/// Canonicalizes the motion of a design variable, or of another handle that it moves.
template <typename Message>
void canonicalize_motion(Message& message) {
  if (message.has_rotate()) {
    fill_point(*message.mutable_rotate()->mutable_centre());
    if (message.rotate().unit() == v1::RADIANS) message.mutable_rotate()->clear_unit();
  }
  if (message.has_scale()) fill_point(*message.mutable_scale()->mutable_centre());
}

/// The method of a stage, with problems under the path of the stage.
MethodOptions method_of_stage(const v1::Method& message, const std::string& prefix, Problems& problems) {
  Problems own(problems.collects() ? Problems::Mode::collect : Problems::Mode::throw_first);
  MethodOptions options;
  try {
    options = method_from_proto(message, own);
  } catch (const Error& error) {
    throw Error(error.code(), prefix + error.what());
  }
  for (const Problem& problem : own.list()) {
    problems.check(prefix + problem.field, [&] { throw Error(ErrorCode::invalid_argument, prefix + problem.message); });
  }
  return options;
}

}  // namespace

Setup setup_from_proto(const v1::Setup& message, std::size_t max_handles) {
  Problems problems(Problems::Mode::throw_first);
  return setup_from_proto(message, max_handles, problems);
}

Setup setup_from_proto(const v1::Setup& message, std::size_t max_handles, Problems& problems) {
  const auto check_count = [&](const char* field, int count, std::size_t limit) {
    if (static_cast<std::size_t>(count) > limit) {
      refuse_field(field, std::to_string(count) + " entries are more than the limit of " + std::to_string(limit));
    }
  };
  check_count("then", message.then_size(), most_further_methods);
  int handles = message.handles_size();
  for (int i = 0; i < message.then_size(); ++i) {
    handles += message.then(i).handles_size();
    check_count((indexed("then", i) + ".fixed").c_str(), message.then(i).fixed_size(), max_handles);
  }
  check_count("handles", handles, max_handles);
  check_count("fixed", message.fixed_size(), max_handles);
  check_count("symmetry", message.symmetry_size(), most_planes);
  check_count("variables", message.variables_size(), variables_per_handle * max_handles);

  check_count("constraints", message.constraints_size(), most_constraints);

  Setup setup;
  setup.method = method_from_proto(message.method(), problems);
  setup.seed = message.seed();
  add_handles(message.handles(), "", 0, setup, problems);
  add_fixed(message.fixed(), "", setup.fixed, problems);
  for (int i = 0; i < message.then_size(); ++i) {
    const std::string prefix = indexed("then", i) + ".";
    Stage& stage = setup.then.emplace_back();
    stage.method = method_of_stage(message.then(i).method(), prefix, problems);
    add_handles(message.then(i).handles(), prefix, static_cast<std::size_t>(i) + 1, setup, problems);
    add_fixed(message.then(i).fixed(), prefix, stage.fixed, problems);
  }
  for (int i = 0; i < message.variables_size(); ++i) {
    const std::string path = indexed("variables", i);
    DesignVariable& to = setup.variables.emplace_back(DesignVariable{"", "", DesignVariable::Translate{}});
    problems.check(path, [&] { to = variable(message.variables(i), path, max_handles); });
  }
  for (int i = 0; i < message.symmetry_size(); ++i) {
    const std::string path = indexed("symmetry", i);
    SymmetryPlane& plane = setup.symmetry.emplace_back(SymmetryPlane{SymmetryPlane::Plane{}});
    problems.check(path, [&] { plane = symmetry_plane(message.symmetry(i), path); });
  }
  for (int i = 0; i < message.constraints_size(); ++i) {
    const std::string path = indexed("constraints", i);
    Constraint& constraint = setup.constraints.emplace_back();
    constraint.name = message.constraints(i).name().substr(0, longest_name);
    problems.check(path, [&] {
      check_name(message.constraints(i).name(), path + ".name");
      constraint = constraint_from_proto(message.constraints(i), path);
    });
  }
  problems.check("constraint_options", [&] { setup.constraint_options = constraint_options_from_proto(message); });
  return setup;
}

v1::Setup with_kernel(v1::Setup message, const v1::GeometryInfo& geometry) {
  set_default_kernel(*message.mutable_method(), geometry);
  for (auto& stage : *message.mutable_then()) set_default_kernel(*stage.mutable_method(), geometry);
  return message;
}

v1::Setup canonical_setup(const v1::Setup& message, const std::string& geometry_id) {
  v1::Setup canonical = message;
  canonical.DiscardUnknownFields();
  canonical.set_geometry(geometry_id);
  canonicalize_constraint_options(canonical);  // which look at what the method says
  canonicalize_method(*canonical.mutable_method());
  for (auto& handle : *canonical.mutable_handles()) canonicalize_region(*handle.mutable_region());
  for (auto& region : *canonical.mutable_fixed()) canonicalize_region(region);
  for (auto& stage : *canonical.mutable_then()) {
    canonicalize_method(*stage.mutable_method());
    for (auto& handle : *stage.mutable_handles()) canonicalize_region(*handle.mutable_region());
    for (auto& region : *stage.mutable_fixed()) canonicalize_region(region);
  }
  for (auto& plane : *canonical.mutable_symmetry()) {
    if (plane.has_region()) canonicalize_region(*plane.mutable_region());
    if (!plane.has_sector()) continue;
    fill_point(*plane.mutable_sector()->mutable_origin());
    for (auto& region : *plane.mutable_sector()->mutable_periodic()) canonicalize_region(region);
  }
  for (auto& constraint : *canonical.mutable_constraints()) canonicalize_constraint(constraint);
  for (auto& variable : *canonical.mutable_variables()) {
    canonicalize_motion(variable);
    for (auto& driven : *variable.mutable_also()) canonicalize_motion(driven);
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
