// SPDX-License-Identifier: GPL-3.0-or-later
// What cad-apply makes of a model is a partner of it for cad-move: the mesh lies on the new model then, and where the map takes
// it.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <BRepPrimAPI_MakeCone.hxx>
#include <BRepPrimAPI_MakeSphere.hxx>
#include <BRepPrimAPI_MakeTorus.hxx>
#include <BRepTools.hxx>
#include <BRep_Tool.hxx>
#include <Geom2d_Curve.hxx>
#include <Geom_Surface.hxx>
#include <TopoDS.hxx>
#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <functional>

#include "core/base/error.h"
#include "core/base/vectors.h"
#include "core/cad/cad_apply.h"
#include "core/cad/cad_move.h"
#include "core/cad/face_region.h"
#include "core/cad/model.h"
#include "core/io/mesh_file.h"
#include "tests/core/cad/pair_models.h"
#include "tests/support/long_tests.h"

namespace deform::cad::cad_round_trip_test {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

/// A map of places around the middle of a model, in its diagonals.
using UnitMap = std::function<Vec3(const Vec3&)>;

struct Deformation {
  std::string name;
  UnitMap map;
};

const std::vector<Deformation>& deformations() {
  static const std::vector<Deformation> list{
      {"shears",
       [](const Vec3& p) {
         const double x = p[0] + 0.06 * std::sin(4 * p[1]) + 0.03 * std::cos(3 * p[2]);
         const double y = p[1] + 0.05 * std::sin(4 * x);
         return Vec3{x, y, p[2] + 0.03 * std::sin(4 * x) * std::cos(3 * y)};
       }},
      {"a bend beside what stays",
       [](const Vec3& p) {
         const double s = std::clamp((p[0] + 0.1) / 0.3, 0.0, 1.0);
         const double angle = 0.35 * s * s * s * s * (35 + s * (-84 + s * (70 - 20 * s)));
         return Vec3{p[0] * std::cos(angle) - p[1] * std::sin(angle), p[0] * std::sin(angle) + p[1] * std::cos(angle), p[2]};
       }},
      {"a turn, growth and a twist", [](const Vec3& p) {
         const double angle = 1.9 + 0.5 * p[2];
         return Vec3{1.3 * (p[0] * std::cos(angle) - p[1] * std::sin(angle)), 1.3 * p[2] + 0.4,
                     -1.3 * (p[0] * std::sin(angle) + p[1] * std::cos(angle))};
       }}};
  return list;
}

/// Triangles of a hundredth of each face at places inside it and along its edges, so small and so round that no deformation here
/// turns one round. The faces are groups of their numbers.
Mesh small_triangles(const Model& model) {
  constexpr double least_area = 0.05;  // twice the area of a triangle, by the square of its longest side
  Mesh mesh;
  const auto add = [&](const std::array<gp_Pnt, 3>& corners) {
    for (const gp_Pnt& p : corners) {
      mesh.face_points.push_back(static_cast<PointId>(mesh.points.size()));
      mesh.points.push_back({p.X(), p.Y(), p.Z()});
    }
    mesh.face_sizes.push_back(3);
  };
  for (int f = 0; f < model.face_count(); ++f) {
    const auto surface = BRep_Tool::Surface(model.face(f));
    const FaceRegion region(model.face(f));
    Group group{std::to_string(f + 1), {}, {}};
    const auto first = static_cast<FaceId>(mesh.face_sizes.size());
    const auto& [u0, u1, v0, v1] = region.box();
    const double du = 0.01 * (u1 - u0), dv = 0.01 * (v1 - v0);
    const auto at = [&](const gp_Pnt2d& uv) { return surface->Value(uv.X(), uv.Y()); };
    const auto inside = [&](const gp_Pnt2d& p) { return region.contains(p.X(), p.Y()); };
    // No node near an edge: those within a fiftieth of a side belong to the edge.
    const auto inside_with = [&](const gp_Pnt2d& p, double x, double y) {
      return inside({p.X() - x, p.Y()}) && inside({p.X() + x, p.Y()}) && inside({p.X(), p.Y() - y}) && inside({p.X(), p.Y() + y});
    };
    constexpr int steps = 9;
    for (int i = 0; i < steps; ++i) {
      for (int j = 0; j < steps; ++j) {
        const double u = u0 + (i + 0.5) / steps * (u1 - u0), v = v0 + (j + 0.5) / steps * (v1 - v0);
        const std::array<gp_Pnt2d, 3> corners{gp_Pnt2d(u, v), gp_Pnt2d(u + du, v), gp_Pnt2d(u, v + dv)};
        const bool well_inside =
            std::all_of(corners.begin(), corners.end(), [&](const gp_Pnt2d& p) { return inside_with(p, du, dv); });
        if (well_inside) add({at(corners[0]), at(corners[1]), at(corners[2])});
      }
    }
    for (const Coedge& use : model.coedges[f]) {
      double from = 0, to = 0;
      const TopoDS_Edge edge = TopoDS::Edge(model.edge(use.edge).Oriented(use.sense > 0 ? TopAbs_FORWARD : TopAbs_REVERSED));
      const auto curve = BRep_Tool::CurveOnSurface(edge, model.face(f), from, to);
      if (BRep_Tool::Degenerated(edge) || curve.IsNull()) continue;
      double first = 0, last = 0;
      const auto in_space = BRep_Tool::Curve(edge, first, last);
      for (int k = 0; k < steps; ++k) {
        const double t = from + (k + 0.3) / steps * (to - from);
        const gp_Pnt2d a = curve->Value(t);
        const gp_Pnt p = in_space->Value(t), q = in_space->Value(from + (k + 0.6) / steps * (to - from));
        for (const auto& [x, y] : {std::pair{du, dv}, {du, -dv}, {-du, dv}, {-du, -dv}}) {
          const gp_Pnt2d c(a.X() + 3 * x, a.Y() + 3 * y);
          const gp_Vec along(p, q), across(p, at(c));
          const double longest = std::max({along.SquareMagnitude(), across.SquareMagnitude(), q.SquareDistance(at(c))});
          if (!inside_with(c, du, dv) || along.Crossed(across).Magnitude() < least_area * longest) continue;
          add({p, q, at(c)});
          break;
        }
      }
    }
    for (FaceId t = first; t < mesh.face_sizes.size(); ++t) group.faces.push_back(t);
    if (!group.faces.empty()) mesh.groups.push_back(group);
  }
  return mesh;
}

class CadRoundTrip : public testing::Test {
 protected:
  fs::path path(const std::string& name) {
    const auto* test = testing::UnitTest::GetInstance()->current_test_info();
    std::string stem = test->name();
    std::replace(stem.begin(), stem.end(), '/', '_');
    files_.push_back(fs::temp_directory_path() / ("deform_round_" + stem + "_" + name));
    return files_.back();
  }
  void TearDown() override {
    for (const auto& file : files_) fs::remove(file);
  }

  fs::path file(const TopoDS_Shape& shape, const std::string& name) {
    const fs::path written = path(name);
    BRepTools::Write(shape, written.c_str());
    return written;
  }

  /// Applies the deformation and moves the mesh; compares both.
  void expect_round_trip(const fs::path& before, const Deformation& deformation, const std::string& extension,
                         double tolerance = 1e-4) {
    SCOPED_TRACE(deformation.name);
    const Model model = read_model(before, 1);
    const double size = model.diagonal;
    const Mesh mesh = small_triangles(model);
    const Box box = bounding_box(mesh.points);
    const Vec3 middle = 0.5 * (box.min + box.max);
    const auto moved = [&](const Vec3& p) { return middle + size * deformation.map((p - middle) / size); };
    ApplyRequest apply;
    apply.model = before;
    apply.output = path("after" + extension);
    apply.tolerance = tolerance;
    const DeformedModel deformed = apply_to_model(apply, [&](std::span<const Vec3> points) {
      Points places;
      for (const Vec3& p : points) places.push_back(moved(p));
      return places;
    });
    MoveRequest move;
    move.before = before;
    move.after = apply.output;
    const CarriedNodes carried = carry_nodes(mesh, move);
    EXPECT_THAT(carried.notes, testing::Contains(HasSubstr("nodes keep their parameters")));
    EXPECT_LT(carried.distance, tolerance * size);
    for (const FaceOutcome& face : carried.faces) EXPECT_EQ(face.warp_outside, 0u) << face.before;  // nor is anything slid
    ASSERT_EQ(carried.nodes.size(), mesh.point_count());
    double worst = 0;
    for (const Group& group : mesh.groups) {
      // Points slide in faces that keep their type, and a file does not say where they go.
      if (deformed.faces.at(std::stoul(group.name) - 1).became == DeformedFace::Became::reshaped) continue;
      for (const FaceId t : group.faces) {
        for (PointId node = 3 * t; node < 3 * t + 3; ++node) {
          const double off = distance(carried.places[node], moved(mesh.points[node]));
          worst = std::max(worst, off);
        }
      }
    }
    EXPECT_LT(worst, 2 * (tolerance * size + carried.farthest));
  }

 private:
  std::vector<fs::path> files_;
};

/// All of them take minutes.
std::vector<std::string> shared_models() {
  std::vector<std::string> names;
  if (!test::long_tests()) return {"s11o_cube_cyl.stp"};
#ifdef DEFORM_SHARED_DATA
  for (const auto& entry : fs::directory_iterator(fs::path(DEFORM_SHARED_DATA) / "D_cad")) {
    const std::string name = entry.path().filename().string();
    if (entry.path().extension() != ".md") names.push_back(name);
  }
  std::sort(names.begin(), names.end());
#endif
  return names;
}

TopoDS_Shape cube() { return block({0, 0, 0}, {1, 1, 1}); }

TEST_F(CadRoundTrip, WhatStructureAndPlacesLeaveOpenIsKnown) {
  const UnitMap turn = [](const Vec3& p) {
    const double s = std::sqrt(0.5);
    return Vec3{s * (p[0] - p[1]), s * (p[0] + p[1]), p[2]};
  };
  for (const char* extension : {".step", ".brep"}) expect_round_trip(file(cube(), "cube.brep"), {"a turn", turn}, extension);
}

TEST_F(CadRoundTrip, MapsOfManyKindsAreFollowed) {
  const fs::path bored = file(without(block({0, 0, 0}, {4, 3, 2}), rod({1.5, 1.2, -1}, {0, 0, 1}, 0.5, 4)), "bored.brep");
  for (const int i : {1, 2}) expect_round_trip(bored, deformations()[i], ".step");
  const fs::path round =
      file(together({BRepPrimAPI_MakeSphere(1).Shape(), shifted(BRepPrimAPI_MakeTorus(1, 0.3).Shape(), {3, 0, 0}),
                     shifted(BRepPrimAPI_MakeCone(1, 0, 2).Shape(), {0, 3, 0})}),
           "round.brep");
  for (const int i : {0, 2}) expect_round_trip(round, deformations()[i], ".step", 1e-3);
}

class CadAfterApply : public CadRoundTrip {
 protected:
  CadAfterApply() : before_(file(bored(), "before.brep")), after_(path("after.step")) {
    ApplyRequest apply;
    apply.model = before_;
    apply.output = after_;
    apply_to_model(apply, [](std::span<const Vec3> points) {
      Points places;
      for (const Vec3& p : points)
        places.push_back({p[0] + 0.1 * std::sin(p[1]), p[1] + 0.1 * std::sin(p[0]), p[2] + 0.02 * p[0] * p[1]});
      return places;
    });
  }
  static TopoDS_Shape bored() { return without(block({0, 0, 0}, {4, 3, 2}), rod({1.5, 1.2, -1}, {0, 0, 1}, 0.5, 4)); }
  CarriedNodes carry(const fs::path& before) {
    MoveRequest move;
    move.before = before;
    move.after = after_;
    return carry_nodes(small_triangles(read_model(before, 1)), move);
  }
  void expect_by_structure(const CarriedNodes& carried) {
    EXPECT_THAT(carried.notes, testing::Not(testing::Contains(HasSubstr("nodes keep their parameters"))));
    EXPECT_THAT(carried.notes,
                testing::Contains(HasSubstr("7 of 7 faces have another type in the new model, such as face 1 (plane), "
                                            "whose partner is face 1 (B-spline)")));
    EXPECT_LT(carried.distance, 1e-9 * carried.diagonal);
  }

  const fs::path before_, after_;
};

TEST_F(CadAfterApply, WithoutTheLineInTheFileStructureAndPlacesDecide) {
  const std::string text = io::read_file(after_);
  const std::size_t at = text.find("Deformed by deform cad-apply");
  ASSERT_NE(at, std::string::npos);
  io::write_file(after_, text.substr(0, at) + "Another" + text.substr(at + 7));
  expect_by_structure(carry(before_));
}

TEST_F(CadAfterApply, AnotherModelOfTheSameStructureIsPairedByStructureAndPlaces) {
  // Its bore lies elsewhere: the parameters would be wrong.
  const fs::path other = file(without(block({0, 0, 0}, {4, 3, 2}), rod({1.7, 1.2, -1}, {0, 0, 1}, 0.5, 4)), "other.brep");
  expect_by_structure(carry(other));
}

class SharedCad : public CadRoundTrip, public testing::WithParamInterface<std::string> {};

#ifdef DEFORM_SHARED_DATA
TEST_P(SharedCad, TheMeshGoesWhereTheMapTakesIt) {
  fs::path file = fs::path(DEFORM_SHARED_DATA) / "D_cad" / GetParam();
  if (file.extension() == ".gz") {
    const fs::path plain = path(file.stem().string());
    io::write_file(plain, io::read_file(file));
    file = plain;
  }
  const bool needs_brep = GetParam().rfind("oneraM6", 0) == 0;  // in STEP it gets further edges at its poles
  for (const Deformation& deformation : deformations()) {
    expect_round_trip(file, deformation, needs_brep ? ".brep" : ".step", 1e-6);
  }
}
#endif
GTEST_ALLOW_UNINSTANTIATED_PARAMETERIZED_TEST(SharedCad);
INSTANTIATE_TEST_SUITE_P(All, SharedCad, testing::ValuesIn(shared_models()), [](const auto& model) {
  std::string name = model.param;
  std::replace_if(
      name.begin(), name.end(), [](char c) { return std::isalnum(static_cast<unsigned char>(c)) == 0; }, '_');
  return name;
});

}  // namespace
}  // namespace deform::cad::cad_round_trip_test
