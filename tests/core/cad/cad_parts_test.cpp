// SPDX-License-Identifier: GPL-3.0-or-later
// Parts of core/cad by themselves: what read_document() finds in a STEP file, models with merged faces, regions of faces, faces
// that cross, surfaces that fit places, nodes that slide, marks of faces, and what is said of shapes that are not valid.
#include <gmock/gmock-more-matchers.h>
#include <gtest/gtest.h>

#include <BRepAlgoAPI_Cut.hxx>
#include <BRepAlgoAPI_Fuse.hxx>
#include <BRepBuilderAPI_MakeFace.hxx>
#include <BRepBuilderAPI_MakePolygon.hxx>
#include <BRepGProp.hxx>
#include <BRepPrimAPI_MakeBox.hxx>
#include <BRepPrimAPI_MakeCylinder.hxx>
#include <BRepTools.hxx>
#include <BRepTopAdaptor_FClass2d.hxx>
#include <BRep_Builder.hxx>
#include <GProp_GProps.hxx>
#include <Geom2d_Line.hxx>
#include <Geom_ConicalSurface.hxx>
#include <Geom_CylindricalSurface.hxx>
#include <Geom_Plane.hxx>
#include <Geom_SphericalSurface.hxx>
#include <Interface_Static.hxx>
#include <Message.hxx>
#include <Message_Messenger.hxx>
#include <Message_Printer.hxx>
#include <STEPCAFControl_Controller.hxx>
#include <STEPCAFControl_Writer.hxx>
#include <STEPControl_Writer.hxx>
#include <TDataStd_Name.hxx>
#include <TDocStd_Document.hxx>
#include <TopExp.hxx>
#include <TopExp_Explorer.hxx>
#include <TopTools_IndexedMapOfShape.hxx>
#include <TopoDS.hxx>
#include <TopoDS_Compound.hxx>
#include <TopoDS_Wire.hxx>
#include <XCAFApp_Application.hxx>
#include <XCAFDoc_ColorTool.hxx>
#include <XCAFDoc_DocumentTool.hxx>
#include <XCAFDoc_ShapeTool.hxx>
#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <gp_Pln.hxx>
#include <map>
#include <memory>
#include <optional>
#include <random>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/base/vectors.h"
#include "core/cad/analytic_fit.h"
#include "core/cad/boundary_triangles.h"
#include "core/cad/crossing_faces.h"
#include "core/cad/deformed_shape.h"
#include "core/cad/document.h"
#include "core/cad/face_marks.h"
#include "core/cad/face_mending.h"
#include "core/cad/face_region.h"
#include "core/cad/model.h"
#include "core/cad/spline_axis.h"
#include "core/cad/thin_plate.h"
#include "core/mesh/elements.h"
#include "core/mesh/mesh.h"

namespace deform::cad::cad_parts_test {
namespace {

using testing::HasSubstr;

TopoDS_Compound together(const TopoDS_Shape& a, const TopoDS_Shape& b) {
  TopoDS_Compound both;
  const BRep_Builder builder;
  builder.MakeCompound(both);
  builder.Add(both, a);
  builder.Add(both, b);
  return both;
}

TopTools_IndexedMapOfShape faces_of(const TopoDS_Shape& shape) {
  TopTools_IndexedMapOfShape faces;
  TopExp::MapShapes(shape, TopAbs_FACE, faces);
  return faces;
}

TEST(CadDocument, FacesHaveTheColourOfTheirSolidOrTheirOwn) {
  Handle(TDocStd_Document) document;
  XCAFApp_Application::GetApplication()->NewDocument("MDTV-XCAF", document);
  const auto shapes = XCAFDoc_DocumentTool::ShapeTool(document->Main());
  const auto colours = XCAFDoc_DocumentTool::ColorTool(document->Main());
  // One part of two solids, of which the second has a colour.
  const TopoDS_Shape both = together(BRepPrimAPI_MakeBox(1, 1, 1).Shape(), BRepPrimAPI_MakeBox(gp_Pnt(3, 0, 0), 1, 1, 1).Shape());
  const TDF_Label part = shapes->AddShape(both, false);
  const TopoDS_Shape shape = XCAFDoc_ShapeTool::GetShape(part);
  TopExp_Explorer solids(shape, TopAbs_SOLID);
  solids.Next();
  const TopoDS_Shape second = solids.Current();
  const TDF_Label named = shapes->AddSubShape(part, faces_of(second)(2));
  TDataStd_Name::Set(named, "inlet");
  TDataStd_Name::Set(shapes->AddSubShape(part, second), "lid");
  const auto paint = [&](const TopoDS_Shape& sub, double red, double green, double blue) {
    colours->SetColor(shapes->AddSubShape(part, sub), Quantity_Color(red, green, blue, Quantity_TOC_RGB), XCAFDoc_ColorSurf);
  };
  paint(faces_of(second)(4), 0, 0, 1);  // before the solid
  paint(second, 1, 0, 0);
  paint(faces_of(second)(5), 0, 1, 0);  // after it
  const auto path = std::filesystem::temp_directory_path() / "deform_parts_colours.step";
  STEPCAFControl_Controller::Init();
  Model millimetres;
  keep_unit("millimetre", millimetres);
  STEPCAFControl_Writer writer;
  Interface_Static::SetIVal("write.stepcaf.subshapes.name", 1);
  writer.SetNameMode(true);
  writer.SetColorMode(true);
  ASSERT_TRUE(writer.Transfer(document, STEPControl_AsIs));
  writer.Write(path.c_str());

  const auto expect_marks = [](const std::filesystem::path& file) {
    const Document read = read_document(file);
    ASSERT_EQ(read.parts.size(), 1u);
    EXPECT_EQ(read.parts[0].solid_names, (std::vector<std::string>{"", "lid"}));
    std::map<int, FaceMark> marks;
    for (const FaceMark& mark : read.parts[0].faces) EXPECT_TRUE(marks.emplace(mark.face, mark).second) << "one for each face";
    for (int f = 0; f < 6; ++f) EXPECT_EQ(marks.count(f), 0u) << f;
    for (int f = 6; f < 12; ++f) {
      ASSERT_EQ(marks.count(f), 1u) << f;
      EXPECT_EQ(marks[f].name, f == 7 ? "inlet" : "");
      ASSERT_TRUE(marks[f].colour) << f;
      const Quantity_Color& colour = marks[f].colour->GetRGB();
      EXPECT_NEAR(colour.Red(), f == 9 || f == 10 ? 0 : 1, 0.01) << f;
      EXPECT_NEAR(colour.Blue(), f == 9 ? 1 : 0, 0.01) << f;
      EXPECT_NEAR(colour.Green(), f == 10 ? 1 : 0, 0.01) << f;
    }
  };
  expect_marks(path);
  const auto again = std::filesystem::temp_directory_path() / "deform_parts_colours_again.step";
  write_document(read_document(path), again);
  expect_marks(again);
  std::filesystem::remove(path);
  std::filesystem::remove(again);
}

/// Two places of a box, red here and blue there, but for a green face of each.
void expect_colours(const Model& model) {
  ASSERT_EQ(model.face_count(), 12);
  ASSERT_EQ(model.face_colours.size(), 12u);
  std::map<std::array<int, 2>, int> counts;  // by place and channel
  for (int f = 0; f < 12; ++f) {
    ASSERT_TRUE(model.face_colours[f]) << f;
    const FaceColour& colour = *model.face_colours[f];
    GProp_GProps properties;
    BRepGProp::SurfaceProperties(model.face(f), properties);
    const int channel = static_cast<int>(std::max_element(colour.begin(), colour.begin() + 3) - colour.begin());
    ++counts[{properties.CentreOfMass().X() > 3 ? 1 : 0, channel}];
    EXPECT_NEAR(colour[0] + colour[1] + colour[2], 1, 1e-6);
    EXPECT_NEAR(colour[channel], 1, 1e-6);
    EXPECT_EQ(colour[3], 1);
  }
  EXPECT_EQ(counts, (std::map<std::array<int, 2>, int>{{{0, 0}, 5}, {{0, 1}, 1}, {{1, 1}, 1}, {{1, 2}, 5}}));
}

TEST(CadModel, PlacesOfOnePartHaveColoursOfTheirOwn) {
  Handle(TDocStd_Document) document;
  XCAFApp_Application::GetApplication()->NewDocument("MDTV-XCAF", document);
  const auto shapes = XCAFDoc_DocumentTool::ShapeTool(document->Main());
  const auto colours = XCAFDoc_DocumentTool::ColorTool(document->Main());
  const TDF_Label assembly = shapes->NewShape();
  const TDF_Label part = shapes->AddShape(BRepPrimAPI_MakeBox(1, 1, 1).Shape(), false);
  const auto paint = [&](const TDF_Label& label, double red, double green, double blue) {
    colours->SetColor(label, Quantity_Color(red, green, blue, Quantity_TOC_sRGB), XCAFDoc_ColorSurf);
  };
  paint(shapes->AddSubShape(part, faces_of(XCAFDoc_ShapeTool::GetShape(part))(3)), 0, 1, 0);
  gp_Trsf away;
  away.SetTranslation(gp_Vec(5, 0, 0));
  paint(part, 1, 1, 0);  // which its places override
  TDataStd_Name::Set(part, "wheel");
  const std::array<TDF_Label, 2> places{shapes->AddComponent(assembly, part, TopLoc_Location()),
                                        shapes->AddComponent(assembly, part, TopLoc_Location(away))};
  paint(places[0], 1, 0, 0);
  paint(places[1], 0, 0, 1);
  TDataStd_Name::Set(places[0], "front wheel");
  TDataStd_Name::Set(places[1], "rear wheel");
  shapes->UpdateAssemblies();
  STEPCAFControl_Controller::Init();
  Interface_Static::SetCVal("xstep.cascade.unit", "MM");
  Interface_Static::SetCVal("write.step.unit", "MM");
  STEPCAFControl_Writer writer;
  writer.SetColorMode(true);
  ASSERT_TRUE(writer.Transfer(document, STEPControl_AsIs));
  const auto path = std::filesystem::temp_directory_path() / "deform_parts_places.step";
  writer.Write(path.c_str());
  const auto again = std::filesystem::temp_directory_path() / "deform_parts_places_again.step";
  for (const bool rewritten : {false, true}) {
    const Document read = read_document(rewritten ? again : path);
    ASSERT_EQ(read.parts.size(), 2u);
    for (int i = 0; i < 2; ++i) {
      EXPECT_EQ(read.parts[i].name, "wheel");
      EXPECT_EQ(read.parts[i].place, i == 0 ? "front wheel" : "rear wheel");
    }
    expect_colours(read_model(rewritten ? again : path, 1));
    if (!rewritten) write_document(read, again);
  }
  std::filesystem::remove(path);
  std::filesystem::remove(again);
}

TEST(CadModel, MergedFacesStayInTheUnitOfTheFile) {
  const TopoDS_Shape halves =
      BRepAlgoAPI_Fuse(BRepPrimAPI_MakeBox(1, 2, 3).Shape(), BRepPrimAPI_MakeBox(gp_Pnt(1, 0, 0), 1, 2, 3).Shape()).Shape();
  Model model = make_model(halves, "halves.step");
  keep_unit("INCH", model);
  const Model merged = unified(model);
  EXPECT_EQ(merged.face_count(), 6);
  EXPECT_EQ(merged.edge_count(), 12);
  EXPECT_EQ(merged.unit, 0.0254);
  EXPECT_EQ(merged.name, "halves.step");
  EXPECT_THAT(merged.notes,
              testing::ElementsAre(HasSubstr("is in inch."), HasSubstr("10 faces and 20 edges were merged to 6 and 12")));
}

TEST(CadModel, WhatIsNotValidIsHealedAndSaidToBe) {
  const std::filesystem::path path = std::filesystem::temp_directory_path() / "deform_parts_WhatIsNotValid.brep";
  const auto sheet = [](const std::array<gp_Pnt, 4>& rim) {
    const TopoDS_Wire wire = BRepBuilderAPI_MakePolygon(rim[0], rim[1], rim[2], rim[3], true).Wire();
    return BRepBuilderAPI_MakeFace(gp_Pln(gp::Origin(), gp::DZ()), wire, true).Face();
  };
  const auto square = [&](double low, double high) {
    return sheet({gp_Pnt(low, low, 0), gp_Pnt(high, low, 0), gp_Pnt(high, high, 0), gp_Pnt(low, high, 0)});
  };
  // A hole that runs round as the rim does.
  TopoDS_Face turned = square(0, 3);
  BRep_Builder().Add(turned, TopExp_Explorer(square(1, 2), TopAbs_WIRE).Current());
  TopoDS_Edge bare;  // without a curve
  BRep_Builder().MakeEdge(bare);
  const auto notes = [&](const TopoDS_Shape& shape) {
    BRepTools::Write(shape, path.c_str());
    std::string all;
    for (const std::string& note : read_model(path, 1).notes) all += note + "\n";
    return all;
  };
  EXPECT_THAT(notes(square(0, 3)), testing::Not(HasSubstr("not valid")));
  EXPECT_THAT(notes(turned), HasSubstr(path.string() + " is not valid; it was healed."));
  EXPECT_THAT(notes(together(square(0, 3), bare)), HasSubstr(path.string() + " is not valid; healing did not mend all of it."));
  std::filesystem::remove(path);
}

/// Counts what the libraries have to say.
class Listener : public Message_Printer {
 public:
  int heard() const { return heard_; }

 protected:
  void send(const TCollection_AsciiString&, const Message_Gravity) const override { ++heard_; }

 private:
  mutable int heard_ = 0;
};

TEST(CadModel, ReadingSaysNothingOfItsOwn) {
  const std::filesystem::path path = std::filesystem::temp_directory_path() / "deform_parts_ReadingSaysNothing.step";
  for (const bool is_damaged : {false, true}) {
    SCOPED_TRACE(is_damaged);
    STEPControl_Writer writer;
    writer.Transfer(BRepPrimAPI_MakeBox(1, 2, 3).Shape(), STEPControl_AsIs);
    writer.Write(path.c_str());
    if (is_damaged) std::filesystem::resize_file(path, std::filesystem::file_size(path) / 2);
    for (int way = 0; way < 2; ++way) {
      const Handle(Listener) listener = new Listener;
      Message::DefaultMessenger()->AddPrinter(listener);
      testing::internal::CaptureStdout();
      testing::internal::CaptureStderr();
      const auto read = [&] { way == 0 ? (void)read_model(path, 1) : (void)read_document(path); };
      if (is_damaged) {
        EXPECT_THROW(read(), Error);
      } else {
        EXPECT_NO_THROW(read());
      }
      EXPECT_EQ(testing::internal::GetCapturedStdout(), "");
      EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
      EXPECT_EQ(listener->heard(), 0);
    }
  }
  std::filesystem::remove(path);
}

TEST(CrossingFaces, AreThoseThatGoThroughEachOther) {
  // A slanted face, in whose box there are a block below it and one above; a third goes through it.
  BRepBuilderAPI_MakePolygon border;
  for (const gp_Pnt& p : {gp_Pnt(0, 0, 1), gp_Pnt(1, 0, 0), gp_Pnt(1, 1, 0), gp_Pnt(0, 1, 1)}) border.Add(p);
  border.Close();
  const TopoDS_Shape slanted = BRepBuilderAPI_MakeFace(border.Wire()).Shape();
  const auto block = [](double x, double y, double z) { return BRepPrimAPI_MakeBox(gp_Pnt(x, y, z), 0.2, 0.2, 0.2).Shape(); };
  const auto crossings = [&](const TopoDS_Shape& other) {
    return crossing_faces(make_model(together(slanted, other), "slanted"), 1e-3, {});
  };
  for (const double x : {-0.1, 0.9}) {
    for (const double y : {-0.1, 0.4, 0.9}) {
      EXPECT_THAT(crossings(block(x, y, x)), testing::IsEmpty()) << x << " " << y;
    }
  }
  const std::set<std::array<int, 2>> found = crossings(block(0.35, 0.4, 0.42));
  EXPECT_EQ(found.size(), 4u) << "the sides of the block that the plane goes through";
  for (const std::array<int, 2>& pair : found) EXPECT_EQ(pair[0], 0);
  EXPECT_THAT(crossings(block(0.3, 0.4, 0.7)), testing::IsEmpty()) << "it stands on it with an edge";
}

/// A place on a surface over a patch of it, share of each range.
Eigen::Vector3d on(const Geom_Surface& surface, const std::array<double, 4>& patch, double u, double v) {
  const gp_Pnt p = surface.Value(patch[0] + u * (patch[1] - patch[0]), patch[2] + v * (patch[3] - patch[2]));
  return {p.X(), p.Y(), p.Z()};
}

struct Fitted {
  std::string name;
  Handle(Geom_ElementarySurface) rest, target;
  std::array<double, 4> patch;  ///< of both
};

TEST(AnalyticFit, FindsTheSurfaceWithOtherDimensionsAndInAnotherPlace) {
  const gp_Ax3 here(gp_Pnt(1, 2, 3), gp_Dir(1, 2, 2), gp_Dir(2, -2, 1)),
      there(gp_Pnt(-2, 0, 5), gp_Dir(2, 1, 2), gp_Dir(1, 2, -2));
  std::vector<Fitted> cases{{"plane", new Geom_Plane(here), new Geom_Plane(there), {-1, 2, 0, 1}}};
  // Patches all around, whose middles lie in other directions from the centre.
  for (const double u : {0.0, 1.5, 3.0, 4.5}) {
    cases.push_back(
        {"cylinder", new Geom_CylindricalSurface(here, 1), new Geom_CylindricalSurface(there, 1.3), {u, u + 1, 0, 2}});
    cases.push_back({"cone", new Geom_ConicalSurface(here, 0.3, 1), new Geom_ConicalSurface(there, 0.4, 1.2), {u, u + 1, 0, 2}});
    for (const double v : {-1.4, -0.4, 0.6}) {
      cases.push_back(
          {"sphere", new Geom_SphericalSurface(here, 1), new Geom_SphericalSurface(there, 1.2), {u, u + 0.8, v, v + 0.8}});
    }
  }
  for (const Fitted& one : cases) {
    SCOPED_TRACE(one.name + " " + std::to_string(one.patch[0]) + " " + std::to_string(one.patch[2]));
    Eigen::Matrix3Xd before(3, 49), after(3, 49);
    for (int i = 0; i < 49; ++i) {
      before.col(i) = on(*one.rest, one.patch, i % 7 / 6.0, i / 7 / 6.0);
      after.col(i) = on(*one.target, one.patch, i % 7 / 6.0, i / 7 / 6.0);
    }
    const AnalyticFit fit = analytic_fit(one.rest, before, after);
    ASSERT_FALSE(fit.surface.IsNull());
    EXPECT_LT(fit.largest, 1e-9);
    EXPECT_EQ(fit.surface->DynamicType(), one.target->DynamicType());
    for (int i = 0; i < 49; ++i) {
      EXPECT_LT(analytic_distance(*fit.surface, {after(0, i), after(1, i), after(2, i)}), 1e-9);
    }
    // Beyond the patch, too.
    const Eigen::Vector3d beyond = on(*one.target, one.patch, 1.3, 1.2);
    EXPECT_LT(analytic_distance(*fit.surface, {beyond[0], beyond[1], beyond[2]}), 1e-8);
  }
}

TEST(AnalyticFit, TellsHowFarPlacesAreFromIt) {
  const Handle(Geom_Surface) plane = new Geom_Plane(gp_Pln(gp::Origin(), gp::DZ()));
  Eigen::Matrix3Xd before(3, 25), after(3, 25);
  for (int i = 0; i < 25; ++i) {
    before.col(i) = Eigen::Vector3d(i % 5, i / 5, 0);
    after.col(i) = Eigen::Vector3d(i % 5, i / 5, 3 + (i % 2 == 0 ? 0.01 : -0.01));  // 13 over and 12 below
  }
  EXPECT_NEAR(analytic_fit(plane, before, after).largest, 0.01 * (1 + 1.0 / 25), 1e-6);
  EXPECT_TRUE(analytic_fit(plane, before.leftCols(2), after.leftCols(2)).surface.IsNull()) << "takes three";
}

TEST(CadFaults, AllShapesAreLookedAt) {
  EXPECT_EQ(faults_of(BRepPrimAPI_MakeBox(1, 2, 3).Shape()), "");
  // A sheet whose rim crosses itself, after a sound one and before it.
  const auto sheet = [](const std::array<gp_Pnt, 4>& p) -> TopoDS_Shape {
    const TopoDS_Wire wire = BRepBuilderAPI_MakePolygon(p[0], p[1], p[2], p[3], true).Wire();
    return BRepBuilderAPI_MakeFace(gp_Pln(gp::Origin(), gp::DZ()), wire, true).Shape();
  };
  const TopoDS_Shape sound = sheet({gp_Pnt(0, 0, 0), gp_Pnt(1, 0, 0), gp_Pnt(1, 1, 0), gp_Pnt(0, 1, 0)});
  const TopoDS_Shape crossed = sheet({gp_Pnt(3, 0, 0), gp_Pnt(4, 1, 0), gp_Pnt(4, 0, 0), gp_Pnt(3, 1, 0)});
  EXPECT_THAT(faults_of(together(sound, crossed)), HasSubstr("loop 2 on face 2: "));
  EXPECT_THAT(faults_of(together(crossed, sound)), HasSubstr("loop 1 on face 1: "));
  // Edges without a curve are wrong by themselves, and the first few are named.
  const auto bare = [](int edges) {
    const BRep_Builder builder;
    TopoDS_Compound all;
    builder.MakeCompound(all);
    for (int k = 0; k < edges; ++k) {
      TopoDS_Edge edge;
      builder.MakeEdge(edge);
      builder.Add(all, edge);
    }
    return together(BRepPrimAPI_MakeBox(1, 2, 3).Shape(), all);
  };
  const std::string first = "edge 13: BRepCheck_No3DCurve; edge 13: BRepCheck_CheckFail";
  const std::string second = "; edge 14: BRepCheck_No3DCurve; edge 14: BRepCheck_CheckFail";
  EXPECT_EQ(faults_of(bare(1)), first);
  EXPECT_EQ(faults_of(bare(2)), first + second);
  EXPECT_EQ(faults_of(bare(3)), first + second + "; and 2 more");
}

TEST(ThinPlate, InterpolatesReproducesPlanesAndHasItsGradient) {
  std::mt19937 engine(3);
  std::uniform_real_distribution<double> share(-1, 1);
  std::vector<Eigen::Vector2d> centres;
  Eigen::MatrixXd values(25, 3);
  for (int i = 0; i < 25; ++i) {
    centres.emplace_back(share(engine), share(engine));
    values.row(i) << share(engine), std::sin(3 * centres[i].x()), 2 - centres[i].x() + 4 * centres[i].y();
  }
  const ThinPlate plate(centres, values);
  for (int i = 0; i < 25; ++i) EXPECT_LT((plate(centres[i]) - values.row(i)).norm(), 1e-11);
  for (int i = 0; i < 10; ++i) {
    const Eigen::Vector2d x(share(engine), share(engine));
    EXPECT_NEAR(plate(x)[2], 2 - x.x() + 4 * x.y(), 1e-11);
    for (int k = 0; k < 2; ++k) {
      const Eigen::Vector2d step = 1e-5 * Eigen::Vector2d::Unit(k);
      const Eigen::RowVectorXd slope = (plate(x + step) - plate(x - step)) / 2e-5;
      EXPECT_LT((plate.gradient(x).row(k) - slope).norm(), 1e-7);
    }
  }
}

TEST(Distortion, IsThatOfTheStretches) {
  const auto stretched = [](const std::array<double, 2>& first, const std::array<double, 2>& second) {
    FacePatch patch;  // two right triangles side by side, stretched along x and y
    const auto add = [&](double x, double y) { patch.nodes.push_back({{x, y, 0}, {}, true}); };
    add(0, 0), add(first[0], 0), add(0, first[1]);
    add(0, 0), add(second[0], 0), add(0, second[1]);
    for (const int k : {0, 3}) patch.triangles.push_back({{k, k + 1, k + 2}, {Vec3{5, 5, 5}, Vec3{5, 6, 5}, Vec3{5, 5, 6}}});
    return patch;
  };
  EXPECT_NEAR(distortion(stretched({3, 3}, {3, 3})), 0, 1e-14);                                        // a similarity
  EXPECT_NEAR(distortion(stretched({4, 2}, {2, 4})), 0.25, 1e-14);                                     // s = 2
  EXPECT_NEAR(distortion(stretched({1, 1}, {2, 2})), (0.4 + 2.5) / 4 + (1.6 + 0.625) / 4 - 1, 1e-14);  // areas 1 and 4, mean 2.5
  EXPECT_TRUE(std::isinf(distortion(stretched({1, 1}, {2, 0}))));
}

/// A hexagon of equilateral triangles with two inner rings of nodes around its middle, laid onto a surface by its (u, v).
FacePatch hexagon(const Handle(Geom_Surface) & surface, const std::array<double, 2>& uv_per_length) {
  FacePatch patch;
  std::map<std::array<int, 2>, int> number;
  for (int j = -3; j <= 3; ++j) {
    for (int i = -3; i <= 3; ++i) {
      if (std::abs(i + j) > 3) continue;
      number[{i, j}] = static_cast<int>(patch.nodes.size());
      const Parameters uv{(i + 0.5 * j) * uv_per_length[0], std::sqrt(0.75) * j * uv_per_length[1]};
      const gp_Pnt p = surface->Value(uv[0], uv[1]);
      const bool inner = std::max({std::abs(i), std::abs(j), std::abs(i + j)}) < 3;
      patch.nodes.push_back({{p.X(), p.Y(), p.Z()}, uv, inner});
    }
  }
  const auto add = [&](const std::array<int, 2>& a, const std::array<int, 2>& b, const std::array<int, 2>& c) {
    if (number.count(a) == 0 || number.count(b) == 0 || number.count(c) == 0) return;
    const std::array<int, 3> nodes{number[a], number[b], number[c]};
    patch.triangles.push_back({nodes, {patch.nodes[nodes[0]].place, patch.nodes[nodes[1]].place, patch.nodes[nodes[2]].place}});
  };
  for (int j = -3; j <= 3; ++j) {
    for (int i = -3; i <= 3; ++i) {
      add({i, j}, {i + 1, j}, {i, j + 1});
      add({i - 1, j}, {i, j - 1}, {i, j});
    }
  }
  patch.box = {-10, 10, -10, 10};
  return patch;
}

void put(FacePatch::Node& node, const Handle(Geom_Surface) & surface, const Parameters& uv) {
  const gp_Pnt p = surface->Value(uv[0], uv[1]);
  node.uv = uv;
  node.place = {p.X(), p.Y(), p.Z()};
}

TEST(FaceMending, NodesSlideBackToWhereForcesAreInBalance) {
  const gp_Ax3 frame(gp_Pnt(1, 2, 3), gp_Dir(1, 2, 2), gp_Dir(2, -2, 1));
  const double radius = 5;
  const std::vector<std::pair<Handle(Geom_Surface), std::array<double, 2>>> cases{
      {Handle(Geom_Surface)(new Geom_Plane(frame)), {1, 1}},
      {Handle(Geom_Surface)(new Geom_CylindricalSurface(frame, radius)), {1 / radius, 1}}};
  for (const auto& [surface, per_length] : cases) {
    for (const double stretch : {1.0, 1.4}) {
      SCOPED_TRACE(surface->DynamicType()->Name() + std::string(", stretched by ") + std::to_string(stretch));
      // All triangles are stretched alike where the rim is, which balances the forces at each node.
      FacePatch rest = hexagon(surface, {per_length[0], stretch * per_length[1]});
      const FacePatch shapes = hexagon(surface, per_length);
      for (std::size_t t = 0; t < rest.triangles.size(); ++t) rest.triangles[t].shape = shapes.triangles[t].shape;
      ASSERT_EQ(rest.nodes.size(), 37u);
      ASSERT_EQ(rest.triangles.size(), 54u);
      EXPECT_THAT(flipped_triangles(surface, rest), testing::IsEmpty());
      FacePatch patch = rest;
      std::mt19937 engine(4);
      std::uniform_real_distribution<double> share(-1, 1);
      std::vector<std::size_t> inner;
      for (std::size_t i = 0; i < patch.nodes.size(); ++i) {
        if (!patch.nodes[i].inner) continue;
        inner.push_back(i);
        const Parameters& uv = rest.nodes[i].uv;
        put(patch.nodes[i], surface, {uv[0] + share(engine) * per_length[0], uv[1] + share(engine) * per_length[1]});
      }
      for (FacePatch::Triangle& triangle : patch.triangles) {
        for (Vec3& corner : triangle.shape) corner = 3 * corner;  // shapes count, not sizes
      }
      const std::vector<std::size_t> flipped = flipped_triangles(surface, patch);
      EXPECT_GT(flipped.size(), 5u);
      slide_inner_nodes(surface, patch, flipped, inner, 0, {});
      EXPECT_THAT(flipped_triangles(surface, patch), testing::IsEmpty());
      for (std::size_t i = 0; i < patch.nodes.size(); ++i) {
        const FacePatch::Node &now = patch.nodes[i], &before = rest.nodes[i];
        if (!now.inner) {
          EXPECT_EQ(now.place, before.place);
          EXPECT_EQ(now.uv, before.uv);
        }
        EXPECT_LT(norm(now.place - before.place), 5e-3) << i;
        const gp_Pnt p = surface->Value(now.uv[0], now.uv[1]);
        EXPECT_LT(norm(now.place - Vec3{p.X(), p.Y(), p.Z()}), 1e-14);
      }
    }
  }
}

TEST(FaceMending, OnlyTheRingsAroundTheTrianglesAndNodesSlide) {
  const Handle(Geom_Surface) plane = new Geom_Plane(gp::XOY());
  const FacePatch rest = hexagon(plane, {1, 1});
  const auto is_middle = [](const FacePatch::Node& node) { return std::hypot(node.uv[0], node.uv[1]) < 0.1; };
  const auto middle =
      static_cast<std::size_t>(std::find_if(rest.nodes.begin(), rest.nodes.end(), is_middle) - rest.nodes.begin());
  FacePatch crossed = rest;
  put(crossed.nodes[middle], plane, {1.2, 0.3});  // beyond its neighbours
  const std::vector<std::size_t> flipped = flipped_triangles(plane, crossed);
  ASSERT_FALSE(flipped.empty());
  const auto moved = [&](const std::vector<std::size_t>& triangles, const std::vector<std::size_t>& nodes, std::size_t rings,
                         const std::array<double, 4>& box) {
    FacePatch patch = crossed;
    patch.box = box;
    slide_inner_nodes(plane, patch, triangles, nodes, rings, {});
    int count = 0;
    for (std::size_t i = 0; i < patch.nodes.size(); ++i) count += patch.nodes[i].place == crossed.nodes[i].place ? 0 : 1;
    for (const FacePatch::Node& node : patch.nodes) {
      if (node.inner) EXPECT_LE(std::abs(node.uv[0]), box[1]);
    }
    return std::pair(count, norm(patch.nodes[middle].place));
  };
  const std::array<double, 4> wide{-10, 10, -10, 10};
  EXPECT_EQ(moved({}, {}, 3, wide).first, 0);
  const auto alone = moved({}, {middle}, 0, wide);
  EXPECT_EQ(alone.first, 1);
  EXPECT_LT(alone.second, 1e-3);
  EXPECT_EQ(moved({}, {middle}, 1, wide).first, 7);
  EXPECT_EQ(moved({}, {middle}, 2, wide).first, 19);
  EXPECT_EQ(moved({}, {middle}, 9, wide).first, 19) << "no other nodes are inner ones";
  std::set<int> corners;
  for (const std::size_t t : flipped) corners.insert(rest.triangles[t].nodes.begin(), rest.triangles[t].nodes.end());
  EXPECT_EQ(moved(flipped, {}, 0, wide).first, static_cast<int>(corners.size()));
  // A box that ends before the middle.
  EXPECT_NEAR(moved({}, {middle}, 0, {0.2, 10, -10, 10}).second, 0.2, 1e-3);
}

TEST(FaceMarks, OnlyNamesThatOneFaceHasTellFacesApart) {
  Model before, after;
  before.face_names = {"roof", "side", "", "side", "NONE", "door", "window"};
  after.face_names = {"", "window", "roof", "door", "NONE", "door", "side"};
  // Both models have one roof and one window; of doors and sides one of them has two.
  EXPECT_THAT(common_names(before, after), testing::UnorderedElementsAre(std::array{0, 2}, std::array{6, 1}));
  EXPECT_THAT(common_names(after, before), testing::UnorderedElementsAre(std::array{2, 0}, std::array{1, 6}));
  EXPECT_THAT(common_names(before, Model()), testing::IsEmpty());
}

TEST(FaceMarks, ColoursThatDifferByRoundingAreOne) {
  const FaceColour red{1, 0, 0, 1}, almost{1, 0.009, 0, 0.995}, pink{1, 0.011, 0, 1}, glass{1, 0, 0, 0.5};
  Model before, after;
  EXPECT_THAT(numbered_colours(before, after).first, testing::IsEmpty());
  before.face_colours = {red, std::nullopt, glass, almost};
  EXPECT_THAT(numbered_colours(before, after).first, testing::IsEmpty()) << "both need colours";
  after.face_colours = {pink, almost, std::nullopt, glass, pink};
  const auto [old, now] = numbered_colours(before, after);
  EXPECT_THAT(old, testing::ElementsAre(0, unpainted, 1, 0));
  EXPECT_THAT(now, testing::ElementsAre(2, 0, unpainted, 1, 2));
}

TEST(BoundaryTriangles, AreFansAndTheCornersOfQuadraticFaces) {
  Mesh mesh;
  mesh.points.resize(15);
  const std::vector<std::vector<PointId>> faces{{0, 1},          {2, 1, 0},          {3, 4, 5, 6},
                                                {0, 1, 2, 3, 4}, {0, 5, 1, 6, 2, 7}, {0, 1, 2, 3, 5, 6}};
  for (const auto& face : faces) {
    mesh.face_sizes.push_back(static_cast<std::uint32_t>(face.size()));
    mesh.face_points.insert(mesh.face_points.end(), face.begin(), face.end());
  }
  using Triangle = std::array<PointId, 3>;
  const std::vector<Triangle> fans{{2, 1, 0}, {3, 4, 5}, {3, 5, 6}, {0, 1, 2}, {0, 2, 3}, {0, 3, 4}};
  std::vector<Triangle> linear = fans;
  for (const Triangle& one : {Triangle{0, 5, 1}, Triangle{0, 1, 6}, Triangle{0, 6, 2}, Triangle{0, 2, 7}}) linear.push_back(one);
  for (const Triangle& one : {Triangle{0, 1, 2}, Triangle{0, 2, 3}, Triangle{0, 3, 5}, Triangle{0, 5, 6}}) linear.push_back(one);
  EXPECT_EQ(boundary_triangles(mesh), linear);
  // The same faces beside a linear tetrahedron, and on a quadratic one of which 5 to 10 are in the middle of edges.
  auto elements = std::make_shared<Elements>();
  elements->add(ElementType::tetrahedron, std::vector<PointId>{11, 12, 13, 14});
  mesh.elements = elements;
  EXPECT_EQ(boundary_triangles(mesh), linear);
  elements->add(ElementType::tetrahedron10, std::vector<PointId>{0, 1, 2, 3, 5, 6, 7, 8, 9, 10});
  std::vector<Triangle> quadratic = fans;
  for (const Triangle& one : {Triangle{7, 0, 5}, Triangle{5, 1, 6}, Triangle{6, 2, 7}, Triangle{5, 6, 7}})
    quadratic.push_back(one);
  // In the last face two nodes that are in the middle of edges follow each other.
  for (const Triangle& one : {Triangle{0, 1, 2}, Triangle{0, 2, 3}, Triangle{0, 3, 5}, Triangle{0, 5, 6}})
    quadratic.push_back(one);
  EXPECT_EQ(boundary_triangles(mesh), quadratic);
  // A quadratic quadrangle: its corners, and the middle as two triangles.
  mesh.face_sizes = {8};
  mesh.face_points = {0, 5, 1, 6, 2, 7, 3, 8};
  const std::vector<Triangle> corners{{8, 0, 5}, {5, 1, 6}, {6, 2, 7}, {7, 3, 8}, {5, 6, 7}, {5, 7, 8}};
  EXPECT_EQ(boundary_triangles(mesh), corners);
}

TEST(FaceRegion, CurvesThatMeetOnlyAlmostAreJoined) {
  // The right side of the unit square ends 0.1 before its corners.
  const Handle(Geom_Plane) plane = new Geom_Plane(gp::XOY());
  TopoDS_Face face;
  const BRep_Builder builder;
  builder.MakeFace(face, plane, 1e-7);
  TopoDS_Wire wire;
  builder.MakeWire(wire);
  const auto add = [&](const gp_Pnt2d& from, const gp_Pnt2d& to) {
    TopoDS_Edge edge;
    builder.MakeEdge(edge);
    builder.UpdateEdge(edge, new Geom2d_Line(from, gp_Dir2d(to.XY() - from.XY())), face, 0.2);
    builder.Range(edge, 0, from.Distance(to));
    builder.Add(wire, edge);
  };
  add({0, 0}, {1, 0});
  add({1, 0.1}, {1, 0.9});
  add({1, 1}, {0, 1});
  add({0, 1}, {0, 0});
  builder.Add(face, wire);
  const FaceRegion region(face);
  for (const double v : {0.05, 0.5, 0.95}) {
    EXPECT_TRUE(region.contains(0.5, v)) << v;
    EXPECT_TRUE(region.contains(0.99, v)) << v;
    EXPECT_FALSE(region.contains(1.01, v)) << v;
  }
}

TEST(FaceRegion, AgreesWithTheClassifierOfOpenCascade) {
  std::mt19937 engine(3);
  std::uniform_real_distribution<double> share(0, 1);
  const TopoDS_Shape box = BRepPrimAPI_MakeBox(gp_Pnt(-2, -1, 0), 4, 2, 4).Shape();
  const TopoDS_Shape bore = BRepPrimAPI_MakeCylinder(gp_Ax2(gp_Pnt(0, -1, 3), gp::DY()), 0.5, 2).Shape();
  const TopTools_IndexedMapOfShape faces = faces_of(BRepAlgoAPI_Cut(box, bore).Shape());
  for (int f = 1; f <= faces.Extent(); ++f) {
    const TopoDS_Face face = TopoDS::Face(faces(f).Oriented(TopAbs_FORWARD));
    const FaceRegion region(face);
    const BRepTopAdaptor_FClass2d classifier(face, 1e-9);
    const auto& bounds = region.box();
    int different = 0;
    for (int k = 0; k < 2000; ++k) {
      const double u = bounds[0] + (1.4 * share(engine) - 0.2) * (bounds[1] - bounds[0]);
      const double v = bounds[2] + (1.4 * share(engine) - 0.2) * (bounds[3] - bounds[2]);
      const bool is_outside = u < bounds[0] || u > bounds[1] || v < bounds[2] || v > bounds[3];
      const bool inside = !is_outside && classifier.Perform(gp_Pnt2d(u, v)) == TopAbs_IN;
      different += inside != region.contains(u, v) ? 1 : 0;
    }
    EXPECT_LE(different, 4) << "face " << f << ": only beside its curves";
  }
}

TEST(SplineAxis, ReproducesCubicsAndHasCornersAtItsBreaks) {
  SplineAxis axis({-1, 0.3, 2});
  ASSERT_TRUE(axis.halve({3}));
  ASSERT_TRUE(axis.halve({4}));
  ASSERT_EQ(axis.nodes().size(), 10u) << "a neighbour was halved, too";
  const int nodes = 10;
  const auto curve = [](double t) { return t < 0.3 ? t * t * t - 2 * t : 0.3 * 0.3 * 0.3 - 0.6 + 5 * (t - 0.3) * (t - 0.3); };
  Eigen::MatrixXd values(nodes, 1);
  for (int i = 0; i < nodes; ++i) values(i, 0) = curve(axis.nodes()[i]);
  std::vector<double> at;
  for (int k = 0; k <= 300; ++k) at.push_back(-1 + 0.01 * k);
  const Eigen::MatrixXd spline = axis.values(axis.poles(values), at);
  for (std::size_t k = 0; k < at.size(); ++k) EXPECT_NEAR(spline(static_cast<int>(k), 0), curve(at[k]), 1e-12) << at[k];
  int sum = 0;
  for (const int m : axis.multiplicities()) sum += m;
  EXPECT_EQ(sum, nodes + 4);
}

TEST(SplineAxis, IsHalvedWithinItsLimits) {
  SplineAxis axis({0, 1, 3});
  EXPECT_THAT(axis.nodes(), testing::ElementsAre(0, 1 / 3.0, 2 / 3.0, 1, 1 + 2 / 3.0, 1 + 4 / 3.0, 3));
  EXPECT_EQ(axis.interval_of(-1), 0);
  EXPECT_EQ(axis.interval_of(0.5), 1);
  EXPECT_EQ(axis.interval_of(1), 3) << "a node is the start of the next interval";
  EXPECT_EQ(axis.interval_of(3), 5);
  EXPECT_EQ(axis.interval_of(4), 5);
  // At the end of the first stretch, as often as it goes: intervals of it grow away from there, the other stretch stays.
  int halved = 0;
  while (axis.halve({axis.interval_of(1 - 1e-9)})) ASSERT_LT(++halved, 20);
  EXPECT_EQ(halved, 11) << "1/3 / 2^10 is the last length over 1/4000";
  const std::vector<double> nodes = axis.nodes();
  const auto joint = std::find(nodes.begin(), nodes.end(), 1.0) - nodes.begin();
  EXPECT_EQ(static_cast<int>(nodes.size()) - joint, 4);
  EXPECT_NEAR(nodes[joint] - nodes[joint - 1], 1 / 3.0 / 2048, 1e-12);
  for (int k = 1; k < joint; ++k) {
    const double ratio = (nodes[k] - nodes[k - 1]) / (nodes[k + 1] - nodes[k]);
    EXPECT_LT(ratio, 2.001);
    EXPECT_GT(ratio, 0.999);
  }
  // Up to 250 nodes, else all stay.
  std::vector<double> breaks;
  for (int k = 0; k <= 82; ++k) breaks.push_back(k);
  SplineAxis many(breaks);
  ASSERT_EQ(many.nodes().size(), 247u);
  EXPECT_FALSE(many.halve({0, 5, 10, 15}));
  EXPECT_EQ(many.nodes().size(), 247u);
  EXPECT_TRUE(many.halve({0, 5, 10}));
  EXPECT_EQ(many.nodes().size(), 250u);
}

TEST(SplineAxis, ChecksLieBetweenTheNodesAndMayBecomeThem) {
  SplineAxis axis({-0.1, 0.7, 5});
  axis.halve({0, 4});
  for (const double spacing : {10.0, 0.3, 0.05}) {
    const std::vector<double> checks = axis.checks(spacing);
    std::vector<double> all = axis.nodes();
    all.insert(all.end(), checks.begin(), checks.end());
    std::sort(all.begin(), all.end());
    EXPECT_EQ(std::adjacent_find(all.begin(), all.end()), all.end()) << "no node is one of them";
    EXPECT_TRUE(std::is_sorted(checks.begin(), checks.end()));
    if (spacing == 10) EXPECT_EQ(checks.size(), axis.nodes().size() - 1) << "the middles";
    double widest = 0;
    for (std::size_t i = 1; i < all.size(); ++i) widest = std::max(widest, all[i] - all[i - 1]);
    EXPECT_LE(widest, spacing);
    if (spacing < 1) EXPECT_GT(widest, spacing / 2) << "not many more than needed";
    SplineAxis finer = axis;
    std::set<int> each;
    for (int k = 0; k + 1 < static_cast<int>(axis.nodes().size()); ++k) each.insert(k);
    ASSERT_TRUE(finer.halve(each));
    for (const double t : finer.nodes()) EXPECT_TRUE(std::binary_search(all.begin(), all.end(), t)) << t;
  }
}

}  // namespace
}  // namespace deform::cad::cad_parts_test
