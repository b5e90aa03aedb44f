// SPDX-License-Identifier: GPL-3.0-or-later
// Shared models: primitives are compared with what the CAD files, or the meshes by other means, say.
#include <gtest/gtest.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <numeric>
#include <random>
#include <regex>
#include <sstream>

#include "core/base/error.h"
#include "core/constraints/constraint.h"
#include "core/io/mesh_file.h"
#include "tests/core/constraints/detection/expect_found.h"
#include "tests/support/long_tests.h"

namespace deform::shared_data_test {
namespace {

using test::Kind;
using test::Part;

namespace fs = std::filesystem;

const fs::path data = DEFORM_SHARED_DATA;

Detection detected(const Mesh& mesh, const std::string& name) {
  const auto start = std::chrono::steady_clock::now();
  Detection found = detect(mesh, {});
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  std::printf("%s: %zu faces, %.2f s, %.1f %% covered, %zu feature edges\n", name.c_str(), mesh.face_count(), seconds,
              100 * found.coverage, found.edges.size());
  for (const Primitive& p : found.primitives) {
    std::printf("  %-12s %5.2f %% of the area, %5zu faces, radius %-8.5g half angle %-6.2f rms %.1e max %.1e of the size\n",
                p.name.c_str(), 100 * p.area / found.area, p.faces.size(), p.radius, p.half_angle * 180 / std::numbers::pi,
                p.rms / found.size, p.max / found.size);
  }
  return found;
}

std::size_t count(const Detection& found, PrimitiveKind kind) {
  return static_cast<std::size_t>(
      std::count_if(found.primitives.begin(), found.primitives.end(), [&](const Primitive& p) { return p.kind == kind; }));
}

Vec3 normal_of(const Mesh& mesh, std::size_t f) {
  const Vec3 &a = mesh.points[mesh.face_points[3 * f]], &b = mesh.points[mesh.face_points[3 * f + 1]],
             &c = mesh.points[mesh.face_points[3 * f + 2]];
  const Vec3 u{b[0] - a[0], b[1] - a[1], b[2] - a[2]}, v{c[0] - a[0], c[1] - a[1], c[2] - a[2]};
  Vec3 n{u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]};
  const double length = std::hypot(n[0], n[1], n[2]);
  for (double& x : n) x /= length;
  return n;
}

double angle(const Vec3& a, const Vec3& b) { return std::acos(std::clamp(a[0] * b[0] + a[1] * b[1] + a[2] * b[2], -1.0, 1.0)); }

/// Connected sets of faces whose normals agree with that of the first within `most` radians, of at least 1 % of the area.
std::vector<std::vector<FaceId>> flats(const Mesh& mesh, double most) {
  std::map<std::pair<PointId, PointId>, std::vector<FaceId>> edges;
  double all = 0;
  for (std::size_t f = 0; f < mesh.face_count(); ++f) {
    all += test::face_area(mesh, f);
    for (std::size_t k = 0; k < 3; ++k) {
      edges[std::minmax(mesh.face_points[3 * f + k], mesh.face_points[3 * f + (k + 1) % 3])].push_back(static_cast<FaceId>(f));
    }
  }
  std::vector<char> seen(mesh.face_count(), 0);
  std::vector<std::vector<FaceId>> found;
  for (std::size_t start = 0; start < mesh.face_count(); ++start) {
    if (seen[start]) continue;
    seen[start] = 1;
    std::vector<FaceId> flat{static_cast<FaceId>(start)};
    const Vec3 normal = normal_of(mesh, start);
    double area = 0;
    for (std::size_t i = 0; i < flat.size(); ++i) {
      area += test::face_area(mesh, flat[i]);
      for (std::size_t k = 0; k < 3; ++k) {
        for (const FaceId f :
             edges[std::minmax(mesh.face_points[3 * flat[i] + k], mesh.face_points[3 * flat[i] + (k + 1) % 3])]) {
          if (seen[f] || angle(normal, normal_of(mesh, f)) > most) continue;
          seen[f] = 1;
          flat.push_back(f);
        }
      }
    }
    if (area > 0.011 * all) found.push_back(std::move(flat));
  }
  return found;
}

/// Every flat piece lies in one plane, 98 % of it.
void expect_flats_in_planes(const Mesh& mesh, const Detection& found, double most, std::size_t expected) {
  std::vector<int> plane_of(mesh.face_count(), -1);
  for (std::size_t p = 0; p < found.primitives.size(); ++p) {
    if (found.primitives[p].kind != PrimitiveKind::plane) continue;
    for (const FaceId f : found.primitives[p].faces) plane_of[f] = static_cast<int>(p);
  }
  const auto pieces = flats(mesh, most);
  EXPECT_EQ(pieces.size(), expected);
  for (const auto& piece : pieces) {
    std::map<int, std::size_t> votes;
    for (const FaceId f : piece) ++votes[plane_of[f]];
    const auto best =
        std::max_element(votes.begin(), votes.end(), [](const auto& a, const auto& b) { return a.second < b.second; });
    EXPECT_GE(best->first, 0) << "a flat piece of " << piece.size() << " faces is in no plane";
    EXPECT_GE(static_cast<double>(best->second), 0.98 * static_cast<double>(piece.size()));
  }
}

/// Radii of what is found, ascending.
std::vector<double> radii(const Detection& found) {
  std::vector<double> result;
  for (const Primitive& p : found.primitives) {
    if (p.kind == PrimitiveKind::cylinder) result.push_back(p.radius);
  }
  std::sort(result.begin(), result.end());
  return result;
}

TEST(SharedModels, FandiskHasItsPlanesAndCylinders) {
  const auto file = io::read_mesh_file(data / "A_surface" / "fandisk.off.gz");
  const Detection found = detected(*file->mesh(), "fandisk");
  // Normals of the exactly flat faces agree to 1e-6; those of the slanted ones are off by up to half a degree.
  expect_flats_in_planes(*file->mesh(), found, 1e-6, 5);
  EXPECT_EQ(count(found, PrimitiveKind::plane), 10u);
  EXPECT_GE(count(found, PrimitiveKind::cylinder), 7u);
  EXPECT_GE(found.coverage, 0.77) << "the rest is free-form";
  for (const Primitive& p : found.primitives) EXPECT_LE(p.rms, 5e-5 * found.size) << p.name << " is as exact as the model";
}

TEST(SharedModels, JointHasThreeCylindersAndNinePlanes) {
  const auto coarse = io::read_mesh_file(data / "A_surface" / "joint.off");
  const Detection exact = detected(*coarse->mesh(), "joint");
  ASSERT_EQ(count(exact, PrimitiveKind::cylinder), 3u);
  EXPECT_EQ(exact.primitives.size(), 12u);
  const auto fine = io::read_mesh_file(data / "A_surface" / "joint_remeshed.off.gz");
  const Detection found = detected(*fine->mesh(), "joint_remeshed");
  expect_flats_in_planes(*fine->mesh(), found, 1e-5, 9);
  ASSERT_EQ(found.primitives.size(), 12u);
  // Its cylinders are the 40 facets of the coarse model: on average 0.2 % inside the circle.
  const auto wanted = radii(exact), got = radii(found);
  ASSERT_EQ(got.size(), 3u);
  for (std::size_t i = 0; i < 3; ++i) EXPECT_NEAR(got[i], wanted[i], 0.003 * wanted[i]);
  EXPECT_GE(found.coverage, 0.99);
  EXPECT_EQ(
      std::count_if(found.edges.begin(), found.edges.end(), [](const EdgeFeature& e) { return e.kind == EdgeKind::circle; }), 4);
}

using Corners = std::array<PointId, 3>;

Corners sorted(Corners corners) {
  std::sort(corners.begin(), corners.end());
  return corners;
}

/// Which CAD face the triangles of a Gmsh 4.1 text file belong to; its nodes are numbered from 1.
std::map<Corners, int> entities(const std::string& text) {
  std::istringstream in(text.substr(text.find("$Elements") + 9));
  std::size_t blocks = 0, skipped = 0;
  in >> blocks >> skipped >> skipped >> skipped;
  std::map<Corners, int> result;
  for (std::size_t b = 0; b < blocks; ++b) {
    int dimension = 0, entity = 0, type = 0;
    std::size_t size = 0;
    in >> dimension >> entity >> type >> size;
    std::string line;
    std::getline(in, line);
    for (std::size_t i = 0; i < size; ++i) {
      std::getline(in, line);
      if (type != 2) continue;
      std::istringstream numbers(line);
      Corners corners{};
      numbers >> skipped >> corners[0] >> corners[1] >> corners[2];
      for (PointId& p : corners) --p;
      result[sorted(corners)] = entity;
    }
  }
  return result;
}

/// CAD files cut cylinders into halves: curved faces of equal area that go on smoothly across an edge are one.
void join_smooth(Part& part) {
  std::vector<int> root(part.truths.size());
  std::iota(root.begin(), root.end(), 0);
  std::map<std::pair<PointId, PointId>, std::size_t> seen;
  std::vector<double> areas(part.truths.size(), 0);
  for (std::size_t f = 0; f < part.mesh.face_count(); ++f) {
    areas[static_cast<std::size_t>(part.labels[f])] += test::face_area(part.mesh, f);
  }
  const auto is_curved = [&](int label) { return part.truths[static_cast<std::size_t>(label)].kind == Kind::cylinder; };
  for (std::size_t f = 0; f < part.mesh.face_count(); ++f) {
    for (std::size_t k = 0; k < 3; ++k) {
      const auto edge = std::minmax(part.mesh.face_points[3 * f + k], part.mesh.face_points[3 * f + (k + 1) % 3]);
      const auto [place, added] = seen.try_emplace(edge, f);
      const int a = part.labels[f], b = part.labels[place->second];
      if (added || a == b || !is_curved(a) || !is_curved(b)) continue;
      const double area = areas[static_cast<std::size_t>(a)];
      if (std::abs(area - areas[static_cast<std::size_t>(b)]) > 1e-3 * area) continue;
      if (angle(normal_of(part.mesh, f), normal_of(part.mesh, place->second)) > 0.6) continue;
      const int from = root[static_cast<std::size_t>(a)], to = root[static_cast<std::size_t>(b)];
      std::replace(root.begin(), root.end(), from, to);
    }
  }
  for (int& label : part.labels) label = root[static_cast<std::size_t>(label)];
}

class CadParts : public testing::TestWithParam<std::pair<const char*, const char*>> {};

TEST_P(CadParts, AreFoundAsTheCadFileSays) {
  const auto [mesh_name, cad_name] = GetParam();
  const fs::path path = data / "B_volume" / mesh_name;
  Part part;
  part.mesh = *io::read_mesh_file(path)->mesh();
  const std::map<Corners, int> entity = entities(io::read_file(path));
  ASSERT_EQ(entity.size(), part.mesh.face_count());
  // The flat faces are the planes among planes and cylinders; their numbers are those of the CAD file.
  const std::string cad = io::read_file(data / "D_cad" / cad_name);
  const auto uses = [&](const std::string& pattern) {
    const std::regex regex(pattern);
    return static_cast<std::size_t>(std::distance(std::sregex_iterator(cad.begin(), cad.end(), regex), std::sregex_iterator()));
  };
  std::map<int, int> label_of;
  std::vector<Vec3> normals;
  for (std::size_t f = 0; f < part.mesh.face_count(); ++f) {
    const PointId* corners = part.mesh.face_points.data() + 3 * f;
    const Vec3 normal = normal_of(part.mesh, f);
    const auto [place, added] =
        label_of.try_emplace(entity.at(sorted({corners[0], corners[1], corners[2]})), static_cast<int>(part.truths.size()));
    if (added) {
      part.truth(Kind::plane);
      normals.push_back(normal);
    }
    const auto t = static_cast<std::size_t>(place->second);
    if (angle(normal, normals[t]) > 1e-4) part.truths[t].kind = Kind::cylinder;
    part.labels.push_back(place->second);
  }
  const auto curved = static_cast<std::size_t>(
      std::count_if(part.truths.begin(), part.truths.end(), [](const auto& t) { return t.kind == Kind::cylinder; }));
  ASSERT_EQ(curved, uses("= *CYLINDRICAL_SURFACE"));
  ASSERT_EQ(part.truths.size(), uses("= *ADVANCED_FACE"));
  join_smooth(part);
  const Detection found = detected(part.mesh, mesh_name);
  expect_found(part, found, mesh_name, -1);
  // The radii are those of the CAD file.
  std::vector<double> known;
  const std::regex radius(R"(CYLINDRICAL_SURFACE\('[^']*',#\d+,([-+0-9.Ee]+)\))");
  for (std::sregex_iterator i(cad.begin(), cad.end(), radius), end; i != end; ++i) known.push_back(std::stod((*i)[1]));
  for (const double r : radii(found)) {
    EXPECT_TRUE(std::any_of(known.begin(), known.end(), [&](double k) { return std::abs(k - r) < 1e-6 * k; })) << r;
  }
}

INSTANTIATE_TEST_SUITE_P(All, CadParts,
                         testing::Values(std::pair{"mambo/mambo_s1_tet_cadclassified.msh.gz", "i11o_s1.step"},
                                         std::pair{"mambo/mambo_s22_tet_cadclassified.msh.gz", "i18o_s22.step"},
                                         std::pair{"param/bore_tet_p0_cadclassified.msh.gz", "bore_p000.step"}));

TEST(SharedModels, BentPipeHasNoCylinderOnItsBend) {
  const auto file = io::read_mesh_file(data / "B_volume" / "param" / "pipe_tet_p0_cadclassified.msh.gz");
  const Detection found = detected(*file->mesh(), "pipe_tet");
  EXPECT_EQ(count(found, PrimitiveKind::plane), 2u);
  const auto got = radii(found);
  ASSERT_EQ(got.size(), 4u);
  for (std::size_t i = 0; i < 4; ++i) EXPECT_NEAR(got[i], i < 2 ? 0.7 : 1.0, 1e-3);
  EXPECT_EQ(found.primitives.size(), 6u);
}

TEST(SharedModels, FreeFormsHaveNoPrimitives) {
  for (const char* name : {"ChineseDragon-10kv.off.gz", "bumpy-cube.obj.gz"}) {
    const auto file = io::read_mesh_file(data / "A_surface" / name);
    EXPECT_LE(detected(*file->mesh(), name).coverage, 0.05) << name;
  }
}

/// The same mesh with normal noise of that standard deviation over the diagonal, in every coordinate.
Mesh shaken(Mesh mesh, double level) {
  const double deviation = level * bounding_box(mesh.points).diagonal();
  std::mt19937_64 engine(7);
  std::normal_distribution<double> normal(0, deviation);
  for (Vec3& p : mesh.points) {
    for (double& x : p) x += normal(engine);
  }
  return mesh;
}

ConstraintKind kind_named(const std::string& name) {
  const ConstraintKind kinds[] = {Planar{}, Cylindrical{}, Spherical{}, Conical{}, Straight{}, Circular{}};
  for (const ConstraintKind& kind : kinds) {
    if (kind_name(kind) == name) return kind;
  }
  throw Error(ErrorCode::internal, "no constraint " + name);
}

/// Whatever is found can be constrained, or says that it cannot; what implies a set can be constrained itself and is not implied.
void expect_legal(const Mesh& mesh, const Detection& found) {
  std::map<std::string, bool> stays;
  const auto check = [&](const auto& set) {
    SCOPED_TRACE(set.name);
    EXPECT_TRUE(stays.emplace(set.name, !set.constraint.empty() && set.implied_by.empty()).second) << "two of that name";
    if (set.constraint.empty()) return;
    std::vector<std::vector<Vec3>> rest(1);
    for (const PointId id : set.points) rest[0].push_back(mesh.points[id]);
    EXPECT_NO_THROW(make_projection(kind_named(set.constraint), rest));
  };
  for (const Primitive& p : found.primitives) check(p);
  for (const EdgeFeature& e : found.edges) check(e);
  const auto check_implied = [&](const auto& set) {
    for (const std::string& name : set.implied_by) EXPECT_TRUE(stays.at(name)) << set.name << " follows from " << name;
  };
  for (const Primitive& p : found.primitives) check_implied(p);
  for (const EdgeFeature& e : found.edges) check_implied(e);
}

TEST(SharedModels, WhateverIsFoundIsLegalAndNoDust) {
  std::size_t models = 0;
  for (const auto& entry : fs::directory_iterator(data / "A_surface")) {
    const std::string name = entry.path().filename().string();
    if (name.find(".off") == name.npos && name.find(".obj") == name.npos && name.find(".stl") == name.npos) continue;
    const Mesh mesh = *io::read_mesh_file(entry.path())->mesh();
    if (mesh.face_count() > 30'000 && !test::long_tests()) continue;
    for (const double level : {0.0, 1e-4}) {
      if (level > 0 && mesh.face_count() > 30000) continue;  // the large ones: FreeFormPanelsAreNoCylinders
      SCOPED_TRACE(name + " with noise " + std::to_string(level));
      const Mesh tested = level > 0 ? shaken(mesh, level) : mesh;
      const Detection found = detect(tested, {});
      expect_legal(tested, found);
      for (const EdgeFeature& e : found.edges) EXPECT_GE(e.points.size(), e.kind == EdgeKind::line ? 3u : 5u) << e.name;
      EXPECT_LE(found.edges.size(), 100u);
    }
    ++models;
  }
  EXPECT_GE(models, 20u);
  for (const char* name : {"mambo/mambo_s1_tet_cadclassified.msh.gz", "param/pipe_tet_p0_cadclassified.msh.gz"}) {
    SCOPED_TRACE(name);
    const auto file = io::read_mesh_file(data / "B_volume" / name);
    expect_legal(*file->mesh(), detect(*file->mesh(), {}));
  }
}

TEST(SharedModels, CreasesOfOrganicMeshesAreNoLines) {
  for (const char* name : {"ChineseDragon-10kv.off.gz", "bumpy-cube.obj.gz", "lion_vase_poly.off.gz"}) {
    const Mesh mesh = *io::read_mesh_file(data / "A_surface" / name)->mesh();
    for (const double level : {0.0, 1e-4}) EXPECT_LE(detect(shaken(mesh, level), {}).edges.size(), 3u) << name << " " << level;
  }
}

TEST(SharedModels, FreeFormPanelsAreNoCylinders) {
  // Cars have wheels, or stilts; nothing else on these is round.
  const std::pair<const char*, double> models[] = {{"car_fastback.stl.gz", 0.1},
                                                   {"oneraM6_wing.off.gz", 0.0},
                                                   {"NACA0012.obj.gz", 0.0},
                                                   {"DTC-scaled.stl.gz", 0.0},
                                                   {"ahmed_slant25.stl.gz", 0.1}};
  for (const auto& [name, largest] : models) {
    const Mesh mesh = *io::read_mesh_file(data / "A_surface" / name)->mesh();
    for (const double level : {0.0, 1e-4}) {
      if (level == 0 && mesh.face_count() > 30'000 && !test::long_tests()) continue;
      const Mesh tested = shaken(mesh, level);
      const Detection found = detected(tested, name);
      expect_legal(tested, found);
      for (const Primitive& p : found.primitives) {
        if (p.kind == PrimitiveKind::plane) continue;
        EXPECT_EQ(p.kind, PrimitiveKind::cylinder) << name << " " << p.name;
        EXPECT_LE(p.radius, largest * found.size) << name << " " << p.name;
      }
    }
  }
}

}  // namespace
}  // namespace deform::shared_data_test
