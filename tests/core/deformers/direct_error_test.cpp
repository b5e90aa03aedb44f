// SPDX-License-Identifier: GPL-3.0-or-later
// What direct manipulation tells of its rounding, of half models above all, whose singular values come in pairs: against the
// solution in extended precision at all points, by the published formulas.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <memory>
#include <numeric>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "core/base/vectors.h"
#include "core/deformers/system.h"
#include "tests/core/deformers/dense_controls.h"
#include "tests/core/deformers/half_cages.h"

namespace deform::direct_error_test {
namespace {

using test::dense_controls::Extended;
using test::dense_controls::Functions;
using test::dense_controls::Matrix;

/// What a part is one image of: reflections in coordinate planes, or four turns about the first axis.
struct Cut {
  std::size_t planes = 0;
  bool turns = false;

  std::size_t count() const { return turns ? 4 : std::size_t{1} << planes; }
  /// The image of a vector; exact.
  Vec3 operator()(Vec3 x, std::size_t image) const {
    for (std::size_t k = 0; k < 3 && !turns; ++k) {
      if ((image >> k & 1u) != 0) x[k] = -x[k];
    }
    for (std::size_t g = 0; g < image && turns; ++g) x = {x[0], -x[2], x[1]};
    return x;
  }
  Affine operator()(const Affine& map, std::size_t image) const {
    const std::size_t back = turns ? (count() - image) % count() : image;
    Affine result{};
    for (std::size_t l = 0; l < 3; ++l) {
      Vec3 unit{};
      unit[l] = 1;
      const Vec3 from = (*this)(unit, back);
      const Vec3 to = (*this)(transformed(map, from) - transformed(map, Vec3{}), image);
      for (std::size_t k = 0; k < 3; ++k) result[4 * k + l] = to[k];
    }
    const Vec3 shift = (*this)(Vec3{map[3], map[7], map[11]}, image);
    for (std::size_t k = 0; k < 3; ++k) result[4 * k + 3] = shift[k];
    return result;
  }
};

/// A part of a bumpy body, with handles in it that move by affine maps; points on planes slide. And the whole of it, whose points
/// are in another order.
struct Parted {
  Cut cut;
  std::shared_ptr<const Mesh> part, whole;
  deform::Setup of_part, of_whole;
  Design design, whole_design;
  std::vector<std::vector<PointId>> images;  ///< of each image, the point of the whole for each of the part

  Parted(const Cut& of, std::size_t handles, std::size_t points, unsigned seed) : cut(of) {
    const std::size_t planes = cut.planes;
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> uniform(-1, 1);
    Mesh mesh;
    std::vector<unsigned> on;
    while (mesh.points.size() < points) {
      Vec3 x{uniform(random), uniform(random), uniform(random)};
      x = (1 / norm(x)) * x;
      unsigned mask = 0;
      for (std::size_t k = 0; k < planes; ++k) {
        x[k] = std::abs(x[k]);
        if (x[k] > 0.08) continue;
        x[k] = 0;
        mask |= 1u << k;
      }
      if (cut.turns) x = {x[0], 0.1 + std::abs(x[1]), 0.1 + std::abs(x[2])};
      const double bump = 1 + 0.1 * std::cos(3 * x[0]) + 0.07 * std::cos(5 * x[1]) - 0.05 * std::cos(4 * x[2]);
      mesh.points.push_back({1.9 * bump * x[0], 1.1 * bump * x[1], 0.8 * bump * x[2]});
      on.push_back(mask);
    }
    std::vector<std::vector<PointId>> held(handles + 1);
    std::vector<bool> taken(points);
    for (std::size_t h = 0; h <= handles; ++h) {
      const Vec3 centre = mesh.points[random() % points];
      const double reach = 0.45 + 0.2 * uniform(random);
      for (std::size_t i = 0; i < points; ++i) {
        if (taken[i] || distance(mesh.points[i], centre) > reach) continue;
        taken[i] = true;
        held[h].push_back(static_cast<PointId>(i));
      }
    }
    std::vector<Affine> maps;
    for (std::size_t h = 1; h <= handles; ++h) {
      unsigned touched = 0;
      for (const PointId id : held[h]) touched |= on[id];
      Affine map = identity_affine;
      for (std::size_t k = 0; k < 3; ++k) {
        for (std::size_t l = 0; l < 4; ++l) {
          const bool leaves = (touched >> k & 1u) != 0 && k != l;
          if (!leaves) map[4 * k + l] += 0.1 * uniform(random);
        }
      }
      maps.push_back(map);
    }
    for (std::size_t k = 0; k < planes; ++k) {
      Vec3 normal{};
      normal[k] = 1;
      of_part.symmetry.emplace_back(SymmetryPlane::Plane{{}, normal});
    }
    if (cut.turns) {
      SectorOptions sector;
      sector.axis = {1, 0, 0};
      sector.count = cut.count();
      of_part.symmetry = {{sector}};
    }
    // The whole.
    const std::size_t count = cut.count();
    std::vector<std::pair<std::size_t, std::size_t>> order;  // image, point
    for (std::size_t g = 0; g < count; ++g) {
      for (std::size_t i = 0; i < points; ++i) {
        if ((on[i] & g) == 0) order.emplace_back(g, i);
      }
    }
    std::shuffle(order.begin(), order.end(), random);
    images.assign(count, std::vector<PointId>(points));
    Mesh all;
    for (const auto& [g, i] : order) {
      for (std::size_t other = 0; other < count; ++other) {
        if ((cut.turns ? other : other & ~static_cast<std::size_t>(on[i])) == g)
          images[other][i] = static_cast<PointId>(all.points.size());
      }
      all.points.push_back(cut(mesh.points[i], g));
    }
    Region::Ids fixed;
    for (std::size_t g = 0; g < count; ++g) {
      for (std::size_t h = 0; h <= handles; ++h) {
        std::vector<PointId> own;
        for (const PointId id : held[h]) {
          if ((on[id] & g) == 0) own.push_back(images[g][id]);
        }
        if (h == 0) {
          fixed.ids.insert(fixed.ids.end(), own.begin(), own.end());
        } else if (!own.empty()) {
          whole_design.motions.push_back({of_whole.handles.size(), cut(maps[h - 1], g)});
          of_whole.handles.push_back({"h" + std::to_string(h) + "_" + std::to_string(g), {Region::Ids{own}}});
        }
      }
    }
    of_whole.fixed = {{fixed}};
    of_part.fixed = {{Region::Ids{held[0]}}};
    for (std::size_t h = 1; h <= handles; ++h) {
      if (held[h].empty()) continue;
      design.motions.push_back({of_part.handles.size(), maps[h - 1]});
      of_part.handles.push_back({"h" + std::to_string(h), {Region::Ids{held[h]}}});
    }
    part = std::make_shared<const Mesh>(std::move(mesh));
    whole = std::make_shared<const Mesh>(std::move(all));
  }
};

std::size_t rank_of(const SystemInfo& info) {
  for (const std::string& note : info.notes) {
    const auto at = note.find("rank ");
    if (at != std::string::npos) return static_cast<std::size_t>(std::atoi(note.c_str() + at + 5));
  }
  return 0;
}

/// The displacements of the points of a mesh, in extended precision: n x 3.
Matrix exact(const Mesh& mesh, const deform::Setup& setup, const Design& design, const Functions& functions, std::size_t rank) {
  std::vector<Vec3> places;
  std::vector<std::array<Extended, 3>> values;
  const SelectedRegions regions = validate(setup, mesh);
  for (const Motion& motion : design.motions) {
    const Affine& map = std::get<Affine>(motion.value);
    for (const PointId id : regions.handles[motion.handle]) {
      const Vec3& x = mesh.points[id];
      places.push_back(x);
      auto& u = values.emplace_back();
      for (std::size_t k = 0; k < 3; ++k) {
        u[k] = static_cast<Extended>(map[4 * k + 3]) - x[k];
        for (std::size_t l = 0; l < 3; ++l) u[k] += static_cast<Extended>(map[4 * k + l]) * x[l];
      }
    }
  }
  for (const PointId id : regions.fixed) {
    places.push_back(mesh.points[id]);
    values.push_back({});
  }
  Matrix data(static_cast<Eigen::Index>(places.size()), 3);
  for (Eigen::Index i = 0; i < data.rows(); ++i) {
    for (Eigen::Index k = 0; k < 3; ++k) data(i, k) = values[static_cast<std::size_t>(i)][static_cast<std::size_t>(k)];
  }
  const Matrix moved = manipulated(functions, places, data, rank);
  Matrix result(static_cast<Eigen::Index>(mesh.point_count()), 3);
  for (Eigen::Index i = 0; i < result.rows(); ++i) {
    const std::vector<Extended> row = functions.values(mesh.points[static_cast<std::size_t>(i)]);
    result.row(i).setZero();
    for (std::size_t j = 0; j < row.size(); ++j) result.row(i) += row[j] * moved.row(static_cast<Eigen::Index>(j));
  }
  return result;
}

/// By how much points are off, and how far they move.
struct Compared {
  double off = 0, motion = 0;
};

Compared compared(const Points& got, const Mesh& mesh, const Matrix& expected, const std::vector<PointId>& rows) {
  Compared result;
  for (std::size_t i = 0; i < got.size(); ++i) {
    Extended off = 0, motion = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      const Extended u = expected(static_cast<Eigen::Index>(rows[i]), static_cast<Eigen::Index>(k));
      const Extended e = static_cast<Extended>(got[i][k]) - mesh.points[i][k] - u;
      off += e * e;
      motion += u * u;
    }
    result.off = std::max(result.off, static_cast<double>(std::sqrt(off)));
    result.motion = std::max(result.motion, static_cast<double>(std::sqrt(motion)));
  }
  return result;
}

FfdOptions lattice_across(double clamp, const std::array<std::size_t, 3>& points, LatticeBasis basis) {
  FfdOptions options;
  options.control = FfdControl::mesh;
  options.clamp = clamp;
  options.lattice.basis = basis;
  options.lattice.points = points;
  options.lattice.frame = LatticeFrame{{-2.4, -1.7, -1.7}, {{{4.8, 0, 0}, {0, 3.4, 0}, {0, 0, 3.4}}}};
  return options;
}

CageOptions cage_across(double clamp) {
  CageOptions options = test::options_of(test::pyramids({-2.6, -1.8, -1.8}, {2.6, 1.8, 1.8}));
  options.control = CageControl::mesh;
  options.clamp = clamp;
  return options;
}

std::vector<MethodOptions> methods() {
  return {lattice_across(0, {8, 6, 6}, LatticeBasis::uniform_cubic),
          lattice_across(1e-6, {8, 6, 6}, LatticeBasis::uniform_cubic),
          lattice_across(1e-9, {8, 6, 6}, LatticeBasis::uniform_cubic),
          lattice_across(1e-3, {7, 7, 7}, LatticeBasis::clamped_cubic),
          lattice_across(1e-9, {7, 7, 7}, LatticeBasis::clamped_cubic),
          lattice_across(1e-6, {6, 5, 5}, LatticeBasis::bernstein),
          cage_across(0),
          cage_across(1e-6)};
}

std::unique_ptr<const Functions> functions_of(const MethodOptions& method) {
  if (const auto* ffd = std::get_if<FfdOptions>(&method)) {
    return std::make_unique<const test::dense_controls::LatticeFunctions>(ffd->lattice);
  }
  return std::make_unique<const test::dense_controls::CageFunctions>(std::get<CageOptions>(method));
}

class DirectError : public testing::TestWithParam<Cut> {};

/// Not less than half of the true one, and not many times as large. It was up to 1e9 times as large, where a pair of singular
/// values lies on both sides of the clamp: what rounding adds along functions that are odd where the model is even is not in the
/// mean over the images.
TEST_P(DirectError, IsThatOfThePartAndOfTheWhole) {
  std::size_t number = 0;
  for (const MethodOptions& method : methods()) {
    const Cut& cut = GetParam();
    Parted model(cut, 3 + 2 * cut.planes, 320 / cut.count(), static_cast<unsigned>(cut.planes));
    model.of_part.method = model.of_whole.method = method;
    const auto part = prepare(model.part, model.of_part), whole = prepare(model.whole, model.of_whole);
    const std::size_t rank = rank_of(whole->info());
    EXPECT_EQ(rank_of(part->info()), rank);
    const Matrix truth = exact(*model.whole, model.of_whole, model.whole_design, *functions_of(method), rank);
    std::vector<PointId> all(model.whole->point_count());
    std::iota(all.begin(), all.end(), PointId{0});
    for (const EvaluationPath path : {EvaluationPath::basis, EvaluationPath::direct}) {
      const auto check = [&](const System& system, const Mesh& mesh, const Design& design, const std::vector<PointId>& rows,
                             const char* what) {
        const Compared true_error = compared(system.evaluate({&design, 1}, path)[0], mesh, truth, rows);
        const double told = system.bind({&design, 1}, path, {})->report(0).error;
        EXPECT_GE(told, 0.5 * true_error.off) << what << ", method " << number;
        EXPECT_LE(told, 300 * true_error.off) << what << ", method " << number << ", of " << true_error.motion;
      };
      check(*part, *model.part, model.design, model.images[0], "part");
      check(*whole, *model.whole, model.whole_design, all, "whole");
    }
    ++number;
  }
}

INSTANTIATE_TEST_SUITE_P(Parts, DirectError, testing::Values(Cut{1}, Cut{2}, Cut{3}, Cut{0, true}), [](const auto& of) {
  return of.param.turns ? std::string("sector") : std::to_string(of.param.planes) + "_planes";
});

}  // namespace
}  // namespace deform::direct_error_test
