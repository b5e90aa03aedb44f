// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/mesh/winding_number.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "core/base/vectors.h"
#include "tests/core/quality/surface_meshes.h"

namespace deform::winding_number_test {
namespace {

/// The sum over all triangles in long double, by the angles of the spherical triangles.
double direct(const Mesh& mesh, const Vec3& x) {
  long double sum = 0;
  for (std::size_t f = 0; f < mesh.face_count(); ++f) {
    std::array<std::array<long double, 3>, 3> u;
    for (std::size_t i = 0; i < 3; ++i) {
      const Vec3 from = mesh.points[mesh.face_points[3 * f + i]] - x;
      const long double size =
          std::sqrt(static_cast<long double>(from[0]) * from[0] + static_cast<long double>(from[1]) * from[1] +
                    static_cast<long double>(from[2]) * from[2]);
      for (std::size_t k = 0; k < 3; ++k) u[i][k] = from[k] / size;
    }
    const auto dot = [&](std::size_t i, std::size_t j) { return u[i][0] * u[j][0] + u[i][1] * u[j][1] + u[i][2] * u[j][2]; };
    const long double triple = u[0][0] * (u[1][1] * u[2][2] - u[1][2] * u[2][1]) -
                               u[0][1] * (u[1][0] * u[2][2] - u[1][2] * u[2][0]) +
                               u[0][2] * (u[1][0] * u[2][1] - u[1][1] * u[2][0]);
    sum += 2 * std::atan2(triple, 1 + dot(0, 1) + dot(1, 2) + dot(2, 0));
  }
  return static_cast<double>(sum / (4 * std::numbers::pi_v<long double>));
}

TEST(WindingNumber, IsTheSumOfTheSolidAngles) {
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> uniform(-1.5, 1.5);
  Mesh closed = test::sphere(1, 4), open = closed;
  open.face_sizes.resize(3 * open.face_count() / 4);  // a quarter is missing
  open.face_points.resize(3 * open.face_count());
  for (const Mesh& mesh : {closed, open, test::tube(0.7, 40, 20, 1.1, test::Faces::triangles)}) {
    const WindingNumber winding(mesh, mesh.points);
    for (int i = 0; i < 300; ++i) {
      const Vec3 x{uniform(random), uniform(random), uniform(random)};
      EXPECT_NEAR(winding.at(x), direct(mesh, x), 0.01);
    }
  }
}

TEST(WindingNumber, TellsInsideFromOutsideUpToTheFaces) {
  const Mesh mesh = test::sphere(1, 5);
  const WindingNumber winding(mesh, mesh.points);
  for (std::size_t f = 0; f < mesh.face_count(); f += 7) {
    const PointId* const corners = mesh.face_points.data() + 3 * f;
    const Vec3 middle = (mesh.points[corners[0]] + mesh.points[corners[1]] + mesh.points[corners[2]]) / 3;
    EXPECT_NEAR(winding.at((1 - 1e-7) * middle), 1, 0.02);
    EXPECT_NEAR(winding.at((1 + 1e-7) * middle), 0, 0.02);
  }
}

TEST(WindingNumber, OfFacesThatFaceInwardsIsNegative) {
  Mesh mesh = test::sphere(1, 3);
  for (std::size_t f = 0; f < mesh.face_count(); ++f) std::swap(mesh.face_points[3 * f], mesh.face_points[3 * f + 1]);
  EXPECT_NEAR(WindingNumber(mesh, mesh.points).at({0.2, 0.1, 0}), -1, 0.01);
}

TEST(WindingNumber, OfNoFacesIsZero) {
  Mesh mesh;
  mesh.points = {{1, 2, 3}};
  EXPECT_EQ(WindingNumber(mesh, mesh.points).at({0, 0, 0}), 0);
}

}  // namespace
}  // namespace deform::winding_number_test
