// SPDX-License-Identifier: GPL-3.0-or-later
// Half models, and the whole ones that they were cut from.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <random>
#include <utility>
#include <vector>

#include "core/deformers/setup.h"
#include "core/deformers/system.h"
#include "core/mesh/mesh.h"

namespace deform::test {

/// Where the planes are: their normals are the first axes, and they meet in the origin.
struct Frame {
  Vec3 origin{0.3, -0.2, 0.1};
  std::array<Vec3, 3> axes{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};

  Vec3 vector(const Vec3& y) const {
    Vec3 v{};
    for (std::size_t k = 0; k < 3; ++k) {
      for (std::size_t i = 0; i < 3; ++i) v[i] += axes[k][i] * y[k];
    }
    return v;
  }
  Vec3 point(const Vec3& y) const {
    const Vec3 v = vector(y);
    return {origin[0] + v[0], origin[1] + v[1], origin[2] + v[2]};
  }
};

/// Parallel to nothing.
inline Frame oblique() {
  const double a = 0.7, b = 0.4, ca = std::cos(a), sa = std::sin(a), cb = std::cos(b), sb = std::sin(b);
  return {{10.3, -0.2, 3.1}, {{{ca * cb, sa * cb, sb}, {-sa, ca, 0}, {-ca * sb, -sa * sb, cb}}}};
}

/// A shaken grid of points in the octant of a frame, its corner a handle, the sides away from the corner fixed; `planes` of the
/// sides at the corner are symmetry planes.
struct HalfModel {
  HalfModel(std::size_t plane_count, const Frame& at, std::uint64_t seed = 1, std::size_t n = 5)
      : planes(plane_count), frame(at) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> uniform(-1, 1);
    setup.handles = {{"corner", {Region::Ids{}}}};
    setup.fixed = {{Region::Ids{}}};
    Mesh mesh;
    for (std::size_t i = 0; i < n * n * n; ++i) {
      const std::array<std::size_t, 3> step{i % n, i / n % n, i / n / n};
      Vec3 y{};
      unsigned on = 0;
      bool handle = true, fixed = false;
      for (std::size_t k = 0; k < 3; ++k) {
        const double width = 1 / static_cast<double>(n - 1);
        y[k] = width * (static_cast<double>(step[k]) + 0.2 * uniform(random));
        if (k < planes && step[k] == 0) {
          y[k] = 0;
          on |= 1u << k;
        }
        handle = handle && step[k] < 2;
        fixed = fixed || step[k] == n - 1;
      }
      const auto id = static_cast<PointId>(i);
      if (handle) std::get<Region::Ids>(setup.handles[0].region.kind).ids.push_back(id);
      if (fixed) std::get<Region::Ids>(setup.fixed[0].kind).ids.push_back(id);
      local.push_back(y);
      mask.push_back(on);
      mesh.points.push_back(frame.point(y));
      // Those of handle points that may be: along the planes.
      Vec3 u{0.1 * uniform(random), 0.1 * uniform(random), 0.1 * uniform(random)};
      for (std::size_t k = 0; k < planes; ++k) {
        if ((on >> k & 1u) != 0) u[k] = 0;
      }
      if (handle) displacements.push_back(u);
    }
    half = std::make_shared<const Mesh>(std::move(mesh));
    for (std::size_t k = 0; k < planes; ++k) setup.symmetry.push_back({SymmetryPlane::Plane{frame.origin, frame.axes[k]}});
  }

  const std::vector<PointId>& handle() const { return std::get<Region::Ids>(setup.handles[0].region.kind).ids; }

  Design design() const {
    std::vector<Vec3> u;
    for (const Vec3& v : displacements) u.push_back(frame.vector(v));
    return {{}, {{0, std::move(u)}}};
  }

  /// Largest distance of the points on planes from where they were along the normals.
  double out_of_planes(const Points& points) const {
    double largest = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
      for (std::size_t k = 0; k < planes; ++k) {
        double along = 0;
        for (std::size_t c = 0; c < 3; ++c) along += frame.axes[k][c] * (points[i][c] - half->points[i][c]);
        if ((mask[i] >> k & 1u) != 0) largest = std::max(largest, std::abs(along));
      }
    }
    return largest;
  }

  std::size_t planes;
  Frame frame;
  std::shared_ptr<const Mesh> half;
  deform::Setup setup;
  std::vector<Vec3> local;          ///< coordinates in the frame
  std::vector<unsigned> mask;       ///< of planes that a point is on
  std::vector<Vec3> displacements;  ///< of the handle's points, in the frame
};

/// All images of a half model: its points first.
struct WholeModel {
  explicit WholeModel(const HalfModel& of) {
    Mesh mesh = *of.half;
    setup = of.setup;
    setup.symmetry.clear();
    auto& handle = std::get<Region::Ids>(setup.handles[0].region.kind).ids;
    auto& fixed = std::get<Region::Ids>(setup.fixed[0].kind).ids;
    const std::vector<PointId> handles = handle, fixed_points = fixed;
    std::vector<Vec3> u;
    for (const Vec3& v : of.displacements) u.push_back(of.frame.vector(v));
    for (unsigned g = 1; g < 1u << of.planes; ++g) {
      const auto image = [&](Vec3 y) {
        for (std::size_t k = 0; k < of.planes; ++k) {
          if ((g >> k & 1u) != 0) y[k] = -y[k];
        }
        return y;
      };
      std::vector<PointId> id_of(of.local.size());
      for (std::size_t i = 0; i < of.local.size(); ++i) {
        if ((of.mask[i] & g) != 0) continue;
        id_of[i] = static_cast<PointId>(mesh.points.size());
        mesh.points.push_back(of.frame.point(image(of.local[i])));
      }
      for (std::size_t j = 0; j < handles.size(); ++j) {
        if ((of.mask[handles[j]] & g) != 0) continue;
        handle.push_back(id_of[handles[j]]);
        u.push_back(of.frame.vector(image(of.displacements[j])));
      }
      for (const PointId id : fixed_points) {
        if ((of.mask[id] & g) == 0) fixed.push_back(id_of[id]);
      }
    }
    whole = std::make_shared<const Mesh>(std::move(mesh));
    design = {{}, {{0, std::move(u)}}};
  }

  std::shared_ptr<const Mesh> whole;
  deform::Setup setup;
  Design design;
};

}  // namespace deform::test
