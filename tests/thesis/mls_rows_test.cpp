// T34 (thesis 8.3, figure 8.3): functions in space for energies on the mesh. T37 (8.4, figure 8.5): energies in space as well.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/deformers/mls_space.h"
#include "core/deformers/subspace_space.h"
#include "core/mesh/shell_operators.h"
#include "core/numerics/kernel_rows.h"
#include "core/numerics/subspace.h"
#include "tests/core/deformers/space_cases.h"

namespace deform {
namespace {

using Eigen::VectorXd;

/// The shell on the mesh (thesis eq. 8.10) as a space whose functions are those of the points.
EnergySpace mesh_space(const Mesh& mesh, double stretching, double bending) {
  const ShellOperators shell = shell_operators(mesh, bounding_box(mesh.points).diagonal());
  const Eigen::Index n = shell.areas.size();
  SparseMatrix inverse_areas(n, n), identity(n, n);
  identity.setIdentity();
  inverse_areas.setIdentity();
  for (Eigen::Index i = 0; i < n; ++i) inverse_areas.coeffRef(i, i) = 1 / shell.areas[i];
  EnergySpace space;
  space.values = identity;
  const SparseMatrix whole =
      -stretching * shell.laplacian + bending * SparseMatrix(shell.laplacian * inverse_areas * shell.laplacian);
  space.energy = whole.triangularView<Eigen::Lower>();
  return space;
}

/// What is held, and where to.
struct Held {
  std::vector<PointId> points;
  VectorXd prescribed;
};

/// The plane is fixed at both ends and lifted by 0.2 in the middle: a strip across it, or a disc while the whole rim is fixed.
enum class Lifted { strip, disc };
Held lift(const Mesh& mesh, Lifted lifted) {
  const Box box = bounding_box(mesh.points);
  std::vector<double> values;
  Held held;
  for (PointId i = 0; i < mesh.points.size(); ++i) {
    const double x = mesh.points[i][0], y = mesh.points[i][1] - box.max[1] / 2;
    const bool handle = lifted == Lifted::strip ? std::abs(x - 0.5) < 0.1 : std::hypot(x - 0.5, y) < 0.1;
    const double to_rim = std::min({x, 1 - x, lifted == Lifted::strip ? 1.0 : box.max[1] / 2 - std::abs(y)});
    if (!handle && to_rim > (lifted == Lifted::strip ? 0.1 : 0.06)) continue;
    held.points.push_back(i);
    values.push_back(handle ? 0.2 / box.diagonal() : 0);
  }
  held.prescribed = Eigen::Map<VectorXd>(values.data(), static_cast<Eigen::Index>(values.size()));
  return held;
}

VectorXd solution(const EnergySpace& space, const Held& held) {
  return test::least_energy(space, held.points, held.prescribed) / held.prescribed.maxCoeff();
}

// 1000 functions for 1100 points, errors relative to the lift of 0.2 (largest, root mean square), the strip lifted.
TEST(T34, OrderOfFigure83) {
  const Mesh plane = test::thesis_plane();
  const Held held = lift(plane, Lifted::strip);
  struct Row {
    const char* name;
    SubspaceKernel kernel;
    double cover;
  };
  const std::vector<Row> rows{{"triharmonic", SubspaceKernel::triharmonic, 5},
                              {"biharmonic", SubspaceKernel::biharmonic, 5},
                              {"wendland 5", SubspaceKernel::wendland_c2, 5},
                              {"wendland 50", SubspaceKernel::wendland_c2, 50},
                              {"gaussian 5", SubspaceKernel::gaussian, 5},
                              {"gaussian 50", SubspaceKernel::gaussian, 50},
                              {"mls 5", SubspaceKernel::mls, 5}};
  for (const bool bending : {true, false}) {
    const VectorXd reference = solution(mesh_space(plane, bending ? 0 : 1, bending ? 1 : 0), held);
    std::map<std::string, double> largest, mean;
    for (const auto& [name, kernel, cover] : rows) {
      SubspaceOptions options;
      options.kernel = kernel;
      options.cover = cover;
      options.centres = 1000;
      options.stretching = bending ? 0 : 1;
      options.bending = bending ? 1 : 0;
      const VectorXd error = solution(subspace_space(plane, options, 1), held) - reference;
      largest[name] = error.cwiseAbs().maxCoeff();
      mean[name] = error.norm() / std::sqrt(1100.0);
      std::printf("T34 %-10s %-12s largest %.5f rms %.5f\n", bending ? "bending" : "stretching", name, largest[name], mean[name]);
    }
    for (const char* poor : {"wendland 5", "gaussian 5"}) EXPECT_LT(10 * largest["mls 5"], largest[poor]) << poor;
    EXPECT_LT(largest["mls 5"], bending ? 0.005 : 0.03);
    EXPECT_LT(largest["wendland 50"], 0.1);  // comparable: 40 and 100 times better than with a cover of 5
    EXPECT_LT(largest["wendland 50"], 0.1 * largest["wendland 5"]);
    EXPECT_LT(largest["gaussian 50"], 0.1 * largest["gaussian 5"]);
    if (!bending) {
      // Triharmonic functions are the best for bending and among the worst for stretching: with orthonormal combinations they are
      // several times behind; as they stand (next test) they fail.
      EXPECT_GT(largest["triharmonic"], 2.5 * largest["mls 5"]);
      EXPECT_GT(largest["biharmonic"], largest["mls 5"]);
    }
  }
}

// The thesis' own way: normal equations of the functions as they stand.
TEST(T34, TriharmonicFunctionsAsTheyStandFailForStretching) {
  const Mesh plane = test::thesis_plane();
  const Held held = lift(plane, Lifted::strip);
  std::vector<Vec3> centres(plane.points.begin(), plane.points.end());
  for (Vec3& x : centres) x[0] += 0.003;  // nearly as good as spread ones, and simple
  centres.resize(1000);
  const Eigen::MatrixXd phi = full_kernel_rows({Kernel::triharmonic, 1}, centres, plane.points);
  EnergySpace space;
  space.values = phi.sparseView(0, 0);
  const SparseMatrix shell = mesh_space(plane, 1, 0).energy.selfadjointView<Eigen::Lower>();
  space.energy = projected_lower(shell, phi);
  EXPECT_THROW(test::least_energy(space, held.points, held.prescribed), Error);
}

struct Regime {
  const char* name;
  double stretching, bending;
};

class T37 : public testing::TestWithParam<Regime> {};

TEST_P(T37, EnergiesInSpaceGiveTheSolutionOfTheMesh) {
  const Mesh plane = test::thesis_plane();
  ASSERT_EQ(plane.points.size(), 1100u);
  const auto& [name, stretching, bending] = GetParam();
  MlsOptions options;
  options.stretching = stretching;
  options.bending = bending;
  options.surface_samples = 1000;
  const EnergySpace space = mls_space(plane, options, 1), reference = mesh_space(plane, stretching, bending);
  EXPECT_EQ(space.samples, 1000u);
  EXPECT_NEAR(static_cast<double>(space.cubature_points), 4000, 40);
  for (const Lifted lifted : {Lifted::strip, Lifted::disc}) {
    const Held held = lift(plane, lifted);
    const double height = held.prescribed.maxCoeff();
    const VectorXd error =
        test::least_energy(space, held.points, held.prescribed) - test::least_energy(reference, held.points, held.prescribed);
    const double worst = error.cwiseAbs().maxCoeff() / height;
    // Stretching alone has a kink at the handle; round a disc it falls by a quarter of the height from one point of the mesh to
    // the next, where functions that reach over several points cannot follow.
    const bool kink = bending == 0 && lifted == Lifted::disc;
    EXPECT_LE(worst, kink ? 0.15 : 0.05) << name << (lifted == Lifted::strip ? " strip" : " disc");
    EXPECT_LE(error.norm() / std::sqrt(1100) / height, 0.02);
    RecordProperty(lifted == Lifted::strip ? "strip" : "disc", std::to_string(worst));
  }
}

INSTANTIATE_TEST_SUITE_P(Regimes, T37,
                         testing::Values(Regime{"bending", 0, 1}, Regime{"stretching", 1, 0}, Regime{"both", 1, 0.6}),
                         [](const auto& tested) { return std::string(tested.param.name); });

// Why bending is the whole second derivative: with free rims, as with the strip, |laplace d|^2 lets the rim go.
TEST(T37Forms, LaplacianAsPrintedLetsFreeRimsGo) {
  const Mesh plane = test::thesis_plane();
  const EnergySpace reference = mesh_space(plane, 0, 1);
  MlsOptions options;
  options.surface_samples = 1000;
  const auto worst = [&](BendingForm form, Lifted lifted) {
    const Held held = lift(plane, lifted);
    const VectorXd error = test::least_energy(mls_space(plane, options, 1, {}, form), held.points, held.prescribed) -
                           test::least_energy(reference, held.points, held.prescribed);
    return error.cwiseAbs().maxCoeff() / held.prescribed.maxCoeff();
  };
  EXPECT_LE(worst(BendingForm::laplacian, Lifted::disc), 0.05);
  EXPECT_GT(worst(BendingForm::laplacian, Lifted::strip), 0.2);
}

// Faces added on the same points, degenerate, double and non-manifold, change where samples fall, but hardly the result; a grid
// cut into single triangles is as good as a whole one.
TEST(T37Defects, FacesDoNotMatter) {
  const Mesh plane = test::thesis_plane();
  Mesh defect = plane;
  for (PointId i = 100; i < 160; ++i) {
    defect.face_sizes.insert(defect.face_sizes.end(), {3, 3, 4});
    defect.face_points.insert(defect.face_points.end(), {i, i, i + 1, i, i + 1, i + 2, i, i + 1, i + 45, i + 44});
  }
  Mesh soup;
  std::size_t corner = 0;
  for (const std::uint32_t size : plane.face_sizes) {
    for (std::uint32_t c = 0; c < size; ++c, ++corner) {
      soup.face_points.push_back(static_cast<PointId>(soup.points.size()));
      soup.points.push_back(plane.points[plane.face_points[corner]]);
    }
    soup.face_sizes.push_back(size);
  }
  MlsOptions options;
  options.surface_samples = 600;
  options.stretching = 1;
  options.bending = 0.6;
  const auto result = [&](const Mesh& mesh) {
    const Held held = lift(mesh, Lifted::disc);
    return VectorXd(test::least_energy(mls_space(mesh, options, 1), held.points, held.prescribed) / held.prescribed.maxCoeff());
  };
  const VectorXd whole = result(plane), with_defects = result(defect), of_soup = result(soup);
  EXPECT_LE((whole - with_defects).cwiseAbs().maxCoeff(), 0.05);
  double worst = 0;
  for (std::size_t i = 0; i < soup.points.size(); ++i) {
    worst = std::max(worst, std::abs(of_soup[static_cast<Eigen::Index>(i)] - whole[plane.face_points[i]]));
  }
  EXPECT_LE(worst, 0.05);
}

}  // namespace
}  // namespace deform
