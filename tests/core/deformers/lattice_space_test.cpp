// SPDX-License-Identifier: GPL-3.0-or-later
// Thesis 3.2 as an energy space: the matrix against quadrature of differences of the field, the values against coordinates.
#include "core/deformers/energy/spaces/lattice_space.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <functional>
#include <random>

#include "core/base/vectors.h"
#include "core/deformers/energy/spaces/model_lattice.h"
#include "tests/core/deformers/shapes.h"
#include "tests/support/expect_error.h"
#include "tests/support/linear_algebra.h"

namespace deform::lattice_space_test {
namespace {

FfdOptions options_of(LatticeBasis basis, double stretching, double bending) {
  FfdOptions options;
  options.stretching = stretching;
  options.bending = bending;
  options.lattice.basis = basis;
  options.lattice.points = {5, 4, 6};
  // Around the sheet, neither orthogonal nor along the axes.
  options.lattice.frame = LatticeFrame{{-0.9, -0.8, -0.8}, {{{3.6, 0.6, 0.2}, {0.5, 2.4, 0.1}, {0.2, -0.1, 1.5}}}};
  return options;
}

EnergyModel model_of(const Mesh& mesh, const FfdOptions& options) {
  return lattice_model(mesh, options, std::vector<RegionIndex>(mesh.point_count(), fixed_region), {});
}

Eigen::MatrixXd full(const SparseMatrix& lower) { return Eigen::MatrixXd(lower).selfadjointView<Eigen::Lower>(); }

/// The energy of sum_p w_p phi_p in unit coordinates, from the values of the field alone: derivatives by differences along x, y
/// and z, four Gauss points per span and axis, which is exact for these polynomials.
double energy_by_quadrature(const Lattice& lattice, double D, const Eigen::VectorXd& w, const FfdOptions& options) {
  const auto field = [&](const Vec3& x) {
    const Vec3 u = lattice.coordinates(x);
    double sum = 0;
    lattice.for_each(lattice.weights(u), [&](std::size_t p, double weight) { sum += weight * w[static_cast<Eigen::Index>(p)]; });
    return sum;
  };
  const GaussRule rule = gauss_rule(6);
  const auto& axes = lattice.frame().axes;
  const double volume = std::abs(dot(axes[0], cross(axes[1], axes[2])));
  constexpr double h = 1e-4;
  const auto unit = [](std::size_t k) {
    Vec3 e{};
    e[k] = 1;
    return e;
  };
  double total = 0;
  std::array<std::vector<std::pair<double, double>>, 3> nodes;
  for (std::size_t k = 0; k < 3; ++k) {
    const auto spans = static_cast<double>(lattice.axis(k).spans());
    for (std::size_t s = 0; s < lattice.axis(k).spans(); ++s) {
      for (std::size_t g = 0; g < rule.nodes.size(); ++g) {
        nodes[k].emplace_back((static_cast<double>(s) + rule.nodes[g]) / spans, rule.weights[g] / spans);
      }
    }
  }
  for (const auto& [a, wa] : nodes[0]) {
    for (const auto& [b, wb] : nodes[1]) {
      for (const auto& [c, wc] : nodes[2]) {
        const Vec3 x = lattice.place({a, b, c});
        const double middle = field(x);
        double stretching = 0, bending = 0;
        for (std::size_t i = 0; i < 3; ++i) {
          const double above = field(x + h * unit(i)), below = field(x - h * unit(i));
          const double slope = (above - below) / (2 * h), curvature = (above - 2 * middle + below) / (h * h);
          stretching += slope * slope;
          bending += curvature * curvature;
          for (std::size_t j = 0; j < i; ++j) {
            const double mixed = (field(x + h * unit(i) + h * unit(j)) - field(x + h * unit(i) - h * unit(j)) -
                                  field(x - h * unit(i) + h * unit(j)) + field(x - h * unit(i) - h * unit(j))) /
                                 (4 * h * h);
            bending += 2 * mixed * mixed;
          }
        }
        // Unit coordinates: slopes times D, curvatures times D^2, volumes over D^3.
        total += wa * wb * wc * volume / (D * D * D) *
                 (options.stretching * stretching * D * D + options.bending * bending * D * D * D * D);
      }
    }
  }
  return total;
}

TEST(LatticeSpace, EnergyIsTheIntegral) {
  const Mesh mesh = test::bumpy_sheet(9, 5);
  const double D = bounding_box(mesh.points).diagonal();
  std::mt19937_64 random(1);
  std::normal_distribution<double> normal;
  for (const LatticeBasis basis : {LatticeBasis::uniform_cubic, LatticeBasis::clamped_cubic, LatticeBasis::bernstein}) {
    for (const auto& [stretching, bending] : {std::pair{1.0, 0.0}, {0.0, 1.0}, {2.0, 0.5}}) {
      const FfdOptions options = options_of(basis, stretching, bending);
      const EnergyModel model = model_of(mesh, options);
      const Lattice lattice = lattice_of(options.lattice, mesh);
      Eigen::VectorXd w(model.space.energy.rows());
      for (double& value : w) value = normal(random);
      const double energy = w.dot(full(model.space.energy) * w);
      // Differences are good to h^2 times higher derivatives, and to rounding over h^2.
      EXPECT_NEAR(energy_by_quadrature(lattice, D, w, options) / energy, 1, 2e-5) << static_cast<int>(basis) << " " << bending;
    }
  }
}

TEST(LatticeSpace, OnlyAffineDisplacementsDoNotBend) {
  const Mesh mesh = test::bumpy_sheet(9, 5);
  for (const LatticeBasis basis : {LatticeBasis::uniform_cubic, LatticeBasis::clamped_cubic, LatticeBasis::bernstein}) {
    const EnergyModel model = model_of(mesh, options_of(basis, 0, 1));
    const Eigen::MatrixXd K = full(model.space.energy);
    const Eigen::VectorXd values = test::symmetric_eigenvalues(K);
    const double largest = values[values.size() - 1];
    EXPECT_LT(std::abs(values[3]), 1e-13 * largest);
    EXPECT_GT(values[4], 1e-11 * largest);
    EXPECT_LT((K * Eigen::MatrixXd(model.space.linear)).cwiseAbs().maxCoeff(), 1e-12 * largest);
  }
}

// The cost of changes across held points that do not extend there is the stretching of the same field in that direction, a
// millionth of what bends for the same trace in all directions; fields that change along them cost nothing more.
TEST(LatticeSpace, ChangesAcrossThePlaneOfHeldPointsHaveASmallCost) {
  const Mesh mesh = test::bumpy_sheet(9, 5);
  const auto energy = [&](double stretching, double bending, const std::function<bool(std::size_t)>& holds) {
    std::vector<RegionIndex> region_of(mesh.point_count(), deformable_region);
    for (std::size_t i = 0; i < region_of.size(); ++i) region_of[i] = holds(i) ? fixed_region : deformable_region;
    const EnergyModel model = lattice_model(mesh, options_of(LatticeBasis::uniform_cubic, stretching, bending), region_of, {});
    return std::pair(full(model.space.energy), model.space.notes.size());
  };
  const auto all = [](std::size_t) { return true; };
  const auto [bending, notes] = energy(0, 1, all);
  const Eigen::MatrixXd stretching = energy(1, 0, all).first;
  const double factor = 1e-6 * bending.trace() / stretching.trace();
  const auto [of_one, notes_of_one] = energy(0, 1, [](std::size_t i) { return i == 22; });
  EXPECT_EQ(notes_of_one, notes + 1);
  EXPECT_LT((of_one - bending - factor * stretching).cwiseAbs().maxCoeff(), 1e-14 * bending.cwiseAbs().maxCoeff());
  const auto [of_plane, notes_of_plane] = energy(0, 1, [](std::size_t i) { return i % 9 == 3; });  // of one x
  EXPECT_EQ(notes_of_plane, notes + 1);
  const EnergyModel model = model_of(mesh, options_of(LatticeBasis::uniform_cubic, 0, 1));
  const Eigen::MatrixXd linear = Eigen::MatrixXd(model.space.linear);
  const auto cost = [&](const Eigen::MatrixXd& K, Eigen::Index c) { return linear.col(c).dot(K * linear.col(c)); };
  const double of_x = factor * cost(stretching, 1);
  EXPECT_NEAR(cost(of_plane, 1), of_x, 1e-6 * of_x);
  for (const Eigen::Index c : {0, 2, 3}) EXPECT_NEAR(cost(of_plane, c), 0, 1e-6 * of_x);
}

TEST(LatticeSpace, ValuesAreComputedAndReproduceCoordinates) {
  const Mesh mesh = test::bumpy_sheet(21, 11);
  const Box box = bounding_box(mesh.points);
  const EnergyModel model = model_of(mesh, options_of(LatticeBasis::uniform_cubic, 0, 1));
  EXPECT_EQ(model.space.values.nonZeros(), 0);
  // A place in the lattice for each point, the lattice once, and no weights.
  const Mesh finer = test::bumpy_sheet(41, 31);
  const std::size_t bytes = model.space.value_bytes();
  const std::size_t finer_bytes = model_of(finer, options_of(LatticeBasis::uniform_cubic, 0, 1)).space.value_bytes();
  EXPECT_EQ(finer_bytes - bytes, (finer.point_count() - mesh.point_count()) * 24);
  EXPECT_LE(bytes, mesh.point_count() * 24 + 512);
  const Eigen::MatrixXd linear = Eigen::MatrixXd(model.space.linear);
  for (std::size_t i = 0; i < mesh.point_count(); ++i) {
    Eigen::RowVector4d sum = Eigen::RowVector4d::Zero();
    std::size_t count = 0;
    std::int64_t last = -1;
    model.space.functions().for_each(static_cast<std::int64_t>(i), [&](std::int64_t column, double value) {
      EXPECT_GT(column, last);
      last = column;
      ++count;
      sum += value * linear.row(column);
    });
    EXPECT_EQ(count, 64u);
    EXPECT_EQ(model.space.functions().count(static_cast<std::int64_t>(i)), 64u);
    EXPECT_NEAR(sum[0], 1, 1e-14);
    for (std::size_t k = 0; k < 3; ++k) {
      EXPECT_NEAR(sum[static_cast<Eigen::Index>(k) + 1], (mesh.points[i][k] - box.min[k]) / box.diagonal(), 1e-14);
    }
  }
}

TEST(LatticeSpace, AutomaticLatticesHoldTheMesh) {
  const Mesh mesh = test::bumpy_sheet(21, 11);
  for (const LatticeBasis basis : {LatticeBasis::uniform_cubic, LatticeBasis::bernstein}) {
    LatticeOptions options;
    options.basis = basis;
    const Lattice lattice = lattice_of(options, mesh);
    for (const Vec3& x : mesh.points) EXPECT_TRUE(lattice.inside(x));
    const bool bernstein = basis == LatticeBasis::bernstein;
    // 2 x 1 x 0.2, and the padding: eight cells, or degree six, along x.
    EXPECT_EQ(lattice.axis(0).size(), bernstein ? 7u : 11u);
    EXPECT_EQ(lattice.axis(1).size(), bernstein ? 4u : 7u);
    EXPECT_EQ(lattice.axis(2).size(), bernstein ? 2u : 4u);
  }
}

TEST(LatticeSpace, PointsOutsideMustBeFixed) {
  const Mesh mesh = test::bumpy_sheet(21, 11);
  FfdOptions options;
  options.lattice.frame = LatticeFrame{{-0.1, -0.1, -0.5}, {{{1.13, 0, 0}, {0, 2, 0}, {0, 0, 1}}}};
  std::vector<RegionIndex> region_of(mesh.point_count(), deformable_region);
  // Columns 11 to 20 have x > 1.03: 10 of 21 points in each of 11 rows.
  test::expect_error(ErrorCode::invalid_argument, {"method.ffd.lattice", "110 points", "the first is 11"},
                     [&] { lattice_model(mesh, options, region_of, {}); });
  for (std::size_t i = 0; i < region_of.size(); ++i) region_of[i] = i % 21 > 8 ? fixed_region : deformable_region;
  const EnergyModel model = lattice_model(mesh, options, region_of, {});
  EXPECT_EQ(model.space.functions().count(10), 64u);
  EXPECT_EQ(model.space.functions().count(11), 0u);
  ASSERT_EQ(model.space.notes.size(), 2u);
  // One edge of the grid in each row.
  EXPECT_NE(model.space.notes[1].find("110 fixed points lie outside of the lattice, the first is 11; 11 edges"),
            std::string::npos)
      << model.space.notes[1];
  region_of[12] = 0;
  test::expect_error(ErrorCode::invalid_argument, {"1 points", "1 of handles", "the first is 12"},
                     [&] { lattice_model(mesh, options, region_of, {}); });
}

}  // namespace
}  // namespace deform::lattice_space_test
