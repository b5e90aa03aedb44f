// SPDX-License-Identifier: GPL-3.0-or-later
// Compiled deformations whose right answers are known without a solver.
#pragma once

#include <cmath>
#include <cstddef>
#include <random>
#include <string>
#include <vector>

#include "core/base/types.h"
#include "core/base/vectors.h"
#include "core/compiled/content.h"
#include "core/compiled/records.h"

namespace deform::compiled::test {

/// How much a handle pulls at a place: any smooth function will do.
inline double pull(const Vec3& place, std::size_t handle) {
  return std::exp(-squared_distance(place, {0.3 + 0.9 * static_cast<double>(handle), 0.2, -0.1}));
}

/// Points in a box of which the first belong to two handles and some are fixed. The fields of a handle are 1, x, y, z times its
/// pull, so that a point that follows goes by the sum over the handles of pull * (motion(x) - x).
struct Blend {
  explicit Blend(std::size_t points, std::uint32_t planes = 0) {
    std::mt19937_64 random(3);
    std::uniform_real_distribution<double> uniform(0, 1);
    content.geometry_id = std::string(64, 'a');
    content.system_id = std::string(63, '0') + "7";
    content.creator = "test";
    content.method = "rbf";
    content.mesh = "blend.obj";
    content.notes = {"one", "two"};
    content.setup = "not parsed here";
    content.diagonal = 2.5;
    content.largest_coordinate = 2;
    content.origin = {0.1, -0.2, 0.3};
    content.scale = 1.7;
    content.error_margin = 2;
    content.handles = {{"left", 40, {0.2, 0.1, 0.4}, {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}}},
                       {"right", 40, {0.5, 0.3, -0.1}, {{{0, 1, 0}, {0, 0, 1}, {1, 0, 0}}}}};
    content.variables = {
        {"up", 0, {MotionKind::translation, {0.1, 0, 1}, {}}, -1, 2},
        {"turn", 0, {MotionKind::rotation, {0.2, 1, 0.1}, {0.4, 0.1, 0}}, -1, 1},
        {"grow", 1, {MotionKind::scaling, {}, {1, 0.5, 0}}, -0.5, 0.5},
        {"stretch", 1, {MotionKind::scaling, {0, 1, 1}, {1, 0.5, 0}}, -0.5, 0.5},
        {"roll", 1, {MotionKind::rotation, {1, 0, 0}, {1, 0.5, 0}, 0.25}, -std::numeric_limits<double>::infinity(), 3},
    };
    content.variables[2].also = {{0, {MotionKind::rotation, {0, 0, 1}, {0, 0.2, 0}, 0.5}}};
    content.variables[3].also = {{0, {MotionKind::translation, {0, 0.3, 0.4}, {}}}};
    content.planes = planes;
    for (std::size_t k = 0; k < planes; ++k) content.reach[k] = 1e-9;
    for (std::size_t i = 0; i < points; ++i) {
      Vec3 x{2 * uniform(random), uniform(random), uniform(random)};
      std::uint8_t on = 0;
      for (std::size_t k = 0; k < planes; ++k) {
        if (i % 7 == k) {
          x[k] = 0;
          on = static_cast<std::uint8_t>(on | 1u << k);
        }
      }
      content.rest.push_back(x);
      content.regions.push_back(i < 40 ? 0 : i < 80 ? 1 : i % 11 == 0 ? fixed_region : following_region);
      if (planes > 0) content.on_planes.push_back(on);
    }
    if (planes == 0) {
      add_basis(7);
    } else {
      add_basis(1);
      add_basis(6);
    }
  }

  void add_basis(std::uint32_t components) {
    Basis& basis = content.bases.emplace_back();
    basis.components = components;
    const std::size_t fields = content.fields();
    for (std::size_t f = 0; f < fields; ++f) {
      basis.residuals.push_back(1e-12 * static_cast<double>(f + 1));
      basis.more.push_back(1e-13);
      basis.compression.push_back(2e-13);
    }
    basis.errors.assign(3 * fields, 1e-14);
    basis.values.assign(basis_values(following_points(content), fields), 0.0);
    std::size_t s = 0;
    for (std::size_t i = 0; i < content.points(); ++i) {
      if (content.regions[i] != following_region) continue;
      for (std::size_t h = 0; h < content.handles.size(); ++h) {
        Vec3 unit = (content.rest[i] - content.origin) / content.scale - content.handles[h].reference;
        const auto& axes = content.handles[h].axes;
        const double values[4] = {1, dot(axes[0], unit), dot(axes[1], unit), dot(axes[2], unit)};
        for (std::size_t k = 0; k < 4; ++k) {
          basis.values[(s / tile_points * fields + 4 * h + k) * tile_points + s % tile_points] =
              pull(content.rest[i], h) * values[k];
        }
      }
      ++s;
    }
  }

  Content content;
};

/// The bytes of a file.
inline std::vector<std::byte> file_of(const Content& content) {
  Records records(content);
  std::vector<std::byte> bytes, piece;
  while (records.next(piece)) bytes.insert(bytes.end(), piece.begin(), piece.end());
  return bytes;
}

}  // namespace deform::compiled::test
