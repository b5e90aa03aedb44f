// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/bench/constraint_parts.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <string>
#include <utility>

#include "core/base/error.h"
#include "core/constraints/detection/detect.h"
#include "core/io/mesh_file.h"
#include "core/mesh/ahmed.h"
#include "tests/bench/refined.h"

namespace deform::bench {

namespace {

namespace fs = std::filesystem;

Region half_space(std::size_t axis, double from, double direction) {
  Region::InHalfSpace half;
  half.point[axis] = from;
  half.normal[axis] = direction;
  return {half};
}

bool has_car(const fs::path& data) { return !data.empty() && fs::exists(data / "A_surface" / "car_fastback.stl.gz"); }

/// The wall of a wheelhouse: along y, of circular section.
struct Wheelhouse {
  double x = 0, z = 0, radius = 0;
  double inner = 0, outer = 0;  ///< y
  std::vector<PointId> points;
};

Wheelhouse wheelhouse(const Mesh& mesh, const std::string& side) {
  const std::string name = "wheelhouse_" + side;
  Wheelhouse house;
  house.points = select({Region::GroupName{name}}, mesh, name);
  Box box;
  for (const PointId id : house.points) box.add(mesh.points[id]);
  house.radius = 0.5 * (box.max[0] - box.min[0]);
  house.x = 0.5 * (box.max[0] + box.min[0]);
  house.z = box.max[2] - house.radius;
  const bool left = box.min[1] < 0;
  house.inner = left ? box.max[1] : box.min[1];
  house.outer = left ? box.min[1] : box.max[1];
  return house;
}

/// The rim at that y.
Constraint rim(const Mesh& mesh, const Wheelhouse& house, const std::string& name, double y) {
  Region::Ids ids;
  for (const PointId id : house.points) {
    if (std::abs(mesh.points[id][1] - y) < 1e-6) ids.ids.push_back(id);
  }
  return {name, {{std::move(ids)}}, Circular{}};
}

/// Points of a stilt of the Ahmed body, on its cylinder.
Constraint stilt(const Mesh& mesh, const std::string& name, double side) {
  Region::Ids ids;
  Box box;
  const auto belongs = [&](const Vec3& x) { return x[0] < 0.4 && x[1] * side > 0; };
  const std::vector<PointId> stilts = select({Region::GroupName{"stilts"}}, mesh, name);
  for (const PointId id : stilts) {
    if (belongs(mesh.points[id])) box.add(mesh.points[id]);
  }
  const double radius = 0.5 * (box.max[0] - box.min[0]), x = box.min[0] + radius, y = 0.5 * (box.min[1] + box.max[1]);
  for (const PointId id : stilts) {
    const Vec3& p = mesh.points[id];
    if (belongs(p) && std::hypot(p[0] - x, p[1] - y) > (1 - 1e-6) * radius) ids.ids.push_back(id);
  }
  return {name, {{std::move(ids)}}, Cylindrical{}};
}

ConstraintCase part(const fs::path& file) {
  ConstraintCase result;
  result.name = file.stem().stem().string();
  result.mesh = io::read_mesh_file(file)->mesh();
  return result;
}

std::vector<PointId> without(std::vector<PointId> ids, const std::vector<char>& held) {
  ids.erase(std::remove_if(ids.begin(), ids.end(), [&](PointId id) { return held[id] != 0; }), ids.end());
  return ids;
}

/// 1 for points of handles and fixed regions.
std::vector<char> held_points(const ConstraintCase& of) {
  std::vector<char> held(of.mesh->point_count(), 0);
  for (const Handle& handle : of.setup.handles) {
    for (const PointId id : select(handle.region, *of.mesh, handle.name)) held[id] = 1;
  }
  for (const Region& region : of.setup.fixed) {
    for (const PointId id : select(region, *of.mesh, "fixed")) held[id] = 1;
  }
  return held;
}

}  // namespace

ConstraintCase joint_case(const fs::path& data) {
  ConstraintCase joint = part(data / "A_surface" / "joint_remeshed.off.gz");
  const Box box = bounding_box(joint.mesh->points);
  const double margin = 1e-4 * (box.max[2] - box.min[2]);
  joint.setup.handles = {{"top", half_space(2, box.max[2] - margin, 1)}};
  joint.setup.fixed = {half_space(2, box.min[2] + margin, -1)};
  joint.design.motions.push_back({0, Affine{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0.3}});
  const Detection found = detect(*joint.mesh, {});
  double longest = 0;
  for (const EdgeFeature& edge : found.edges) {
    if (edge.kind == EdgeKind::circle) longest = std::max(longest, edge.length);
  }
  for (const EdgeFeature& edge : found.edges) {
    if (edge.kind != EdgeKind::circle || edge.length < 0.99 * longest) continue;
    joint.setup.constraints.push_back({edge.name, {{Region::Ids{edge.points}}}, Circular{}});
  }
  return joint;
}

ConstraintCase fandisk_case(const fs::path& data) {
  ConstraintCase fandisk = part(data / "A_surface" / "fandisk.off.gz");
  const Box box = bounding_box(fandisk.mesh->points);
  const double height = box.max[2] - box.min[2];
  fandisk.setup.handles = {{"end", half_space(2, box.max[2] - 0.15 * height, 1)}};
  fandisk.setup.fixed = {half_space(2, box.min[2] + 0.15 * height, -1)};
  fandisk.design.motions.push_back({0, Affine{1, 0, 0, -0.25, 0, 1, 0, 0.1, 0, 0, 1, 0}});
  const std::vector<char> held = held_points(fandisk);
  const Detection found = detect(*fandisk.mesh, {});
  // What is not held of the longest edges, at least ten points of each, and of the largest plane.
  for (const EdgeFeature& edge : found.edges) {
    std::vector<PointId> ids = without(edge.points, held);
    if (ids.size() < 10 || fandisk.setup.constraints.size() == 4) continue;
    fandisk.setup.constraints.push_back({edge.name, {{Region::Ids{std::move(ids)}}}, FeatureLine{}});
  }
  const Primitive* largest = nullptr;
  std::size_t most = 0;
  for (const Primitive& primitive : found.primitives) {
    const std::size_t free = without(primitive.points, held).size();
    if (primitive.kind == PrimitiveKind::plane && free > most) {
      most = free;
      largest = &primitive;
    }
  }
  if (largest == nullptr) throw Error(ErrorCode::internal, "no plane was found on the fandisk");
  fandisk.setup.constraints.push_back({largest->name, {{Region::Ids{without(largest->points, held)}}}, Planar{}});
  return fandisk;
}

Mesh car_body(const fs::path& data, std::size_t points) {
  if (!has_car(data)) return ahmed_body({.target_points = points});
  Mesh mesh = refined(*io::read_mesh_file(data / "A_surface" / "car_fastback.stl.gz")->mesh(), points);
  for (const char* side : {"fl", "fr", "rl", "rr"}) {  // middles of chords out to the circle
    const Wheelhouse house = wheelhouse(mesh, side);
    for (const PointId id : house.points) {
      Vec3& p = mesh.points[id];
      const double out = house.radius / std::hypot(p[0] - house.x, p[2] - house.z);
      p[0] = house.x + out * (p[0] - house.x);
      p[2] = house.z + out * (p[2] - house.z);
    }
  }
  return mesh;
}

ConstraintCase stretched_car(const fs::path& data, std::size_t points) {
  ConstraintCase car;
  Mesh mesh = car_body(data, points);
  if (has_car(data)) {
    car.name = "car_fastback";
    car.setup.handles = {{"front", half_space(0, 0.3, -1)}};
    car.setup.fixed = {half_space(0, 1.8, 1)};
    car.setup.variables = {{"stretch", "front", DesignVariable::Translate{{-1, 0, 0}}}};
    car.design.variables = {0.3};
    for (const char* side : {"fl", "fr"}) {
      const Wheelhouse house = wheelhouse(mesh, side);
      car.setup.constraints.push_back(rim(mesh, house, std::string("outer_") + side, house.outer));
      car.setup.constraints.push_back(rim(mesh, house, std::string("inner_") + side, house.inner));
    }
  } else {
    car.name = "Ahmed body";
    car.setup.handles = {{"front", half_space(0, 0.06, -1)}};
    car.setup.fixed = {half_space(0, 0.5, 1)};
    car.setup.variables = {{"stretch", "front", DesignVariable::Translate{{-1, 0, 0}}}};
    car.design.variables = {0.1};
    car.setup.constraints = {stilt(mesh, "stilt_left", -1), stilt(mesh, "stilt_right", 1)};
  }
  car.mesh = std::make_shared<const Mesh>(std::move(mesh));
  return car;
}

}  // namespace deform::bench
