// SPDX-License-Identifier: GPL-3.0-or-later
// Names and colours of faces in STEP files, which tell what structure and places do not: solved, which is judged by where the
// parts are known to go, refused by name, or said and not used.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <IGESCAFControl_Writer.hxx>
#include <IGESControl_Controller.hxx>
#include <Interface_Static.hxx>
#include <TDF_Label.hxx>
#include <TDataStd_Name.hxx>
#include <array>
#include <cmath>
#include <string>

#include "core/base/error.h"
#include "core/base/vectors.h"
#include "core/cad/cad_move.h"
#include "core/cad/step_parts.h"
#include "tests/core/cad/pair_files.h"
#include "tests/core/cad/pair_models.h"

namespace deform::cad::cad_marks_test {
namespace {

using testing::Contains;
using testing::HasSubstr;
using testing::Not;

const Quantity_ColorRGBA red(0.8F, 0, 0, 1), almost_red(0.803F, 0, 0, 1), dark_red(0.6F, 0, 0, 1), blue(0, 0, 0.8F, 1),
    glass(0.8F, 0, 0, 0.5F);

class CadMarks : public PairFiles {
 protected:
  /// A colour of the face at a point.
  struct Paint {
    Vec3 at;
    Quantity_ColorRGBA colour;
  };
  std::filesystem::path painted(const TopoDS_Shape& shape, const std::string& name, const std::vector<Paint>& paints) {
    std::vector<FaceMark> marks;
    for (const Paint& paint : paints) marks.push_back({face_at(shape, paint.at), "", paint.colour});
    return step(shape, name, marks);
  }
  static std::string refusal(const Mesh& mesh, const MoveRequest& request) {
    try {
      carry_nodes(mesh, request);
      return "it was solved";
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), ErrorCode::failed_precondition);
      return error.what();
    }
  }
  /// The farthest that a node is from where a turn about the z axis through a point takes it.
  static double off_turn(const Mesh& mesh, const CarriedNodes& carried, const Vec3& centre, double degrees) {
    const double angle = degrees * std::acos(-1.0) / 180;
    double worst = 0;
    for (std::size_t i = 0; i < carried.nodes.size(); ++i) {
      const Vec3 p = mesh.points[carried.nodes[i]] - centre;
      const Vec3 to{std::cos(angle) * p[0] - std::sin(angle) * p[1], std::sin(angle) * p[0] + std::cos(angle) * p[1], p[2]};
      worst = std::max(worst, distance(carried.places[i], centre + to));
    }
    return worst;
  }
};

/// A square plate with two equal bores, at a distance from its middle along x or y.
TopoDS_Shape two_bores(const Vec3& way) {
  const Vec3 one = Vec3{2, 2, -1} + way, other = Vec3{2, 2, -1} - way;
  return without(without(block({0, 0, 0}, {4, 4, 1}), rod(one, {0, 0, 1}, 0.4, 3)), rod(other, {0, 0, 1}, 0.4, 3));
}

TEST_F(CadMarks, AColourTellsTwoEqualBoresApart) {
  const TopoDS_Shape before = two_bores({1, 0, 0}), after = two_bores({0, 1, 0});
  const Mesh mesh = mesh_of(before, 0.1);
  MoveRequest request;
  request.before = painted(before, "before", {{{3.4, 2, 0.5}, red}});
  request.after = painted(after, "plain", {});
  EXPECT_THAT(refusal(mesh, request), HasSubstr("ambiguous"));
  request.after = painted(after, "otherwise", {{{2, 3.4, 0.5}, blue}});
  EXPECT_THAT(refusal(mesh, request), HasSubstr("ambiguous"));
  for (const Quantity_ColorRGBA& like : {dark_red, glass}) {
    request.after = painted(after, "nearly", {{{2, 3.4, 0.5}, like}});
    EXPECT_THAT(refusal(mesh, request), HasSubstr("ambiguous"));
  }
  // It says nothing about what is painted twice only in the new model, and a colour of all that are alike neither.
  request.before = painted(before, "more", {{{3.4, 2, 0.5}, red}, {{0, 2, 0.5}, blue}, {{0.5, 0.5, 1}, red}});
  request.after =
      painted(after, "more_after", {{{2, 3.4, 0.5}, red}, {{0, 2, 0.5}, blue}, {{4, 2, 0.5}, blue}, {{0.5, 0.5, 1}, red}});
  EXPECT_THAT(carry_nodes(mesh, request).notes, Contains(HasSubstr("the colours of 2 faces agree")));
  for (const double way : {1.0, -1.0}) {  // the sides stay, and the bores go along
    request.after = painted(after, "after", {{{2, 2 + 1.4 * way, 0.5}, almost_red}});
    const CarriedNodes carried = carry_nodes(mesh, request);
    std::size_t nodes = 0;
    for (std::size_t i = 0; i < carried.nodes.size(); ++i) {
      const Vec3& p = mesh.points[carried.nodes[i]];
      const double side = p[0] > 2 ? 1 : -1;
      const bool wall = std::abs(std::hypot(p[0] - 2 - side, p[1] - 2) - 0.4) < 1e-9;
      if (wall) {
        EXPECT_LT(distance(carried.places[i], p + side * Vec3{-1, way, 0}), 1e-6);
      }
      nodes += wall ? 1 : 0;
    }
    EXPECT_GT(nodes, 100u);
    EXPECT_THAT(carried.notes, Contains(HasSubstr("the colours of 1 face agree with the one that is taken")));
  }
}

class IgesMarks : public CadMarks {
 protected:
  /// A file in which the face at a place has a name, or the colour red where that is empty, and the others are called "other".
  std::filesystem::path iges(const TopoDS_Shape& shape, const Vec3& at, const std::string& name, const std::string& file) {
    const OpenDocument open;
    const std::vector<TopoDS_Face> faces = faces_of(shape);
    for (int f = 0; f < static_cast<int>(faces.size()); ++f) {
      const TDF_Label face = open.shapes()->AddShape(faces[f], false);
      TDataStd_Name::Set(face, "other");
      if (f != face_at(shape, at)) continue;
      if (name.empty()) {
        open.colours()->SetColor(face, red, XCAFDoc_ColorSurf);
      } else {
        TDataStd_Name::Set(face, name.c_str());
      }
    }
    IGESControl_Controller::Init();
    Interface_Static::SetCVal("xstep.cascade.unit", "MM");
    Interface_Static::SetCVal("write.iges.unit", "MM");
    IGESCAFControl_Writer writer;
    writer.SetColorMode(true);
    writer.SetNameMode(true);
    EXPECT_TRUE(writer.Transfer(open.get()));
    writer.ComputeModel();
    const auto written = path(file);
    EXPECT_TRUE(writer.Write(written.c_str()));
    return written;
  }
};

TEST_F(IgesMarks, FacesAreReadWithTheirNamesAndColours) {
  const TopoDS_Shape shape = block({0, 0, 0}, {4, 3, 2});
  for (const std::string name : {"", "oil"}) {
    const Model model = read_model(iges(shape, {2, 3, 1}, name, "block.igs"), 1);
    ASSERT_EQ(model.face_count(), 6);
    const int marked = face_at(model.shape, {2, 3, 1});
    ASSERT_GE(marked, 0);
    for (int f = 0; f < 6; ++f) {
      if (name.empty()) {
        ASSERT_EQ(model.face_colours.size(), 6u);
        EXPECT_EQ(model.face_colours[f].has_value(), f == marked);
      } else {
        ASSERT_EQ(model.face_names.size(), 6u);
        EXPECT_EQ(model.face_names[f], f == marked ? "oil" : "other");
        EXPECT_TRUE(model.face_colours.empty());
      }
    }
  }
}

TEST_F(IgesMarks, FacesAreCarriedByTheirNamesAndColours) {
  const TopoDS_Shape before = two_bores({1, 0, 0}), after = two_bores({0, 1, 0});
  const Mesh mesh = mesh_of(before, 0.1);
  for (const std::string name : {"", "oil"}) {
    MoveRequest request;
    request.before = iges(before, {3.4, 2, 0.5}, name, "before.igs");
    for (const double way : {1.0, -1.0}) {
      request.after = iges(after, {2, 2 + 1.4 * way, 0.5}, name, "after.igs");
      const CarriedNodes carried = carry_nodes(mesh, request);
      EXPECT_THAT(carried.notes, Contains(HasSubstr(name.empty() ? "the colours of 1 face agree" : "1 name of faces agrees")));
      for (std::size_t i = 0; i < carried.nodes.size(); ++i) {
        const Vec3& p = mesh.points[carried.nodes[i]];
        if (std::abs(std::hypot(p[0] - 3, p[1] - 2) - 0.4) < 1e-9) {
          EXPECT_NEAR(std::hypot(carried.places[i][0] - 2, carried.places[i][1] - 2 - way), 0.4, 1e-5);
        }
      }
    }
    // What cad-apply writes keeps them.
    const auto again = path("again.step");
    write_document(read_document(request.before), again);
    const Model model = read_model(again, 1);
    const int bore = face_at(model.shape, {3.4, 2, 0.5});
    ASSERT_GE(bore, 0);
    EXPECT_EQ(model.solids.Extent(), 1);
    for (int f = 0; f < model.face_count(); ++f) {
      EXPECT_EQ(!model.face_names.empty() && model.face_names[f] == "oil", f == bore && !name.empty());
      EXPECT_EQ(!model.face_colours.empty() && model.face_colours[f].has_value(), f == bore && name.empty());
    }
  }
}

TEST_F(CadMarks, ColoursOfSeveralFacesTellTogether) {
  // No two of them alone: four sides of a cube in two colours.
  const TopoDS_Shape cube = block({0, 0, 0}, {1, 1, 1}), after = turned(cube, {0.5, 0.5, 0}, {0, 0, 1}, 45);
  const Mesh mesh = mesh_of(cube, 0.1);
  const double s = std::sqrt(0.125), m = 0.5;
  MoveRequest request;
  request.before =
      painted(cube, "before", {{{m, 0, m}, red}, {{1, m, m}, red}, {{m, 1, m}, blue}, {{0, m, m}, blue}, {{m, m, 1}, dark_red}});
  const std::array<Vec3, 4> sides{{{m + s, m - s, m}, {m + s, m + s, m}, {m - s, m + s, m}, {m - s, m - s, m}}};
  for (const int quarter : {0, 1, 2, 3}) {
    std::vector<Paint> paints{{{m, m, 1}, dark_red}};
    for (int i = 0; i < 4; ++i) paints.push_back({sides[(i + quarter) % 4], i < 2 ? red : blue});
    request.after = painted(after, "after", paints);
    const CarriedNodes carried = carry_nodes(mesh, request);
    EXPECT_LT(off_turn(mesh, carried, {m, m, 0}, 45 + 90 * quarter), 1e-9);
    EXPECT_THAT(carried.notes, Contains(HasSubstr("the colours of 5 faces agree")));
  }
  // Faces of one colour that are neighbours here and were so nowhere: structure forbids it, and nothing is chosen.
  request.after =
      painted(after, "crossed", {{sides[0], red}, {sides[2], red}, {sides[1], blue}, {sides[3], blue}, {{m, m, 1}, dark_red}});
  EXPECT_THAT(refusal(mesh, request), HasSubstr("ambiguous"));
}

TEST_F(CadMarks, ColoursThatContradictPlacesAreRefused) {
  const auto plate = [](double first, double second) {
    return without(bored({10, 2, 1}, {first, 1, 0}, 0.4), rod({second, 1, -1}, {0, 0, 1}, 0.4, 3));
  };
  const TopoDS_Shape before = plate(3, 7), after = plate(3.2, 7.1);
  const Mesh mesh = mesh_of(before, 0.2);
  MoveRequest request;
  request.before = painted(before, "before", {{{3.4, 1, 0.5}, red}});
  request.after = painted(after, "after", {{{7.5, 1, 0.5}, red}});
  EXPECT_THAT(refusal(mesh, request),
              testing::AllOf(HasSubstr("the partner of face " + std::to_string(face_at(before, {3.4, 1, 0.5}) + 1)),
                             HasSubstr("by the colours of faces in the files")));
  request.pairs = {{ForcedPair::Kind::face, face_at(before, {3.4, 1, 0.5}) + 1, face_at(after, {3.6, 1, 0.5}) + 1}};
  EXPECT_THAT(carry_nodes(mesh, request).notes, Contains(HasSubstr("The colours of 2 faces differ")));  // given pairs decide
  request.pairs.clear();
  request.after = painted(after, "right", {{{3.6, 1, 0.5}, red}});
  EXPECT_THAT(carry_nodes(mesh, request).notes, Contains(HasSubstr("; the colours of 1 face agree.")));
  // Colours that are not as often among bores are said and not used.
  request.after = painted(after, "side", {{{0, 1, 0.5}, red}});
  EXPECT_THAT(carry_nodes(mesh, request).notes,
              Contains(HasSubstr("The colours of 2 faces differ from those of their partners and are not used")));
  request.after = painted(after, "both", {{{3.6, 1, 0.5}, red}, {{7.5, 1, 0.5}, red}});
  EXPECT_THAT(carry_nodes(mesh, request).notes, Contains(HasSubstr("differs from that of its partner, face ")));
  request.after = painted(after, "red", {{{3.6, 1, 0.5}, red}, {{7.5, 1, 0.5}, red}});  // as both are in the old model now
  request.before = painted(before, "red_before", {{{3.4, 1, 0.5}, red}, {{7.4, 1, 0.5}, red}});
  EXPECT_THAT(carry_nodes(mesh, request).notes, Not(Contains(HasSubstr("colours"))));
  request.before = painted(before, "again", {{{3.4, 1, 0.5}, red}});
  request.after = painted(after, "blue", {{{3.6, 1, 0.5}, blue}});  // painted anew
  EXPECT_THAT(carry_nodes(mesh, request).notes, Not(Contains(HasSubstr("colours"))));
}

TEST_F(CadMarks, OnlyOneWayOverrulesColoursAndNames) {
  const TopoDS_Shape before = bored({4, 3, 2}, {1.5, 1.2, 0}, 0.5), after = bored({4, 3, 2}, {2.1, 1.5, 0}, 0.8);
  const Mesh mesh = mesh_of(before, 0.2);
  MoveRequest request;
  const int bore = face_at(before, {2, 1.2, 1}), side = face_at(after, {4, 1, 1});
  request.before = step(before, "before", {{bore, "inlet", red}});
  request.after = step(after, "after", {{side, "inlet", red}});
  const auto expect_on_bore = [&](const CarriedNodes& carried) {
    for (const FaceOutcome& face : carried.faces) {
      if (face.before == bore + 1) {
        EXPECT_EQ(face.type, "cylinder");
      }
      if (face.before == bore + 1) {
        EXPECT_EQ(face.after, face_at(after, {2.9, 1.5, 1}) + 1);
      }
    }
  };
  CarriedNodes carried = carry_nodes(mesh, request);
  expect_on_bore(carried);
  EXPECT_THAT(carried.notes, Contains(HasSubstr("The names of faces in the files contradict the structure of the models")));
  EXPECT_THAT(carried.notes, Contains(HasSubstr("The colours of 2 faces differ from those of their partners and are not used")));
}

TEST_F(CadMarks, NoChoiceIsSpokenOfWhereLoopsLeaveNone) {
  // Its mirror image is as like, with the left side for the right one, but for the way the loops run.
  const auto part = [](double size) {
    const TopoDS_Shape bored_block = without(block({0, 0, 0}, {4, 3, size}), rod({2, 1.5, size}, {0, 0, -1}, 0.5, 1));
    return joined(bored_block, rod({2, 0, 1}, {0, -1, 0}, 0.5, 1));
  };
  const TopoDS_Shape before = part(2);
  MoveRequest request;
  request.before = painted(before, "before", {{{0, 1, 1}, red}});
  request.after = painted(part(2.5), "after", {{{0, 1, 1}, red}});
  EXPECT_THAT(carry_nodes(mesh_of(before, 0.2), request).notes, testing::Each(HasSubstr("is in metre.")));
  request.after = painted(part(2.5), "wrong", {{{4, 1, 1}, red}});
  EXPECT_THAT(carry_nodes(mesh_of(before, 0.2), request).notes, Contains(HasSubstr("The colours of 2 faces differ")));
}

TEST_F(CadMarks, NamesAndColoursTellTogetherWhatNeitherDoes) {
  // Which side is the front by a name, and which of the two others is the top by a colour.
  const TopoDS_Shape cube = block({0, 0, 0}, {1, 1, 1}), after = turned(cube, {0.5, 0.5, 0}, {0, 0, 1}, 45);
  const Mesh mesh = mesh_of(cube, 0.1);
  const double s = std::sqrt(0.125);
  const auto request_of = [&](bool named, bool coloured) {
    const auto marks = [&](const TopoDS_Shape& shape, const Vec3& front) {
      std::vector<FaceMark> listed;
      if (named) listed.push_back({face_at(shape, front), "front", std::nullopt});
      if (coloured) listed.push_back({face_at(shape, {0.5, 0.5, 1}), "", blue});
      return listed;
    };
    MoveRequest request;
    request.before = step(cube, "before", marks(cube, {0.5, 0, 0.5}));
    request.after = step(after, "after", marks(after, {0.5 + s, 0.5 - s, 0.5}));
    return request;
  };
  EXPECT_THAT(refusal(mesh, request_of(false, true)), HasSubstr("ambiguous"));
  const CarriedNodes carried = carry_nodes(mesh, request_of(true, true));
  EXPECT_LT(off_turn(mesh, carried, {0.5, 0.5, 0}, 45), 1e-9);
  EXPECT_THAT(carried.notes, Contains(HasSubstr("1 name of faces and the colours of 1 agree")));
}

TEST_F(CadMarks, NamesAndColoursDecideWherePlacesContradictEachOther) {
  const TopoDS_Shape before = row_of_bores(1), after = row_of_bores(3);  // by one pitch
  const Mesh mesh = mesh_of(before, 0.2, 0);
  const auto request_of = [&](const std::vector<double>& order, bool named, bool coloured) {
    const std::array<std::string, 4> names{"a", "b", "c", "d"};
    const auto marks = [&](const TopoDS_Shape& shape, double first, const std::vector<double>& places) {
      std::vector<FaceMark> listed;
      for (std::size_t i = 0; i < places.size(); ++i) {
        const auto colour =
            coloured ? std::optional<Quantity_ColorRGBA>(Quantity_Color(0.2 * i, 0, 0, Quantity_TOC_sRGB)) : std::nullopt;
        listed.push_back({face_at(shape, {first + 2 * places[i], 0.6, 0.2}), named ? names[i] : "", colour});
      }
      return listed;
    };
    MoveRequest request;
    request.before = step(before, "before", marks(before, 1, {0, 1, 2, 3}));
    request.after = step(after, "after", marks(after, 3, order));
    return request;
  };
  for (const bool named : {true, false}) {
    const CarriedNodes moved = carry_nodes(mesh, request_of({0, 1, 2, 3}, named, !named));
    const CarriedNodes stayed = carry_nodes(mesh, request_of({3, 0, 1, 2}, named, !named));
    std::size_t nodes = 0;
    for (std::size_t i = 0; i < moved.nodes.size(); ++i) {
      const Vec3& p = mesh.points[moved.nodes[i]];
      for (int bore = 0; bore < 4; ++bore) {
        if (std::abs(std::hypot(p[0] - 1 - 2 * bore, p[1] - 1) - 0.4) > 1e-9) continue;
        ++nodes;
        EXPECT_LT(distance(moved.places[i], {p[0] + 2, p[1], p[2]}), 1e-6);
        EXPECT_LT(distance(stayed.places[i], {p[0] + (bore == 0 ? 8 : 0), p[1], p[2]}), 1e-6);
      }
    }
    EXPECT_GT(nodes, 30u);
  }
}

TEST_F(CadMarks, PartsAndTheirPlacesHaveColours) {
  // Two equal bricks, which were set on another axis: which is which is said by the colours of the parts.
  const TopoDS_Shape brick = without(block({-0.5, -0.5, 0}, {1, 1, 1}), rod({0, 0, 1}, {0, 0, -1}, 0.2, 0.3));
  const auto bricks = [&](const Vec3& way, const std::string& name, const Quantity_ColorRGBA& one,
                          const Quantity_ColorRGBA& other) {
    return step({Part{shifted(brick, way), "brick", one, {}, {}}, Part{shifted(brick, Vec3{} - way), "brick", other, {}, {}}},
                name);
  };
  const Mesh mesh = mesh_of(together({shifted(brick, {3, 0, 0}), shifted(brick, {-3, 0, 0})}), 0.2);
  MoveRequest request;
  request.before = bricks({3, 0, 0}, "before", red, blue);
  request.after = bricks({0, 3, 0}, "same", red, red);
  EXPECT_THAT(refusal(mesh, request), HasSubstr("ambiguous"));
  for (const double way : {3.0, -3.0}) {
    request.after = bricks({0, way, 0}, "after", red, blue);
    const CarriedNodes carried = carry_nodes(mesh, request);
    EXPECT_LT(off_turn(mesh, carried, {0, 0, 0}, way > 0 ? 90 : -90), 1e-6);
  }
}

TEST_F(CadMarks, MergedFacesKeepTheColourOfTheirParts) {
  // A cube in halves that becomes a whole one, turned by 45 degrees.
  const TopoDS_Shape before = joined(block({0, 0, 0}, {0.4, 1, 1}), block({0.4, 0, 0}, {0.6, 1, 1}));
  const TopoDS_Shape cube = block({0, 0, 0}, {1, 1, 1}), after = turned(cube, {0.5, 0.5, 0}, {0, 0, 1}, -45);
  ASSERT_EQ(faces_of(before).size(), 10u);
  const Mesh mesh = mesh_of(before, 0.1);
  const double s = std::sqrt(0.125);
  MoveRequest request;
  request.after = painted(after, "after", {{{0.5 - s, 0.5 - s, 0.5}, red}, {{0.5, 0.5, 1}, blue}});
  request.before =
      painted(before, "before", {{{0.2, 0, 0.5}, red}, {{0.7, 0, 0.5}, red}, {{0.2, 0.5, 1}, blue}, {{0.7, 0.5, 1}, blue}});
  EXPECT_LT(off_turn(mesh, carry_nodes(mesh, request), {0.5, 0.5, 0}, -45), 1e-9);
  request.before = painted(before, "half", {{{0.2, 0, 0.5}, red}, {{0.2, 0.5, 1}, blue}, {{0.7, 0.5, 1}, blue}});
  EXPECT_THAT(refusal(mesh, request), HasSubstr("ambiguous"));
}

TEST_F(CadMarks, NamesOfFacesTellWhatPlacesDoNot) {
  const TopoDS_Shape cube = block({0, 0, 0}, {1, 1, 1});
  const TopoDS_Shape after = turned(cube, {0.5, 0.5, 0}, {0, 0, 1}, 45);
  const auto marked = [&](const TopoDS_Shape& shape, const Vec3& front, const Vec3& top, const std::string& name) {
    return step(shape, name, {{face_at(shape, front), "front", std::nullopt}, {face_at(shape, top), "top", std::nullopt}},
                "metre");
  };
  const double s = std::sqrt(0.125);
  MoveRequest request;
  request.before = marked(cube, {0.5, 0, 0.5}, {0.5, 0.5, 1}, "before");
  request.after = marked(after, {0.5 - s, 0.5 - s, 0.5}, {0.5, 0.5, 1}, "after");  // turned by -45 degrees
  const CarriedNodes carried = carry_nodes(mesh_of(cube, 0.1), request);
  const Mesh mesh = mesh_of(cube, 0.1);
  for (std::size_t i = 0; i < carried.nodes.size(); ++i) {
    const Vec3& p = mesh.points[carried.nodes[i]];
    const double x = (p[0] - 0.5) * std::sqrt(0.5), y = (p[1] - 0.5) * std::sqrt(0.5);
    EXPECT_LT(distance(carried.places[i], {0.5 + x + y, 0.5 - x + y, p[2]}), 1e-9);
  }
  EXPECT_THAT(carried.notes, testing::Contains(HasSubstr("2 names of faces agree")));
}

TEST_F(CadMarks, NamesThatContradictPlacesAreRefused) {
  const auto plate = [](double first, double second) {
    return without(bored({10, 2, 1}, {first, 1, 0}, 0.4), rod({second, 1, -1}, {0, 0, 1}, 0.4, 3));
  };
  const TopoDS_Shape before = plate(3, 7), after = plate(3.2, 7.1);
  const auto marked = [&](const TopoDS_Shape& shape, const Vec3& oil, const std::string& name) {
    return step(shape, name, {{face_at(shape, oil), "oil", std::nullopt}}, "metre");
  };
  MoveRequest request;
  request.before = marked(before, {3.4, 1, 0.5}, "before");
  request.after = marked(after, {7.5, 1, 0.5}, "after");
  const Mesh mesh = mesh_of(before, 0.2);
  try {
    carry_nodes(mesh, request);
    ADD_FAILURE() << "it was solved";
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), HasSubstr("by the names of faces in the files"));
  }
  request.pairs = {{ForcedPair::Kind::face, face_at(before, {3.4, 1, 0.5}) + 1, face_at(after, {7.5, 1, 0.5}) + 1}};
  EXPECT_NO_THROW(carry_nodes(mesh, request));  // given pairs decide
  request.pairs.clear();
  request.after = marked(after, {3.6, 1, 0.5}, "after");
  EXPECT_NO_THROW(carry_nodes(mesh, request));
  // A name that structure forbids is said and not used.
  request.after = step(after, "after", {{face_at(after, {0, 1, 0.5}), "oil", std::nullopt}}, "metre");
  EXPECT_THAT(carry_nodes(mesh, request).notes, testing::Contains(HasSubstr("contradict the structure")));
}

}  // namespace
}  // namespace deform::cad::cad_marks_test
