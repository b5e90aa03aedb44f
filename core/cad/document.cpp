// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/cad/document.h"

#include <APIHeaderSection_MakeHeader.hxx>
#include <BRepAdaptor_Curve.hxx>
#include <BRepLib.hxx>
#include <BRepTools.hxx>
#include <BRep_Builder.hxx>
#include <BRep_Tool.hxx>
#include <GCPnts_AbscissaPoint.hxx>
#include <IFSelect_ReturnStatus.hxx>
#include <Interface_HArray1OfHAsciiString.hxx>
#include <Interface_Static.hxx>
#include <Precision.hxx>
#include <STEPCAFControl_Reader.hxx>
#include <STEPCAFControl_Writer.hxx>
#include <STEPControl_Controller.hxx>
#include <ShapeUpgrade_RemoveLocations.hxx>
#include <Standard_Failure.hxx>
#include <TColStd_SequenceOfAsciiString.hxx>
#include <TCollection_HAsciiString.hxx>
#include <TDF_Label.hxx>
#include <TDataStd_Name.hxx>
#include <TopExp.hxx>
#include <TopExp_Explorer.hxx>
#include <TopTools_IndexedMapOfShape.hxx>
#include <TopoDS.hxx>
#include <TopoDS_Compound.hxx>
#include <XCAFDoc_ColorTool.hxx>
#include <XCAFDoc_ShapeTool.hxx>
#include <XSAlgo.hxx>
#include <XSAlgo_AlgoContainer.hxx>
#include <XSAlgo_ToolContainer.hxx>
#include <algorithm>
#include <array>
#include <fstream>
#include <limits>

#include "core/base/error.h"
#include "core/base/small_file.h"
#include "core/base/text.h"
#include "core/cad/deformed_shape.h"
#include "core/cad/model.h"
#include "core/cad/step_parts.h"

namespace deform::cad {

namespace {

/// What OpenCASCADE does to shapes that it has read: nothing.
class NoMending : public XSAlgo_AlgoContainer {
 public:
  TopoDS_Shape ProcessShape(const TopoDS_Shape& shape, Standard_Real, Standard_Real, Standard_CString, Standard_CString,
                            Handle(Standard_Transient) & done, const Message_ProgressRange&, Standard_Boolean) const override {
    done.Nullify();
    return shape;
  }
};

/// Until it goes, readers leave shapes as they stand in the file.
class WithoutMending {
 public:
  WithoutMending() {
    STEPControl_Controller::Init();  // before it, there is no container
    usual_ = XSAlgo::AlgoContainer();
    const Handle(NoMending) none = new NoMending;
    none->SetToolContainer(usual_->ToolContainer());
    XSAlgo::SetAlgoContainer(none);
  }
  ~WithoutMending() { XSAlgo::SetAlgoContainer(usual_); }
  WithoutMending(const WithoutMending&) = delete;
  WithoutMending& operator=(const WithoutMending&) = delete;

 private:
  Handle(XSAlgo_AlgoContainer) usual_;
};

TCollection_ExtendedString extended(const std::string& text) { return {text.c_str(), true}; }

/// What an IGES file calls and paints its faces.
std::vector<FaceMark> marks_of(const Model& reading, int faces) {
  std::vector<FaceMark> marks;
  for (int f = 0; f < faces; ++f) {
    FaceMark mark;
    mark.face = f;
    if (!reading.face_names.empty()) mark.name = reading.face_names[f];
    if (!reading.face_colours.empty() && reading.face_colours[f]) {
      const auto& [red, green, blue, opacity] = *reading.face_colours[f];
      mark.colour = Quantity_ColorRGBA(Quantity_Color(red, green, blue, Quantity_TOC_sRGB), static_cast<float>(opacity));
    }
    if (!mark.name.empty() || mark.colour) marks.push_back(mark);
  }
  return marks;
}

void read_step_parts(const std::filesystem::path& path, Model& reading, Document& document) {
  STEPCAFControl_Reader reader;
  reader.SetColorMode(true);
  reader.SetNameMode(true);
  Interface_Static::SetIVal("read.stepcaf.subshapes.name", 1);
  if (reader.ReadFile(path.c_str()) != IFSelect_RetDone) {
    throw Error(ErrorCode::invalid_argument, reading.name + ": is no STEP file that can be read");
  }
  TColStd_SequenceOfAsciiString lengths, angles, solid_angles;
  reader.ChangeReader().FileUnits(lengths, angles, solid_angles);
  keep_unit(lengths.IsEmpty() ? "" : lengths.First().ToCString(), reading);
  const OpenDocument open;
  Handle(TDocStd_Document) filled = open.get();
  if (!reader.Transfer(filled)) throw Error(ErrorCode::invalid_argument, reading.name + ": the CAD model is empty");
  read_parts(open, document);
}

/// Start and end in (u, v) of an edge as it runs in a face, which is taken forwards.
std::array<gp_Pnt2d, 2> ends_in(const TopoDS_Edge& edge, const TopoDS_Face& face) {
  std::array<gp_Pnt2d, 2> ends;
  BRep_Tool::UVPoints(edge, face, ends[0], ends[1]);
  if (edge.Orientation() == TopAbs_REVERSED) std::swap(ends[0], ends[1]);
  return ends;
}

/// Exchanges the two curves in (u, v) of a seam where their ends are nearer to those of other edges of the loop then: in STEP
/// files they stand in any order.
void order_seam(const TopoDS_Edge& seam, const std::vector<TopoDS_Edge>& loop, const TopoDS_Face& face) {
  const auto miss = [&](TopAbs_Orientation from, TopAbs_Orientation like) {
    // As it runs backwards, the curve of the other side runs the other way.
    std::array<gp_Pnt2d, 2> ends = ends_in(TopoDS::Edge(seam.Oriented(like)), face);
    if (from != like) std::swap(ends[0], ends[1]);
    std::array<double, 2> nearest{1e300, 1e300};
    for (const TopoDS_Edge& other : loop) {
      if (other.IsSame(seam)) continue;
      const std::array<gp_Pnt2d, 2> theirs = ends_in(other, face);
      for (int k = 0; k < 2; ++k) nearest[k] = std::min(nearest[k], ends[k].Distance(theirs[1 - k]));
    }
    return nearest[0] + nearest[1];
  };
  const double kept = miss(TopAbs_FORWARD, TopAbs_FORWARD) + miss(TopAbs_REVERSED, TopAbs_REVERSED);
  const double exchanged = miss(TopAbs_FORWARD, TopAbs_REVERSED) + miss(TopAbs_REVERSED, TopAbs_FORWARD);
  if (!(exchanged < kept)) return;
  double from = 0, to = 0;
  const Handle(Geom2d_Curve) first = BRep_Tool::CurveOnSurface(TopoDS::Edge(seam.Oriented(TopAbs_FORWARD)), face, from, to),
                             second = BRep_Tool::CurveOnSurface(TopoDS::Edge(seam.Oriented(TopAbs_REVERSED)), face, from, to);
  BRep_Builder().UpdateEdge(seam, second, first, face, BRep_Tool::Tolerance(seam));
}

void order_seams(const TopoDS_Shape& shape) {
  for (TopExp_Explorer used(shape, TopAbs_FACE); used.More(); used.Next()) {
    const TopoDS_Face face = TopoDS::Face(used.Current().Oriented(TopAbs_FORWARD));
    for (TopExp_Explorer wire(face, TopAbs_WIRE); wire.More(); wire.Next()) {
      std::vector<TopoDS_Edge> loop, seams;
      for (TopExp_Explorer edge(wire.Current(), TopAbs_EDGE); edge.More(); edge.Next()) {
        loop.push_back(TopoDS::Edge(edge.Current()));
        if (edge.Current().Orientation() == TopAbs_FORWARD && BRep_Tool::IsClosed(loop.back(), face))
          seams.push_back(loop.back());
      }
      for (const TopoDS_Edge& seam : seams) order_seam(seam, loop, face);
    }
  }
}

int solid_count(const TopoDS_Shape& shape) {
  TopTools_IndexedMapOfShape solids;
  TopExp::MapShapes(shape, TopAbs_SOLID, solids);
  return solids.Extent();
}

/// Heals it, takes the locations out, and gives every edge a curve.
void settle(Part& part, Model& reading, Reading how) {
  const int faces = face_count(part.shape);
  TopoDS_Shape shape = how == Reading::healed ? healed(part.shape, reading) : part.shape;
  ShapeUpgrade_RemoveLocations removal;
  removal.Remove(shape);
  shape = removal.GetResult();
  BRepTools::Clean(shape);
  BRepLib::BuildCurves3d(shape);
  if (how == Reading::as_it_stands) {
    order_seams(shape);
    set_tolerances(shape);
  }
  if (face_count(shape) != faces && !part.faces.empty()) {
    part.faces.clear();
    reading.notes.push_back(reading.name + ": names and colours of faces were lost by healing.");
  }
  if (solid_count(shape) != static_cast<int>(part.solid_names.size())) part.solid_names.clear();
  part.shape = shape;
}

/// In pieces that every reader takes.
std::vector<std::string> pieces_of(const std::string& text) {
  constexpr std::size_t longest = 60;
  std::vector<std::string> pieces;
  for (std::size_t i = 0; i < text.size(); i += longest) pieces.push_back(text.substr(i, longest));
  return pieces;
}

/// Puts a text into the header.
void describe(STEPControl_Writer& writer, const std::string& text) {
  const std::vector<std::string> pieces = pieces_of(text);
  const Handle(Interface_HArray1OfHAsciiString) lines = new Interface_HArray1OfHAsciiString(1, static_cast<int>(pieces.size()));
  for (int i = 1; i <= lines->Length(); ++i) lines->SetValue(i, new TCollection_HAsciiString(pieces[i - 1].c_str()));
  APIHeaderSection_MakeHeader(writer.Model()).SetDescription(lines);
}

/// OpenCASCADE skips what stands before its version.
bool write_brep(const TopoDS_Shape& shape, const std::string& text, const std::filesystem::path& path) {
  std::ofstream file(path);
  file << "DBRep_DrawableShape\n";
  for (const std::string& piece : pieces_of(text)) file << brep_note << piece << '\n';
  BRepTools::Write(shape, file);
  file.close();
  return file.good();
}

/// What the file says about how exact it is, in the unit of the model: as the widest edge, since readers project curves in (u, v)
/// anew that are farther off than that, but no more than a tenth of the shortest one, since they drop edges that are shorter.
double uncertainty_of(const Document& document) {
  double widest = 0, shortest = std::numeric_limits<double>::infinity();
  for (const Part& part : document.parts) {
    TopTools_IndexedMapOfShape edges;
    TopExp::MapShapes(part.shape, TopAbs_EDGE, edges);
    for (int i = 1; i <= edges.Extent(); ++i) {
      const TopoDS_Edge edge = TopoDS::Edge(edges(i));
      if (BRep_Tool::Degenerated(edge)) continue;
      widest = std::max(widest, BRep_Tool::Tolerance(edge));
      shortest = std::min(shortest, GCPnts_AbscissaPoint::Length(BRepAdaptor_Curve(edge)));
    }
  }
  return std::max(Precision::Confusion(), std::min(widest, 0.1 * shortest));
}

void write_step(const Document& document, const std::filesystem::path& path) {
  const OpenDocument open;
  const auto shapes = open.shapes();
  const auto colours = open.colours();
  TDF_Label assembly;
  if (document.parts.size() > 1) {
    assembly = shapes->NewShape();
    TDataStd_Name::Set(assembly, extended(document.name.empty() ? path.stem().string() : document.name));
  }
  for (const Part& part : document.parts) {
    const TDF_Label label = shapes->AddShape(part.shape, false);
    TDataStd_Name::Set(label, extended(part.name));
    if (part.colour) colours->SetColor(label, *part.colour, XCAFDoc_ColorSurf);
    TopTools_IndexedMapOfShape faces;
    TopExp::MapShapes(part.shape, TopAbs_FACE, faces);
    for (const FaceMark& mark : part.faces) {
      const TDF_Label face = shapes->AddSubShape(label, faces(mark.face + 1));
      if (face.IsNull()) continue;
      if (!mark.name.empty()) TDataStd_Name::Set(face, extended(mark.name));
      if (mark.colour) colours->SetColor(face, *mark.colour, XCAFDoc_ColorSurf);
    }
    TopTools_IndexedMapOfShape solids;
    TopExp::MapShapes(part.shape, TopAbs_SOLID, solids);
    for (int i = 0; i < static_cast<int>(part.solid_names.size()); ++i) {
      if (part.solid_names[i].empty()) continue;
      const TDF_Label solid = shapes->AddSubShape(label, solids(i + 1));
      if (!solid.IsNull()) TDataStd_Name::Set(solid, extended(part.solid_names[i]));
    }
    if (!assembly.IsNull()) {
      const TDF_Label component = shapes->AddComponent(assembly, label, TopLoc_Location());
      TDataStd_Name::Set(component, extended(part.place.empty() ? part.name : part.place));
    }
  }
  shapes->UpdateAssemblies();
  Interface_Static::SetCVal("write.step.unit", Interface_Static::CVal("xstep.cascade.unit"));
  Interface_Static::SetIVal("write.precision.mode", 2);
  Interface_Static::SetRVal("write.precision.val", uncertainty_of(document));
  STEPCAFControl_Writer writer;
  writer.SetColorMode(true);
  writer.SetNameMode(true);
  Interface_Static::SetIVal("write.stepcaf.subshapes.name", 1);  // names of faces
  if (!writer.Transfer(open.get(), STEPControl_AsIs)) {
    throw Error(ErrorCode::internal, path.string() + ": OpenCASCADE could not make a STEP file of the model");
  }
  if (!document.derivation.empty()) describe(writer.ChangeWriter(), document.derivation);
  if (writer.Write(path.c_str()) != IFSelect_RetDone) {
    throw Error(ErrorCode::internal, path.string() + ": OpenCASCADE could not write the file");
  }
}

}  // namespace

int face_count(const TopoDS_Shape& shape) {
  TopTools_IndexedMapOfShape faces;
  TopExp::MapShapes(shape, TopAbs_FACE, faces);
  return faces.Extent();
}

Model model_of(const Document& document, const std::string& name) {
  TopoDS_Compound all;
  const BRep_Builder builder;
  builder.MakeCompound(all);
  for (const Part& part : document.parts) builder.Add(all, part.shape);
  return make_model(all, name);
}

bool can_be_written(const std::filesystem::path& path) {
  const std::string extension = lower_case(path.extension().string());
  return extension == ".step" || extension == ".stp" || extension == ".brep";
}

Document read_document(const std::filesystem::path& path, Reading how) {
  if (const std::string why = why_unreadable(path); !why.empty()) {
    throw Error(ErrorCode::not_found, path.string() + ": the CAD file cannot be opened: " + why);
  }
  silence_messages();
  Document document;
  Model reading;
  reading.name = path.string();
  const std::string extension = lower_case(path.extension().string());
  try {
    if (extension == ".step" || extension == ".stp") {
      const std::optional<WithoutMending> unmended =
          how == Reading::as_it_stands ? std::optional<WithoutMending>(std::in_place) : std::nullopt;
      read_step_parts(path, reading, document);
    } else {
      const TopoDS_Shape shape = read_shape(path, reading);
      if (!shape.IsNull() && face_count(shape) > 0) {
        document.parts.push_back({shape, path.stem().string(), std::nullopt, marks_of(reading, face_count(shape)), {}});
      }
    }
    for (Part& part : document.parts) settle(part, reading, how);
  } catch (const Standard_Failure& failure) {
    throw Error(ErrorCode::invalid_argument, reading.name + ": OpenCASCADE cannot read it: " + failure.GetMessageString());
  }
  if (document.parts.empty()) throw Error(ErrorCode::invalid_argument, reading.name + ": the CAD model has no faces");
  document.notes = reading.notes;
  return document;
}

void write_document(const Document& document, const std::filesystem::path& path) {
  if (!can_be_written(path))
    throw Error(ErrorCode::invalid_argument, path.string() + ": CAD models are written to .step, .stp and .brep");
  if (lower_case(path.extension().string()) != ".brep") return write_step(document, path);
  TopoDS_Shape shape = document.parts.front().shape;
  if (document.parts.size() > 1) {
    TopoDS_Compound all;
    const BRep_Builder builder;
    builder.MakeCompound(all);
    for (const Part& part : document.parts) builder.Add(all, part.shape);
    shape = all;
  }
  if (!write_brep(shape, document.derivation, path)) {
    throw Error(ErrorCode::internal, path.string() + ": OpenCASCADE could not write the file");
  }
}

}  // namespace deform::cad
