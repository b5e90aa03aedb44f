// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <map>
#include <memory>
#include <utility>
#include <vector>

#include "tests/core/deformers/block_meshes.h"
#include "tests/core/mesh/polyhedral.h"
#include "tests/server/test_mesh.h"

namespace deform::server {

/// The unit cube in n x n x n hexahedra.
inline Mesh volume_mesh(std::size_t n) {
  test::Cube cube = test::cube(n);
  cube.mesh.elements = std::make_shared<const Elements>(std::move(cube.elements));
  return std::move(cube.mesh);
}

/// The same by its faces.
inline Mesh polyhedral_mesh(std::size_t n) {
  Mesh mesh = volume_mesh(n);
  mesh.cells = std::make_shared<const PolyhedralCells>(test::by_faces(*mesh.elements));
  mesh.elements = nullptr;
  return mesh;
}

/// block_setup() of block_meshes.h: the sides stay, the block between them turns about z and moves along x.
inline v1::Setup block_setup_message(const std::string& geometry_id, int dimensions) {
  v1::Setup setup;
  setup.set_geometry(geometry_id);
  const auto box = [](v1::Region& region, const Vec3& min, const Vec3& max) {
    for (const double x : min) region.mutable_box()->add_min(x);
    for (const double x : max) region.mutable_box()->add_max(x);
  };
  const double low = dimensions == 3 ? 0.399 : -1, high = dimensions == 3 ? 0.601 : 1;
  auto* handle = setup.add_handles();
  handle->set_name("block");
  box(*handle->mutable_region(), {0.399, 0.399, low}, {0.601, 0.601, high});
  for (std::size_t axis = 0; axis < static_cast<std::size_t>(dimensions); ++axis) {
    for (const double at : {0.0, 1.0}) {
      Vec3 min{-1, -1, -1}, max{2, 2, 2};
      min[axis] = at - 1e-9;
      max[axis] = at + 1e-9;
      box(*setup.add_fixed(), min, max);
    }
  }
  auto* turn = setup.add_variables();
  turn->set_name("turn");
  turn->set_handle("block");
  for (const double x : {0., 0., 1.}) turn->mutable_rotate()->add_axis(x);
  for (const double x : {0.5, 0.5, 0.}) turn->mutable_rotate()->add_centre(x);
  auto* shift = setup.add_variables();
  shift->set_name("shift");
  shift->set_handle("block");
  for (const double x : {1., 0., 0.}) shift->add_translate(x);
  return setup;
}

}  // namespace deform::server
