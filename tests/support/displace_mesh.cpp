// SPDX-License-Identifier: GPL-3.0-or-later
// usage: displace_mesh IN OUT
//
// Reads a mesh file and writes it with every point moved by a shear and a bump that depend on the bounding box only: exact
// arithmetic up to rounding, so that test_independent_readers.py computes the same from what another reader gave it. A mesh in a
// plane z = constant stays in it, since 2D formats have no z.
#include <cstdio>
#include <exception>

#include "core/base/types.h"
#include "core/io/mesh_file.h"

namespace {

deform::Points displaced(const deform::Points& points) {
  const deform::Box box = deform::bounding_box(points);
  const double size = box.diagonal();
  const bool flat = box.min[2] == box.max[2];
  deform::Points moved = points;
  for (deform::Vec3& p : moved) {
    double u[3], square = 0;  // from the middle of the box, in units of its diagonal
    for (int k = 0; k < 3; ++k) {
      u[k] = (p[k] - 0.5 * (box.min[k] + box.max[k])) / size;
      square += u[k] * u[k];
    }
    const double bump = 0.02 / (1 + 25 * square);
    p[0] += size * (0.03 * u[0] + 0.05 * u[1] + bump + 0.01);
    p[1] += size * (0.04 * u[0] - 0.02 * u[1] - bump);
    if (!flat) p[2] += size * (0.02 * u[0] + 0.03 * u[2] + 0.5 * bump);
  }
  return moved;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) {
    std::fprintf(stderr, "usage: displace_mesh IN OUT\n");
    return 2;
  }
  try {
    const auto file = deform::io::read_mesh_file(argv[1]);
    deform::io::write_mesh_file(*file, displaced(file->mesh()->points), argv[2]);
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "displace_mesh: %s\n", error.what());
    return 1;
  }
}
