// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/energy/spaces/mesh_pieces.h"

#include <algorithm>
#include <cmath>

#include "core/base/vectors.h"
#include "core/deformers/energy/spaces/enclosed_pieces.h"
#include "core/mesh/cells.h"
#include "core/mesh/elements.h"

namespace deform {

namespace {

double area(const Vec3& a, const Vec3& b, const Vec3& c) { return 0.5 * length(cross(b - a, c - a)); }
double volume(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d) {
  return std::abs(dot(cross(b - a, c - a), d - a)) / 6;
}

/// A part of [0, 1) that belongs to one of several shares of a total: which, and where in it, again in [0, 1).
class Pick {
 public:
  Pick(double random, double total) : left_(random * total) {}
  /// True when it is in this share, the next one.
  bool in(double share) {
    if (left_ >= share) {
      left_ -= share;
      return false;
    }
    left_ = std::min(left_ / share, 1 - 0x1p-53);
    return true;
  }
  double rest() const { return left_; }

 private:
  double left_;
};

/// All of space around points.
class BoxPieces : public Pieces {
 public:
  explicit BoxPieces(std::span<const Vec3> points) {
    for (const Vec3& x : points) box_.add(x);
    const double margin = 0.05 * box_.diagonal();
    for (std::size_t k = 0; k < 3; ++k) {
      box_.min[k] -= margin;
      box_.max[k] += margin;
    }
  }
  std::size_t count() const override { return 1; }
  double measure(std::size_t /*piece*/) const override {
    return (box_.max[0] - box_.min[0]) * (box_.max[1] - box_.min[1]) * (box_.max[2] - box_.min[2]);
  }
  Vec3 place(std::size_t /*piece*/, const Vec3& random) const override {
    Vec3 x;
    for (std::size_t k = 0; k < 3; ++k) x[k] = box_.min[k] + random[k] * (box_.max[k] - box_.min[k]);
    return x;
  }

 private:
  Box box_;
};

}  // namespace

FacePieces::FacePieces(const Mesh& mesh, std::span<const Vec3> points)
    : mesh_(mesh), points_(points), offsets_(mesh.face_offsets()) {}

std::size_t FacePieces::count() const { return mesh_.face_count(); }

double FacePieces::measure(std::size_t face) const {
  const PointId* corners = mesh_.face_points.data() + offsets_[face];
  double sum = 0;
  for (std::size_t i = 2; i < mesh_.face_sizes[face]; ++i) {
    sum += area(points_[corners[0]], points_[corners[i - 1]], points_[corners[i]]);
  }
  return sum;
}

Vec3 FacePieces::place(std::size_t face, const Vec3& random) const {
  const PointId* corners = mesh_.face_points.data() + offsets_[face];
  Pick pick(random[2], measure(face));
  std::size_t i = 2;
  while (i + 1 < mesh_.face_sizes[face] && !pick.in(area(points_[corners[0]], points_[corners[i - 1]], points_[corners[i]]))) ++i;
  return place_in_triangle(points_[corners[0]], points_[corners[i - 1]], points_[corners[i]], random);
}

CellPieces::CellPieces(const Mesh& mesh, std::span<const Vec3> points) : mesh_(mesh), points_(points) {
  if (!mesh.cells) return;
  const PolyhedralCells& cells = *mesh.cells;
  cell_starts_.assign(cells.cell_count + 1, 0);
  const auto each = [&](const auto& use) {
    for (std::size_t f = 0; f < cells.face_count(); ++f) {
      use(cells.owner[f], f);
      if (f < cells.internal_faces()) use(cells.neighbour[f], f);
    }
  };
  each([&](std::uint32_t cell, std::size_t /*face*/) { ++cell_starts_[cell + 1]; });
  for (std::size_t c = 0; c < cells.cell_count; ++c) cell_starts_[c + 1] += cell_starts_[c];
  cell_faces_.resize(cell_starts_.back());
  std::vector<std::uint64_t> next(cell_starts_.begin(), cell_starts_.end() - 1);
  each([&](std::uint32_t cell, std::size_t face) { cell_faces_[next[cell]++] = static_cast<std::uint32_t>(face); });
}

std::size_t CellPieces::count() const { return mesh_.cell_count(); }

template <typename Use>
void CellPieces::triangles(std::size_t cell, const Use& use) const {
  if (mesh_.elements) {
    const auto nodes = mesh_.elements->nodes(cell);
    for (const auto& face : shape(mesh_.elements->types[cell]).faces) {
      for (std::size_t i = 2; i < face.size(); ++i) {
        use(points_[nodes[face[0]]], points_[nodes[face[i - 1]]], points_[nodes[face[i]]]);
      }
    }
    return;
  }
  for (std::uint64_t at = cell_starts_[cell]; at < cell_starts_[cell + 1]; ++at) {
    const auto face = mesh_.cells->face(cell_faces_[at]);
    for (std::size_t i = 2; i < face.size(); ++i) use(points_[face[0]], points_[face[i - 1]], points_[face[i]]);
  }
}

Vec3 CellPieces::middle(std::size_t cell) const {
  Vec3 sum{};
  double count = 0;
  triangles(cell, [&](const Vec3& a, const Vec3& b, const Vec3& c) {
    sum = sum + (a + b + c);
    count += 3;
  });
  return count > 0 ? sum / count : sum;
}

double CellPieces::measure(std::size_t cell) const {
  const Vec3 centre = middle(cell);
  double sum = 0;
  triangles(cell, [&](const Vec3& a, const Vec3& b, const Vec3& c) { sum += volume(centre, a, b, c); });
  return sum;
}

Vec3 CellPieces::place(std::size_t cell, const Vec3& random) const {
  const Vec3 centre = middle(cell);
  Pick pick(random[0], measure(cell));
  Vec3 x = centre;
  bool found = false;
  triangles(cell, [&](const Vec3& a, const Vec3& b, const Vec3& c) {
    if (found || !pick.in(volume(centre, a, b, c))) return;
    found = true;
    x = place_in_tetrahedron(centre, a, b, c, {pick.rest(), random[1], random[2]});
  });
  return x;
}

DensePoints dense_points(const Mesh& mesh, std::span<const Vec3> points, const DenseCounts& counts, std::uint64_t seed,
                         const RunContext& context) {
  DensePoints dense;
  UniformSamples surface = sample_uniformly(FacePieces(mesh, points), counts.surface, seed, context);
  UniformSamples volume;
  if (mesh.cell_count() != 0) {
    volume = sample_uniformly(CellPieces(mesh, points), counts.volume, seed + 1, context);
  } else if (counts.volume != 0) {
    if (counts.volume_of != VolumeOf::box) {
      const EnclosedPieces enclosed(mesh, points, surface.points, seed + 1, context);
      volume = sample_uniformly(enclosed, counts.volume, seed + 1, context);
      dense.enclosed = !volume.points.empty();
    }
    if (volume.points.empty() && counts.volume_of != VolumeOf::enclosed)
      volume = sample_uniformly(BoxPieces(points), counts.volume, seed + 1, context);
  }
  if (surface.points.empty() && mesh.cell_count() == 0) {
    surface.points.assign(points.begin(), points.end());
    surface.measure = 1;
    dense.uniform = false;
  }
  dense.points = std::move(surface.points);
  dense.surface = dense.points.size();
  dense.area = surface.measure;
  dense.volume = volume.measure;
  dense.points.insert(dense.points.end(), volume.points.begin(), volume.points.end());
  return dense;
}

}  // namespace deform
