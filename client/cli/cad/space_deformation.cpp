// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/cad/space_deformation.h"

#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>

#include "client/cli/output/gates.h"
#include "client/cli/setup/control_lattice.h"
#include "client/cli/setup/reading.h"
#include "client/design.h"
#include "core/base/vectors.h"
#include "core/mesh/region.h"
#include "core/numerics/lattice/lattice_options.h"
#include "proto/convert/mesh/region.h"

namespace deform::cli {

namespace {

/// A name that no other run gives: what is deleted afterwards belongs to this one.
std::string run_name() {
  return "cad-apply " + std::to_string(::getpid()) + " " +
         std::to_string(std::chrono::system_clock::now().time_since_epoch().count());
}

Vec3 vec3_of(const google::protobuf::RepeatedField<double>& x) { return {x.at(0), x.at(1), x.at(2)}; }

}  // namespace

void check_space_method(const v1::Method& method) {
  const std::string others = "; choose rbf, ffd or cage";
  switch (method.kind_case()) {
    case v1::Method::kShell:
      return refuse(
          "method.shell: it moves the surface of the mesh and no other point of space, so the CAD model does not follow" +
          others);
    case v1::Method::kSubspace:
    case v1::Method::kMls:
      return refuse(std::string("method.") + (method.has_mls() ? "mls" : "subspace") +
                    ": its energy is integrated over the mesh, and would change with the points of the CAD model" + others);
    default:
      return;
  }
}

SpaceDeformation::SpaceDeformation(Connection& connection, const PreparedSetup& prepared, const std::vector<double>& values)
    : connection_(connection), setup_(prepared.system.setup()), mesh_(source_of(prepared).mesh()), values_(values) {
  check_space_method(setup_.method());
  extended_ = setup_;
  const bool controls = selects_controls(setup_);
  const auto freeze = [&](v1::Region& region, const std::string& what) {
    const std::vector<PointId> points = select(convert::region_from_proto(region, what), *mesh_, what);
    regions_.push_back({"region " + std::to_string(regions_.size()), points, {}});
    region.Clear();
    region.set_group(regions_.back().name);
  };
  if (!controls) {
    for (auto& handle : *extended_.mutable_handles()) freeze(*handle.mutable_region(), "handle \"" + handle.name() + "\"");
    for (int i = 0; i < extended_.fixed_size(); ++i) freeze(*extended_.mutable_fixed(i), "fixed[" + std::to_string(i) + "]");
    for (auto& constraint : *extended_.mutable_constraints()) {
      for (auto& region : *constraint.mutable_regions()) freeze(region, "constraint \"" + constraint.name() + "\"");
    }
  }
  for (int i = 0; i < setup_.symmetry_size(); ++i) {
    const auto& plane = setup_.symmetry(i);
    if (plane.has_sector()) {
      refuse("symmetry[" + std::to_string(i) + "].sector: not with CAD models; deform the model of the whole wheel");
    }
    if (plane.has_region()) {
      refuse("symmetry[" + std::to_string(i) +
             "]: give the plane by point and normal, so that the CAD model has exactly the same");
    }
    Plane kept{vec3_of(plane.point()), vec3_of(plane.normal())};
    kept.normal = kept.normal / norm(kept.normal);
    double farthest = 0;
    for (const Vec3& p : mesh_->points) {
      const double d = dot(p - kept.point, kept.normal);
      if (std::abs(d) > std::abs(farthest)) farthest = d;
    }
    if (farthest < 0) kept.normal = -1 * kept.normal;
    planes_.push_back(kept);
  }
  v1::Method& method = *extended_.mutable_method();
  if (method.has_rbf()) method.mutable_rbf()->set_basis(v1::BASIS_NEVER);
  if (method.has_cage()) method.mutable_cage()->set_basis(v1::BASIS_NEVER);
  if (method.has_ffd()) {
    auto& ffd = *method.mutable_ffd();
    if (ffd.control() != v1::CONTROLS) ffd.mutable_energy()->set_basis(v1::BASIS_NEVER);
    if (ffd.lattice().place_case() == v1::Lattice::PLACE_NOT_SET) {
      // As lattice_around() would place it around the mesh alone.
      const deform::Box box = bounding_box(mesh_->points);
      const double padding = LatticeOptions::automatic_padding * box.diagonal();
      auto& place = *ffd.mutable_lattice()->mutable_frame();
      for (int k = 0; k < 3; ++k) {
        place.add_origin(box.min[k] - padding);
        for (int j = 0; j < 3; ++j) place.add_axes(j == k ? box.max[k] - box.min[k] + 2 * padding : 0);
      }
    }
  }
  moved_mesh_ = deformed(prepared.system.id());
}

Points SpaceDeformation::deformed(const std::string& system) {
  v1::DeformRequest request;
  request.set_system_id(system);
  request.mutable_output()->set_encoding(v1::RAW_F64);
  request.set_check(v1::CELL_CHECK_OFF);
  *request.add_designs() = client::variables_design(values_);
  client::DeformOutcome outcome = connection_.client().deform(request, connection_.call());
  client::DeformedDesign& design = outcome.designs.at(0);
  const std::vector<std::string> reasons = bad_reasons(design.result);
  if (!reasons.empty()) throw Error(ErrorCode::failed_precondition, "the design is bad: " + reasons.front());
  if (calls_++ == 0) result_ = design.result;
  return std::move(design.points);
}

/// The mirror image on the side of the mesh, and the planes in which it was mirrored.
Vec3 SpaceDeformation::mirrored(Vec3 point, std::vector<int>& planes) const {
  for (int i = 0; i < static_cast<int>(planes_.size()); ++i) {
    const double d = dot(point - planes_[i].point, planes_[i].normal);
    if (d >= 0) continue;
    point = point - 2 * d * planes_[i].normal;
    planes.push_back(i);
  }
  return point;
}

Points SpaceDeformation::operator()(std::span<const Vec3> points) {
  const auto all = std::make_shared<Points>(mesh_->points);
  std::vector<std::vector<int>> planes(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) all->push_back(mirrored(points[i], planes[i]));
  client::GeometryArrays arrays;
  arrays.points = *all;
  arrays.face_sizes = mesh_->face_sizes;
  arrays.face_points = mesh_->face_points;
  for (const Group& group : regions_) arrays.groups.push_back({group.name, group.points, {}});
  arrays.name = run_name();
  const std::vector<PointId> first{0};
  arrays.groups.push_back({arrays.name, first, {}});  // makes the geometry one of this run
  const std::string id = connection_.client().register_geometry(arrays, connection_.call()).id();
  struct Deletion {
    Connection& connection;
    const std::string& geometry;
    ~Deletion() {
      v1::DeleteGeometryRequest request;
      request.set_id(geometry);
      request.set_with_setups(true);
      try {
        client::CallOptions options;  // also after Ctrl-C
        options.timeout = std::chrono::seconds(10);
        connection.client().delete_geometry(request, options);
      } catch (const Error& error) {
        warn("geometry " + geometry + " stays on the server: " + error.what());
      }
    }
  } const deletion{connection_, id};
  connection_.client().keep_points(id, all);
  extended_.set_geometry(id);
  const v1::SystemInfo system = connection_.client().prepare(extended_, connection_.call());
  Points moved = deformed(system.id());
  for (std::size_t i = 0; i < mesh_->point_count(); ++i) difference_ = std::max(difference_, distance(moved[i], moved_mesh_[i]));
  moved.erase(moved.begin(), moved.begin() + static_cast<std::ptrdiff_t>(mesh_->point_count()));
  for (std::size_t i = 0; i < moved.size(); ++i) {
    for (auto plane = planes[i].rbegin(); plane != planes[i].rend(); ++plane) {
      const Plane& mirror = planes_[*plane];
      moved[i] = moved[i] - 2 * dot(moved[i] - mirror.point, mirror.normal) * mirror.normal;
    }
  }
  return moved;
}

}  // namespace deform::cli
