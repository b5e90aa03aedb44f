// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/output/lattice_file.h"

#include <array>

#include "core/base/vectors.h"
#include "core/io/vtk_output.h"

namespace deform::cli {

namespace {

using io::VtkArray;

/// Points, and edges along the three axes.
Mesh lines_of(const Lattice& lattice, const std::vector<Vec3>& places) {
  Mesh mesh;
  mesh.points = places;
  const auto add = [&](std::size_t a, std::size_t b) {
    mesh.face_sizes.push_back(2);
    mesh.face_points.push_back(static_cast<PointId>(a));
    mesh.face_points.push_back(static_cast<PointId>(b));
  };
  const std::size_t l = lattice.axis(0).size(), m = lattice.axis(1).size(), n = lattice.axis(2).size();
  for (std::size_t k = 0; k < n; ++k) {
    for (std::size_t j = 0; j < m; ++j) {
      for (std::size_t i = 0; i < l; ++i) {
        const std::size_t here = lattice.number(i, j, k);
        if (i + 1 < l) add(here, lattice.number(i + 1, j, k));
        if (j + 1 < m) add(here, lattice.number(i, j + 1, k));
        if (k + 1 < n) add(here, lattice.number(i, j, k + 1));
      }
    }
  }
  return mesh;
}

VtkArray displacement_array(const std::vector<Vec3>& from, const std::vector<Vec3>& to) {
  VtkArray displacement{"displacement", 3, {}, VtkArray::Type::float64};
  for (std::size_t p = 0; p < from.size(); ++p) {
    for (const double u : to[p] - from[p]) displacement.values.push_back(u);
  }
  return displacement;
}

void add_regions(const std::vector<std::uint32_t>& labels, const std::vector<std::string>& handles, io::VtkArrays& arrays) {
  if (labels.empty()) return;
  arrays.points.push_back({"region", 1, {labels.begin(), labels.end()}, VtkArray::Type::int32});
  io::VtkTexts names{"region_names", {"other", "fixed"}};
  names.values.insert(names.values.end(), handles.begin(), handles.end());
  arrays.texts.push_back(std::move(names));
}

}  // namespace

void write_lattice(const LatticePicture& picture, const std::filesystem::path& path) {
  const Lattice& lattice = picture.lattice.lattice;
  const std::size_t l = lattice.axis(0).size(), m = lattice.axis(1).size();
  VtkArray index{"index", 3, {}, VtkArray::Type::int32};
  for (std::size_t p = 0; p < lattice.size(); ++p) {
    for (const std::size_t number : {p % l, p / l % m, p / l / m}) index.values.push_back(static_cast<double>(number));
  }
  io::VtkArrays arrays;
  arrays.points = {std::move(index), displacement_array(picture.lattice.places, picture.moved)};
  add_regions(picture.labels, picture.handles, arrays);
  io::write_vtp(lines_of(lattice, picture.moved), arrays, path);
}

void write_cage(const CagePicture& picture, const std::filesystem::path& path) {
  Mesh mesh;
  mesh.points = picture.moved;
  mesh.face_sizes.assign(picture.corners.size() / 3, 3);
  mesh.face_points = picture.corners;
  mesh.validate();
  VtkArray id{"id", 1, {}, VtkArray::Type::int32};
  for (std::size_t p = 0; p < mesh.point_count(); ++p) id.values.push_back(static_cast<double>(p));
  io::VtkArrays arrays;
  arrays.points = {std::move(id), displacement_array(picture.places, picture.moved)};
  add_regions(picture.labels, picture.handles, arrays);
  io::write_vtp(mesh, arrays, path);
}

}  // namespace deform::cli
