// SPDX-License-Identifier: GPL-3.0-or-later
// The method ffd: by energy (thesis 3.2) and by direct manipulation (thesis 3.3).
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "core/base/number_text.h"
#include "core/base/vectors.h"
#include "core/deformers/energy/spaces/lattice_space.h"
#include "core/deformers/energy/spaces/model_lattice.h"
#include "core/deformers/ffd/clamped_inverse.h"
#include "core/deformers/ffd/damped_inverse.h"
#include "core/deformers/handles/constraint_points.h"
#include "tests/core/deformers/energy_cases.h"
#include "tests/core/deformers/estimate_bounds.h"
#include "tests/support/expect_error.h"
#include "tests/support/linear_algebra.h"

namespace deform::ffd_test {
namespace {

using test::distance;
using test::shared;

const Design turned{{}, {{0, test::turn_and_shift()}}};

FfdOptions by_energy(const std::array<std::size_t, 3>& points = {11, 8, 5}) {
  FfdOptions options;
  options.lattice.points = points;
  return options;
}

FfdOptions by_mesh(const std::array<std::size_t, 3>& points = {8, 6, 4}, double clamp = 0) {
  FfdOptions options = by_energy(points);
  options.control = FfdControl::mesh;
  options.clamp = clamp;
  return options;
}

deform::Setup with(deform::Setup setup, const FfdOptions& options) {
  setup.method = options;
  return setup;
}

TEST(FfdByEnergy, HardHandlesAreMet) {
  const auto mesh = shared(test::bumpy_sheet(41, 21));
  const SelectedRegions regions = validate(test::sheet_setup(), *mesh);
  for (const LatticeBasis basis : {LatticeBasis::uniform_cubic, LatticeBasis::clamped_cubic, LatticeBasis::bernstein}) {
    FfdOptions options = by_energy();
    options.lattice.basis = basis;
    const auto system = prepare(mesh, with(test::sheet_setup(), options));
    EXPECT_EQ(system->info().functions, 11u * 8 * 5);
    const Points got = system->evaluate(turned);
    for (const PointId id : regions.fixed) EXPECT_EQ(got[id], mesh->points[id]);
    for (const PointId id : regions.handles[0]) EXPECT_EQ(got[id], transformed(test::turn_and_shift(), mesh->points[id]));
    // Points beside a handle go nearly where it does.
    for (const EvaluationPath path : {EvaluationPath::basis, EvaluationPath::direct}) {
      EXPECT_LT(system->bind({&turned, 1}, path, {})->report(0).interpolation_residual, 1e-3);
    }
    const Points direct = system->evaluate({&turned, 1}, EvaluationPath::direct)[0];
    EXPECT_LE(distance(got, direct), 1e-8 * system->info().diagonal);
  }
}

/// Softly held points, from the definition: least w^T K w + sum of the weights times the squares of what is missed.
TEST(FfdByEnergy, SoftHandlesAreTheNormalEquations) {
  const auto mesh = shared(test::bumpy_sheet(31, 16));
  FfdOptions options = by_energy({7, 6, 4});
  options.handles = HandleMode::soft;
  options.stretching = 0.3;
  const deform::Setup setup = with(test::sheet_setup(), options);
  const SelectedRegions regions = validate(setup, *mesh);
  const ConstraintPoints points = constraint_points(*mesh, regions);
  const EnergyModel model = lattice_model(*mesh, options, points.region_of, {});
  const Lattice lattice = lattice_of(options.lattice, *mesh);
  Eigen::MatrixXd A = Eigen::MatrixXd(model.space.energy).selfadjointView<Eigen::Lower>();
  Eigen::MatrixXd b = Eigen::MatrixXd::Zero(A.rows(), 3);
  const auto row_of = [&](PointId id) {
    Eigen::RowVectorXd row = Eigen::RowVectorXd::Zero(A.rows());
    lattice.for_each(lattice.weights(lattice.coordinates(mesh->points[id])),
                     [&](std::size_t p, double weight) { row[static_cast<Eigen::Index>(p)] = weight; });
    return row;
  };
  const auto hold = [&](const std::vector<PointId>& ids, const Affine& motion) {
    for (const PointId id : ids) {
      const Eigen::RowVectorXd row = row_of(id);
      const double weight = options.fixing / static_cast<double>(ids.size());
      const Vec3 u = transformed(motion, mesh->points[id]) - mesh->points[id];
      A += weight * row.transpose() * row;
      b += weight * row.transpose() * Eigen::RowVector3d(u[0], u[1], u[2]);
    }
  };
  hold(regions.handles[0], test::turn_and_shift());
  hold(regions.fixed, identity_affine);
  const Eigen::MatrixXd w = test::ldlt_solution(A, b);
  const Points got = prepare(mesh, setup)->evaluate(turned);
  for (std::size_t i = 0; i < got.size(); ++i) {
    const Eigen::RowVector3d u = row_of(static_cast<PointId>(i)) * w;
    EXPECT_LT(distance(got[i], mesh->points[i] + Vec3{u[0], u[1], u[2]}), 1e-9);
  }
}

TEST(FfdByEnergy, FollowsAffineMotionsOfAllHandles) {
  const auto mesh = shared(test::bumpy_sheet(31, 16));
  deform::Setup setup = with(test::sheet_setup(), by_energy());
  setup.handles.push_back({"start", setup.fixed[0]});
  setup.fixed.clear();
  const Affine motion{1.1, -0.2, 0.3, 0.1, 0.25, 0.9, 0.1, -0.05, -0.1, 0.2, 1.3, 0.2};
  const Points got = prepare(mesh, setup)->evaluate({{}, {{0, motion}, {1, motion}}});
  for (std::size_t i = 0; i < got.size(); ++i) EXPECT_LT(distance(got[i], transformed(motion, mesh->points[i])), 1e-9);
}

// In a plane no point tells how displacements change across it.
TEST(FfdByEnergy, TakesPlaneMeshes) {
  const auto mesh = shared(test::flat_sheet(31, 16));
  deform::Setup setup = with(test::sheet_setup(), by_energy());
  setup.handles.push_back({"start", setup.fixed[0]});
  setup.fixed.clear();
  const Affine motion{1.1, -0.2, 0.3, 0.1, 0.25, 0.9, 0.1, -0.05, -0.1, 0.2, 1.3, 0.2};
  const auto system = prepare(mesh, setup);
  EXPECT_LT(system->info().condition, 1e12);
  const Points got = system->evaluate({{}, {{0, motion}, {1, motion}}});
  for (std::size_t i = 0; i < got.size(); ++i) EXPECT_LT(distance(got[i], transformed(motion, mesh->points[i])), 1e-9);
}

/// Model, handles and lattice turned together: the result turns.
TEST(Ffd, DoesNotDependOnAxes) {
  const double c = std::cos(0.7), s = std::sin(0.7);
  const Affine turn{c, -s * 0.6, s * 0.8, 3, s, c * 0.6, -c * 0.8, -1, 0, 0.8, 0.6, 2};
  const auto mesh = shared(test::bumpy_sheet(31, 16));
  Mesh other = *mesh;
  for (Vec3& x : other.points) x = transformed(turn, x);
  const auto turned_mesh = shared(std::move(other));
  const LatticeFrame frame{{-0.1, -0.1, -0.3}, {{{2.2, 0, 0}, {0, 1.2, 0}, {0, 0, 0.6}}}};
  const auto linear = [&](const Vec3& v) { return transformed(turn, v) - transformed(turn, Vec3{}); };
  for (const FfdControl control : {FfdControl::energy, FfdControl::mesh}) {
    FfdOptions options = control == FfdControl::energy ? by_energy() : by_mesh({8, 6, 4}, 1e-5);
    options.handles = HandleMode::soft;
    options.lattice.frame = frame;
    deform::Setup setup = with(test::sheet_setup(), options);
    const SelectedRegions regions = validate(setup, *mesh);
    const Points got = prepare(mesh, setup)->evaluate({{}, {{0, identity_affine}}});
    EXPECT_LT(distance(got, mesh->points), 1e-12);
    std::vector<Vec3> lift(regions.handles[0].size());
    for (std::size_t i = 0; i < lift.size(); ++i) lift[i] = {0.1, 0, 0.3 + 0.1 * mesh->points[regions.handles[0][i]][1]};
    const Points moved = prepare(mesh, setup)->evaluate({{}, {{0, lift}}});

    options.lattice.frame =
        LatticeFrame{transformed(turn, frame.origin), {linear(frame.axes[0]), linear(frame.axes[1]), linear(frame.axes[2])}};
    // Bending counts like 1 / D against the misfit, and the box of the turned model is another one.
    options.bending *= bounding_box(mesh->points).diagonal() / bounding_box(turned_mesh->points).diagonal();
    setup.method = options;
    setup.handles[0].region = Region{Region::Ids{regions.handles[0]}};
    setup.fixed = {Region{Region::Ids{regions.fixed}}};
    for (Vec3& v : lift) v = linear(v);
    const Points also = prepare(turned_mesh, setup)->evaluate({{}, {{0, lift}}});
    for (std::size_t i = 0; i < also.size(); ++i) EXPECT_LT(distance(also[i], transformed(turn, moved[i])), 1e-8);
  }
}

TEST(Ffd, JacobianProducts) {
  const auto mesh = shared(test::bumpy_sheet(31, 16));
  for (const BasisMode basis : {BasisMode::always, BasisMode::never}) {
    for (const HandleMode handles : {HandleMode::hard, HandleMode::soft}) {
      FfdOptions options = by_energy({8, 6, 4});
      options.handles = handles;
      options.basis = basis;
      test::check_jacobians(*prepare(mesh, with(test::setup_with_variables(), options)), 1e-8, 1e-6);
    }
    FfdOptions options = by_mesh({8, 6, 4}, 1e-4);
    options.basis = basis;
    test::check_jacobians(*prepare(mesh, with(test::setup_with_variables(), options)), 1e-9, 1e-6);
  }
}

TEST(Ffd, SaysWhetherABasisIsStored) {
  const auto mesh = shared(test::bumpy_sheet(31, 16));
  const auto mentioned = [](const std::vector<std::string>& notes) {
    return std::any_of(notes.begin(), notes.end(), [](const std::string& note) { return note.starts_with("No handle basis"); });
  };
  for (const FfdOptions& control : {by_energy({8, 6, 4}), by_mesh()}) {
    for (const BasisMode basis : {BasisMode::always, BasisMode::never}) {
      FfdOptions options = control;
      options.basis = basis;
      const deform::Setup setup = with(test::setup_with_variables(), options);
      EXPECT_EQ(mentioned(prepare(mesh, setup)->info().notes), basis == BasisMode::never);
      EXPECT_EQ(mentioned(estimate(*mesh, setup).notes), basis == BasisMode::never);
    }
  }
}

TEST(Ffd, PopulationsEqualSingles) {
  const auto mesh = shared(test::bumpy_sheet(31, 16));
  test::check_population(*prepare(mesh, with(test::setup_with_variables(), by_energy({8, 6, 4}))), 5);
  test::check_population(*prepare(mesh, with(test::setup_with_variables(), by_mesh())), 5);
}

TEST(FfdByEnergy, ConstraintsHold) {
  const auto mesh = shared(test::bumpy_sheet(31, 16));
  for (const bool exact : {false, true}) {
    deform::Setup setup = with(test::setup_with_variables(), by_energy());
    setup.constraints = {{"patch", {test::box({1.2, 0.1, -9}, {1.6, 0.9, 9})}, Planar{}, 1e6, exact}};
    const auto system = prepare(mesh, setup);
    const Design design{{0.4, 0.5, 0.2, -0.4}, {}};
    const auto evaluation = system->bind({&design, 1}, EvaluationPath::automatic, {});
    const DesignReport& report = evaluation->report(0);
    EXPECT_TRUE(report.converged);
    EXPECT_FALSE(report.constraints[0].missed);
    EXPECT_LT(report.constraints[0].rms, 0.3 * report.constraints[0].rms_before);
    const Estimate expected = estimate(*mesh, setup);
    EXPECT_GE(expected.resident_bytes, system->info().bytes);
    if (!exact) test::check_jacobians(*system, 1e-6, 2e-2);
  }
}

TEST(FfdByEnergy, PointsOutsideStay) {
  const auto mesh = shared(test::bumpy_sheet(41, 21));
  FfdOptions options = by_energy();
  options.lattice.frame = LatticeFrame{{0.2, -0.1, -0.5}, {{{1.9, 0, 0}, {0, 1.2, 0}, {0, 0, 1}}}};
  const auto system = prepare(mesh, with(test::sheet_setup(), options));
  const Points got = system->evaluate(turned);
  const SelectedRegions regions = validate(test::sheet_setup(), *mesh);
  for (const PointId id : regions.fixed) EXPECT_EQ(got[id], mesh->points[id]);
  EXPECT_LT(system->bind({&turned, 1}, EvaluationPath::direct, {})->report(0).interpolation_residual, 1e-3);
}

TEST(Ffd, EstimatesBoundWhatIsTaken) {
  for (const std::size_t columns : {31u, 91u}) {
    const auto mesh = shared(test::bumpy_sheet(columns, columns / 2 + 1));
    FfdOptions soft = by_energy();
    soft.handles = HandleMode::soft;
    for (const FfdOptions& options : {by_energy(), soft, by_mesh(), by_mesh({6, 5, 4}, 1e-3)}) {
      const deform::Setup setup = with(test::setup_with_variables(), options);
      const Estimate expected = estimate(*mesh, setup);
      const auto system = prepare(mesh, setup);
      const SystemInfo& info = system->info();
      EXPECT_GE(expected.factor_bytes, info.factor_bytes);
      EXPECT_GE(expected.basis_bytes, info.basis_bytes);
      EXPECT_GE(expected.resident_bytes, info.bytes);
      EXPECT_LE(static_cast<double>(expected.resident_bytes), 2.5 * static_cast<double>(info.bytes));
      EXPECT_GE(expected.peak_bytes, expected.resident_bytes);
      EXPECT_EQ(expected.samples, info.samples);
    }
  }
}

TEST(Ffd, RefusesBadOptions) {
  const auto mesh = shared(test::bumpy_sheet(11, 6));
  const auto refused = [&](const std::vector<const char*>& parts, const auto& spoil) {
    deform::Setup setup = test::sheet_setup();
    FfdOptions& options = setup.method.emplace<FfdOptions>();
    spoil(setup, options);
    test::expect_error(ErrorCode::invalid_argument, parts, [&] { validate(setup, *mesh); });
  };
  using Setup = deform::Setup;
  refused({"method.ffd.lattice.points[1]", "3", "4..1000"}, [](Setup&, FfdOptions& o) { o.lattice.points = {4, 3, 4}; });
  refused({"method.ffd.lattice.points[0]", "17", "2..16"}, [](Setup&, FfdOptions& o) {
    o.lattice.points = {17, 3, 4};
    o.lattice.basis = LatticeBasis::bernstein;
  });
  refused({"method.ffd.lattice.points", "125000", "100000"}, [](Setup&, FfdOptions& o) { o.lattice.points = {50, 50, 50}; });
  refused({"method.ffd.lattice", "axes"}, [](Setup&, FfdOptions& o) {
    o.lattice.frame = LatticeFrame{{0, 0, 0}, {{{1, 0, 0}, {2, 0, 0}, {0, 0, 1}}}};
  });
  refused({"method.ffd", "stretching", "bending"}, [](Setup&, FfdOptions& o) { o.bending = 0; });
  refused({"method.ffd.lattice.points", "BERNSTEIN", "4000", "4096"}, [](Setup&, FfdOptions& o) {
    o.control = FfdControl::mesh;
    o.lattice.basis = LatticeBasis::bernstein;
    o.lattice.points = {16, 16, 16};
  });
  refused({"method.ffd.clamp", "0.6"}, [](Setup&, FfdOptions& o) {
    o.control = FfdControl::mesh;
    o.clamp = 0.6;
  });
  refused({"constraints", "method.ffd", "MESH", "ENERGY"}, [](Setup& s, FfdOptions& o) {
    o.control = FfdControl::mesh;
    s.constraints.push_back({"kept", {s.handles[0].region}, Planar{}});
  });
}

// ---- direct manipulation ----

/// The matrix of eq. 3.5 and its singular value decomposition by Jacobi rotations, which share nothing with what is tested.
struct Dense {
  Eigen::MatrixXd Phi;
  test::ThinSvd<double> svd;
  Dense(const Mesh& mesh, const FfdOptions& options, const std::vector<PointId>& held) {
    const Lattice lattice = lattice_of(options.lattice, mesh);
    Phi = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(held.size()), static_cast<Eigen::Index>(lattice.size()));
    for (std::size_t j = 0; j < held.size(); ++j) {
      lattice.for_each(lattice.weights(lattice.coordinates(mesh.points[held[j]])), [&](std::size_t p, double weight) {
        Phi(static_cast<Eigen::Index>(j), static_cast<Eigen::Index>(p)) = weight;
      });
    }
    svd = test::thin_svd(Phi);
  }
  Eigen::MatrixXd solve(const Eigen::MatrixXd& h, double clamp) const {
    const Eigen::VectorXd& s = svd.values;
    Eigen::Index rank = 1;
    while (rank < s.size() && s[rank] > clamp * s[0]) ++rank;
    return svd.V.leftCols(rank) * s.head(rank).cwiseInverse().asDiagonal() * (svd.U.leftCols(rank).transpose() * h);
  }
};

std::vector<PointId> held_points(const Mesh& mesh, const deform::Setup& setup) {
  const ConstraintPoints points = constraint_points(mesh, validate(setup, mesh));
  std::vector<PointId> held;
  for (std::size_t i = 0; i < mesh.point_count(); ++i) {
    if (points.region_of[i] != deformable_region) held.push_back(static_cast<PointId>(i));
  }
  return held;
}

Eigen::MatrixXd random_matrix(Eigen::Index rows, Eigen::Index columns, unsigned seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  Eigen::MatrixXd result(rows, columns);
  for (Eigen::Index i = 0; i < rows; ++i) {
    for (Eigen::Index j = 0; j < columns; ++j) result(i, j) = normal(random);
  }
  return result;
}

TEST(ClampedInverse, IsThePseudoInverse) {
  // Many points per cell (least squares), and fewer points than functions (least motion).
  for (const std::size_t columns : {61u, 15u}) {
    const Mesh mesh = test::bumpy_sheet(columns, columns / 2 + 1);
    for (const LatticeBasis basis : {LatticeBasis::uniform_cubic, LatticeBasis::bernstein}) {
      FfdOptions options = by_mesh({6, 5, 4});
      options.lattice.basis = basis;
      const deform::Setup setup = with(test::sheet_setup(), options);
      const std::vector<PointId> held = held_points(mesh, setup);
      const Dense dense(mesh, options, held);
      const ModelLattice made =
          model_lattice(mesh, options.lattice, std::vector<RegionIndex>(mesh.point_count(), deformable_region), {});
      const auto m = static_cast<Eigen::Index>(held.size());
      const Eigen::MatrixXd h = random_matrix(m, 3, 1), g = random_matrix(dense.Phi.cols(), 2, 2);
      for (const double clamp : {1e-2, 1e-4, 1e-6}) {
        SCOPED_TRACE(testing::Message() << columns << " " << static_cast<int>(basis) << " " << clamp);
        const SparseRows everywhere = Eigen::MatrixXd(dense.Phi).sparseView();
        const ClampedInverse inverse(*made.rows, held, {clamp, {}, {{everywhere}, 1e-16}}, {});
        const auto [got, parts] = inverse.solution(h);
        const Eigen::MatrixXd expected = dense.solve(h, clamp), off = dense.Phi * (got - expected);
        const double size = expected.norm();
        EXPECT_LT((got - expected).norm(), 1e-8 * size);
        // What is said of the error covers it; both solutions have one.
        for (Eigen::Index c = 0; c < 3; ++c) {
          const HeldInverse::Sizes sizes{got.col(c).norm(), (h - dense.Phi * got).col(c).norm(), 0};
          const double told = inverse.uncertainty(0, parts.col(c), sizes).maxCoeff();
          EXPECT_LT(off.col(c).cwiseAbs().maxCoeff(), 2 * told);
          EXPECT_LT(told, 1e-7 * h.norm());
        }
        const Eigen::MatrixXd back = inverse.adjoint(g);
        const double left = (got.leftCols(2).cwiseProduct(g)).sum(), right = (h.leftCols(2).cwiseProduct(back)).sum();
        EXPECT_NEAR(left, right, 1e-12 * size * g.norm());
        const ClampedInverse::Bytes bytes = ClampedInverse::estimate(*made.rows, held);
        EXPECT_GE(bytes.resident, inverse.bytes());
        EXPECT_EQ(bytes.functions, inverse.functions());
        const Eigen::Index rank = (dense.svd.values.array() > clamp * dense.svd.values[0]).count();
        const double condition = dense.svd.values[0] / dense.svd.values[rank - 1];
        EXPECT_NEAR(inverse.condition(), condition, 1e-6 * condition);
      }
    }
  }
}

/// A pair of singular values on both sides of the clamp, as close as even and odd functions have them: what a column has along
/// their vectors is as uncertain as these, and what it has elsewhere, met or missed, is not.
TEST(ClampedInverse, CountsAPairAtTheClampWhereItMatters) {
  const Eigen::Index m = 12, k = 6;
  const Eigen::MatrixXd Q = test::orthogonal_of(random_matrix(m, m, 3));
  const Eigen::MatrixXd P = test::orthogonal_of(random_matrix(k, k, 4));
  const double pair = 1e-3, gap = 1e-10;
  Eigen::VectorXd values(k);
  values << 1, 0.5, pair * (1 + gap), pair, 1e-5, 1e-6;
  const Eigen::MatrixXd phi = Q.leftCols(k) * values.asDiagonal() * P.transpose(), sums = random_matrix(5, k, 5);
  const SparseRows rows = phi.sparseView(0, 0), checked = sums.sparseView(0, 0);
  std::vector<PointId> held(static_cast<std::size_t>(m));
  for (std::size_t i = 0; i < held.size(); ++i) held[i] = static_cast<PointId>(i);
  const ClampedInverse inverse(rows, held, {pair * (1 + 0.5 * gap), {}, {{checked}, 1e-16}}, {});
  ASSERT_EQ(inverse.rank(), 3u);
  Eigen::MatrixXd h(m, 3);
  h.col(0) = Q.leftCols(k).rowwise().sum();
  h.col(1) = Q.col(0) - 2 * Q.col(1);
  h.col(2) = Q.col(0) + 100 * (Q.col(4) + Q.col(k) + Q.col(k + 1));
  const auto [got, parts] = inverse.solution(h);
  const Eigen::MatrixXd expected = P.leftCols(3) * values.head(3).cwiseInverse().asDiagonal() * (Q.leftCols(3).transpose() * h);
  for (Eigen::Index c = 0; c < 3; ++c) {
    const double off = (sums * (got - expected).col(c)).cwiseAbs().maxCoeff();
    const double told = inverse.uncertainty(0, parts.col(c), {got.col(c).norm(), (phi * got - h).col(c).norm(), 0}).maxCoeff();
    EXPECT_GE(told, 0.5 * off) << c;
    if (c == 0) {
      EXPECT_GT(off, 1e-5) << "the pair is too far apart for this test";
      EXPECT_LT(told, 1e3 * off);
    } else {
      EXPECT_LT(told, c == 1 ? 1e-11 : 1e-6) << c;
    }
  }
}

TEST(FfdByMesh, MeetsWhatItCanWithTheLeastMotion) {
  // Few points, many functions (thesis 3.3: under-determined): handles are met.
  const auto mesh = shared(test::bumpy_sheet(15, 8));
  const FfdOptions options = by_mesh({14, 10, 4}, 1e-14);
  const deform::Setup setup = with(test::sheet_setup(), options);
  const auto system = prepare(mesh, setup);
  const std::vector<PointId> held = held_points(*mesh, setup);
  const Points got = system->evaluate(turned);
  const SelectedRegions regions = validate(setup, *mesh);
  for (const PointId id : regions.handles[0]) {
    EXPECT_LT(distance(got[id], transformed(test::turn_and_shift(), mesh->points[id])), 1e-10);
  }
  for (const PointId id : regions.fixed) EXPECT_LT(distance(got[id], mesh->points[id]), 1e-10);
  EXPECT_LT(system->bind({&turned, 1}, EvaluationPath::direct, {})->report(0).interpolation_residual, 1e-10);
}

TEST(FfdByMesh, SaysByHowMuchHandlesAreMissed) {
  const auto mesh = shared(test::bumpy_sheet(61, 31));
  for (const double clamp : {1e-4, 0.3}) {
    const deform::Setup setup = with(test::sheet_setup(), by_mesh({8, 6, 4}, clamp));
    const auto system = prepare(mesh, setup);
    const SelectedRegions regions = validate(setup, *mesh);
    for (const EvaluationPath path : {EvaluationPath::basis, EvaluationPath::direct}) {
      const Points got = system->evaluate({&turned, 1}, path)[0];
      double missed = 0;
      for (const PointId id : regions.fixed) missed = std::max(missed, distance(got[id], mesh->points[id]));
      for (const PointId id : regions.handles[0]) {
        missed = std::max(missed, distance(got[id], transformed(test::turn_and_shift(), mesh->points[id])));
      }
      EXPECT_GT(missed, 1e-6);
      EXPECT_NEAR(system->bind({&turned, 1}, path, {})->report(0).misfit, missed, 1e-9 * missed + 1e-13);
    }
  }
  const auto by_energies = prepare(mesh, with(test::sheet_setup(), by_energy()));
  EXPECT_EQ(by_energies->bind({&turned, 1}, EvaluationPath::direct, {})->report(0).misfit, 0) << "these are met";
}

TEST(FfdByMesh, AllPointsFollowTheLattice) {
  const auto mesh = shared(test::bumpy_sheet(61, 31));
  const FfdOptions options = by_mesh({8, 6, 4}, 1e-4);
  const deform::Setup setup = with(test::sheet_setup(), options);
  const std::vector<PointId> held = held_points(*mesh, setup);
  const SelectedRegions regions = validate(setup, *mesh);
  Eigen::MatrixXd h = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(held.size()), 3);
  for (std::size_t j = 0; j < held.size(); ++j) {
    if (!std::binary_search(regions.handles[0].begin(), regions.handles[0].end(), held[j])) continue;
    const Vec3 u = transformed(test::turn_and_shift(), mesh->points[held[j]]) - mesh->points[held[j]];
    h.row(static_cast<Eigen::Index>(j)) << u[0], u[1], u[2];
  }
  const Dense dense(*mesh, options, held);
  const Eigen::MatrixXd w = dense.solve(h, options.clamp);
  const Lattice lattice = lattice_of(options.lattice, *mesh);
  const auto system = prepare(mesh, setup);
  for (const EvaluationPath path : {EvaluationPath::basis, EvaluationPath::direct}) {
    const Points got = system->evaluate({&turned, 1}, path)[0];
    for (std::size_t i = 0; i < got.size(); ++i) {
      Vec3 expected = mesh->points[i];
      lattice.for_each(lattice.weights(lattice.coordinates(expected)), [&, at = expected](std::size_t p, double weight) {
        for (std::size_t k = 0; k < 3; ++k) expected[k] += weight * w(static_cast<Eigen::Index>(p), static_cast<Eigen::Index>(k));
      });
      EXPECT_LT(distance(got[i], expected), 1e-9);
    }
    const DesignReport report = system->bind({&turned, 1}, path, {})->report(0);
    EXPECT_NEAR(report.control_displacement, w.rowwise().norm().maxCoeff(), 1e-8 * report.control_displacement);
    const double missed = (h - dense.Phi * w).rowwise().norm().maxCoeff();
    EXPECT_NEAR(report.interpolation_residual, missed, 1e-9);
  }
}

// Thesis 4.3, figure 4.3: smaller clamps meet handles better and move control points farther; the automatic one is in between.
TEST(FfdByMesh, ClampsTradeMisfitForMotion) {
  const auto mesh = shared(test::bumpy_sheet(61, 31));
  const auto report = [&](double clamp, std::vector<std::string>* notes = nullptr) {
    const auto system = prepare(mesh, with(test::sheet_setup(), by_mesh({6, 5, 4}, clamp)));
    if (notes != nullptr) *notes = system->info().notes;
    return system->bind({&turned, 1}, EvaluationPath::direct, {})->report(0);
  };
  std::vector<std::string> notes;
  const DesignReport strong = report(0.3), weak = report(1e-12), automatic = report(0, &notes);
  EXPECT_GT(strong.interpolation_residual, 2 * weak.interpolation_residual);
  EXPECT_GT(weak.control_displacement, 100 * strong.control_displacement);
  EXPECT_LT(automatic.interpolation_residual, strong.interpolation_residual);
  EXPECT_LT(automatic.control_displacement, 20 * automatic.prescribed_displacement);
  EXPECT_TRUE(automatic.warnings.empty());
  ASSERT_EQ(weak.warnings.size(), 1u);
  EXPECT_NE(weak.warnings[0].find("control points move by up to"), std::string::npos);
  EXPECT_TRUE(std::any_of(notes.begin(), notes.end(), [](const std::string& n) { return n.find("rank") != std::string::npos; }));
}

/// One handle holds all points, whose affine motions any clamp meets: other motions of them must not make control points swing.
TEST(FfdByMesh, AutomaticClampsBearWavesOfTheModel) {
  const auto mesh = shared(test::bumpy_sheet(31, 13));
  deform::Setup setup;
  setup.handles = {{"all", {Region::All{}}}};
  std::vector<Vec3> wave, affine;
  for (const Vec3& x : mesh->points) {
    wave.push_back({0, 0, 0.2 * std::sin(3 * x[0])});
    affine.push_back({0.1 * x[2], 0.2 * x[0] - 0.1, 0.3 * x[1]});
  }
  for (const auto& points : {std::array<std::size_t, 3>{8, 6, 4}, {12, 10, 4}, {10, 5, 6}}) {
    SCOPED_TRACE(points[0]);
    const auto report = [&](double clamp, const std::vector<Vec3>& displacements) {
      const auto system = prepare(mesh, with(setup, by_mesh(points, clamp)));
      const Design design{{}, {{0, displacements}}};
      return system->bind({&design, 1}, EvaluationPath::direct, {})->report(0);
    };
    const DesignReport automatic = report(0, wave), weak = report(1e-8, wave);
    EXPECT_GT(weak.control_displacement, 50 * weak.prescribed_displacement);
    EXPECT_LT(automatic.control_displacement, 20 * automatic.prescribed_displacement);
    EXPECT_TRUE(automatic.warnings.empty());
    EXPECT_LT(automatic.misfit, 3 * weak.misfit + 1e-4);
    EXPECT_LT(report(0, affine).misfit, 1e-4);
  }
}

/// Handles that one variable moves against each other are met as well as handles with variables of their own: the clamp sees what
/// the variable does. Where it moves them alike they are one handle.
TEST(FfdByMesh, AutomaticClampsSeeWhatAVariableMoves) {
  const auto mesh = shared(test::bumpy_sheet(61, 31));
  for (const bool alike : {false, true}) {
    deform::Setup joint;
    joint.method = by_mesh({12, 8, 5});
    joint.handles = {{"left", test::box({0, 0, -1}, {0.8, 1, 1})}, {"right", test::box({1.2, 0, -1}, {2, 1, 1})}};
    deform::Setup apart = joint, one = joint;
    const Vec3 up{0, 0, 1};
    joint.variables = {{"roll", "left", DesignVariable::Translate{up}}};
    joint.variables[0].also = {{"right", DesignVariable::Translate{alike ? up : -1.0 * up}}};
    apart.variables = {{"left", "left", DesignVariable::Translate{up}}, {"right", "right", DesignVariable::Translate{up}}};
    one.handles = {{"both", {Region::Union{{joint.handles[0].region, joint.handles[1].region}}}}};
    const auto report = [&](const deform::Setup& setup, const Design& design) {
      return prepare(mesh, setup)->bind({&design, 1}, EvaluationPath::direct, {})->report(0);
    };
    const DesignReport got = report(joint, {{0.2}, {}}), separate = report(apart, {{0.2, alike ? 0.2 : -0.2}, {}});
    if (alike) {
      const Affine shift{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0.2};
      EXPECT_NEAR(got.misfit, report(one, {{}, {{0, shift}}}).misfit, 1e-12);
    } else {
      EXPECT_LT(got.misfit, 1.5 * separate.misfit);
      EXPECT_LT(got.control_displacement, 2 * separate.control_displacement) << "27 where only joint motions are seen";
    }
  }
}

/// Lattices that are too large for a decomposition: the damped least-squares problem, by dense QR of the damped rows.
TEST(DampedInverse, IsTheDampedSolution) {
  const auto mesh = shared(test::bumpy_sheet(40, 17));
  LatticeOptions lattice;
  lattice.points = {9, 6, 4};
  std::mt19937_64 random(18);
  std::normal_distribution<double> normal;
  for (const LatticeBasis basis : {LatticeBasis::uniform_cubic, LatticeBasis::bernstein}) {
    lattice.basis = basis;
    const ModelLattice made = model_lattice(*mesh, lattice, std::vector<RegionIndex>(mesh->point_count(), 0), {});
    std::vector<PointId> held;
    for (PointId id = 0; id < mesh->point_count(); ++id) {
      if (mesh->points[id][0] < 0.9 || id % 7 == 0) held.push_back(id);
    }
    const auto m = static_cast<Eigen::Index>(held.size()), k = static_cast<Eigen::Index>(made.rows->cols());
    Eigen::MatrixXd phi = Eigen::MatrixXd::Zero(m, k), h(m, 3), g(k, 2);
    for (Eigen::Index j = 0; j < m; ++j) {
      made.rows->for_each(held[static_cast<std::size_t>(j)], [&](std::int64_t column, double value) { phi(j, column) = value; });
    }
    for (double& value : h.reshaped()) value = normal(random);
    for (double& value : g.reshaped()) value = normal(random);
    const double largest = test::thin_svd(phi).values[0];
    for (const double damping : {1e-1, 1e-3, 1e-5}) {
      SCOPED_TRACE(testing::Message() << static_cast<int>(basis) << " " << damping);
      const DampedInverse inverse(*made.rows, held, {damping, {}, {{Eigen::MatrixXd::Identity(k, k).sparseView()}, 0}}, {});
      Eigen::MatrixXd damped(m + k, k), right = Eigen::MatrixXd::Zero(m + k, 3);
      damped << phi, damping * largest * Eigen::MatrixXd::Identity(k, k);
      right.topRows(m) = h;
      const Eigen::MatrixXd expected = test::least_squares(damped, right), got = inverse.solve(h);
      const double size = expected.cwiseAbs().maxCoeff();
      EXPECT_LT((got - expected).cwiseAbs().maxCoeff(), 1e-9 * size);
      for (Eigen::Index c = 0; c < 3; ++c) {
        const double off = (got.col(c) - expected.col(c)).norm();
        const HeldInverse::Sizes sizes{expected.col(c).norm(), (phi * expected.col(c) - h.col(c)).norm(), 0};
        EXPECT_LT(off, inverse.uncertainty(0, {}, sizes).minCoeff());
      }
      // The adjoint is the transpose, and columns do not depend on others.
      const Eigen::MatrixXd back = inverse.adjoint(g);
      const double left = (g.transpose() * got).sum(), other = (back.transpose() * h).sum();
      EXPECT_NEAR(left, other, 1e-11 * g.norm() * got.norm());
      EXPECT_TRUE(inverse.solve(h.col(1)) == got.col(1));
      const HeldInverse::Bytes bytes = DampedInverse::estimate(*made.rows, held);
      EXPECT_GE(bytes.resident, inverse.bytes());
      EXPECT_LE(bytes.resident, 2 * inverse.bytes());
    }
    EXPECT_GE(DampedInverse(*made.rows, held, {0, {h, {}}, {}}, {}).damping(), 1e-5);
    test::expect_error(ErrorCode::invalid_argument, {"method.ffd.clamp", "1e-07", "1e-06"}, [&] {
      DampedInverse(*made.rows, held, {1e-7, {}, {}}, {});
    });
  }
}

TEST(DampedInverse, SaysItsDampingAndItsCondition) {
  const Mesh mesh = test::bumpy_sheet(15, 8);
  LatticeOptions lattice;
  lattice.points = {4, 4, 4};
  const ModelLattice made = model_lattice(mesh, lattice, std::vector<RegionIndex>(mesh.point_count(), 0), {});
  std::vector<PointId> held(mesh.point_count());
  for (PointId id = 0; id < held.size(); ++id) held[id] = id;
  for (const double damping : {0.03, 1e-4}) {
    const DampedInverse inverse(*made.rows, held, {damping, {}, {}}, {});
    EXPECT_EQ(inverse.damping(), damping);
    EXPECT_DOUBLE_EQ(inverse.condition(), 1 / damping);
    EXPECT_NE(inverse.note().find("damped with " + number_digits(damping) + " of the largest singular value, because 64 of them"),
              std::string::npos)
        << inverse.note();
  }
}

TEST(FfdByMesh, RefusesTooManyControlPoints) {
  const auto mesh = shared(test::bumpy_sheet(321, 161));
  deform::Setup setup = with(test::sheet_setup(), by_mesh({220, 110, 4}));
  setup.fixed = {{Region::Complement{{setup.handles[0].region}}}};
  test::expect_error(ErrorCode::invalid_argument, {"method.ffd.control", "at most 30000"}, [&] { estimate(*mesh, setup); });
  test::expect_error(ErrorCode::invalid_argument, {"method.ffd.control", "at most 30000"}, [&] { prepare(mesh, setup); });
}

TEST(FfdByMesh, TakesLatticesThatAreTooLargeForADecomposition) {
  const auto mesh = shared(test::bumpy_sheet(161, 81));
  deform::Setup setup = with(test::setup_with_variables(), by_mesh({110, 60, 4}));
  const Estimate expected = estimate(*mesh, setup);
  const auto system = prepare(mesh, setup);
  test::expect_bounds(expected, system->info());
  EXPECT_TRUE(std::any_of(system->info().notes.begin(), system->info().notes.end(),
                          [](const std::string& note) { return note.find("are damped with") != std::string::npos; }));
  const auto report = system->bind({&turned, 1}, EvaluationPath::direct, {})->report(0);
  EXPECT_LT(report.misfit, 1e-3);
  EXPECT_LT(report.control_displacement, 20 * report.prescribed_displacement);
  EXPECT_TRUE(report.warnings.empty());
  // Both paths within what is told of them: what the fit misses is amplified by the square of the damping.
  const double told = report.error + system->bind({&turned, 1}, EvaluationPath::basis, {})->report(0).error;
  EXPECT_LT(told, 1e-3);
  EXPECT_LT(distance(system->evaluate({&turned, 1}, EvaluationPath::direct)[0],
                     system->evaluate({&turned, 1}, EvaluationPath::basis)[0]),
            told);
  test::check_jacobians(*system, 1e-12, 1e-7);
  test::check_population(*system, 3);
}

}  // namespace
}  // namespace deform::ffd_test
