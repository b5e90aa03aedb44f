// SPDX-License-Identifier: GPL-3.0-or-later
// Pairs of models whose faces are renumbered, split, merged, reversed, mirrored or missing: solved, which is judged by a
// projection that knows nothing of partners and by what the pairs are known to be, or refused by name.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <BRepBuilderAPI_MakeEdge.hxx>
#include <BRepBuilderAPI_MakeFace.hxx>
#include <BRepBuilderAPI_MakeWire.hxx>
#include <BRepFilletAPI_MakeFillet.hxx>
#include <BRepGProp.hxx>
#include <BRepPrimAPI_MakeCone.hxx>
#include <BRepPrimAPI_MakePrism.hxx>
#include <BRepPrimAPI_MakeSphere.hxx>
#include <BRepPrimAPI_MakeTorus.hxx>
#include <BRepTools.hxx>
#include <GProp_GProps.hxx>
#include <IGESControl_Controller.hxx>
#include <IGESControl_Writer.hxx>
#include <TopExp_Explorer.hxx>
#include <TopoDS.hxx>
#include <TopoDS_Wire.hxx>
#include <cmath>
#include <filesystem>
#include <functional>
#include <gp_Elips.hxx>
#include <map>
#include <memory>
#include <numbers>
#include <tuple>

#include "core/base/error.h"
#include "core/base/vectors.h"
#include "core/cad/cad_move.h"
#include "core/cad/document.h"
#include "core/mesh/elements.h"
#include "tests/core/cad/pair_files.h"
#include "tests/core/cad/pair_models.h"

namespace deform::cad::cad_pairs_test {
namespace {

using testing::HasSubstr;

/// A face of the old model and its partner, each by a point on it and on no other face.
struct KnownFace {
  Vec3 before, after;
};

struct Pair {
  std::string name;
  std::function<TopoDS_Shape()> before, after;
  std::vector<KnownFace> known;
  std::vector<std::string> refused;  ///< parts of the message; empty: the pair is solved
};

std::ostream& operator<<(std::ostream& out, const Pair& pair) { return out << pair.name; }

/// What tells left from right: a blind bore in one side, two in the next and three in the third.
TopoDS_Shape handed(double length) {
  TopoDS_Shape shape = without(block({0, 0, 0}, {length, 2, 2}), rod({length, 1, 1}, {-1, 0, 0}, 0.3, 0.5));
  for (const double x : {0.6, 1.4}) shape = without(shape, rod({x, 2, 1}, {0, -1, 0}, 0.2, 0.3));
  for (const double x : {0.4, 1.0, 1.6}) shape = without(shape, rod({x, 1, 2}, {0, 0, -1}, 0.2, 0.3));
  return shape;
}

/// A wall of 0.1 around the z axis, by surfaces that have no axis of their own.
TopoDS_Shape elliptic_tube(double a, double b) {
  const auto rod = [](double major, double minor) {
    const gp_Elips ellipse(gp_Ax2(gp_Pnt(0, 0, 0), gp::DZ()), major, minor);
    const TopoDS_Wire wire = BRepBuilderAPI_MakeWire(BRepBuilderAPI_MakeEdge(ellipse)).Wire();
    return BRepPrimAPI_MakePrism(BRepBuilderAPI_MakeFace(wire).Face(), gp_Vec(0, 0, 3)).Shape();
  };
  return without(rod(a, b), rod(a - 0.1, b - 0.1));
}

TopoDS_Shape rounded(const TopoDS_Shape& shape) {
  BRepFilletAPI_MakeFillet fillet(shape);
  fillet.Add(0.2, TopoDS::Edge(TopExp_Explorer(shape, TopAbs_EDGE).Current()));
  return fillet.Shape();
}

TopoDS_Shape halves(double length) { return joined(block({0, 0, 0}, {1, 2, 1}), block({1, 0, 0}, {length - 1, 2, 1})); }

const std::vector<Pair>& pairs() {
  static const std::vector<Pair> list{
      {"a box with its faces in another order",
       [] {
         return block({0, 0, 0}, {1, 2, 3});
       },
       [] {
         return renumbered(block({0, 0, 0}, {1.5, 2, 2.5}), 5);
       },
       {{{0.5, 1, 3}, {0.7, 1, 2.5}}, {{1, 1, 1}, {1.5, 1, 1}}, {{0.5, 0, 1}, {0.7, 0, 1}}},
       {}},
      {"a bored block with its faces in another order",
       [] {
         return bored({4, 3, 2}, {1.5, 1.2, 0}, 0.5);
       },
       [] {
         return renumbered(bored({4, 3, 2}, {2.1, 1.5, 0}, 0.8), 3);
       },
       {{{2, 1.2, 1}, {2.9, 1.5, 1}}, {{3.5, 2.5, 2}, {3.7, 2.7, 2}}},
       {}},
      {"faces split in two",
       [] {
         return block({0, 0, 0}, {3, 2, 1});
       },
       [] { return halves(3.5); },
       {{{1.5, 1, 1}, {1, 1, 1}}, {{3, 1, 0.5}, {3.5, 1, 0.5}}},
       {}},
      {"split faces merged",
       [] { return halves(3); },
       [] {
         return block({0, 0, 0}, {3.5, 2, 1});
       },
       {{{1.5, 1, 1}, {2, 1, 1}}, {{0, 1, 0.5}, {0, 1, 0.5}}},
       {}},
      {"another face split than before",
       [] {
         return joined(block({0, 0, 0}, {1, 2, 1}), block({1, 0, 0}, {2, 2, 1}));
       },
       [] {
         return joined(block({0, 0, 0}, {3.5, 0.8, 1}), block({0, 0.8, 0}, {3.5, 1.2, 1}));
       },
       {{{1, 1, 1}, {1, 0.8, 1}}, {{3, 1, 0.5}, {3.5, 0.8, 0.5}}, {{0, 1, 0.5}, {0, 0.8, 0.5}}},
       {}},
      {"a split in another place of a part with a bore",
       [] {
         return joined(bored({2, 3, 2}, {1, 1, 0}, 0.4), block({2, 0, 0}, {1, 3, 2}));
       },
       [] {
         return joined(bored({3, 2, 2}, {1, 1, 0}, 0.4), block({0, 2, 0}, {3, 1, 2}));
       },
       {{{1.4, 1, 1}, {1.4, 1, 1}}, {{3, 1, 1}, {3, 2, 1}}, {{0, 1, 1}, {0, 2, 1}}},
       {}},
      {"a split in another direction of a part with a blind hole",
       [] {
         return joined(without(block({0, 0, 0}, {2, 3, 2}), rod({1, 1, 1}, {0, 0, 1}, 0.4, 2)), block({2, 0, 0}, {1, 3, 2}));
       },
       [] {
         const TopoDS_Shape upper = without(block({0, 0, 0.5}, {3, 3, 1.5}), rod({1, 1, 1}, {0, 0, 1}, 0.4, 2));
         return joined(block({0, 0, 0}, {3, 3, 0.5}), upper);
       },
       {{{1.4, 1, 1.5}, {1.4, 1, 1.5}}, {{3, 1, 1}, {3, 1, 0.5}}, {{2, 1, 2}, {2, 1, 2}}},
       {}},
      {"a cylinder split into halves",
       [] {
         return bored({4, 4, 2}, {2, 2, 0}, 1);
       },
       [] {
         const TopoDS_Shape tool = turned(rod({2, 2.2, -1}, {0, 0, 1}, 1.2, 4), {2, 2.2, 0}, {0, 0, 1}, 90);
         const TopoDS_Shape left = without(block({0, 0, 0}, {2, 4, 2}), tool);
         const TopoDS_Shape right = without(block({2, 0, 0}, {2, 4, 2}), tool);
         return joined(left, right);
       },
       {{{1, 2, 1}, {2, 1, 1}}},
       {}},
      {"a face is missing",
       [] {
         return sheet(block({0, 0, 0}, {1, 2, 3}), {}, {});
       },
       [] {
         return sheet(block({0, 0, 0}, {1, 2, 3}), {4}, {});
       },
       {},
       {"differ in structure: 6 faces, 12 edges and 8 vertices became 5 faces", "face "}},
      {"a bore is missing",
       [] {
         return without(bored({4, 2, 1}, {1, 1, 0}, 0.3), rod({3, 1, -1}, {0, 0, 1}, 0.3, 3));
       },
       [] {
         return bored({4, 2, 1}, {1, 1, 0}, 0.3);
       },
       {},
       {"differ in structure", "(cylinder) has 1 loop of 4 edges in all and no partner"}},
      {"an edge was rounded",
       [] {
         return block({0, 0, 0}, {1, 2, 3});
       },
       [] {
         return rounded(block({0, 0, 0}, {1, 2, 3}));
       },
       {},
       {"differ in structure", "face "}},
      {"a through hole became a blind one",
       [] {
         return bored({2, 2, 2}, {1, 1, 0}, 0.4);
       },
       [] {
         return without(block({0, 0, 0}, {2, 2, 2}), rod({1, 1, 1}, {0, 0, 1}, 0.4, 2));
       },
       {},
       {"differ in structure", "face "}},
      {"a blind hole became a boss",
       [] {
         return without(block({0, 0, 0}, {2, 2, 2}), rod({1, 1, 1.5}, {0, 0, 1}, 0.4, 1));
       },
       [] {
         return joined(block({0, 0, 0}, {2, 2, 2}), rod({1, 1, 1.5}, {0, 0, 1}, 0.4, 1));
       },
       {},
       {"differ in structure", "(cylinder)", "hollow"}},
      {"a round bore became square",
       [] {
         return bored({2, 2, 2}, {1, 1, 0}, 0.4);
       },
       [] {
         return without(block({0, 0, 0}, {2, 2, 2}), block({0.5, 0.5, -1}, {1, 1, 4}));
       },
       {},
       {"differ in structure", "face "}},
      {"a solid inside out",
       [] {
         return bored({4, 3, 2}, {1.5, 1.2, 0}, 0.5);
       },
       [] {
         return bored({4, 3, 2}, {2.1, 1.5, 0}, 0.8).Reversed();
       },
       {},
       {"face "}},
      {"a solid with as many bores as bosses inside out",  // which differ only in what is beside them
       [] {
         return joined(bored({4, 3, 2}, {1, 1, 0}, 0.5), rod({3, 2, 1.5}, {0, 0, 1}, 0.4, 1));
       },
       [] {
         return joined(bored({4, 3, 2}, {1, 1, 0}, 0.6), rod({3, 2, 1.5}, {0, 0, 1}, 0.5, 1)).Reversed();
       },
       {},
       {"differ in structure", "(cylinder) has 1 loop", "but other neighbours"}},
      {"a solid becomes a sheet",
       [] {
         return bored({4, 3, 2}, {1.5, 1.2, 0}, 0.5);
       },
       [] {
         return sheet(bored({4, 3, 2}, {1.5, 1.2, 0}, 0.5), {}, {});
       },
       {},
       {"differ in structure", "solids: 1 and 0", "face "}},
      {"a sheet with a face the other way round",
       [] {
         return sheet(block({0, 0, 0}, {1, 2, 3}), {}, {});
       },
       [] {
         return sheet(block({0, 0, 0}, {1.5, 2, 2.5}), {}, {2});
       },
       {{{0.5, 1, 3}, {0.7, 1, 2.5}}, {{1, 1, 1}, {1.5, 1, 1}}},
       {}},
      {"a mirror image",
       [] { return handed(3); },
       [] {
         return shifted(mirrored(handed(3), {1, 0, 0}), {3, 0, 0});
       },
       {},
       {"mirror image"}},
      {"a mirror image of what is symmetric",
       [] {
         return bored({4, 3, 2}, {1.5, 1.5, 0}, 0.5);
       },
       [] {
         return shifted(mirrored(bored({4, 3, 2}, {1.5, 1.5, 0}, 0.5), {1, 0, 0}), {4, 0, 0});
       },
       {{{2, 1.5, 1}, {3, 1.5, 1}}, {{0, 1, 1}, {0, 1, 1}}, {{4, 1, 1}, {4, 1, 1}}},
       {}},
      {"a cube turned by 45 degrees",
       [] {
         return block({0, 0, 0}, {1, 1, 1});
       },
       [] {
         return turned(block({0, 0, 0}, {1, 1, 1}), {0.5, 0.5, 0}, {0, 0, 1}, 45);
       },
       {},
       {"ambiguous: face ", "may be face "}},
      {"a handed part that is laid on its side and grows",
       [] { return handed(3); },
       [] {
         return shifted(turned(handed(3.3), {1, 1, 1}, {1, 1, 1}, 120), {7, 1, -2});
       },
       // The axes x, y, z go to y, z, x.
       {{{1.3, 1.5, 2}, {9, 2.3, -0.5}}, {{0, 1, 1}, {8, 1, -1}}},
       {}},
      {"a box whose sides change, or that was turned",
       [] {
         return block({0, 0, 0}, {1, 2, 3});
       },
       [] {
         return turned(block({0, 0, 0}, {1, 2, 3}), {0.5, 1, 0}, {0, 0, 1}, 90);
       },
       {{{1, 1, 1}, {1.5, 1, 1}}},
       {}},
      {"a block that was turned and moved, or its bore moved",
       [] {
         return bored({4, 3, 2}, {1.5, 1.2, 0}, 0.5);
       },
       [] {
         return shifted(turned(bored({4, 3, 2}, {1.5, 1.2, 0}, 0.5), {2, 1.5, 0}, {0, 0, 1}, 180), {0.3, 0.2, 0.1});
       },
       {},
       {"ambiguous: the partner of face ", "where they lie in the files", "after a turn and a scaling"}},
      {"a row of bores moves by one pitch",
       [] { return row_of_bores(1); },
       [] { return row_of_bores(3); },
       {},
       {"ambiguous", "by what stays"}},
      {"a row of bores moves by a part of the pitch",
       [] { return row_of_bores(1); },
       [] { return row_of_bores(1.6); },
       {{{1.4, 1, 0.2}, {2, 1, 0.2}}, {{7.4, 1, 0.2}, {8, 1, 0.2}}},
       {}},
      {"a square tube whose outside goes where its inside was",
       [] {
         return without(block({-1, -1, 0}, {2, 2, 3}), block({-0.9, -0.9, -1}, {1.8, 1.8, 5}));
       },
       [] {
         return without(block({-0.9, -0.9, 0}, {1.8, 1.8, 3}), block({-0.8, -0.8, -1}, {1.6, 1.6, 5}));
       },
       {{{1, 0, 1}, {0.9, 0, 1}}, {{0.9, 0, 1}, {0.8, 0, 1}}},
       {}},
      {"an elliptic tube whose outside goes where its inside was",
       [] { return elliptic_tube(1, 0.8); },
       [] { return elliptic_tube(0.9, 0.7); },
       {{{1, 0, 1}, {0.9, 0, 1}}, {{0.9, 0, 1}, {0.8, 0, 1}}},
       {}},
      {"two blocks in another order",
       [] {
         return together({block({0, 0, 0}, {1, 1, 1}), block({3, 0, 0}, {1, 1, 1})});
       },
       [] {
         return together({block({3.2, 0, 0}, {1, 1, 1}), block({0, 0.1, 0}, {1, 1.2, 1})});
       },
       {{{0.5, 0, 0.5}, {0.5, 0.1, 0.5}}, {{4, 0.5, 0.5}, {4.2, 0.5, 0.5}}},
       {}},
      {"a pipe that bends less, with other legs",
       [] { return pipe({}); },
       [] {
         return pipe({0.55, 1.15, 2.2, 60, 4, 1.5});
       },
       {{{0.85, 0, 0}, {0.85, 0, 0}}, {{1, 0, 1}, {1.15, 0, 2}}, {{0.7, 0, 1}, {0.55, 0, 2}}},
       {}},
      {"a sphere",
       [] { return BRepPrimAPI_MakeSphere(1).Shape(); },
       [] {
         return shifted(BRepPrimAPI_MakeSphere(1.5).Shape(), {1, 0, 0});
       },
       {{{1, 0, 0}, {2.5, 0, 0}}},
       {}},
      {"a cone with its apex",
       [] { return BRepPrimAPI_MakeCone(1, 0, 2).Shape(); },
       [] { return BRepPrimAPI_MakeCone(1.5, 0, 3).Shape(); },
       {{{0.5, 0, 1}, {0.75, 0, 1.5}}},
       {}},
      {"a torus",
       [] { return BRepPrimAPI_MakeTorus(3, 1).Shape(); },
       [] { return BRepPrimAPI_MakeTorus(4, 0.5).Shape(); },
       {{{4, 0, 0}, {4.5, 0, 0}}},
       {}},
  };
  return list;
}

class CadPairs : public PairFiles, public testing::WithParamInterface<Pair> {};

/// Every node lies on the new model, those of known faces on their partners, and nothing is flipped or outside.
void expect_carried(const Mesh& mesh, const CarriedNodes& carried, const TopoDS_Shape& before, const TopoDS_Shape& after,
                    const std::vector<KnownFace>& known) {
  const double limit = 1e-9 * std::max(diagonal_of(before), diagonal_of(after));
  const TopoDS_Shape target = skin(after);
  ASSERT_EQ(carried.nodes.size(), mesh.point_count());
  double worst = 0;
  for (const Vec3& place : carried.places) worst = std::max(worst, distance_from(place, target));
  EXPECT_LT(worst, limit);
  EXPECT_EQ(carried.flipped(), 0u);
  EXPECT_EQ(carried.outside(), 0u);
  const auto face_at = [&](const TopoDS_Shape& shape, const Vec3& point) -> TopoDS_Shape {
    std::vector<TopoDS_Shape> found;
    for (const TopoDS_Face& face : faces_of(shape)) {
      if (distance_from(point, face) < limit) found.push_back(face);
    }
    EXPECT_FALSE(found.empty());
    return together(found);  // a face may be split
  };
  for (const KnownFace& face : known) {
    const TopoDS_Shape old = face_at(before, face.before), now = face_at(after, face.after);
    double farthest = 0;
    std::size_t nodes = 0;
    for (std::size_t i = 0; i < carried.nodes.size(); ++i) {
      if (distance_from(mesh.points[carried.nodes[i]], old) > limit) continue;
      ++nodes;
      if (nodes % 7 == 0) farthest = std::max(farthest, distance_from(carried.places[i], now));
    }
    EXPECT_GT(nodes, 3u);
    EXPECT_LT(farthest, limit);
  }
}

TEST_P(CadPairs, AreSolvedOrRefusedByName) {
  const Pair& pair = GetParam();
  const TopoDS_Shape before = pair.before(), after = pair.after();
  const Mesh mesh = mesh_of(before, 0.04 * diagonal_of(before), 1);
  MoveRequest request;
  request.before = file(before, "before");
  request.after = file(after, "after");
  if (pair.refused.empty()) {
    expect_carried(mesh, carry_nodes(mesh, request), before, after, pair.known);
    return;
  }
  try {
    carry_nodes(mesh, request);
    ADD_FAILURE() << "it was solved";
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::failed_precondition);
    for (const std::string& part : pair.refused) EXPECT_THAT(error.what(), HasSubstr(part));
  }
}

class CadSeams : public PairFiles {
 protected:
  CarriedNodes carry(const Mesh& mesh, const TopoDS_Shape& before, const TopoDS_Shape& after) {
    MoveRequest request;
    request.before = file(before, "before");
    request.after = file(after, "after");
    return carry_nodes(mesh, request);
  }
};

/// A block with a bore whose seam is put at an angle, in degrees.
TopoDS_Shape bored_with_seam(const Vec3& at, double radius, double degrees) {
  const double angle = degrees * std::numbers::pi / 180;
  return without(block({-2, -2, -1}, {4, 4, 2}),
                 rod({at[0], at[1], -2}, {0, 0, 1}, {std::cos(angle), std::sin(angle), 0}, radius, 4));
}

TEST_F(CadSeams, AMeshDoesNotTurnWithTheSeam) {
  // Nodes on the bore keep their angle, wherever the seam of the new model is.
  const TopoDS_Shape before = bored_with_seam({0, 0, 0}, 0.5, 30);
  const Mesh mesh = mesh_of(before, 0.05);
  for (const double seam : {30.0, 75.0, 200.0, 300.0}) {
    const TopoDS_Shape after = bored_with_seam({0.3, -0.2, 0}, 0.8, seam);
    const CarriedNodes carried = carry(mesh, before, after);
    expect_carried(mesh, carried, before, after, {});
    double turn = 0, along = 0;
    std::size_t on_bore = 0;
    for (std::size_t i = 0; i < carried.nodes.size(); ++i) {
      const Vec3& p = mesh.points[carried.nodes[i]];
      if (std::abs(std::hypot(p[0], p[1]) - 0.5) > 1e-9) continue;
      ++on_bore;
      const Vec3& q = carried.places[i];
      turn = std::max(turn, distance(q, {0.3 + 1.6 * p[0], -0.2 + 1.6 * p[1], p[2]}));
      along = std::max(along, std::abs(q[2] - p[2]));
    }
    EXPECT_GT(on_bore, 200u);
    EXPECT_LT(turn, 1e-6) << "seam at " << seam;
    EXPECT_LT(along, 1e-6) << "seam at " << seam;
  }
}

TEST_F(CadSeams, ARodStretchesWhereverItsSeamIs) {
  const TopoDS_Shape before = rod({0, 0, 0}, {0, 0, 1}, {1, 0, 0}, 1, 3);
  const Mesh mesh = mesh_of(before, 0.05);
  const CarriedNodes carried = carry(mesh, before, rod({0, 0, 0}, {0, 0, 1}, {-1, 1, 0}, 1.5, 4));
  double worst = 0;
  for (std::size_t i = 0; i < carried.nodes.size(); ++i) {
    const Vec3& p = mesh.points[carried.nodes[i]];
    worst = std::max(worst, distance(carried.places[i], {1.5 * p[0], 1.5 * p[1], p[2] * 4 / 3}));
  }
  EXPECT_LT(worst, 1e-6);
}

TEST_F(CadSeams, ARimBetweenTwoRoundFacesDoesNotTurnWithTheirSeams) {
  // A cylinder and a cone on it: no face at their common circle but those with the seams.
  const auto drum = [](double size, double seam) {
    const gp_Ax2 place(gp_Pnt(0, 0, 2 * size), gp::DZ(), gp_Dir(std::cos(seam), std::sin(seam), 0));
    return joined(rod({0, 0, 0}, {0, 0, 1}, {std::cos(seam), std::sin(seam), 0}, size, 2 * size),
                  BRepPrimAPI_MakeCone(place, size, 0.4 * size, size).Shape());
  };
  const TopoDS_Shape before = drum(1, 0.3);
  ASSERT_EQ(faces_of(before).size(), 4u);
  const Mesh mesh = mesh_of(before, 0.05);
  const CarriedNodes carried = carry(mesh, before, drum(1.5, 2.4));
  double worst = 0;
  for (std::size_t i = 0; i < carried.nodes.size(); ++i)
    worst = std::max(worst, distance(carried.places[i], 1.5 * mesh.points[carried.nodes[i]]));
  EXPECT_LT(worst, 1e-6);
  EXPECT_EQ(carried.flipped() + carried.outside(), 0u);
}

TEST_F(CadSeams, AConeAndItsApexTurnNeither) {
  const TopoDS_Shape before = BRepPrimAPI_MakeCone(1, 0, 2).Shape();
  const TopoDS_Shape after = turned(BRepPrimAPI_MakeCone(1.5, 0, 3).Shape(), {0, 0, 0}, {0, 0, 1}, 130);
  const Mesh mesh = mesh_of(before, 0.05);
  const CarriedNodes carried = carry(mesh, before, after);
  double worst = 0;
  for (std::size_t i = 0; i < carried.nodes.size(); ++i)
    worst = std::max(worst, distance(carried.places[i], 1.5 * mesh.points[carried.nodes[i]]));
  EXPECT_LT(worst, 1e-6);
}

class CadFiles : public PairFiles {};

TEST_F(CadFiles, IgesIsSewnAndCarried) {
  const TopoDS_Shape before = bored({4, 3, 2}, {1.5, 1.2, 0}, 0.5), after = bored({4.4, 3, 2}, {2.1, 1.5, 0}, 0.8);
  MoveRequest request;
  for (const auto& [shape, name, target] :
       {std::tuple{before, "before.igs", &request.before}, {after, "after.iges", &request.after}}) {
    IGESControl_Controller::Init();
    IGESControl_Writer writer("MM", 0);
    writer.AddShape(shape);
    *target = path(name);
    ASSERT_TRUE(writer.Write(target->c_str()));
  }
  const Mesh mesh = mesh_of(before, 0.1);
  const CarriedNodes carried = carry_nodes(mesh, request);
  // IGES has ten digits or so.
  const double limit = 1e-6 * diagonal_of(after);
  double worst = 0;
  const TopoDS_Shape target = skin(after);
  for (const Vec3& place : carried.places) worst = std::max(worst, distance_from(place, target));
  EXPECT_LT(worst, limit);
  EXPECT_EQ(carried.flipped() + carried.outside(), 0u);
  EXPECT_THAT(carried.notes, testing::Contains(HasSubstr("sewn")));
}

TEST_F(CadFiles, IgesOfASolidIsOne) {
  // A block with a cavity stays sheets: which shell is inside is not looked at.
  const TopoDS_Shape before = bored({4, 3, 2}, {1.5, 1.2, 0}, 0.5), after = bored({4, 3, 2}, {2.1, 1.5, 0}, 0.8);
  const TopoDS_Shape hollow = without(block({0, 0, 0}, {4, 3, 2}), block({1, 1, 0.5}, {1, 1, 1}));
  IGESControl_Controller::Init();
  const auto iges = [&](const TopoDS_Shape& shape, const std::string& name) {
    IGESControl_Writer writer("MM", 0);
    EXPECT_TRUE(writer.AddShape(shape));
    writer.ComputeModel();
    const auto written = path(name + ".igs");
    EXPECT_TRUE(writer.Write(written.c_str()));
    return written;
  };
  const auto volume = [](const TopoDS_Shape& shape) {
    GProp_GProps properties;
    BRepGProp::VolumeProperties(shape, properties);
    return properties.Mass();
  };
  const Mesh mesh = mesh_of(before, 0.1);
  MoveRequest request;
  request.before = step(before, "before", {}, "millimetre");
  request.after = iges(after, "after");
  const CarriedNodes carried = carry_nodes(mesh, request);
  for (std::size_t i = 0; i < carried.nodes.size(); ++i) {
    const Vec3 &p = mesh.points[carried.nodes[i]], &q = carried.places[i];
    EXPECT_LT(distance_from(q, skin(after)), 2e-6);  // the file has seven digits
    if (std::abs(std::hypot(p[0] - 1.5, p[1] - 1.2) - 0.5) < 1e-9) {
      EXPECT_NEAR(std::hypot(q[0] - 2.1, q[1] - 1.5), 0.8, 2e-6);
    }
  }
  EXPECT_EQ(carried.flipped() + carried.outside(), 0u);
  const Model one = read_model(request.after, 1);
  EXPECT_EQ(one.solids.Extent(), 1);
  EXPECT_THAT(one.notes, testing::Contains(HasSubstr("they bound a solid")));
  EXPECT_NEAR(volume(one.shape), volume(after), 1e-6 * volume(after));  // with its outside outside
  const TopoDS_Shape reversed = read_model(iges(after.Reversed(), "reversed"), 1).shape;
  EXPECT_NEAR(volume(reversed), volume(after), 1e-6 * volume(after));
  EXPECT_EQ(read_model(iges(together({after, shifted(after, {9, 0, 0})}), "two"), 1).solids.Extent(), 2);
  EXPECT_EQ(read_model(iges(hollow, "hollow"), 1).solids.Extent(), 0);
  EXPECT_EQ(read_model(iges(sheet(after, {2}, {}), "open"), 1).solids.Extent(), 0);
}

TEST_F(CadFiles, IgesIsReadInItsOwnUnitWhateverWasReadBefore) {
  const TopoDS_Shape shape = block({0, 0, 0}, {10, 20, 30});
  Model ignored;
  for (const auto& [unit, other] : {std::pair{"IN", "millimetre"}, {"MM", "inch"}, {"M", "inch"}}) {
    keep_unit("millimetre", ignored);
    IGESControl_Controller::Init();
    IGESControl_Writer writer(unit, 0);
    writer.AddShape(shape);
    const auto file = path(std::string(unit) + ".igs");
    ASSERT_TRUE(writer.Write(file.c_str()));
    const double millimetres = std::string(unit) == "IN" ? 25.4 : std::string(unit) == "M" ? 1000 : 1;
    for (int time = 0; time < 2; ++time) {
      keep_unit(other, ignored);
      const Model model = read_model(file, 1);
      EXPECT_NEAR(model.diagonal, std::sqrt(1400.0) / millimetres, 1e-6) << unit << " after " << other;
      EXPECT_NEAR(model.unit, millimetres / 1000, 1e-12);
    }
  }
}

TEST_F(CadFiles, UnitsOfFilesAndOfTheMeshMayDiffer) {
  // The new file is in metres, the old one in millimetres, the mesh in centimetres.
  const TopoDS_Shape before = block({0, 0, 0}, {10, 20, 30}), after = scaled(block({0, 0, 0}, {15, 20, 25}), 0.001);
  Mesh mesh = mesh_of(before, 1);
  for (Vec3& p : mesh.points) p = p / 10;
  MoveRequest request;
  request.before = step(before, "before", {}, "millimetre");
  request.after = step(after, "after", {}, "metre");
  request.scale = 0.1;
  const CarriedNodes carried = carry_nodes(mesh, request);
  double worst = 0;
  for (std::size_t i = 0; i < carried.nodes.size(); ++i) {
    const Vec3& p = mesh.points[carried.nodes[i]];
    worst = std::max(worst, distance(carried.places[i], {1.5 * p[0], p[1], p[2] / 1.2}));
  }
  EXPECT_LT(worst, 1e-9);
  EXPECT_THAT(carried.notes, testing::Contains(HasSubstr("is in metre.")));
  EXPECT_THAT(carried.notes, testing::Contains(HasSubstr("is multiplied by 100.")));
}

TEST_F(CadFiles, NodesWithFewDigitsStayOnEdges) {
  // Rounded to four digits behind the point, 1e-5 D or so: edges of the new model are met all the same.
  const TopoDS_Shape before = bored({4, 3, 2}, {1.5, 1.2, 0}, 0.5), after = bored({4, 3, 2}, {2.1, 1.5, 0}, 0.8);
  Mesh mesh = mesh_of(before, 0.1);
  const Mesh exact = mesh;
  for (Vec3& p : mesh.points) {
    for (double& x : p) x = std::round(1e4 * x) / 1e4;
  }
  MoveRequest request;
  request.before = file(before, "before");
  request.after = file(after, "after");
  const CarriedNodes carried = carry_nodes(mesh, request), wanted = carry_nodes(exact, request);
  EXPECT_EQ(carried.on_vertices, wanted.on_vertices);
  EXPECT_EQ(carried.on_edges, wanted.on_edges);
  EXPECT_EQ(carried.flipped() + carried.outside(), 0u);
  double worst = 0;  // on the bore, where nothing is mended
  for (std::size_t i = 0; i < carried.nodes.size(); ++i) {
    const Vec3& p = exact.points[carried.nodes[i]];
    if (std::abs(std::hypot(p[0] - 1.5, p[1] - 1.2) - 0.5) > 1e-9) continue;
    worst = std::max(worst, distance(carried.places[i], wanted.places[i]));
  }
  EXPECT_LT(worst, 1e-3);
}

TEST_F(CadFiles, WhatCannotBeMendedIsCounted) {
  // Without nodes inside the top nothing can slide there.
  const TopoDS_Shape before = bored({4, 4, 1}, {0.8, 0.8, 0}, 0.4), after = bored({4, 4, 1}, {3, 3, 0}, 0.8);
  MoveRequest request;
  request.before = file(before, "before");
  request.after = file(after, "after");
  const CarriedNodes bare = carry_nodes(mesh_of(before, 0.02, 0), request);
  EXPECT_GT(bare.flipped(), 0u);
  for (const FaceOutcome& face : bare.faces) EXPECT_EQ(face.flipped, face.warp_flipped);
}

/// Quadrilaterals on the top of a bored block of 4 x 4 x 1, from the rim of the bore to the sides.
Mesh polar_top(const Vec3& at, double radius) {
  constexpr int around = 64, layers = 10;
  Mesh mesh;
  for (int j = 0; j <= layers; ++j) {
    for (int i = 0; i < around; ++i) {
      const double share = static_cast<double>(j) / layers, angle = 2 * std::numbers::pi * (i - around / 8.0) / around;
      const int side = i / (around / 4);
      const double along = 4.0 * (i % (around / 4)) / (around / 4.0);
      const std::array<Vec3, 4> square{{{4, along, 1}, {4 - along, 4, 1}, {0, 4 - along, 1}, {along, 0, 1}}};
      const Vec3 rim{at[0] + radius * std::cos(angle), at[1] + radius * std::sin(angle), 1};
      mesh.points.push_back((1 - share) * rim + share * square[side]);
    }
  }
  for (int j = 0; j < layers; ++j) {
    for (int i = 0; i < around; ++i) {
      const auto next = (i + 1) % around;
      mesh.face_sizes.push_back(4);
      for (const int p : {j * around + i, (j + 1) * around + i, (j + 1) * around + next, j * around + next}) {
        mesh.face_points.push_back(static_cast<PointId>(p));
      }
    }
  }
  return mesh;
}

TEST_F(CadFiles, AFaceWhoseBoreGoesToTheOtherCornerIsMended) {
  const TopoDS_Shape before = bored({4, 4, 1}, {0.8, 0.8, 0}, 0.4), after = bored({4, 4, 1}, {3, 3, 0}, 0.8);
  const Mesh mesh = polar_top({0.8, 0.8, 0}, 0.4);
  MoveRequest request;
  request.before = file(before, "before");
  request.after = file(after, "after");
  const CarriedNodes carried = carry_nodes(mesh, request);
  std::size_t flipped = 0;
  for (const FaceOutcome& face : carried.faces) flipped += face.warp_flipped;
  EXPECT_GT(flipped, 20u);
  expect_carried(mesh, carried, before, after, {});
  // By the signs of the areas of all triangles, seen from above.
  std::size_t first = 0;
  for (const std::uint32_t size : mesh.face_sizes) {
    for (std::uint32_t k = 1; k + 1 < size; ++k) {
      const Vec3 &a = carried.places[mesh.face_points[first]], &b = carried.places[mesh.face_points[first + k]],
                 &c = carried.places[mesh.face_points[first + k + 1]];
      EXPECT_GT(cross(b - a, c - a)[2], 0);
    }
    first += size;
  }
}

TEST_F(CadFiles, GivenPairsSolveWhatIsAmbiguous) {
  const TopoDS_Shape cube = block({0, 0, 0}, {1, 1, 1}), after = turned(cube, {0.5, 0.5, 0}, {0, 0, 1}, 45);
  const Mesh mesh = mesh_of(cube, 0.1);
  const double s = std::sqrt(0.125);
  MoveRequest request;
  request.before = file(cube, "before");
  request.after = file(after, "after");
  request.pairs = {{ForcedPair::Kind::face, face_at(cube, {0.5, 0, 0.5}) + 1, face_at(after, {0.5 + s, 0.5 - s, 0.5}) + 1},
                   {ForcedPair::Kind::face, face_at(cube, {0.5, 0.5, 1}) + 1, face_at(after, {0.5, 0.5, 1}) + 1}};
  const CarriedNodes carried = carry_nodes(mesh, request);
  for (std::size_t i = 0; i < carried.nodes.size(); ++i) {
    const Vec3& p = mesh.points[carried.nodes[i]];
    const double x = (p[0] - 0.5) * std::sqrt(0.5), y = (p[1] - 0.5) * std::sqrt(0.5);
    EXPECT_LT(distance(carried.places[i], {0.5 + x - y, 0.5 + x + y, p[2]}), 1e-9);
  }
}

TEST_F(CadFiles, GroupsWithNamesOfFacesTellTheSidesOfASheet) {
  const TopoDS_Shape sheet = block({0, 0, 0}, {4, 3, 5e-5});
  MoveRequest request;
  request.before =
      step(sheet, "before",
           {{face_at(sheet, {2, 1, 0}), "hub", std::nullopt}, {face_at(sheet, {2, 1, 5e-5}), "tip", std::nullopt}}, "metre");
  request.after = step(block({0, 0, 0}, {4, 3, 0.5}), "after", {}, "metre");
  // Two triangles with few digits: below, seen from below, and above, seen from above.
  Mesh mesh;
  mesh.points = {{1, 1, 0}, {1, 2, 0}, {2, 1, 0}, {1, 1, 0}, {2, 1, 0}, {1, 2, 0}};
  mesh.face_sizes = {3, 3};
  mesh.face_points = {0, 1, 2, 3, 4, 5};
  const auto heights = [&](const std::string& below, const std::string& above, std::vector<std::string>& notes) {
    mesh.groups = {{below, {}, {0}}, {above, {}, {1}}};
    const CarriedNodes carried = carry_nodes(mesh, request);
    notes = carried.notes;
    return std::array<double, 2>{carried.places[0][2], carried.places[3][2]};
  };
  std::vector<std::string> notes;
  EXPECT_EQ(heights("hub", "tip", notes), (std::array{0.0, 0.5}));
  EXPECT_THAT(notes, testing::Not(testing::Contains(HasSubstr("lie on no single face"))));
  EXPECT_EQ(heights("one", "other", notes), (std::array{0.0, 0.0}));
}

/// A tube of hexahedra with 20 nodes around the z axis, 12 around, 2 across and 3 along, with its boundary as faces.
Mesh quadratic_tube(double inner, double outer, double height) {
  constexpr int around = 12, across = 2, along = 3;
  Mesh mesh;
  std::map<std::array<int, 3>, PointId> ids;
  const auto node = [&](int i, int j, int k) {  // in halves of an element
    const auto [entry, fresh] = ids.try_emplace({i, j % (2 * around), k}, static_cast<PointId>(mesh.points.size()));
    if (fresh) {
      const double radius = inner + i * (outer - inner) / (2 * across), angle = j * std::numbers::pi / around;
      mesh.points.push_back({radius * std::cos(angle), radius * std::sin(angle), k * height / (2 * along)});
    }
    return entry->second;
  };
  constexpr std::array<std::array<int, 3>, 20> places{
      {{0, 0, 0}, {2, 0, 0}, {2, 2, 0}, {0, 2, 0}, {0, 0, 2}, {2, 0, 2}, {2, 2, 2}, {0, 2, 2}, {1, 0, 0}, {2, 1, 0},
       {1, 2, 0}, {0, 1, 0}, {0, 0, 1}, {2, 0, 1}, {2, 2, 1}, {0, 2, 1}, {1, 0, 2}, {2, 1, 2}, {1, 2, 2}, {0, 1, 2}}};
  auto elements = std::make_shared<Elements>();
  for (int k = 0; k < along; ++k) {
    for (int j = 0; j < around; ++j) {
      for (int i = 0; i < across; ++i) {
        std::vector<PointId> nodes;
        for (const auto& [a, b, c] : places) nodes.push_back(node(2 * i + a, 2 * j + b, 2 * k + c));
        elements->add(ElementType::hexahedron20, nodes);
      }
    }
  }
  const BoundaryFaces faces = boundary_faces(*elements);
  mesh.face_sizes = faces.sizes;
  mesh.face_points = faces.points;
  mesh.elements = elements;
  return mesh;
}

TEST_F(CadFiles, MidSideNodesLieOnTheModelToo) {
  const auto tube = [](double inner, double outer, double height) {
    return without(rod({0, 0, 0}, {0, 0, 1}, outer, height), rod({0, 0, -1}, {0, 0, 1}, inner, height + 2));
  };
  const Mesh mesh = quadratic_tube(0.5, 1, 2);
  const TopoDS_Shape after = tube(0.6, 1.5, 2.5);
  MoveRequest request;
  request.before = file(tube(0.5, 1, 2), "before");
  request.after = file(after, "after");
  const CarriedNodes carried = carry_nodes(mesh, request);
  const TopoDS_Shape target = skin(after);
  std::size_t round = 0;
  for (std::size_t i = 0; i < carried.nodes.size(); ++i) {
    const Vec3 &p = mesh.points[carried.nodes[i]], &q = carried.places[i];
    EXPECT_LT(distance_from(q, target), 1e-9);
    const double radius = std::hypot(p[0], p[1]);
    if (std::abs(radius - 0.5) > 1e-9 && std::abs(radius - 1) > 1e-9) continue;
    ++round;
    const double by = radius < 0.75 ? 1.2 : 1.5;
    EXPECT_LT(distance(q, {by * p[0], by * p[1], 1.25 * p[2]}), 1e-9);
  }
  EXPECT_EQ(round, 2u * (24 * 4 + 12 * 3));  // corners and mid-side nodes of both walls
  std::size_t triangles = 0;
  for (const FaceOutcome& face : carried.faces) triangles += face.triangles;
  EXPECT_EQ(triangles, 6u * (2 * 12 * 3 + 2 * 12 * 2));  // four corners and two in the middle of each side
  EXPECT_EQ(carried.flipped() + carried.outside(), 0u);
}

INSTANTIATE_TEST_SUITE_P(All, CadPairs, testing::ValuesIn(pairs()), [](const auto& info) {
  std::string name = info.param.name;
  for (char& c : name) c = std::isalnum(static_cast<unsigned char>(c)) ? c : '_';
  return name;
});

}  // namespace
}  // namespace deform::cad::cad_pairs_test
