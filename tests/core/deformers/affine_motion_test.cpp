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
#include "tests/support/long_tests.h"

namespace deform::affine_motion_test {
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
    if (!test::long_tests() && (i == 2 || i == 4 || i == 7)) continue;  // the same with other proportions
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
  options.domain = MlsDomain::connected;
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

TEST(AffineMotion, OpenSurfacesHaveNoMoreSamplesThanPointsByDefault) {
  const auto tube = std::make_shared<const Mesh>(test::tube(0.5, 20, 20, 1, test::Faces::quads));
  const auto system = prepare(tube, between(*tube, MlsOptions{}));
  EXPECT_EQ(system->info().samples, tube->point_count());
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

MlsOptions few_samples(double stretching) {
  MlsOptions options;
  options.surface_samples = options.volume_samples = 200;
  options.stretching = stretching;
  return options;
}

FfdOptions small_lattice(double stretching) {
  FfdOptions options;
  options.lattice.points = {7, 7, 7};
  options.stretching = stretching;
  return options;
}

/// Not even a translation is followed.
TEST(AffineMotion, IsMissedByKernelsThatDecayAloneWhichSaySo) {
  const Mesh mesh = bumpy();
  SubspaceOptions options;
  options.centres = 100;
  const auto told = [&](const Affine& map) {
    const auto system = prepare(std::make_shared<const Mesh>(mesh), between(mesh, options));
    const Design design{{}, {{0, map}}};
    std::vector<std::string> warnings = system->bind({&design, 1}, EvaluationPath::direct, {})->report(0).warnings;
    EXPECT_EQ(system->bind({&design, 1}, EvaluationPath::basis, {})->report(0).warnings, warnings);
    return warnings;
  };
  Affine up = identity_affine;
  up[11] = 0.1;
  for (const std::optional<Kernel> kernel : {std::optional(Kernel::wendland_c2), std::optional(Kernel::gaussian)}) {
    options.kernel = kernel;
    options.linear = SubspaceLinear::left_out;
    ASSERT_EQ(told(up).size(), 1u);
    EXPECT_NE(told(up)[0].find("LINEAR_LEFT_OUT"), std::string::npos) << told(up)[0];
    EXPECT_EQ(told(identity_affine).size(), 0u) << "nothing moves";
    options.linear = SubspaceLinear::added;
    EXPECT_EQ(told(up).size(), 0u);
  }
  options.linear = SubspaceLinear::left_out;
  for (const std::optional<Kernel> kernel : {std::optional<Kernel>(), std::optional(Kernel::triharmonic)}) {
    options.kernel = kernel;
    EXPECT_EQ(told(up).size(), 0u) << "there is nothing to leave out";
  }
}

/// A turn of all handles is missed in proportion to stretching over bending. It is warned of from 1 on, also in a part of the
/// body.
TEST(AffineMotion, IsMissedByStretchingWhichSaysSo) {
  const Mesh mesh = bumpy();
  MlsOptions in_a_region = few_samples(0);
  in_a_region.weights = {{{Region::InBox{{-0.3, -9, -9}, {0.3, 9, 9}}}, 10, 1}};
  struct Row {
    MethodOptions method;
    double least, most;
    bool warned;
  };
  const std::vector<Row> rows{{few_samples(0), 0, 1e-9, false},   {few_samples(0.1), 1e-6, 1e-3, false},
                              {few_samples(10), 1e-3, 1, true},   {in_a_region, 1e-3, 1, true},
                              {small_lattice(0), 0, 1e-9, false}, {small_lattice(0.1), 1e-6, 1e-3, false},
                              {small_lattice(1), 1e-3, 1, true}};
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const auto& [method, least, most, warned] = rows[i];
    const double missed = largest_error(mesh, method);
    EXPECT_GE(missed, least) << i;
    EXPECT_LE(missed, most) << i;
    const auto system = prepare(std::make_shared<const Mesh>(mesh), between(mesh, method));
    const Design design{{}, {{0, turned()}, {1, turned()}}};
    for (const EvaluationPath path : {EvaluationPath::automatic, EvaluationPath::direct}) {
      const std::vector<std::string> warnings = system->bind({&design, 1}, path, {})->report(0).warnings;
      ASSERT_EQ(warnings.size(), warned ? 2u : 0u) << i;
      if (!warned) continue;
      EXPECT_NE(warnings[0].find("handle \"first\" turns by 3"), std::string::npos) << warnings[0];
      EXPECT_NE(warnings[0].find("`stretching` far below `bending`"), std::string::npos) << warnings[0];
    }
  }
}

/// A turn that is prescribed point by point is seen as well.
TEST(AffineMotion, DisplacementsThatTurnAreWarnedOf) {
  const Mesh mesh = bumpy();
  const auto with = [&](const MethodOptions& method, const Region& of, const auto& displacement) {
    deform::Setup setup = between(mesh, method);
    setup.handles[1].region = of;
    const auto system = prepare(std::make_shared<const Mesh>(mesh), setup);
    std::vector<Vec3> u;
    for (const PointId id : select(of, mesh, "of")) u.push_back(displacement(mesh.points[id]));
    const Design design{{}, {{1, std::move(u)}}};
    return system->bind({&design, 1}, EvaluationPath::automatic, {})->report(0).warnings;
  };
  const auto by = [](double degrees) {
    return [degrees](const Vec3& x) {
      const double c = std::cos(degrees * M_PI / 180), s = std::sin(degrees * M_PI / 180);
      return Vec3{c * x[0] - s * x[1] + 5 - x[0], s * x[0] + c * x[1] - x[1], 0.2 * x[2]};
    };
  };
  const Region end = between(mesh, ShellOptions{}).handles[1].region;
  for (const HandleMode handles : {HandleMode::hard, HandleMode::soft}) {
    ShellOptions shell;
    shell.handles = handles;
    const std::vector<std::string> told = with(shell, end, by(40));
    ASSERT_EQ(told.size(), 1u);
    EXPECT_NE(told[0].find("handle \"last\" turns by 40 degrees, as its displacements tell"), std::string::npos) << told[0];
    EXPECT_TRUE(with(shell, end, by(14)).empty());
    EXPECT_EQ(with(shell, end, by(-16)).size(), 1u);
    EXPECT_EQ(with(shell, end, by(170)).size(), 1u) << "farther than a right angle";
  }
  SubspaceOptions subspace;
  subspace.centres = 100;
  EXPECT_EQ(with(subspace, end, by(20)).size(), 1u);
  EXPECT_EQ(with(few_samples(10), end, by(20)).size(), 1u);
  EXPECT_EQ(with(small_lattice(1), end, by(20)).size(), 1u);
  EXPECT_TRUE(with(few_samples(0), end, by(20)).empty());
  EXPECT_TRUE(with(RbfOptions{}, end, by(20)).empty());
  // No turn: stretched, and crushed to a point.
  const ShellOptions shell;
  const std::vector<std::string> none;
  EXPECT_EQ(with(shell, end, [](const Vec3& x) { return Vec3{0.1 * x[0], -0.5 * x[1], 0.1 * x[1]}; }), none);
  EXPECT_TRUE(with(shell, end, [](const Vec3& x) { return -1.0 * x; }).empty());
  // The direction of two points turns; about the line through them they do not say anything.
  const Box box = bounding_box(mesh.points);
  PointId low = 0, high = 0;
  for (std::size_t i = 0; i < mesh.points.size(); ++i) {
    if (mesh.points[i][1] < mesh.points[low][1]) low = static_cast<PointId>(i);
    if (mesh.points[i][1] > mesh.points[high][1]) high = static_cast<PointId>(i);
  }
  const Region pair{Region::Ids{{low, high}}};
  EXPECT_EQ(with(shell, pair, by(20)).size(), 1u);
  EXPECT_TRUE(with(shell, pair, [&](const Vec3& x) { return (x[1] - box.min[1]) * Vec3{0, 0.1, 0}; }).empty());
  EXPECT_TRUE(with(shell, Region{Region::Ids{{high}}}, [](const Vec3&) { return Vec3{0.1, 0.2, 0.3}; }).empty());
}

}  // namespace
}  // namespace deform::affine_motion_test
