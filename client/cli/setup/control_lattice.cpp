// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/setup/control_lattice.h"

#include <algorithm>

#include "client/cli/setup/prescribed_places.h"
#include "client/cli/setup/reading.h"
#include "core/base/error.h"
#include "core/base/vectors.h"
#include "core/mesh/region.h"
#include "proto/convert/controls/controls.h"
#include "proto/convert/mesh/region.h"

namespace deform::cli {

namespace {

/// The box of the mesh with its images in the planes.
Box whole_box(const std::vector<std::optional<client::MirrorPlane>>& planes, const Mesh& mesh) {
  for (std::size_t k = 0; k < planes.size(); ++k) {
    if (planes[k]) continue;
    refuse("box: an automatic lattice surrounds the model with its mirror images, but symmetry[" + std::to_string(k) +
           "] is a region that is not perpendicular to an axis; give `box` or `frame`");
  }
  return bounding_box(client::whole_model(mesh, planes).points);
}

}  // namespace

void move_images(const std::vector<std::optional<client::MirrorPlane>>& planes, const std::vector<Vec3>& at_rest,
                 std::vector<Vec3>& moved) {
  const double near = client::MirrorPlane::flatness * bounding_box(at_rest).diagonal();
  for (const auto& plane : planes) {
    if (!plane) continue;
    const std::vector<Vec3> before = moved;
    for (std::size_t p = 0; p < at_rest.size(); ++p) {
      if (before[p] == at_rest[p]) continue;
      const Vec3 image = plane->reflected(at_rest[p]);
      if (distance(at_rest[p], image) <= near) {  // in the plane, along which it moves
        moved[p] = 0.5 * (before[p] + plane->reflected(before[p]));
        continue;
      }
      for (std::size_t q = 0; q < at_rest.size(); ++q) {
        if (distance(at_rest[q], image) > near || before[q] != at_rest[q]) continue;
        moved[q] = plane->reflected(before[p]);
      }
    }
  }
}

bool selects_controls(const v1::Setup& setup) {
  if (setup.method().has_cage()) return setup.method().cage().control() != v1::MESH;
  return setup.method().has_ffd() && setup.method().ffd().control() == v1::CONTROLS;
}

std::vector<Vec3> control_places(const v1::Setup& setup, const Mesh& mesh) {
  if (!setup.method().has_cage()) return control_lattice(setup, mesh).places;
  const auto& numbers = setup.method().cage().vertices();
  std::vector<Vec3> places(static_cast<std::size_t>(numbers.size()) / 3);
  for (std::size_t i = 0; i < 3 * places.size(); ++i) places[i / 3][i % 3] = numbers[static_cast<int>(i)];
  return places;
}

std::vector<PointId> control_points_of(const v1::Region& region, const v1::Setup& setup, const Mesh& mesh,
                                       const std::string& what) {
  if (!setup.method().has_cage()) return control_points_of(region, control_lattice(setup, mesh), what);
  return select_controls(convert::region_from_proto(region, what), cage_controls(setup), what);
}

ControlSet ControlLattice::controls() const {
  return {lattice.size(), {{lattice.axis(0).size(), lattice.axis(1).size(), lattice.axis(2).size()}}};
}

ControlLattice control_lattice(const v1::Setup& setup, const Mesh& mesh) {
  if (!setup.method().has_ffd()) refuse("method: only method.ffd has a lattice");
  const std::string field = "method.ffd.lattice";
  LatticeOptions options = convert::lattice_from_proto(setup.method().ffd().lattice());
  try {
    const Box box = options.frame ? bounding_box(mesh.points) : whole_box(client::mirror_planes(setup, mesh), mesh);
    ControlLattice made{lattice_around(options, box), std::move(options.control_points)};
    if (made.places.empty()) made.places = made.lattice.control_points();
    if (made.places.size() == made.lattice.size()) return made;
    refuse("control_points: " + std::to_string(made.places.size()) + " for a lattice of " + std::to_string(made.lattice.size()));
  } catch (const Error& error) {
    refuse(field + ": " + error.what());
  }
}

std::vector<PointId> control_points_of(const v1::Region& region, const ControlLattice& lattice, const std::string& what) {
  return select_controls(convert::region_from_proto(region, what), lattice.controls(), what);
}

ControlSet cage_controls(const v1::Setup& setup) { return {static_cast<std::size_t>(setup.method().cage().vertices_size()) / 3}; }

std::vector<std::uint32_t> control_labels(const v1::Setup& setup, const ControlSet& controls) {
  std::vector<std::uint32_t> labels(controls.size, 0);
  const auto mark = [&](const v1::Region& region, std::uint32_t label, const std::string& what) {
    for (const PointId p : select_controls(convert::region_from_proto(region, what), controls, what)) labels[p] = label;
  };
  for (int i = 0; i < setup.fixed_size(); ++i) mark(setup.fixed(i), 1, "fixed[" + std::to_string(i) + "]");
  for (int i = setup.handles_size() - 1; i >= 0; --i) {
    mark(setup.handles(i).region(), static_cast<std::uint32_t>(2 + i), "handle \"" + setup.handles(i).name() + "\"");
  }
  return labels;
}

std::vector<Vec3> moved_controls(const v1::Setup& setup, const ControlLattice& lattice, const std::vector<double>& values) {
  return moved_controls(setup, lattice.controls(), lattice.places, values);
}

std::vector<Vec3> moved_controls(const v1::Setup& setup, const ControlSet& controls, const std::vector<Vec3>& at_rest,
                                 const std::vector<double>& values) {
  std::vector<Vec3> places = at_rest;
  for (const auto& handle : setup.handles()) {
    const Affine motion = handle_motion(setup, handle.name(), values);
    if (motion == identity_affine) continue;
    const std::string what = "handle \"" + handle.name() + "\"";
    for (const PointId p : select_controls(convert::region_from_proto(handle.region(), what), controls, what)) {
      places[p] = transformed(motion, at_rest[p]);
    }
  }
  return places;
}

}  // namespace deform::cli
