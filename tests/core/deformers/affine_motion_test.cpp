// SPDX-License-Identifier: GPL-3.0-or-later
// All handles move by the same affine map: what is between them has to follow.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "core/base/vectors.h"
#include "core/deformers/system.h"
#include "core/mesh/ahmed.h"
#include "tests/core/quality/surface_meshes.h"

namespace deform {
namespace {

/// By 30 degrees about (1, 2, 3), and a little shear.
Affine turned() {
  const double angle = M_PI / 6, c = std::cos(angle), s = std::sin(angle), root = std::sqrt(14.0);
  const Vec3 n{1 / root, 2 / root, 3 / root};
  Affine map{};
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t j = 0; j < 3; ++j) map[4 * i + j] = (i == j ? c : 0) + (1 - c) * n[i] * n[j];
  }
  map[1] -= s * n[2];
  map[2] += s * n[1];
  map[4] += s * n[2];
  map[6] -= s * n[0];
  map[8] -= s * n[1];
  map[9] += s * n[0];
  map[3] = 0.3;
  return map;
}

Mesh torus(unsigned around, unsigned about, double radius) {
  Mesh mesh;
  for (unsigned j = 0; j < about; ++j) {
    for (unsigned i = 0; i < around; ++i) {
      const double a = 2 * M_PI * i / around, b = 2 * M_PI * j / about, r = 1 + radius * std::cos(b);
      mesh.points.push_back({r * std::cos(a), r * std::sin(a), radius * std::sin(b)});
    }
  }
  for (unsigned j = 0; j < about; ++j) {
    for (unsigned i = 0; i < around; ++i) {
      const unsigned right = (i + 1) % around, up = around * ((j + 1) % about);
      test::add_face(mesh, {i + around * j, right + around * j, right + up, i + up});
    }
  }
  return mesh;
}

template <typename Place>
Mesh bent(Mesh mesh, const Place& place) {
  for (Vec3& x : mesh.points) x = place(x);
  return mesh;
}

Mesh bumpy() {
  return bent(test::sphere(1, 4),
              [](const Vec3& x) { return (1 + 0.25 * std::sin(5 * x[0]) * std::sin(4 * x[1] + 1) * std::cos(3 * x[2])) * x; });
}

/// The first and the last part along x are handles.
Setup between(const Mesh& mesh, const decltype(Setup::method)& method) {
  const Box box = bounding_box(mesh.points);
  const double near = box.min[0] + 0.15 * box.side(0), far = box.max[0] - 0.15 * box.side(0);
  Setup setup;
  setup.method = method;
  setup.handles.push_back({"first", Region{Region::InBox{{-1e9, -1e9, -1e9}, {near, 1e9, 1e9}}}});
  setup.handles.push_back({"last", Region{Region::InBox{{far, -1e9, -1e9}, {1e9, 1e9, 1e9}}}});
  return setup;
}

/// As a fraction of D.
double largest_error(const Mesh& mesh, const decltype(Setup::method)& method) {
  const auto system = prepare(std::make_shared<const Mesh>(mesh), between(mesh, method));
  const Points moved = system->evaluate({{}, {{0, turned()}, {1, turned()}}});
  double worst = 0;
  for (std::size_t i = 0; i < moved.size(); ++i)
    worst = std::max(worst, distance(moved[i], transformed(turned(), mesh.points[i])));
  return worst / bounding_box(mesh.points).diagonal();
}

TEST(AffineMotion, OfAllHandlesIsFollowedByMlsOnClosedSurfaces) {
  Mesh with_holes = test::sphere(1, 4);
  for (std::size_t f = 0; f < with_holes.face_count(); f += 200)
    with_holes.face_points[3 * f + 1] = with_holes.face_points[3 * f];
  Mesh inwards = test::sphere(1, 4);
  for (std::size_t f = 0; f < inwards.face_count(); ++f) std::swap(inwards.face_points[3 * f], inwards.face_points[3 * f + 1]);
  const std::vector<Mesh> closed{test::sphere(1, 4),
                                 test::sphere(1e-4, 4),
                                 bent(test::sphere(1, 4),
                                      [](const Vec3& x) {
                                        return Vec3{2000 * x[0], 1000 * x[1], 600 * x[2]};
                                      }),
                                 bent(test::sphere(1, 4),
                                      [](const Vec3& x) {
                                        return Vec3{x[0], x[1], x[2] + 0.4 * x[0] * x[0]};
                                      }),
                                 bent(test::sphere(1, 4),
                                      [](const Vec3& x) {
                                        return Vec3{5 * x[0], x[1], x[2]};
                                      }),
                                 bumpy(),
                                 torus(60, 30, 0.35),
                                 torus(90, 20, 0.1),
                                 ahmed_body({.target_points = 2000}),
                                 with_holes,
                                 inwards};
  for (std::size_t i = 0; i < closed.size(); ++i) {
    MlsOptions options;
    options.surface_samples = 500;
    options.volume_samples = 300;
    EXPECT_LT(largest_error(closed[i], options), 1e-9) << i;
  }
}

// What the surface alone misses: nothing tells how curved parts of it turn.
TEST(AffineMotion, IsMissedByMlsOnTheSurfaceAlone) {
  MlsOptions options;
  options.domain = MlsDomain::surface;
  options.surface_samples = 2000;
  EXPECT_GT(largest_error(torus(120, 60, 0.35), options), 1e-3);
}

TEST(AffineMotion, OpenSurfacesSayThatTheyAreThin) {
  MlsOptions options;
  options.surface_samples = 300;
  const auto notes = [&](const Mesh& mesh) {
    const auto system = prepare(std::make_shared<const Mesh>(mesh), between(mesh, options));
    std::string all;
    for (const std::string& note : system->info().notes) all += note;
    return all;
  };
  EXPECT_NE(notes(test::tube(0.5, 40, 40, 1, test::Faces::quads)).find("do not enclose a volume"), std::string::npos);
  EXPECT_EQ(notes(bumpy()).find("do not enclose a volume"), std::string::npos);
}

TEST(AffineMotion, OfAllHandlesIsFollowedByKernelsThatDecay) {
  const Mesh sheet = test::sheet(50, 30, test::Faces::triangles, [](unsigned i, unsigned j) {
    return Vec3{i / 25.0, j / 25.0, 0.2 * std::sin(i / 8.0) * std::cos(j / 10.0)};
  });
  for (const Kernel kernel : {Kernel::wendland_c2, Kernel::gaussian}) {
    for (const Mesh& mesh : {sheet, bumpy(), test::tube(0.5, 40, 40, 2, test::Faces::triangles)}) {
      SubspaceOptions options;
      options.kernel = kernel;
      options.linear = SubspaceLinear::added;
      options.cover = 50;
      options.centres = 400;
      EXPECT_LT(largest_error(mesh, options), 1e-9);
      options.cover = 10;
      options.stretching = 1;
      EXPECT_LT(largest_error(mesh, options), 1e-9);
    }
  }
}

// Points of a handle in a plane do not tell how the functions change across it.
TEST(AffineMotion, HandlesInOnePlaneAreEnoughForKernelsThatDecay) {
  const Mesh flat = test::sheet(30, 20, test::Faces::triangles, [](unsigned i, unsigned j) { return Vec3{0.1 * i, 0.1 * j, 0}; });
  SubspaceOptions options;
  options.kernel = Kernel::wendland_c2;
  options.linear = SubspaceLinear::added;
  options.cover = 50;
  options.centres = 200;
  EXPECT_LT(largest_error(flat, options), 1e-9);
}

TEST(AffineMotion, ShellsSayThatTheyDoNotTurn) {
  const Mesh mesh = bumpy();
  const auto warnings = [&](const decltype(Setup::method)& method, double degrees) {
    const double c = std::cos(degrees * M_PI / 180), s = std::sin(degrees * M_PI / 180);
    const auto system = prepare(std::make_shared<const Mesh>(mesh), between(mesh, method));
    const Design design{{}, {{1, Affine{2 * c, -s, 0, 0, 2 * s, c, 0, 0, 0, 0, 1, 0}}}};  // and stretched
    return system->bind({&design, 1}, EvaluationPath::automatic, {})->report(0).warnings;
  };
  ShellOptions shell;
  const std::vector<std::string> far = warnings(shell, 20);
  ASSERT_EQ(far.size(), 1u);
  EXPECT_NE(far[0].find("handle \"last\" turns by 20 degrees"), std::string::npos) << far[0];
  EXPECT_EQ(warnings(shell, 14).size(), 0u);
  shell.handles = HandleMode::soft;
  EXPECT_EQ(warnings(shell, 20).size(), 1u);
  SubspaceOptions subspace;
  subspace.centres = 100;
  EXPECT_EQ(warnings(subspace, 20).size(), 1u);
  EXPECT_EQ(warnings(RbfOptions{}, 20).size(), 0u);
}

}  // namespace
}  // namespace deform
