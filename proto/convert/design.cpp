// SPDX-License-Identifier: GPL-3.0-or-later
#include "proto/convert/design.h"

#include <cmath>
#include <cstring>
#include <map>
#include <string>
#include <string_view>

#include "core/base/error.h"
#include "proto/convert/base/fields.h"

namespace deform::convert {

namespace {

std::string item(const char* field, int index) { return std::string(field) + "[" + std::to_string(index) + "]"; }

void check_motion(const v1::Motion& motion, const std::string& path) {
  if (motion.handle().empty()) refuse_field(path + ".handle", "must not be empty");
  const bool affine = motion.affine_size() > 0;
  const bool displacements = motion.displacements_size() > 0;
  if (affine == displacements) refuse_field(path, "expected exactly one of affine and displacements");
  if (affine && motion.affine_size() != 12) {
    refuse_field(path + ".affine", "expected 12 numbers, got " + std::to_string(motion.affine_size()));
  }
  check_finite(motion.affine(), path, ".affine");
  for (int k = 0; k < motion.displacements_size(); ++k) {
    const std::string& bytes = motion.displacements(k).xyz();
    if (bytes.size() % sizeof(Vec3) != 0) {
      refuse_field(path + item(".displacements", k) + ".xyz", std::to_string(bytes.size()) + " bytes are not a multiple of 24");
    }
  }
}

std::vector<Vec3> displacements(const v1::Motion& motion, std::size_t points, const std::string& path) {
  std::vector<Vec3> field(points);
  std::vector<char> seen(points, 0);
  std::size_t covered = 0;
  for (int k = 0; k < motion.displacements_size(); ++k) {
    const auto& piece = motion.displacements(k);
    const std::size_t count = piece.xyz().size() / sizeof(Vec3);
    if (piece.first() > points || count > points - piece.first()) {
      refuse_field(path + item(".displacements", k), "points " + std::to_string(piece.first()) + " to " +
                                                         std::to_string(piece.first() + count) + " are out of range, handle \"" +
                                                         motion.handle() + "\" has " + std::to_string(points));
    }
    if (count == 0) continue;
    std::memcpy(field.data() + piece.first(), piece.xyz().data(), piece.xyz().size());
    for (std::size_t i = piece.first(); i < piece.first() + count; ++i) {
      if (seen[i]) refuse_field(path + item(".displacements", k), "point " + std::to_string(i) + " of the handle is given twice");
      seen[i] = 1;
      for (const double x : field[i]) {
        if (!std::isfinite(x)) {
          refuse_field(path + item(".displacements", k), "point " + std::to_string(i) + " of the handle: must be finite");
        }
      }
    }
    covered += count;
  }
  if (covered != points) {
    refuse_field(path + ".displacements", std::to_string(covered) + " displacements for the " + std::to_string(points) +
                                              " points of handle \"" + motion.handle() + "\"");
  }
  return field;
}

Motion convert(const v1::Motion& message, std::size_t handle, std::size_t points, const std::string& path) {
  Motion motion;
  motion.handle = handle;
  if (message.affine_size() > 0) {
    Affine affine{};
    for (int k = 0; k < 12; ++k) affine[k] = message.affine(k);
    motion.value = affine;
  } else {
    motion.value = displacements(message, points, path);
  }
  return motion;
}

}  // namespace

void check_design_count(const v1::DeformRequest& request, std::size_t max_designs) {
  const double tolerance = request.solver_tolerance();
  if (tolerance != 0 && !(tolerance >= least_tolerance && tolerance <= largest_tolerance)) {
    refuse_field("solver_tolerance", "must be 0 or in 1e-10..1e-2");
  }
  if (request.designs_size() == 0) refuse_field("designs", "at least one is needed");
  if (static_cast<std::size_t>(request.designs_size()) > max_designs) {
    refuse_field("designs",
                 std::to_string(request.designs_size()) + " designs are more than the limit of " + std::to_string(max_designs));
  }
}

void check_design(const v1::DeformRequest& request, std::size_t design) {
  const int d = static_cast<int>(design);
  const auto& message = request.designs(d);
  const std::string path = item("designs", d);
  if (message.continues()) refuse_field(path + ".continues", "there is nothing that this design could continue");
  check_finite(message.variables(), path, ".variables");
  for (int k = 0; k < message.motions_size(); ++k) check_motion(message.motions(k), path + item(".motions", k));
}

void check_designs(const v1::DeformRequest& request, std::size_t max_designs) {
  check_design_count(request, max_designs);
  for (int d = 0; d < request.designs_size(); ++d) check_design(request, static_cast<std::size_t>(d));
}

namespace {

using HandleIndex = std::map<std::string_view, std::size_t>;

HandleIndex handle_index(const v1::SystemInfo& info) {
  HandleIndex handles;
  for (int h = 0; h < info.handles_size(); ++h) handles.emplace(info.handles(h).name(), static_cast<std::size_t>(h));
  return handles;
}

[[noreturn]] void refuse_handle(const std::string& name, const v1::SystemInfo& info, const std::string& path) {
  std::vector<std::string> names;
  for (const auto& handle : info.handles()) names.push_back(handle.name());
  const std::string near = nearest_names(name, names);
  refuse_field(path + ".handle",
               "the setup has no handle \"" + name + "\"" + (near.empty() ? "" : "; did you mean " + near + "?"));
}

Design convert(const v1::DeformRequest& request, int d, const v1::SystemInfo& info, const HandleIndex& handles) {
  const auto& message = request.designs(d);
  const std::string path = item("designs", d);
  const int variables = info.setup().variables_size();
  if (message.variables_size() != 0 && message.variables_size() != variables) {
    refuse_field(path + ".variables",
                 "expected none or " + std::to_string(variables) + " values, got " + std::to_string(message.variables_size()));
  }
  Design design;
  design.variables.assign(message.variables().begin(), message.variables().end());
  design.tolerance = request.solver_tolerance();
  for (int k = 0; k < message.motions_size(); ++k) {
    const auto& motion = message.motions(k);
    const std::string motion_path = path + item(".motions", k);
    const auto found = handles.find(motion.handle());
    if (found == handles.end()) refuse_handle(motion.handle(), info, motion_path);
    const std::size_t points = info.handles(static_cast<int>(found->second)).points();
    design.motions.push_back(convert(motion, found->second, points, motion_path));
  }
  return design;
}

}  // namespace

std::vector<Design> designs_from_proto(const v1::DeformRequest& request, const v1::SystemInfo& info) {
  const HandleIndex handles = handle_index(info);
  std::vector<Design> designs;
  for (int d = 0; d < request.designs_size(); ++d) designs.push_back(convert(request, d, info, handles));
  return designs;
}

Design design_from_proto(const v1::DeformRequest& request, std::size_t design, const v1::SystemInfo& info) {
  return convert(request, static_cast<int>(design), info, handle_index(info));
}

bool needs_solution(const v1::DeformRequest& request) {
  if (request.path() == v1::PATH_BASIS) return false;  // or refuse it
  bool direct = request.path() == v1::PATH_DIRECT || request.solver_tolerance() != 0;
  for (const auto& design : request.designs()) {
    for (const auto& motion : design.motions()) direct = direct || motion.displacements_size() > 0;
  }
  return direct;
}

std::size_t bind_bytes(const v1::DeformRequest& request, const v1::SystemInfo& info) {
  // One of several methods may take the direct path, as the handles turn, with displacements of its own handles' points.
  const bool several = info.setup().then_size() > 0;
  const bool direct = several || info.basis_fields() == 0 || needs_solution(request);
  const std::size_t designs = static_cast<std::size_t>(request.designs_size());
  const std::size_t affine_coefficients = 12 * static_cast<std::size_t>(info.handles_size()) * sizeof(double);
  // The direct path holds right-hand sides and weights, three columns each, and prescribed positions of the constraint points.
  const std::size_t direct_columns = 3 * sizeof(double) * (2 * info.centres() + (several ? 4 : 1) * info.constraint_points());
  return 2 * request.ByteSizeLong() + designs * (sizeof(Design) + affine_coefficients + (direct ? direct_columns : 0));
}

}  // namespace deform::convert
