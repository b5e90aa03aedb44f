// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <memory>
#include <numbers>
#include <stdexcept>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "core/base/vectors.h"
#include "core/deformers/mirrored_mesh.h"
#include "tests/core/deformers/contract_setups.h"
#include "tests/core/deformers/wide.h"

/// Half models and sectors as the whole models that they stand for.
namespace deform::test::contract {

/// A vector by the linear part of a map.
inline WideVec turned(const WideMap& map, const WideVec& v) {
  WideVec result;
  for (std::size_t k = 0; k < 3; ++k) {
    for (std::size_t l = 0; l < 3; ++l) result[k] += map[4 * k + l] * v[l];
  }
  return result;
}

/// A case with the images of its model, each with handles of its own, without symmetry. The points are those of MirroredMesh;
/// what images do is prescribed by formulas in double-double.
class WholeModel {
 public:
  explicit WholeModel(const Case& c)
      : made(c), mirrored_(*c.mesh, Symmetry(c.setup.symmetry, *c.mesh)), plane_(c.symmetric), points_(c.mesh->point_count()) {
    if (!plane_) sector_ = std::get<SectorOptions>(c.setup.symmetry.at(0).kind);
    made.mesh = mirrored_.mesh();
    made.images = mirrored_.images();
    made.symmetric.reset();
    made.setup.symmetry.clear();
    for (std::size_t g = 1; g < made.images; ++g) {
      const std::vector<PointId> more = mirrored_.own_images(c.fixed[0], g);
      made.fixed[0].insert(made.fixed[0].end(), more.begin(), more.end());
      const WideMap to = image(g), back = image(g, -1);
      check_image(to, g);
      for (std::size_t h = 0; h < c.handles.size(); ++h) {
        std::vector<PointId> ids = mirrored_.own_images(c.handles[h], g);
        if (ids.empty()) continue;
        made.setup.handles.push_back({c.setup.handles[h].name + " " + std::to_string(g), {Region::Ids{ids}}});
        made.handles.push_back(std::move(ids));
        for (std::size_t d = 0; d < c.designs.size(); ++d) {
          const Prescribed& from = c.prescribed[d][h];
          Prescribed own;
          own.map = from.displacements.empty() ? after(to, after(from.map, back)) : to;
          for (std::size_t i = 0; i < from.displacements.size(); ++i) {
            if (mirrored_.is_own(c.handles[h][i], g)) own.displacements.push_back(from.displacements[i]);
          }
          made.prescribed[d].push_back(std::move(own));
        }
      }
    }
    std::sort(made.fixed[0].begin(), made.fixed[0].end());
  }

  /// For each point of the model the mean displacement of its images, turned back.
  std::vector<WideVec> means(const std::vector<WideVec>& of_whole) const {
    std::vector<WideVec> result(points_);
    for (std::size_t g = 0; g < made.images; ++g) {
      const WideMap back = image(g, -1);
      for (std::size_t i = 0; i < points_; ++i) {
        const WideVec u = turned(back, of_whole[mirrored_.image(static_cast<PointId>(i), g)]);
        for (std::size_t k = 0; k < 3; ++k) result[i][k] += u[k] / Wide(static_cast<double>(made.images));
      }
    }
    return result;
  }

  Case made;

 private:
  /// The map to an image, or back.
  WideMap image(std::size_t g, int direction = 1) const {
    WideMap map = wide_map(identity_affine);
    if (g == 0) return map;
    if (plane_) {
      map[5] = -1;
      map[7] = Wide(*plane_) + Wide(*plane_);
      return map;
    }
    const long double angle = 2 * std::numbers::pi_v<long double> * static_cast<long double>(g) / sector_.count;
    return about(wide_rotation(sector_.axis, direction * angle), sector_.origin);
  }

  /// That the images are where they are said to be.
  void check_image(const WideMap& map, std::size_t g) const {
    const double D = bounding_box(made.mesh->points).diagonal();
    for (std::size_t i = 0; i < points_; ++i) {
      const Vec3 &x = made.mesh->points[i], &to = made.mesh->points[mirrored_.image(static_cast<PointId>(i), g)];
      const WideVec u = displacement(map, wide(x));
      WideVec off;
      for (std::size_t k = 0; k < 3; ++k) off[k] = u[k] + Wide(x[k]) - Wide(to[k]);
      if (!(length(off) < 1e-9 * D)) throw std::logic_error("image " + std::to_string(g) + " is somewhere else");
    }
  }

  const MirroredMesh mirrored_;
  const std::optional<double> plane_;
  const std::size_t points_;
  SectorOptions sector_;
};

}  // namespace deform::test::contract
