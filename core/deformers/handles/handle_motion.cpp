// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/handles/handle_motion.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <map>

#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/base/vectors.h"
#include "core/compiled/motion.h"

namespace deform {

namespace {

constexpr double agreement = 1e-10;  // of D: how far apart coincident points may be sent

[[noreturn]] void invalid(const std::string& message) { throw Error(ErrorCode::invalid_argument, message); }
[[noreturn]] void invalid(std::size_t design, const std::string& message) {
  invalid("designs[" + std::to_string(design) + "]" + message);
}

}  // namespace

std::vector<Vec3> unit_places(const Mesh& mesh, const UnitBox& box, std::span<const PointId> ids) {
  std::vector<Vec3> places;
  places.reserve(ids.size());
  for (const PointId id : ids) places.push_back(box.to_unit(mesh.points[id]));
  return places;
}

void field_coefficients(const Affine& motion, MotionKind kind, const HandleFrame& frame, const UnitBox& box, double* out) {
  const double identity = kind == MotionKind::position ? 1.0 : 0.0;
  compiled::field_coefficients(motion, identity, {box.origin, box.scale, frame.reference, frame.axes}, out);
}

namespace {

void put_on_planes(const Mesh& mesh, const Symmetry& symmetry, const std::vector<PointId>& handle, const UnitBox& box,
                   HandleFrame& frame) {
  for (std::size_t k = 0; k < 3; ++k) {
    Vec3 e{};
    e[k] = 1;
    frame.axes[k] = symmetry.from_frame(e);
  }
  for (std::size_t k = 0; k < symmetry.planes(); ++k) {
    double nearest = std::numeric_limits<double>::infinity(), farthest = 0;
    bool on = false;
    for (const PointId id : handle) {
      const double away = std::abs(symmetry.coordinates(mesh.points[id])[k]);
      nearest = std::min(nearest, away);
      farthest = std::max(farthest, away);
      on = on || (symmetry.on(id) >> k & 1u) != 0;
    }
    if (!on && nearest > farthest - nearest) continue;
    const double away = symmetry.coordinates(box.to_model(frame.reference))[k] / box.scale;
    frame.reference = frame.reference - away * frame.axes[k];
  }
}

}  // namespace

std::vector<HandleFrame> handle_frames(const Mesh& mesh, const SelectedRegions& regions, const Symmetry& symmetry,
                                       const UnitBox& box) {
  std::vector<HandleFrame> frames;
  for (const auto& handle : regions.handles) {
    Box extent;
    for (const PointId id : handle) extent.add(box.to_unit(mesh.points[id]));
    HandleFrame frame;
    for (int k = 0; k < 3; ++k) frame.reference[k] = 0.5 * (extent.min[k] + extent.max[k]);
    if (!symmetry.empty()) put_on_planes(mesh, symmetry, handle, box, frame);
    frames.push_back(frame);
  }
  return frames;
}

bool BoundDesign::is_affine() const {
  return std::all_of(displacement.begin(), displacement.end(), [](const auto& d) { return d.empty(); });
}

BoundDesign HeldPoints::bound(const Design& design, std::size_t index) const {
  const std::size_t handles = setup.handles.size();
  BoundDesign result{std::vector<Affine>(handles, identity_affine), std::vector<std::vector<Vec3>>(handles), design.tolerance};
  if (!design.variables.empty()) {
    try {
      result.affine = handle_motions(setup, design.variables);
    } catch (const Error& error) {
      invalid(index, std::string(".") + error.what());
    }
  }
  std::vector<char> moved(handles);
  for (std::size_t k = 0; k < design.motions.size(); ++k) {
    const Motion& motion = design.motions[k];
    const std::string field = ".motions[" + std::to_string(k) + "]";
    if (motion.handle >= handles) {
      invalid(index, field + ".handle: " + std::to_string(motion.handle) + " is out of range, the setup has " +
                         std::to_string(handles) + " handles");
    }
    const std::string name = " (handle \"" + setup.handles[motion.handle].name + "\")";
    if (moved[motion.handle]++) invalid(index, field + name + ": the handle has two motions");
    if (result.affine[motion.handle] != identity_affine) {
      invalid(index, field + name + ": the handle is moved by design variables as well; set those to 0");
    }
    if (const auto* affine = std::get_if<Affine>(&motion.value)) {
      for (std::size_t j = 0; j < affine->size(); ++j) {
        if (!std::isfinite((*affine)[j]))
          invalid(index, field + ".affine[" + std::to_string(j) + "]" + name + ": must be finite");
      }
      result.affine[motion.handle] = *affine;
      continue;
    }
    const auto& displacement = std::get<std::vector<Vec3>>(motion.value);
    const std::size_t expected = regions.handles[motion.handle].size();
    if (displacement.size() != expected) {
      invalid(index, field + ".displacements" + name + ": expected " + std::to_string(expected) +
                         " vectors, one per point, got " + std::to_string(displacement.size()));
    }
    for (std::size_t j = 0; j < displacement.size(); ++j) {
      if (!std::isfinite(displacement[j][0] + displacement[j][1] + displacement[j][2])) {
        invalid(index, field + ".displacements[" + std::to_string(j) + "]" + name + ": must be finite");
      }
    }
    result.displacement[motion.handle] = displacement;
  }
  return result;
}

Vec3 HeldPoints::prescribed_position(const BoundDesign& design, PointId id, MotionKind kind) const {
  const RegionIndex region = region_of[id];
  const Vec3& x = mesh.points[id];
  if (region == fixed_region) return kind == MotionKind::position ? x : Vec3{};
  const auto& displacement = design.displacement[region];
  if (displacement.empty()) {
    // At rest exactly, not up to the rounding of 1 x + 0 y + 0 z + 0 with huge coordinates.
    return design.affine[region] == identity_affine ? x : transformed(design.affine[region], x);
  }
  const Vec3& u = displacement[rank_of[id]];
  return x + u;
}

Vec3 HeldPoints::place(const BoundDesign& design, PointId id, MotionKind kind) const {
  const Vec3 to = prescribed_position(design, id, kind);
  const unsigned on = symmetry.on(id);
  if (on == 0) return to;
  return symmetry.slid(kind == MotionKind::position ? mesh.points[id] : Vec3{}, to, on);
}

Vec3 HeldPoints::displacement(const BoundDesign& design, PointId id, MotionKind kind) const {
  const RegionIndex region = region_of[id];
  if (region == fixed_region) return {};
  Vec3 result{};
  if (!design.displacement[region].empty()) {
    result = design.displacement[region][rank_of[id]];
  } else {
    const Affine& map = design.affine[region];
    if (kind == MotionKind::position && map == identity_affine) return {};
    const Vec3& x = mesh.points[id];
    for (std::size_t k = 0; k < 3; ++k) {
      long double sum = map[4 * k + 3];
      for (std::size_t l = 0; l < 3; ++l) {
        const bool less_one = kind == MotionKind::position && k == l;
        sum += (static_cast<long double>(map[4 * k + l]) - (less_one ? 1 : 0)) * x[l];
      }
      result[k] = static_cast<double>(sum);
    }
  }
  const unsigned on = symmetry.on(id);
  return on == 0 ? result : symmetry.slid({}, result, on);
}

void HeldPoints::check_coincident(const BoundDesign& design, std::size_t index) const {
  const auto name = [&](PointId id) {
    const RegionIndex region = region_of[id];
    return std::to_string(id) + (region == fixed_region ? " (fixed)" : " (handle \"" + setup.handles[region].name + "\")");
  };
  for (const auto& cluster : coincident) {
    const Vec3 first = place(design, cluster[0], MotionKind::position);
    for (std::size_t k = 1; k < cluster.size(); ++k) {
      const double apart = distance(place(design, cluster[k], MotionKind::position), first);
      if (apart <= agreement * diagonal) continue;
      invalid(index, ": points " + name(cluster[0]) + " and " + name(cluster[k]) +
                         " coincide but are sent to places a distance of " + number_digits(apart) + " apart");
    }
  }
}

double HeldPoints::largest_displacement(const BoundDesign& design) const {
  double largest = 0;
  for (std::size_t h = 0; h < regions.handles.size(); ++h) {
    if (!design.moves(h)) continue;
    for (const PointId id : regions.handles[h]) {
      largest = std::max(largest, distance(place(design, id, MotionKind::position), mesh.points[id]));
    }
  }
  return largest;
}

double HeldPoints::largest_terms(const BoundDesign& design, double coordinate) const {
  double largest = 0;
  for (std::size_t h = 0; h < design.affine.size(); ++h) {
    if (design.moves(h)) largest = std::max(largest, compiled::largest_terms(design.affine[h], coordinate));
  }
  return largest;
}

std::vector<Affine> motion_derivative(const Setup& setup, std::span<const double> variables, std::span<const double> direction) {
  const std::size_t count = setup.variables.size();
  if (direction.size() != count) {
    invalid("direction: expected " + std::to_string(count) + " values, one per design variable, got " +
            std::to_string(direction.size()));
  }
  std::vector<Affine> motion(setup.handles.size(), Affine{});
  for (std::size_t k = 0; k < count; ++k) {
    if (!std::isfinite(direction[k])) invalid("direction[" + std::to_string(k) + "]: must be finite");
    const std::vector<Affine> derivative = handle_motion_derivative(setup, variables, k);
    for (std::size_t h = 0; h < motion.size(); ++h) {
      for (std::size_t j = 0; j < 12; ++j) motion[h][j] += direction[k] * derivative[h][j];
    }
  }
  return motion;
}

void check_cotangent(const Points& cotangent, std::size_t points) {
  if (cotangent.size() != points) {
    invalid("cotangent: expected " + std::to_string(points) + " vectors, one per point, got " + std::to_string(cotangent.size()));
  }
  for (std::size_t i = 0; i < cotangent.size(); ++i) {
    if (!std::isfinite(cotangent[i][0] + cotangent[i][1] + cotangent[i][2])) {
      invalid("cotangent[" + std::to_string(i) + "]: must be finite");
    }
  }
}

std::vector<double> variable_gradient(const HeldPoints& held, std::span<const double> variables, const Points& cotangent,
                                      std::span<const double> fields, const std::vector<HandleFrame>& frames,
                                      const UnitBox& box) {
  // Moments of the cotangent over the handle points: what an affine derivative there is multiplied with.
  std::vector<Affine> moments(frames.size(), Affine{});
  for (std::size_t h = 0; h < frames.size(); ++h) {
    for (const PointId id : held.regions.handles[h]) {
      const Vec3& x = held.mesh.points[id];
      const unsigned on = held.symmetry.on(id);
      const Vec3 along = on == 0 ? cotangent[id] : held.symmetry.slid({}, cotangent[id], on);
      for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) moments[h][4 * i + j] += along[i] * x[j];
        moments[h][4 * i + 3] += along[i];
      }
    }
  }
  std::vector<double> gradient(held.setup.variables.size(), 0.0);
  double block[12];
  for (std::size_t k = 0; k < gradient.size(); ++k) {
    const std::vector<Affine> derivative = handle_motion_derivative(held.setup, variables, k);
    for (std::size_t h = 0; h < frames.size(); ++h) {
      if (derivative[h] == Affine{}) continue;
      field_coefficients(derivative[h], MotionKind::derivative, frames[h], box, block);
      for (std::size_t j = 0; j < 12; ++j) gradient[k] += block[j] * fields[12 * h + j] + derivative[h][j] * moments[h][j];
    }
  }
  return gradient;
}

std::string scientific(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1e", value);
  return text;
}

std::size_t point_bytes(std::size_t n, const Symmetry& symmetry) {
  return n * (4 + 4 + 4 + 24 + 4 + (symmetry.empty() ? 0 : 1)) + (symmetry.is_sector() ? symmetry.sector().bytes() : 0) + 4096;
}

std::vector<std::size_t> driven_groups(const Setup& setup) {
  std::map<std::vector<std::size_t>, std::size_t> groups;
  std::vector<std::size_t> group_of;
  for (std::size_t h = 0; h < setup.handles.size(); ++h) {
    const std::string& name = setup.handles[h].name;
    std::vector<std::size_t> driven_by;
    for (std::size_t k = 0; k < setup.variables.size(); ++k) {
      const DesignVariable& variable = setup.variables[k];
      const bool drives = variable.handle == name || std::any_of(variable.also.begin(), variable.also.end(),
                                                                 [&](const DrivenHandle& also) { return also.handle == name; });
      if (drives) driven_by.push_back(k);
    }
    if (driven_by.empty()) driven_by.push_back(setup.variables.size() + h);
    const std::size_t next = groups.size();
    group_of.push_back(groups.emplace(driven_by, next).first->second);
  }
  return group_of;
}

}  // namespace deform
