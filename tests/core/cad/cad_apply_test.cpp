// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/cad/cad_apply.h"

#include <gmock/gmock-more-matchers.h>
#include <gtest/gtest.h>

#include <BRepAdaptor_Curve.hxx>
#include <BRepAdaptor_Surface.hxx>
#include <BRepAlgoAPI_Cut.hxx>
#include <BRepBuilderAPI_MakeFace.hxx>
#include <BRepBuilderAPI_MakeVertex.hxx>
#include <BRepBuilderAPI_Transform.hxx>
#include <BRepCheck_Analyzer.hxx>
#include <BRepExtrema_DistShapeShape.hxx>
#include <BRepGProp.hxx>
#include <BRepPrimAPI_MakeBox.hxx>
#include <BRepPrimAPI_MakeCone.hxx>
#include <BRepPrimAPI_MakeCylinder.hxx>
#include <BRepPrimAPI_MakeSphere.hxx>
#include <BRepPrimAPI_MakeTorus.hxx>
#include <BRepTools.hxx>
#include <BRepTopAdaptor_FClass2d.hxx>
#include <BRep_Builder.hxx>
#include <BRep_Tool.hxx>
#include <GProp_GProps.hxx>
#include <Geom_BSplineSurface.hxx>
#include <Interface_Static.hxx>
#include <Quantity_Color.hxx>
#include <STEPCAFControl_Controller.hxx>
#include <STEPCAFControl_Reader.hxx>
#include <STEPCAFControl_Writer.hxx>
#include <STEPControl_Reader.hxx>
#include <STEPControl_Writer.hxx>
#include <TColStd_SequenceOfAsciiString.hxx>
#include <TDF_LabelSequence.hxx>
#include <TDataStd_Name.hxx>
#include <TDocStd_Document.hxx>
#include <TopExp.hxx>
#include <TopTools_IndexedMapOfShape.hxx>
#include <TopoDS.hxx>
#include <TopoDS_Compound.hxx>
#include <XCAFApp_Application.hxx>
#include <XCAFDoc_ColorTool.hxx>
#include <XCAFDoc_DocumentTool.hxx>
#include <XCAFDoc_ShapeTool.hxx>
#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <gp_Pln.hxx>
#include <gp_Trsf.hxx>
#include <iterator>
#include <limits>
#include <numbers>
#include <random>
#include <tuple>

#include "core/base/error.h"
#include "core/base/vectors.h"
#include "core/cad/deformed_shape.h"
#include "core/cad/document.h"
#include "tests/support/expect_error.h"

namespace deform::cad::cad_apply_test {
namespace {

using Became = DeformedFace::Became;
using testing::HasSubstr;
using PointMap = std::function<Vec3(const Vec3&)>;

SpaceMap each(const PointMap& map) {
  return [map](std::span<const Vec3> points) {
    Points moved;
    for (const Vec3& p : points) moved.push_back(map(p));
    return moved;
  };
}

/// Three shears one after the other: volumes stay.
Vec3 sheared(const Vec3& p) {
  const double x = p[0] + 0.2 * std::sin(0.8 * p[1]) + 0.1 * std::cos(p[2]);
  const double y = p[1] + 0.15 * std::sin(0.9 * x);
  return {x, y, p[2] + 0.1 * std::sin(0.7 * x) * std::cos(0.5 * y)};
}

/// Nothing moves below z = 1; what is above z = 2 turns about an axis along y.
Vec3 bent(const Vec3& p) {
  const double s = std::clamp(p[2] - 1, 0.0, 1.0);
  const double angle = 0.3 * s * s * s * s * (35 + s * (-84 + s * (70 - 20 * s)));
  const double z = p[2] - 2;
  return {p[0] * std::cos(angle) + z * std::sin(angle), p[1], 2 - p[0] * std::sin(angle) + z * std::cos(angle)};
}

/// A block with a bore along y through its upper part.
TopoDS_Shape block() {
  const TopoDS_Shape box = BRepPrimAPI_MakeBox(gp_Pnt(-2, -1, 0), 4, 2, 4).Shape();
  return BRepAlgoAPI_Cut(box, BRepPrimAPI_MakeCylinder(gp_Ax2(gp_Pnt(0, -1, 3), gp::DY()), 0.5, 2).Shape()).Shape();
}

double volume(const TopoDS_Shape& shape) {
  GProp_GProps properties;
  BRepGProp::VolumeProperties(shape, properties, 1e-9);
  return properties.Mass();
}

TopTools_IndexedMapOfShape faces_of(const TopoDS_Shape& shape) {
  TopTools_IndexedMapOfShape faces;
  TopExp::MapShapes(shape, TopAbs_FACE, faces);
  return faces;
}

BRepAdaptor_Surface face_of(const TopoDS_Shape& shape, int number) {
  return BRepAdaptor_Surface(TopoDS::Face(faces_of(shape)(number)));
}

class CadApply : public testing::Test {
 protected:
  std::filesystem::path path(const std::string& name) {
    std::string test = testing::UnitTest::GetInstance()->current_test_info()->name();
    std::replace(test.begin(), test.end(), '/', '_');
    files_.push_back(std::filesystem::temp_directory_path() / ("deform_apply_" + test + "_" + name));
    return files_.back();
  }
  void TearDown() override {
    for (const auto& file : files_) std::filesystem::remove(file);
  }
  ApplyRequest request(const TopoDS_Shape& shape, const std::string& extension) {
    ApplyRequest request;
    request.model = path("in" + extension);
    request.output = path("out" + extension);
    request.checks = 2000;
    if (extension == ".brep") {
      BRepTools::Write(shape, request.model.c_str());
    } else {
      Interface_Static::SetCVal("write.step.unit", "MM");
      Interface_Static::SetCVal("xstep.cascade.unit", "MM");
      STEPControl_Writer writer;
      writer.Transfer(shape, STEPControl_AsIs);
      writer.Write(request.model.c_str());
    }
    return request;
  }
  static TopoDS_Shape read(const std::filesystem::path& file) {
    TopoDS_Shape shape;
    if (file.extension() == ".brep") {
      std::ifstream stream(file);
      BRepTools::Read(shape, stream, BRep_Builder());
      return shape;
    }
    Interface_Static::SetCVal("xstep.cascade.unit", "MM");
    STEPControl_Reader reader;
    reader.ReadFile(file.c_str());
    reader.TransferRoots();
    return reader.OneShape();
  }
  /// The largest distance of the file from where the map takes points of the original, by projection.
  static double distance_from(const TopoDS_Shape& rest, const TopoDS_Shape& deformed, const PointMap& map) {
    std::mt19937 engine(5);
    std::uniform_real_distribution<double> share(0, 1);
    double largest = 0;
    const auto faces = faces_of(rest), targets = faces_of(deformed);
    for (int f = 1; f <= faces.Extent(); ++f) {
      const TopoDS_Face face = TopoDS::Face(faces(f));
      const BRepTopAdaptor_FClass2d region(face, 1e-9);
      const BRepAdaptor_Surface surface(face);
      for (int found = 0; found < 8;) {
        const double u = surface.FirstUParameter() + share(engine) * (surface.LastUParameter() - surface.FirstUParameter());
        const double v = surface.FirstVParameter() + share(engine) * (surface.LastVParameter() - surface.FirstVParameter());
        if (region.Perform(gp_Pnt2d(u, v)) != TopAbs_IN) continue;
        ++found;
        const gp_Pnt p = surface.Value(u, v);
        const Vec3 target = map({p.X(), p.Y(), p.Z()});
        const TopoDS_Shape vertex = BRepBuilderAPI_MakeVertex(gp_Pnt(target[0], target[1], target[2])).Shape();
        largest = std::max(largest, BRepExtrema_DistShapeShape(vertex, targets(f)).Value());
      }
    }
    return largest;
  }
  std::string refusal(const ApplyRequest& request, const SpaceMap& map) {
    try {
      apply_to_model(request, map);
    } catch (const Error& error) {
      return error.what();
    }
    return "nothing was refused";
  }

 private:
  std::vector<std::filesystem::path> files_;
};

/// By the number of a shape, and the extension of the file.
class CadApplyTo : public CadApply, public testing::WithParamInterface<std::tuple<int, const char*>> {};

TEST_P(CadApplyTo, TheFileLiesOnTheDeformedModelAndKeepsItsVolume) {
  const auto& [number, extension] = GetParam();
  const TopoDS_Shape shape = number == 0   ? block()
                             : number == 1 ? BRepPrimAPI_MakeTorus(2, 0.5).Shape()
                                           : BRepPrimAPI_MakeSphere(1.5).Shape();
  const ApplyRequest asked = request(shape, extension);
  const DeformedModel model = apply_to_model(asked, each(sheared));
  const double limit = 2 * asked.tolerance * model.diagonal;
  EXPECT_LT(model.error, limit);
  EXPECT_LT(model.gap, limit);
  EXPECT_TRUE(model.coarse.empty());
  const TopoDS_Shape deformed = read(asked.output);
  EXPECT_TRUE(BRepCheck_Analyzer(deformed).IsValid());
  EXPECT_EQ(faces_of(deformed).Extent(), faces_of(shape).Extent());
  EXPECT_LT(distance_from(shape, deformed, sheared), limit);
  EXPECT_NEAR(volume(deformed) / volume(shape), 1, 1e-6);
}

INSTANTIATE_TEST_SUITE_P(
    Shapes, CadApplyTo, testing::Combine(testing::Values(0, 1, 2), testing::Values(".brep", ".step")), [](const auto& one) {
      return std::string(std::array{"Block", "Torus", "Sphere"}[std::get<0>(one.param)]) + "_" + (std::get<1>(one.param) + 1);
    });

TEST_F(CadApply, TheReportedErrorIsThatOfTheFile) {
  ApplyRequest asked = request(block(), ".brep");
  asked.tolerance = 1e-3;
  const DeformedModel model = apply_to_model(asked, each(sheared));
  const double measured = distance_from(block(), read(asked.output), sheared);
  EXPECT_LE(measured, 1.05 * model.error);
  EXPECT_GT(measured, 0.02 * model.error);
  EXPECT_GT(model.error, 1e-5 * model.diagonal) << "a coarse tolerance makes a coarse model";
}

/// What a STEP file says about how exact it is, in millimetres.
double uncertainty_of(const std::filesystem::path& file) {
  std::ifstream stream(file);
  const std::string text((std::istreambuf_iterator<char>(stream)), {});
  const std::string name = "UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE(";
  return std::stod(text.substr(text.find(name) + name.size()));
}

TEST_F(CadApply, TheFileSaysThatItIsAsExactAsItsWidestEdge) {
  for (const double size : {1.0, 1000.0}) {
    gp_Trsf scaling;
    scaling.SetScale(gp::Origin(), size);
    // With many edges that are met exactly the mean gap is small, and readers project the others anew.
    BRep_Builder builder;
    TopoDS_Compound all;
    builder.MakeCompound(all);
    builder.Add(all, block());
    for (int i = 0; i < 40; ++i) builder.Add(all, BRepPrimAPI_MakeBox(gp_Pnt(-2, 2 + i, -5), 1, 0.5, 1).Shape());
    ApplyRequest asked = request(BRepBuilderAPI_Transform(all, scaling, true).Shape(), ".step");
    asked.tolerance = 1e-5;
    const DeformedModel model =
        apply_to_model(asked, each([&](const Vec3& p) { return size * (p[1] > 1.5 * size ? p / size : sheared(p / size)); }));
    EXPECT_GE(uncertainty_of(asked.output), model.gap);
    EXPECT_LE(uncertainty_of(asked.output), 1.3 * model.gap);
  }
}

TEST_F(CadApply, NoEdgeIsShorterThanTheFileIsExact) {
  // An edge of 2e-5 beside gaps of about 1e-4.
  const TopoDS_Shape step = BRepAlgoAPI_Cut(block(), BRepPrimAPI_MakeBox(gp_Pnt(1, -1, 4 - 2e-5), 2, 2, 1).Shape()).Shape();
  ApplyRequest asked = request(step, ".step");
  asked.tolerance = 1e-4;
  const DeformedModel model = apply_to_model(asked, each(sheared));
  EXPECT_GT(model.gap, 1e-5);
  EXPECT_NEAR(uncertainty_of(asked.output), 2e-6, 4e-7);
}

TEST_F(CadApply, WhatMovesRigidlyKeepsItsTypeAndWhatStaysIsKept) {
  const ApplyRequest asked = request(block(), ".step");
  const DeformedModel model = apply_to_model(asked, each(bent));
  const TopoDS_Shape deformed = read(asked.output);
  int cylinders = 0;
  for (const DeformedFace& face : model.faces) {
    const BRepAdaptor_Surface surface = face_of(deformed, face.number), before = face_of(block(), face.number);
    if (face.type == "cylinder") {
      ++cylinders;
      EXPECT_EQ(face.became, Became::moved);
      ASSERT_EQ(surface.GetType(), GeomAbs_Cylinder);
      EXPECT_NEAR(surface.Cylinder().Radius(), 0.5, 1e-9);
      const Vec3 centre = bent({0, 0, 3});
      EXPECT_NEAR(surface.Cylinder().Axis().Location().X(), centre[0], 1e-9);
      EXPECT_NEAR(surface.Cylinder().Axis().Location().Z(), centre[2], 1e-9);
    }
    if (face.became == Became::fitted) {
      EXPECT_EQ(surface.GetType(), GeomAbs_BSplineSurface);
    } else {
      EXPECT_EQ(surface.GetType(), before.GetType());
    }
  }
  EXPECT_EQ(cylinders, 1);
  EXPECT_EQ(model.count(Became::kept), 1u) << "the bottom";
  EXPECT_EQ(model.count(Became::moved), 2u) << "the bore and the top";
}

/// Points slide about and along the axis of the bore of block(), whose radius grows by a fifth, and within the planes across it.
Vec3 widened(const Vec3& p) {
  const double x = p[0], z = p[2] - 3, radius = std::hypot(x, z);
  const double angle = std::atan2(z, x) + 0.05 * std::sin(2 * std::atan2(z, x)) * std::exp(1 - 4 * radius * radius);
  const double grown = radius * (1 + 0.2 * std::exp(1 - 4 * radius * radius));
  return {grown * std::cos(angle), p[1] + 0.03 * (1 - p[1] * p[1]) * x, 3 + grown * std::sin(angle)};
}

TEST_F(CadApply, OnlyPolesAreMendedInTheFile) {
  const auto faults = [](const std::filesystem::path& file, Reading how) {
    std::string all;
    for (const Part& part : read_document(file, how).parts) all += faults_of(part.shape);
    return all;
  };
  const TopoDS_Shape notched = BRepAlgoAPI_Cut(block(), BRepPrimAPI_MakeBox(gp_Pnt(1, -1, 3.2), 2, 2, 1).Shape()).Shape();
  const TopoDS_Shape plate =
      BRepAlgoAPI_Cut(BRepPrimAPI_MakeBox(gp_Pnt(-2, -2, 0), 4, 4, 2).Shape(), BRepPrimAPI_MakeCylinder(1, 2).Shape()).Shape();
  const PointMap wider = [](const Vec3& p) { return Vec3{1.2 * p[0], 1.2 * p[1], p[2] + 0.1 * p[2] * p[2]}; };
  const std::vector<std::tuple<TopoDS_Shape, PointMap, double>> cases{
      {block(), bent, 1e-6}, {block(), widened, 1e-6}, {plate, wider, 1e-6}, {notched, sheared, 1e-5}};
  for (const double size : {1.0, 1000.0}) {
    gp_Trsf scaling;
    scaling.SetScale(gp::Origin(), size);
    for (std::size_t i = 0; i < cases.size(); ++i) {
      const auto& [shape, map, tolerance] = cases[i];
      ApplyRequest asked = request(BRepBuilderAPI_Transform(shape, scaling, true).Shape(), ".step");
      asked.tolerance = tolerance;
      const PointMap& unscaled = map;
      apply_to_model(asked, each([&](const Vec3& p) { return size * unscaled(p / size); }));
      EXPECT_EQ(faults(asked.output, Reading::as_it_stands), "") << size << ' ' << i;
    }
  }
  // An eighth of a sphere.
  const ApplyRequest sphere =
      request(BRepPrimAPI_MakeSphere(1.5, 0, 0.5 * std::numbers::pi, 0.5 * std::numbers::pi).Shape(), ".step");
  apply_to_model(sphere, each(sheared));
  EXPECT_NE(faults(sphere.output, Reading::as_it_stands), "") << "STEP files have no degenerate edges";
  EXPECT_EQ(faults(sphere.output, Reading::mended), "");
}

TEST_F(CadApply, WhatStaysOfItsTypeKeepsItWithOtherDimensions) {
  for (const char* extension : {".brep", ".step"}) {
    const ApplyRequest asked = request(block(), extension);
    const DeformedModel model = apply_to_model(asked, each(widened));
    const double limit = 2 * asked.tolerance * model.diagonal;
    const TopoDS_Shape deformed = read(asked.output);
    EXPECT_TRUE(BRepCheck_Analyzer(deformed).IsValid());
    EXPECT_LT(model.gap, limit);
    EXPECT_LT(distance_from(block(), deformed, widened), limit) << extension;
    int planes = 0, cylinders = 0;
    for (const DeformedFace& face : model.faces) {
      const BRepAdaptor_Surface surface = face_of(deformed, face.number);
      if (face.became != Became::reshaped) continue;
      EXPECT_EQ(surface.GetType(), face_of(block(), face.number).GetType());
      if (surface.GetType() == GeomAbs_Plane) {
        planes += std::abs(std::abs(surface.Plane().Axis().Direction().Y()) - 1) < 1e-12 ? 1 : 0;
      } else if (surface.GetType() == GeomAbs_Cylinder) {
        ++cylinders;
        EXPECT_NEAR(surface.Cylinder().Radius(), 0.6, 1e-9);
        EXPECT_NEAR(surface.Cylinder().Axis().Location().Z(), 3, 1e-9);
      }
    }
    EXPECT_EQ(planes, 2) << "across the bore";
    EXPECT_EQ(cylinders, 1);
  }
}

TEST_F(CadApply, ConesAndSpheresGrow) {
  const PointMap grown = [](const Vec3& p) { return Vec3{1.1 * p[0] + 3, 1.1 * p[1], 1.1 * p[2] - 1}; };
  const ApplyRequest cone = request(BRepPrimAPI_MakeCone(1, 0.4, 2).Shape(), ".step");
  EXPECT_EQ(apply_to_model(cone, each(grown)).count(Became::reshaped), 3u);
  const TopoDS_Shape deformed_cone = read(cone.output);
  int cones = 0;
  for (int f = 1; f <= 3; ++f) {
    const BRepAdaptor_Surface surface = face_of(deformed_cone, f);
    if (surface.GetType() != GeomAbs_Cone) continue;
    ++cones;
    EXPECT_NEAR(std::abs(surface.Cone().SemiAngle()), std::atan(0.3), 1e-9);
  }
  EXPECT_EQ(cones, 1);
  EXPECT_NEAR(volume(deformed_cone) / volume(BRepPrimAPI_MakeCone(1, 0.4, 2).Shape()), 1.331, 1e-6);

  const TopoDS_Shape zone = BRepPrimAPI_MakeSphere(1.5, -0.5, 0.7).Shape();  // without poles
  const ApplyRequest sphere = request(zone, ".step");
  EXPECT_EQ(apply_to_model(sphere, each(grown)).count(Became::reshaped), 3u);
  const TopoDS_Shape deformed_sphere = read(sphere.output);
  int spheres = 0;
  for (int f = 1; f <= 3; ++f) {
    const BRepAdaptor_Surface surface = face_of(deformed_sphere, f);
    if (surface.GetType() != GeomAbs_Sphere) continue;
    ++spheres;
    EXPECT_NEAR(surface.Sphere().Radius(), 1.65, 1e-9);
    EXPECT_NEAR(surface.Sphere().Location().X(), 3, 1e-9);
  }
  EXPECT_EQ(spheres, 1);
  EXPECT_NEAR(volume(deformed_sphere) / volume(zone), 1.331, 1e-6);
}

TEST_F(CadApply, AConeWithItsApexStaysACone) {
  // It widens, and its seam turns about the axis, the more the higher.
  const PointMap grown = [](const Vec3& p) {
    const double angle = 0.3 * p[2];
    return Vec3{1.2 * (p[0] * std::cos(angle) - p[1] * std::sin(angle)), 1.2 * (p[0] * std::sin(angle) + p[1] * std::cos(angle)),
                1.1 * p[2]};
  };
  const TopoDS_Shape cone = BRepPrimAPI_MakeCone(1, 0, 2).Shape();
  for (const char* extension : {".step", ".brep"}) {
    const ApplyRequest asked = request(cone, extension);
    EXPECT_EQ(apply_to_model(asked, each(grown)).count(Became::reshaped), 2u);
    const TopoDS_Shape deformed = read(asked.output);
    const BRepAdaptor_Surface surface = face_of(deformed, 1);
    ASSERT_EQ(surface.GetType(), GeomAbs_Cone);
    EXPECT_NEAR(std::abs(surface.Cone().SemiAngle()), std::atan(1.2 / 2.2), 1e-9);
    EXPECT_LT(surface.Cone().Apex().Distance(gp_Pnt(0, 0, 2.2)), 1e-9);
    EXPECT_NEAR(volume(deformed) / volume(cone), 1.44 * 1.1, 1e-5);
  }
}

TEST_F(CadApply, WholeSpheresAndToriGrow) {
  const PointMap grown = [](const Vec3& p) { return Vec3{1.1 * p[0] + 3, 1.1 * p[1], 1.1 * p[2] - 1}; };
  const ApplyRequest sphere = request(BRepPrimAPI_MakeSphere(1.5).Shape(), ".step");
  EXPECT_EQ(apply_to_model(sphere, each(grown)).count(Became::reshaped), 1u);
  const BRepAdaptor_Surface ball = face_of(read(sphere.output), 1);
  ASSERT_EQ(ball.GetType(), GeomAbs_Sphere);
  EXPECT_NEAR(ball.Sphere().Radius(), 1.65, 1e-9);
  EXPECT_NEAR(ball.Sphere().Location().X(), 3, 1e-9);
  const ApplyRequest torus = request(BRepPrimAPI_MakeTorus(3, 1).Shape(), ".step");
  EXPECT_EQ(apply_to_model(torus, each(grown)).count(Became::reshaped), 1u);
  const BRepAdaptor_Surface ring = face_of(read(torus.output), 1);
  ASSERT_EQ(ring.GetType(), GeomAbs_Torus);
  EXPECT_NEAR(ring.Torus().MajorRadius(), 3.3, 1e-9);
  EXPECT_NEAR(ring.Torus().MinorRadius(), 1.1, 1e-9);
}

/// A mesh of block(): a grid of nodes on its faces, and on its bore.
MeshMotion grid_on_block(const PointMap& map) {
  MeshMotion mesh;
  constexpr int n = 16;
  for (int i = 0; i <= n; ++i) {
    for (int j = 0; j <= n; ++j) {
      const double x = -2 + 4.0 * i / n, y = -1 + 2.0 * j / n, angle = 2 * std::numbers::pi * i / n;
      mesh.rest.push_back({x, y, 0});
      mesh.rest.push_back({x, y, 4});
      mesh.rest.push_back({0.5 * std::cos(angle), y, 3 + 0.5 * std::sin(angle)});
    }
  }
  for (const Vec3& p : mesh.rest) mesh.moved.push_back(map(p));
  for (PointId i = 0; i < mesh.rest.size(); ++i) mesh.boundary.push_back(i);
  return mesh;
}

TEST_F(CadApply, AModelThatIsNotThatOfTheMeshIsRefused) {
  MeshMotion inches = grid_on_block(bent), elsewhere = inches, half = inches;
  for (Vec3& p : inches.rest) p = 25.4 * p;
  for (Vec3& p : elsewhere.rest) p[0] += 40;
  std::erase_if(half.boundary, [&](PointId id) { return half.rest[id][0] > 0; });
  ApplyRequest asked = request(block(), ".step");
  asked.tolerance = 1e-4;
  for (const double scale : {1.0, 2.0}) {
    asked.scale = scale;
    for (const MeshMotion* mesh : {&inches, &elsewhere}) {
      asked.mesh = mesh;
      const std::string sizes = std::string("the model is ") + (scale == 1 ? "6" : "12") + " across, the boundary of the mesh " +
                                (mesh == &inches ? "152.4" : "6") + ": another unit needs --scale";
      test::expect_error(ErrorCode::invalid_argument, {"is not the model of this mesh", sizes.c_str()},
                         [&] { apply_to_model(asked, each(bent)); });
      EXPECT_FALSE(std::filesystem::exists(asked.output));
    }
  }
  asked.scale = 1;
  asked.mesh = &half;
  EXPECT_NO_THROW(apply_to_model(asked, each(bent))) << "half of a model is enough";
  asked.scale = 25.4;
  asked.mesh = &inches;
  EXPECT_NO_THROW(apply_to_model(asked, each([](const Vec3& p) { return p; })));
}

TEST_F(CadApply, AnotherVariantOfTheModelIsDoubted) {
  const MeshMotion mesh = grid_on_block(bent);
  MeshMotion wider = mesh, inside = mesh, half = mesh, around = mesh;
  const auto doubts = [&](const MeshMotion& of) {
    ApplyRequest asked = request(block(), ".step");
    asked.tolerance = 1e-4;
    asked.mesh = &of;
    std::string found;
    for (const std::string& note : apply_to_model(asked, each(bent)).notes) {
      if (note.find("may not be the model") != std::string::npos) found = note;
    }
    return found;
  };
  EXPECT_EQ(doubts(mesh), "");
  // The bore of the mesh, every third node, is wider by a tenth than that of the model, which is sqrt(36) across.
  for (std::size_t i = 2; i < wider.rest.size(); i += 3) {
    wider.rest[i][0] *= 1.1;
    wider.rest[i][2] = 3 + 1.1 * (wider.rest[i][2] - 3);
  }
  // Every other node is looked at; on the bore that is half of the 15 rings that are not in the planes at its ends.
  const std::string text = doubts(wider);
  EXPECT_NE(text.find("of 434 nodes"), std::string::npos) << text;
  EXPECT_NE(text.find("127 are not on it"), std::string::npos) << text;
  EXPECT_NE(text.find("by 0.00833 D"), std::string::npos) << text;
  // In the solid a node is not on the model either.
  inside.rest[0] = {-1, 0, 1};
  EXPECT_NE(doubts(inside).find(" 1 are not on it"), std::string::npos) << doubts(inside);
  // Meshes of a part of the model, and nodes far from it, say nothing.
  std::erase_if(half.boundary, [&](PointId id) { return half.rest[id][0] > 0; });
  EXPECT_EQ(doubts(half), "");
  around.rest[0] = {50, 0, 0};
  EXPECT_EQ(doubts(around), "");
}

TEST_F(CadApply, NodesHoldFacesWhereTheDeformationDiffersBetweenThem) {
  // Bumps that vanish at the nodes.
  const double height = 1e-3, step = std::numbers::pi * 4;
  const PointMap bumpy = [&](const Vec3& p) {
    const Vec3 q = bent(p);
    return Vec3{q[0], q[1], q[2] + height * std::sin(step * p[0]) * std::sin(2 * step * p[1])};
  };
  const MeshMotion mesh = grid_on_block(bumpy);
  ApplyRequest asked = request(block(), ".step");
  asked.tolerance = 1e-5;
  asked.mesh = &mesh;
  const DeformedModel model = apply_to_model(asked, each(bumpy));
  std::size_t rigid = 0, planes = 0;
  for (const DeformedFace& face : model.faces) {
    rigid += face.held && face.became == Became::moved ? 1 : 0;
    planes += face.held && face.became == Became::reshaped ? 1 : 0;
  }
  EXPECT_EQ(rigid, 3u) << "bottom, top, bore";
  EXPECT_EQ(planes, 2u) << "across the bore: the nodes on their borders stay in them";
  EXPECT_NEAR(model.overlooked, height, 0.05 * height);
  EXPECT_LT(model.error, 2 * asked.tolerance * model.diagonal);
  const TopoDS_Shape deformed = read(asked.output);
  for (const DeformedFace& face : model.faces) {
    if (!face.held) continue;
    EXPECT_EQ(face_of(deformed, face.number).GetType(), face_of(block(), face.number).GetType());
  }
  for (const std::size_t i : {0, 1, 2, 100, 400}) {
    const Vec3& p = mesh.moved[i];
    const TopoDS_Shape vertex = BRepBuilderAPI_MakeVertex(gp_Pnt(p[0], p[1], p[2])).Shape();
    EXPECT_LT(BRepExtrema_DistShapeShape(vertex, deformed).Value(), 1e-7) << i;
  }
  asked.hold = 1e-5;
  EXPECT_LT(apply_to_model(asked, each(bumpy)).overlooked, 1e-9) << "more than may be overlooked";
}

TEST_F(CadApply, EdgesOfHeldFacesStayWithThem) {
  // Bumps along y that vanish at the nodes, also on edges.
  const PointMap bumpy = [](const Vec3& p) {
    const Vec3 q = bent(p);
    return Vec3{q[0], q[1], q[2] + 1e-3 * std::sin(8 * std::numbers::pi * p[1])};
  };
  const MeshMotion mesh = grid_on_block(bumpy);
  ApplyRequest asked = request(block(), ".brep");
  asked.tolerance = 1e-5;
  asked.mesh = &mesh;
  const DeformedModel model = apply_to_model(asked, each(bumpy));
  const TopoDS_Shape deformed = read(asked.output), rest = block();
  int rigid = 0, edges = 0;
  for (const DeformedFace& face : model.faces) {
    if (!face.held || face.became != Became::moved) continue;
    ++rigid;
    TopTools_IndexedMapOfShape before, after;
    TopExp::MapShapes(faces_of(rest)(face.number), TopAbs_EDGE, before);
    TopExp::MapShapes(faces_of(deformed)(face.number), TopAbs_EDGE, after);
    ASSERT_EQ(after.Extent(), before.Extent());
    for (int e = 1; e <= before.Extent(); ++e, ++edges) {
      EXPECT_EQ(BRepAdaptor_Curve(TopoDS::Edge(after(e))).GetType(), BRepAdaptor_Curve(TopoDS::Edge(before(e))).GetType())
          << face.number << " " << e;
    }
  }
  EXPECT_EQ(rigid, 3) << "bottom, top, bore";
  EXPECT_EQ(edges, 4 + 4 + 3);
}

TEST_F(CadApply, AConstraintHoldsAFaceAsNearAsItReports) {
  // The bore is round to 1e-4 at the nodes.
  const PointMap rough = [](const Vec3& p) {
    const Vec3 q = widened(p);
    const double angle = std::atan2(p[2] - 3, p[0]);
    return Vec3{q[0] + 1e-4 * std::sin(5 * angle), q[1], q[2]};
  };
  MeshMotion mesh = grid_on_block(rough);
  ApplyRequest asked = request(block(), ".step");
  asked.mesh = &mesh;
  const auto bore = [&] {
    const DeformedModel model = apply_to_model(asked, each(rough));
    return std::find_if(model.faces.begin(), model.faces.end(), [](const DeformedFace& face) { return face.type == "cylinder"; })
        ->became;
  };
  EXPECT_EQ(bore(), Became::fitted);
  MeshMotion::Kept kept{{}, 1e-4};
  for (PointId i = 2; i < mesh.rest.size(); i += 3) kept.points.push_back(i);
  mesh.kept.push_back(kept);
  EXPECT_EQ(bore(), Became::reshaped);
  mesh.kept[0].largest = 2e-5;
  EXPECT_EQ(bore(), Became::fitted);
}

TEST_F(CadApply, BumpsBetweenTheNodesOfAnEdgeAreFound) {
  // They vanish at all parameters that the first rounds look at, and away from the edge.
  const PointMap bumps = [](const Vec3& p) {
    const double far = p[1] + 1;
    return Vec3{p[0], p[1], 0.1 * p[0] * p[0] + 1e-3 * std::sin(48 * std::numbers::pi * p[0]) * std::exp(-1e4 * far * far)};
  };
  const TopoDS_Shape sheet = BRepBuilderAPI_MakeFace(gp_Pln(gp::Origin(), gp::DZ()), -1, 1, -1, 1).Shape();
  ApplyRequest asked = request(sheet, ".brep");
  asked.tolerance = 1e-4;
  apply_to_model(asked, each(bumps));
  TopTools_IndexedMapOfShape edges;
  const TopoDS_Shape deformed = read(asked.output);
  TopExp::MapShapes(deformed, TopAbs_EDGE, edges);
  double highest = 0;
  for (int e = 1; e <= edges.Extent(); ++e) {
    const BRepAdaptor_Curve curve(TopoDS::Edge(edges(e)));
    for (int k = 0; k <= 500; ++k) {
      const gp_Pnt p = curve.Value(curve.FirstParameter() + (curve.LastParameter() - curve.FirstParameter()) * k / 500);
      if (p.Y() < -0.999) highest = std::max(highest, p.Z() - 0.1 * p.X() * p.X());
    }
  }
  EXPECT_NEAR(highest, 1e-3, 1e-4);
}

TEST_F(CadApply, AFaceWhoseEdgeLeavesItIsFitted) {
  // Few points of the face see the bumps of its edge.
  const PointMap bumps = [](const Vec3& p) {
    const double far = p[1] + 1;
    return Vec3{p[0], p[1], 1e-3 * std::sin(48 * std::numbers::pi * p[0]) * std::exp(-1e4 * far * far)};
  };
  const TopoDS_Shape sheet = BRepBuilderAPI_MakeFace(gp_Pln(gp::Origin(), gp::DZ()), -1, 1, -1, 1).Shape();
  ApplyRequest asked = request(sheet, ".brep");
  asked.tolerance = 1e-4;
  asked.checks = 20;
  EXPECT_EQ(apply_to_model(asked, each(bumps)).faces[0].became, Became::fitted);
}

TEST_F(CadApply, TheSeamOfAReshapedCylinderStaysWhereItsParameterBegins) {
  const PointMap slid = [](const Vec3& p) {
    const double r = std::hypot(p[0], p[1]), angle = 0.1 * (r * r - r * p[0]);  // none on the seam, about the axis elsewhere
    return Vec3{1.1 * (p[0] * std::cos(angle) - p[1] * std::sin(angle)), 1.1 * (p[0] * std::sin(angle) + p[1] * std::cos(angle)),
                p[2]};
  };
  const ApplyRequest asked = request(BRepPrimAPI_MakeCylinder(1, 2).Shape(), ".brep");
  EXPECT_EQ(apply_to_model(asked, each(slid)).count(Became::reshaped), 3u);
  const TopTools_IndexedMapOfShape faces = faces_of(read(asked.output));
  for (int f = 1; f <= faces.Extent(); ++f) {
    const TopoDS_Face face = TopoDS::Face(faces(f));
    if (BRepAdaptor_Surface(face).GetType() != GeomAbs_Cylinder) continue;
    double u0 = 0, u1 = 0, v0 = 0, v1 = 0;
    BRepTools::UVBounds(face, u0, u1, v0, v1);
    EXPECT_NEAR(u0, 0, 1e-6);
    EXPECT_NEAR(u1, 2 * std::numbers::pi, 1e-6);
    EXPECT_NEAR(BRepAdaptor_Surface(face).Cylinder().Radius(), 1.1, 1e-9);
  }
}

TEST_F(CadApply, FacesThatGoThroughEachOtherAreNamed) {
  // Two bars that stand on another; the second is bent through the first.
  TopoDS_Compound bars;
  const BRep_Builder builder;
  builder.MakeCompound(bars);
  builder.Add(bars, BRepPrimAPI_MakeBox(gp_Pnt(0, 0, 0), 5, 1, 0.4).Shape());
  builder.Add(bars, BRepPrimAPI_MakeBox(gp_Pnt(0, 0, 0.6), 5, 1, 0.4).Shape());
  builder.Add(bars, BRepPrimAPI_MakeBox(gp_Pnt(-1, 0, 0), 1, 1, 1).Shape());
  const auto bend = [](double by) {
    return each([by](const Vec3& p) {
      const double s = std::max(0.0, p[0] - 2);
      return Vec3{p[0], p[1] - 0.1 * s, p[2] + (p[2] > 0.5 ? by * s * s * s : 0)};
    });
  };
  ApplyRequest asked = request(bars, ".brep");
  asked.tolerance = 1e-4;
  EXPECT_TRUE(apply_to_model(asked, bend(-0.02)).crossings.empty()) << "not looked for";
  asked.crossings = ApplyRequest::Crossings::looked_for;
  EXPECT_FALSE(apply_to_model(asked, bend(-0.02)).crossings.empty());
  EXPECT_TRUE(apply_to_model(asked, bend(0.02)).crossings.empty());
  for (const std::array<int, 2>& pair : apply_to_model(asked, bend(-0.02)).crossings) EXPECT_LT(pair[0], pair[1]);
}

TEST_F(CadApply, WithoutAMotionTheModelStays) {
  const ApplyRequest asked = request(block(), ".step");
  const DeformedModel model = apply_to_model(asked, each([](const Vec3& p) { return p; }));
  EXPECT_EQ(model.count(Became::kept), model.faces.size());
  EXPECT_EQ(model.error, 0);
  EXPECT_NEAR(volume(read(asked.output)), volume(block()), 1e-9);
}

TEST_F(CadApply, TheScaleLeadsToTheUnitOfTheMap) {
  ApplyRequest asked = request(block(), ".brep");
  asked.scale = 0.1;
  apply_to_model(asked, each([](const Vec3& p) { return 0.1 * sheared(10 * p); }));
  EXPECT_LT(distance_from(block(), read(asked.output), sheared), 2e-6 * 6);
}

TEST_F(CadApply, KinksOfTheOriginalAreKinksOfTheResult) {
  TColgp_Array2OfPnt poles(1, 3, 1, 2);
  for (int j = 1; j <= 2; ++j) {
    poles(1, j) = gp_Pnt(0, j, 0);
    poles(2, j) = gp_Pnt(1.3, j, 1);
    poles(3, j) = gp_Pnt(3, j, 0);
  }
  TColStd_Array1OfReal u(1, 3), v(1, 2);
  TColStd_Array1OfInteger mu(1, 3), mv(1, 2);
  u(1) = 0, u(2) = 0.37, u(3) = 1, v(1) = 0, v(2) = 1;
  mu(1) = mu(3) = 2, mu(2) = 1, mv(1) = mv(2) = 2;
  const TopoDS_Shape roof = BRepBuilderAPI_MakeFace(new Geom_BSplineSurface(poles, u, v, mu, mv, 1, 1), 1e-6).Shape();
  const ApplyRequest asked = request(roof, ".brep");
  const DeformedModel model = apply_to_model(asked, each(sheared));
  ASSERT_EQ(model.faces.size(), 1u);
  EXPECT_LT(model.error, asked.tolerance * model.diagonal);
  EXPECT_LT(model.faces[0].poles[0], 60);
}

TEST_F(CadApply, ADeformationWithAKinkIsReportedByFace) {
  const PointMap folded = [](const Vec3& p) { return Vec3{p[0], p[1], 0.3 * std::abs(p[0] + 0.7 * p[1] - 0.123)}; };
  const TopoDS_Shape sheet = BRepBuilderAPI_MakeFace(gp_Pln(gp::Origin(), gp::DZ()), -1, 1, -1, 1).Shape();
  ApplyRequest asked = request(sheet, ".brep");
  asked.tolerance = 1e-5;
  const DeformedModel model = apply_to_model(asked, each(folded));
  EXPECT_THAT(model.coarse, testing::ElementsAre(1));
  EXPECT_GT(model.error, 2 * asked.tolerance * model.diagonal);
  EXPECT_LE(distance_from(sheet, read(asked.output), folded), 2 * model.error);
}

TEST_F(CadApply, AKinkAlongAParameterIsFollowed) {
  const PointMap folded = [](const Vec3& p) { return Vec3{p[0], p[1], 0.3 * std::abs(p[0] - 0.123)}; };
  const TopoDS_Shape sheet = BRepBuilderAPI_MakeFace(gp_Pln(gp::Origin(), gp::DZ()), -1, 1, -1, 1).Shape();
  ApplyRequest asked = request(sheet, ".brep");
  asked.tolerance = 1e-4;
  const DeformedModel model = apply_to_model(asked, each(folded));
  EXPECT_LT(model.error, 2 * asked.tolerance * model.diagonal);
  EXPECT_THAT(model.coarse, testing::IsEmpty());
  EXPECT_LT(model.faces[0].poles[0], 80) << "nodes only where the kink is";
  EXPECT_EQ(model.faces[0].poles[1], 4);
}

TEST_F(CadApply, ABumpBetweenTheFirstNodesIsFound) {
  const PointMap bump = [](const Vec3& p) { return Vec3{p[0], p[1], 0.1 * std::exp(-200 * (p[0] * p[0] + p[1] * p[1]))}; };
  const TopoDS_Shape sheet = BRepBuilderAPI_MakeFace(gp_Pln(gp::Origin(), gp::DZ()), -1, 1, -1, 1).Shape();
  ApplyRequest asked = request(sheet, ".brep");
  asked.tolerance = 1e-5;
  const DeformedModel model = apply_to_model(asked, each(bump));
  EXPECT_EQ(model.faces[0].became, Became::fitted);
  EXPECT_LT(model.error, 2 * asked.tolerance * model.diagonal);
  EXPECT_THAT(model.coarse, testing::IsEmpty());
}

TEST_F(CadApply, NamesColoursAndTheUnitAreKept) {
  Handle(TDocStd_Document) document;
  XCAFApp_Application::GetApplication()->NewDocument("MDTV-XCAF", document);
  const auto shapes = XCAFDoc_DocumentTool::ShapeTool(document->Main());
  const auto colours = XCAFDoc_DocumentTool::ColorTool(document->Main());
  const TDF_Label part = shapes->AddShape(block(), false);
  TDataStd_Name::Set(part, "bracket");
  const TopoDS_Shape own = XCAFDoc_ShapeTool::GetShape(part);
  const TDF_Label marked = shapes->AddSubShape(part, faces_of(own)(3));
  TDataStd_Name::Set(marked, "inlet");
  colours->SetColor(marked, Quantity_Color(0.25, 0.5, 0.75, Quantity_TOC_RGB), XCAFDoc_ColorSurf);
  ApplyRequest asked;
  asked.model = path("in.step");
  asked.output = path("out.step");
  asked.checks = 500;
  STEPCAFControl_Controller::Init();  // before it, there are no settings in a process
  Interface_Static::SetCVal("xstep.cascade.unit", "INCH");
  Interface_Static::SetCVal("write.step.unit", "INCH");
  STEPCAFControl_Writer writer;
  Interface_Static::SetIVal("write.stepcaf.subshapes.name", 1);
  writer.SetNameMode(true);
  ASSERT_TRUE(writer.Transfer(document, STEPControl_AsIs));
  writer.Write(asked.model.c_str());
  const DeformedModel model = apply_to_model(asked, each(sheared));
  EXPECT_THAT(model.notes, testing::Contains(HasSubstr("inch")));

  Handle(TDocStd_Document) again;
  XCAFApp_Application::GetApplication()->NewDocument("MDTV-XCAF", again);
  STEPCAFControl_Reader reader;
  reader.SetNameMode(true);
  reader.SetColorMode(true);
  Interface_Static::SetIVal("read.stepcaf.subshapes.name", 1);
  reader.ReadFile(asked.output.c_str());
  TColStd_SequenceOfAsciiString lengths, angles, solid_angles;
  reader.ChangeReader().FileUnits(lengths, angles, solid_angles);
  EXPECT_STRCASEEQ(lengths.First().ToCString(), "inch");
  Interface_Static::SetCVal("xstep.cascade.unit", "INCH");
  reader.Transfer(again);
  const auto tool = XCAFDoc_DocumentTool::ShapeTool(again->Main());
  TDF_LabelSequence roots, subs;
  tool->GetFreeShapes(roots);
  ASSERT_EQ(roots.Length(), 1);
  Handle(TDataStd_Name) name;
  ASSERT_TRUE(roots(1).FindAttribute(TDataStd_Name::GetID(), name));
  EXPECT_TRUE(name->Get().IsEqual("bracket"));
  const TopoDS_Shape shape = XCAFDoc_ShapeTool::GetShape(roots(1));
  EXPECT_LT(distance_from(block(), shape, sheared), 2e-6 * 6) << "in inches";
  XCAFDoc_ShapeTool::GetSubShapes(roots(1), subs);
  bool found = false;
  for (int i = 1; i <= subs.Length(); ++i) {
    if (!subs(i).FindAttribute(TDataStd_Name::GetID(), name) || !name->Get().IsEqual("inlet")) continue;
    found = true;
    EXPECT_EQ(faces_of(shape).FindIndex(XCAFDoc_ShapeTool::GetShape(subs(i))), 3);
    Quantity_Color colour;
    ASSERT_TRUE(XCAFDoc_DocumentTool::ColorTool(again->Main())->GetColor(subs(i), XCAFDoc_ColorSurf, colour));
    EXPECT_NEAR(colour.Red(), 0.25, 0.01);
    EXPECT_NEAR(colour.Blue(), 0.75, 0.01);
  }
  EXPECT_TRUE(found);
}

TEST_F(CadApply, PartsInSeveralPlacesDeformEachForItself) {
  Handle(TDocStd_Document) document;
  XCAFApp_Application::GetApplication()->NewDocument("MDTV-XCAF", document);
  const auto shapes = XCAFDoc_DocumentTool::ShapeTool(document->Main());
  const TDF_Label assembly = shapes->NewShape();
  const TDF_Label part = shapes->AddShape(block(), false);
  TDataStd_Name::Set(part, "foot");
  TDataStd_Name::Set(assembly, "table");
  gp_Trsf away;
  away.SetTranslation(gp_Vec(7, 1, 0));
  shapes->AddComponent(assembly, part, TopLoc_Location());
  shapes->AddComponent(assembly, part, TopLoc_Location(away));
  shapes->UpdateAssemblies();
  ApplyRequest asked;
  asked.model = path("in.step");
  asked.output = path("out.step");
  Interface_Static::SetCVal("xstep.cascade.unit", "MM");
  Interface_Static::SetCVal("write.step.unit", "MM");
  STEPCAFControl_Writer writer;
  ASSERT_TRUE(writer.Transfer(document, STEPControl_AsIs));
  writer.Write(asked.model.c_str());
  const DeformedModel model = apply_to_model(asked, each(sheared));
  EXPECT_EQ(model.faces.size(), 14u);
  const TopoDS_Shape rest = read(asked.model), deformed = read(asked.output);
  EXPECT_EQ(faces_of(deformed).Extent(), 14);
  EXPECT_LT(distance_from(rest, deformed, sheared), 2 * asked.tolerance * model.diagonal);
  EXPECT_NEAR(volume(deformed), 2 * volume(block()), 1e-6 * volume(block()));
}

TEST_F(CadApply, TheSameRequestGivesTheSameBytes) {
  const ApplyRequest asked = request(block(), ".brep");
  const auto bytes = [&] {
    apply_to_model(asked, each(sheared));
    std::ifstream stream(asked.output);
    return std::string(std::istreambuf_iterator<char>(stream), {});
  };
  EXPECT_EQ(bytes(), bytes());
}

TEST_F(CadApply, WhatCannotBeDoneIsRefusedAndNothingIsWritten) {
  ApplyRequest asked = request(block(), ".brep");
  EXPECT_THAT(refusal(asked, each([](const Vec3& p) { return Vec3{-p[0], p[1], p[2]}; })), HasSubstr("inside out"));
  EXPECT_THAT(refusal(asked, each([](const Vec3& p) { return Vec3{std::sqrt(p[0]), p[1], p[2]}; })), HasSubstr("not finite"));
  EXPECT_THAT(refusal(asked, each([](const Vec3& p) { return Vec3{0, 0, p[2]}; })), HasSubstr("nothing is written"));
  EXPECT_FALSE(std::filesystem::exists(asked.output));
  ApplyRequest wrong = asked;
  wrong.output.replace_extension(".stl");
  EXPECT_THAT(refusal(wrong, each(sheared)), HasSubstr(".step, .stp and .brep"));
  wrong = asked;
  wrong.tolerance = 0.1;
  EXPECT_THAT(refusal(wrong, each(sheared)), HasSubstr("1e-9 to 1e-2"));
  wrong = asked;
  wrong.rigid = 0.02;
  EXPECT_THAT(refusal(wrong, each(sheared)), HasSubstr("rigid: 0.02 is not from 0 to 1e-2"));
  for (const double hold : {0.02, -1e-3, std::numeric_limits<double>::quiet_NaN()}) {
    wrong = asked;
    wrong.hold = hold;
    EXPECT_THAT(refusal(wrong, each(sheared)), testing::StartsWith("hold: "));
    EXPECT_THAT(refusal(wrong, each(sheared)), HasSubstr(" is not from 0 to 1e-2 of the diagonal"));
  }
  wrong = asked;
  wrong.checks = 10'000'001;
  EXPECT_THAT(refusal(wrong, each(sheared)), HasSubstr("checks: 10000001 are more than 10000000"));
  wrong = asked;
  wrong.scale = -1;
  EXPECT_THAT(refusal(wrong, each(sheared)), HasSubstr("greater than 0"));
  wrong = asked;
  wrong.model = "/nowhere/part.step";
  EXPECT_THAT(refusal(wrong, each(sheared)), HasSubstr("the CAD file cannot be opened: No such file or directory"));
  wrong.model = std::filesystem::temp_directory_path();
  EXPECT_THAT(refusal(wrong, each(sheared)), HasSubstr("the CAD file cannot be opened: Is a directory"));
}

TEST_F(CadApply, AnEdgeThatShrinksToAPointIsRefused) {
  // OpenCASCADE would find the model valid, write it, and read the plane within the upper rim without bounds.
  const auto narrowed = [](const Vec3& foot, double by) {
    return each([foot, by](const Vec3& p) {
      const double share = 1 - by * p[2] / 2;
      return Vec3{foot[0] + (p[0] - foot[0]) * share, foot[1] + (p[1] - foot[1]) * share, p[2]};
    });
  };
  for (const Vec3& foot : {Vec3{0, 0, 0}, Vec3{0.3, 0.7, 0}}) {  // exactly, and but for rounding
    const TopoDS_Shape rod = BRepPrimAPI_MakeCylinder(gp_Ax2(gp_Pnt(foot[0], foot[1], 0), gp::DZ()), 1, 2).Shape();
    for (const char* extension : {".brep", ".step"}) {
      const ApplyRequest asked = request(rod, extension);
      test::expect_error(ErrorCode::failed_precondition, {"edge ", " shrinks to a point; nothing is written"},
                         [&] { apply_to_model(asked, narrowed(foot, 1)); });
      EXPECT_FALSE(std::filesystem::exists(asked.output));
      apply_to_model(asked, narrowed(foot, 0.999));
      const double least = 0.001;  // radius of the upper rim
      EXPECT_NEAR(volume(read(asked.output)), 2 * std::numbers::pi / 3 * (1 + least + least * least), 1e-5) << extension;
      std::filesystem::remove(asked.output);
    }
  }
}

}  // namespace
}  // namespace deform::cad::cad_apply_test
