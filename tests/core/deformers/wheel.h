// SPDX-License-Identifier: GPL-3.0-or-later
// Sectors of wheels, and the whole wheels that they were cut from.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <numbers>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "core/base/vectors.h"
#include "core/deformers/setup.h"
#include "core/deformers/system.h"
#include "core/mesh/elements.h"
#include "core/mesh/mesh.h"
#include "tests/core/deformers/mirrored.h"

namespace deform::test {

struct SectorShape {
  std::size_t count = 7;                            ///< sectors of the wheel
  double hub = 0.4;                                 ///< radius; 0: a wheel without a hole, with points on the axis
  std::uint64_t seed = 1;                           ///< of the shaken points; of odd ones the second boundary has the smaller ids
  std::size_t around = 4, outwards = 4, along = 3;  ///< cells
};

/// A sector of shaken hexahedra between twisted periodic boundaries, around the first axis of a frame. The blade in the middle is
/// a handle; hub and casing are fixed, inlet and outlet are free.
struct SectorModel {
  explicit SectorModel(const SectorShape& given, const Frame& at = {}) : shape(given), frame(at) {
    std::mt19937_64 random(shape.seed);
    std::uniform_real_distribution<double> uniform(-1, 1);
    const auto [nt, nr, nz] = std::array<std::size_t, 3>{shape.around, shape.outwards, shape.along};
    const double pitch = 2 * std::numbers::pi / static_cast<double>(shape.count);
    ids.assign((nt + 1) * (nr + 1) * (nz + 1), 0);
    setup.handles = {{"blade", {Region::Ids{}}}};
    Region::Ids fixed;
    std::vector<Vec3> low;  // in the order of j, k
    for (std::size_t j = 0; j <= nr; ++j) {
      for (std::size_t k = 0; k <= nz; ++k) {
        const bool on_axis = shape.hub == 0 && j == 0;
        const double r = shape.hub + (1 - shape.hub) * (static_cast<double>(j) + 0.15 * uniform(random) * inner(j, nr)) /
                                         static_cast<double>(nr);
        const double z = 0.8 * (static_cast<double>(k) + 0.15 * uniform(random)) / static_cast<double>(nz);
        const double angle = pitch * (0.4 * z - 0.2 * r);
        low.push_back(on_axis ? Vec3{z, 0, 0} : Vec3{z, r * std::cos(angle), r * std::sin(angle)});
      }
    }
    for (std::size_t step = 0; step <= nt; ++step) {
      const std::size_t i = shape.seed % 2 == 1 ? nt - step : step;
      for (std::size_t j = 0; j <= nr; ++j) {
        for (std::size_t k = 0; k <= nz; ++k) {
          Vec3 y = low[j * (nz + 1) + k];
          const bool on_axis = shape.hub == 0 && j == 0;
          PointId& id = ids[(i * (nr + 1) + j) * (nz + 1) + k];
          if (on_axis && step > 0) {
            id = at_grid(shape.seed % 2 == 1 ? nt : 0, j, k);
            continue;
          }
          id = static_cast<PointId>(local.size());
          if (!on_axis) {
            const double shake = inner(i, nt) * 0.15;
            y = turned(y, (static_cast<double>(i) + shake * uniform(random)) / static_cast<double>(nt));
            y[0] += shake * 0.2 * uniform(random);
          }
          if (i == 0 && !on_axis) lows.push_back(id);
          if (i == nt && !on_axis) highs.push_back(id);
          if (on_axis) axis.push_back(id);
          const bool wall = j == nr || (j == 0 && !on_axis);
          const bool blade = inner(i, nt) != 0 && inner(j, nr) != 0 && inner(k, nz) != 0 && j < nr - 1;
          if (wall) fixed.ids.push_back(id);
          if (blade) handle_ids().push_back(id);
          local.push_back(y);
        }
      }
    }
    setup.fixed = {{fixed}};
    Mesh mesh;
    for (const Vec3& y : local) mesh.points.push_back(frame.point(y));
    add_faces(mesh);
    sector = std::make_shared<const Mesh>(std::move(mesh));
    setup.symmetry = {{SectorOptions{frame.origin, frame.axes[0], static_cast<std::uint32_t>(shape.count)}}};
    for (std::size_t i = 0; i < handle().size(); ++i)
      displacements.push_back({0.05 * uniform(random), 0.05 * uniform(random), 0.05 * uniform(random)});
  }

  static double inner(std::size_t i, std::size_t n) { return i > 0 && i < n ? 1 : 0; }
  PointId at_grid(std::size_t i, std::size_t j, std::size_t k) const {
    return ids[(i * (shape.outwards + 1) + j) * (shape.along + 1) + k];
  }
  std::vector<PointId>& handle_ids() { return std::get<Region::Ids>(setup.handles[0].region.kind).ids; }
  const std::vector<PointId>& handle() const { return std::get<Region::Ids>(setup.handles[0].region.kind).ids; }

  /// In the frame, by a number of sectors.
  Vec3 turned(const Vec3& y, double sectors) const {
    const double angle = 2 * std::numbers::pi * sectors / static_cast<double>(shape.count);
    return {y[0], std::cos(angle) * y[1] - std::sin(angle) * y[2], std::sin(angle) * y[1] + std::cos(angle) * y[2]};
  }
  /// A place of the model by a number of sectors.
  Vec3 turned_point(const Vec3& x, double sectors) const {
    Vec3 y{};
    for (std::size_t k = 0; k < 3; ++k) y[k] = dot(frame.axes[k], x - frame.origin);
    return frame.point(turned(y, sectors));
  }

  /// A motion of the blade, in model coordinates: turned about a radius, stretched, moved in all directions.
  Affine motion() const {
    const double c = std::cos(0.2), s = std::sin(0.2);
    const double linear[3][3] = {{c, 0, -s}, {0, 1.1, 0}, {s, 0, c}};
    const Vec3 shift{0.02, -0.03, 0.05};
    Affine result{};
    for (std::size_t i = 0; i < 3; ++i) {
      for (std::size_t j = 0; j < 3; ++j) {
        for (std::size_t a = 0; a < 3; ++a) {
          for (std::size_t b = 0; b < 3; ++b) result[4 * i + j] += frame.axes[a][i] * linear[a][b] * frame.axes[b][j];
        }
        result[4 * i + 3] -= result[4 * i + j] * frame.origin[j];
      }
      result[4 * i + 3] += frame.origin[i] + frame.vector(shift)[i];
    }
    return result;
  }
  Design affine_design() const { return {{}, {{0, motion()}}}; }
  /// Displacements of each point of the blade.
  Design design() const {
    std::vector<Vec3> u;
    for (const Vec3& v : displacements) u.push_back(frame.vector(v));
    return {{}, {{0, std::move(u)}}};
  }

  /// Largest distance of the second partners from the images of the first, and of points that were on the axis from it.
  double out_of_turn(const Points& points) const {
    double largest = 0;
    for (std::size_t p = 0; p < lows.size(); ++p) {
      largest = std::max(largest, distance(points[highs[p]], turned_point(points[lows[p]], 1)));
    }
    for (const PointId id : axis)
      largest = std::max(largest, distance(points[id], turned_point(points[id], 0.25 * static_cast<double>(shape.count))));
    return largest;
  }

  SectorShape shape;
  Frame frame;
  std::shared_ptr<const Mesh> sector;
  deform::Setup setup;
  std::vector<Vec3> local;           ///< coordinates in the frame
  std::vector<PointId> ids;          ///< of the grid
  std::vector<PointId> lows, highs;  ///< partners
  std::vector<PointId> axis;         ///< points on it
  std::vector<Vec3> displacements;   ///< of the blade's points, in the frame

 private:
  void add_faces(Mesh& mesh) const {
    const auto [nt, nr, nz] = std::array<std::size_t, 3>{shape.around, shape.outwards, shape.along};
    auto elements = std::make_shared<Elements>();
    const auto face = [&](std::array<PointId, 4> corners) {
      std::vector<PointId> kept;
      for (const PointId id : corners) {
        if (std::find(kept.begin(), kept.end(), id) == kept.end()) kept.push_back(id);
      }
      if (kept.size() < 3) return;
      mesh.face_sizes.push_back(static_cast<std::uint32_t>(kept.size()));
      mesh.face_points.insert(mesh.face_points.end(), kept.begin(), kept.end());
    };
    for (std::size_t i = 0; i < nt; ++i) {
      for (std::size_t j = 0; j < nr; ++j) {
        for (std::size_t k = 0; k < nz; ++k) {
          // Axial, outwards and around are right-handed.
          const auto p = [&](std::size_t a, std::size_t b, std::size_t c) { return at_grid(i + a, j + b, k + c); };
          const std::array<PointId, 8> hexahedron{p(0, 0, 0), p(0, 0, 1), p(0, 1, 1), p(0, 1, 0),
                                                  p(1, 0, 0), p(1, 0, 1), p(1, 1, 1), p(1, 1, 0)};
          const std::array<PointId, 6> prism{p(0, 0, 0), p(0, 1, 0), p(1, 1, 0), p(0, 0, 1), p(0, 1, 1), p(1, 1, 1)};
          if (shape.hub == 0 && j == 0) {
            elements->add(ElementType::prism, prism);
          } else {
            elements->add(ElementType::hexahedron, hexahedron);
          }
          if (i == 0) face({p(0, 0, 0), p(0, 1, 0), p(0, 1, 1), p(0, 0, 1)});
          if (i + 1 == nt) face({p(1, 0, 0), p(1, 0, 1), p(1, 1, 1), p(1, 1, 0)});
          if (j == 0) face({p(0, 0, 0), p(0, 0, 1), p(1, 0, 1), p(1, 0, 0)});
          if (j + 1 == nr) face({p(0, 1, 0), p(1, 1, 0), p(1, 1, 1), p(0, 1, 1)});
          if (k == 0) face({p(0, 0, 0), p(1, 0, 0), p(1, 1, 0), p(0, 1, 0)});
          if (k + 1 == nz) face({p(0, 0, 1), p(0, 1, 1), p(1, 1, 1), p(1, 0, 1)});
        }
      }
    }
    mesh.elements = elements;
  }
};

/// The surface of the casing: its middle a handle, its inlet fixed. It has 8 cells along, and at least 5 around.
inline SectorModel casing(const SectorShape& shape, const Frame& frame) {
  SectorModel model(shape, frame);
  const std::size_t outer = model.shape.outwards, nt = model.shape.around, nz = model.shape.along;
  SectorModel result = model;
  Mesh mesh;
  result.local.clear();
  result.lows.clear();
  result.highs.clear();
  result.displacements.clear();
  Region::Ids handle, fixed;
  for (std::size_t i = 0; i <= nt; ++i) {
    for (std::size_t k = 0; k <= nz; ++k) {
      const auto id = static_cast<PointId>(result.local.size());
      const Vec3& y = model.local[model.at_grid(i, outer, k)];
      result.local.push_back(y);
      mesh.points.push_back(frame.point(y));
      if (i == 0) result.lows.push_back(id);
      if (i == nt) result.highs.push_back(id);
      if (k == 0) fixed.ids.push_back(id);
      if (k > 3 && k < 6 && i > 1 && i + 1 < nt) {
        handle.ids.push_back(id);
        result.displacements.push_back({0.02, 0.1 * std::sin(static_cast<double>(id)), 0.05});
      }
    }
  }
  for (std::size_t i = 0; i < nt; ++i) {
    for (std::size_t k = 0; k < nz; ++k) {
      const auto at = static_cast<PointId>(i * (nz + 1) + k), next = static_cast<PointId>(at + nz + 1);
      mesh.face_sizes.push_back(4);
      mesh.face_points.insert(mesh.face_points.end(), {at, at + 1, next + 1, next});
    }
  }
  result.sector = shared(std::move(mesh));
  result.setup.handles[0].region = {handle};
  result.setup.fixed = {{fixed}};
  return result;
}

/// A motion turned by a number of sectors: R^k A R^-k.
inline Affine turned_motion(const SectorModel& of, const Affine& motion, std::size_t sectors) {
  const auto turns = static_cast<double>(sectors);
  // From the images of four points.
  const auto image = [&](const Vec3& x) { return of.turned_point(transformed(motion, of.turned_point(x, -turns)), turns); };
  Affine result{};
  const Vec3 origin = image({});
  for (std::size_t k = 0; k < 3; ++k) {
    Vec3 e{};
    e[k] = 1;
    const Vec3 column = image(e) - origin;
    for (std::size_t i = 0; i < 3; ++i) result[4 * i + k] = column[i];
    result[4 * k + 3] = origin[k];
  }
  return result;
}

/// All images of a sector: its points first. Each sector has its own handle.
struct WholeWheel {
  explicit WholeWheel(const SectorModel& of) : setup(of.setup) {
    const std::size_t n = of.local.size(), count = of.shape.count;
    setup.symmetry.clear();
    setup.handles.clear();
    Mesh mesh;
    mesh.points = of.sector->points;
    image_of.assign(count, std::vector<PointId>(n));
    std::vector<std::size_t> low_of(n, n);
    for (std::size_t p = 0; p < of.lows.size(); ++p) low_of[of.highs[p]] = of.lows[p];
    std::vector<char> on_axis(n);
    for (const PointId id : of.axis) on_axis[id] = 1;
    // A low point of sector g is the high one of sector g - 1.
    for (std::size_t g = 0; g < count; ++g) {
      for (std::size_t i = 0; i < n; ++i) {
        if (low_of[i] < n) continue;
        image_of[g][i] = static_cast<PointId>(i);
        if (g == 0 || on_axis[i] != 0) continue;
        const auto high = std::find(of.lows.begin(), of.lows.end(), static_cast<PointId>(i));
        if (g == 1 && high != of.lows.end()) {
          image_of[g][i] = of.highs[static_cast<std::size_t>(high - of.lows.begin())];
          continue;
        }
        image_of[g][i] = static_cast<PointId>(mesh.points.size());
        mesh.points.push_back(of.turned_point(of.sector->points[i], static_cast<double>(g)));
      }
    }
    for (std::size_t g = 0; g < count; ++g) {
      for (std::size_t i = 0; i < n; ++i) {
        if (low_of[i] < n) image_of[g][i] = image_of[(g + 1) % count][low_of[i]];
      }
    }
    std::vector<char> is_fixed(mesh.points.size());
    for (std::size_t g = 0; g < count; ++g) {
      Region::Ids handle;
      for (const PointId id : of.handle()) handle.ids.push_back(image_of[g][id]);
      setup.handles.push_back({"blade " + std::to_string(g), {handle}});
      for (const PointId id : std::get<Region::Ids>(of.setup.fixed[0].kind).ids) is_fixed[image_of[g][id]] = 1;
      std::vector<Vec3> u;
      for (const Vec3& v : of.displacements) u.push_back(of.frame.vector(of.turned(v, static_cast<double>(g))));
      design.motions.push_back({g, std::move(u)});
      affine_design.motions.push_back({g, turned_motion(of, of.motion(), g)});
    }
    Region::Ids fixed;
    for (std::size_t i = 0; i < is_fixed.size(); ++i) {
      if (is_fixed[i] != 0) fixed.ids.push_back(static_cast<PointId>(i));
    }
    setup.fixed = {{fixed}};
    for (std::size_t g = 0; g < count; ++g) {
      const PointId* corners = of.sector->face_points.data();
      for (const std::uint32_t size : of.sector->face_sizes) {
        mesh.face_sizes.push_back(size);
        for (std::size_t c = 0; c < size; ++c) mesh.face_points.push_back(image_of[g][corners[c]]);
        corners += size;
      }
    }
    wheel = std::make_shared<const Mesh>(std::move(mesh));
  }

  std::shared_ptr<const Mesh> wheel;
  deform::Setup setup;
  Design design, affine_design;
  std::vector<std::vector<PointId>> image_of;  ///< of each sector the ids of the points
};

/// Control points around the middle of a sector, which reach into others.
inline FfdOptions sector_lattice(const Frame& frame) {
  FfdOptions options;
  options.control = FfdControl::controls;
  options.basis = BasisMode::always;
  options.lattice.frame =
      LatticeFrame{frame.point({-0.1, -0.3, -0.4}), {1.1 * frame.axes[0], 1.4 * frame.axes[1], 1.3 * frame.axes[2]}};
  options.lattice.points = {5, 6, 5};
  return options;
}

/// A can around the wheel: rings of `sides` vertices per sector at both ends, and one vertex of each end on the axis.
inline void make_can(const SectorModel& model, std::uint32_t sides, double radius, CageOptions& options) {
  const std::uint32_t ring = sides * static_cast<std::uint32_t>(model.shape.count);
  for (const double z : {-0.3, 1.2}) {
    for (std::uint32_t i = 0; i < ring; ++i) {
      const double angle = 2 * std::numbers::pi * i / ring + 0.1;
      options.vertices.push_back(model.frame.point({z, radius * std::cos(angle), radius * std::sin(angle)}));
    }
  }
  for (const double z : {-0.4, 1.3}) options.vertices.push_back(model.frame.point({z, 0, 0}));
  for (std::uint32_t i = 0; i < ring; ++i) {
    const std::uint32_t next = (i + 1) % ring;
    options.triangles.push_back({i, next, ring + next});
    options.triangles.push_back({i, ring + next, ring + i});
    options.triangles.push_back({2 * ring, next, i});
    options.triangles.push_back({2 * ring + 1, ring + i, ring + next});
  }
}

}  // namespace deform::test
