// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/cad/model.h"

#include <APIHeaderSection_MakeHeader.hxx>
#include <BRepAdaptor_Curve.hxx>
#include <BRepAdaptor_Surface.hxx>
#include <BRepBndLib.hxx>
#include <BRepBuilderAPI_MakeSolid.hxx>
#include <BRepBuilderAPI_Sewing.hxx>
#include <BRepBuilderAPI_Transform.hxx>
#include <BRepCheck_Analyzer.hxx>
#include <BRepLib.hxx>
#include <BRepTools.hxx>
#include <BRepTools_History.hxx>
#include <BRepTopAdaptor_FClass2d.hxx>
#include <BRep_Builder.hxx>
#include <BRep_Tool.hxx>
#include <Bnd_Box.hxx>
#include <IGESCAFControl_Reader.hxx>
#include <IGESControl_Reader.hxx>
#include <IGESData_IGESEntity.hxx>
#include <IGESData_IGESModel.hxx>
#include <Interface_Static.hxx>
#include <Message.hxx>
#include <Message_Messenger.hxx>
#include <Message_Printer.hxx>
#include <STEPCAFControl_Reader.hxx>
#include <STEPControl_Controller.hxx>
#include <STEPControl_Reader.hxx>
#include <ShapeFix_Shape.hxx>
#include <ShapeUpgrade_UnifySameDomain.hxx>
#include <Standard_Failure.hxx>
#include <StepRepr_RepresentationItem.hxx>
#include <TColStd_SequenceOfAsciiString.hxx>
#include <TCollection_HAsciiString.hxx>
#include <TopExp.hxx>
#include <TopExp_Explorer.hxx>
#include <TopTools_ListOfShape.hxx>
#include <TopoDS.hxx>
#include <TopoDS_Compound.hxx>
#include <TopoDS_Iterator.hxx>
#include <TopoDS_Shell.hxx>
#include <TopoDS_Solid.hxx>
#include <Transfer_TransientProcess.hxx>
#include <XSControl_TransferReader.hxx>
#include <XSControl_WorkSession.hxx>
#include <algorithm>
#include <array>
#include <fstream>
#include <utility>

#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/base/small_file.h"
#include "core/base/text.h"
#include "core/cad/availability.h"
#include "core/cad/step_parts.h"

namespace deform::cad {

namespace {

constexpr const char* surface_names[] = {"plane",    "cylinder",   "cone",      "sphere", "torus",  "Bezier surface",
                                         "B-spline", "revolution", "extrusion", "offset", "surface"};

struct Unit {
  const char* name;  ///< in STEP and IGES files
  const char* code;  ///< of OpenCASCADE
  double metres;
};

constexpr std::array<Unit, 12> units{{{"millimetre", "MM", 1e-3},
                                      {"metre", "M", 1},
                                      {"centimetre", "CM", 1e-2},
                                      {"inch", "INCH", 0.0254},
                                      {"foot", "FT", 0.3048},
                                      {"kilometre", "KM", 1e3},
                                      {"micrometre", "UM", 1e-6},
                                      {"mm", "MM", 1e-3},
                                      {"m", "M", 1},
                                      {"cm", "CM", 1e-2},
                                      {"in", "INCH", 0.0254},
                                      {"ft", "FT", 0.3048}}};

/// The diagonal of the bounding box of points on edges and faces. BRepBndLib's exact box of splines takes seconds.
double diagonal_of(const Model& model) {
  Bnd_Box box;
  constexpr int pieces = 64, across = 24;
  for (int e = 0; e < model.edge_count(); ++e) {
    if (BRep_Tool::Degenerated(model.edge(e))) continue;
    const BRepAdaptor_Curve curve(model.edge(e));
    const double from = curve.FirstParameter(), to = curve.LastParameter();
    const int steps = curve.GetType() == GeomAbs_Line ? 1 : pieces;
    for (int k = 0; k <= steps; ++k) box.Add(curve.Value(from + (to - from) * k / steps));
  }
  for (int f = 0; f < model.face_count(); ++f) {
    const BRepAdaptor_Surface surface(model.face(f));
    if (surface.GetType() == GeomAbs_Plane) continue;
    const double u0 = surface.FirstUParameter(), u1 = surface.LastUParameter();
    const double v0 = surface.FirstVParameter(), v1 = surface.LastVParameter();
    const BRepTopAdaptor_FClass2d region(model.face(f), 1e-7);
    for (int i = 0; i <= across; ++i) {
      for (int j = 0; j <= across; ++j) {
        const gp_Pnt2d at(u0 + (u1 - u0) * i / across, v0 + (v1 - v0) * j / across);
        const gp_Pnt p = surface.Value(at.X(), at.Y());
        Bnd_Box wider = box;
        wider.Add(p);
        if (wider.SquareExtent() > box.SquareExtent() && region.Perform(at) != TopAbs_OUT) box = wider;
      }
    }
  }
  return std::sqrt(box.SquareExtent());
}

[[noreturn]] void cannot_read(const std::string& name, const std::string& format) {
  throw Error(ErrorCode::invalid_argument, name + ": is no " + format + " file that can be read");
}

/// The description in the header of the file, in one line.
std::string description_of(const STEPControl_Reader& reader) {
  std::string text;
  const APIHeaderSection_MakeHeader header(reader.StepModel());
  for (int i = 1; i <= header.NbDescription(); ++i) {
    if (!header.DescriptionValue(i).IsNull()) text += header.DescriptionValue(i)->ToCString();
  }
  return text;
}

/// What a file calls an entity.
std::string name_of(const Handle(Standard_Transient) & entity) {
  Handle(TCollection_HAsciiString) name;
  if (const auto item = Handle(StepRepr_RepresentationItem)::DownCast(entity); !item.IsNull()) {
    name = item->Name();
  } else if (const auto sheet = Handle(IGESData_IGESEntity)::DownCast(entity); !sheet.IsNull()) {
    if (sheet->HasName()) name = sheet->NameValue();  // labels are mostly numbers that programs give
  }
  return name.IsNull() ? "" : name->ToCString();
}

/// Names of the faces in the order in which they are numbered; nothing when none has one.
std::vector<std::string> names_of_faces(const XSControl_Reader& reader, const TopoDS_Shape& shape) {
  TopTools_IndexedMapOfShape faces;
  TopExp::MapShapes(shape, TopAbs_FACE, faces);
  const auto transfer = reader.WS()->TransferReader();
  std::vector<std::string> names;
  bool any = false;
  for (int f = 1; f <= faces.Extent(); ++f) {
    Handle(Standard_Transient) entity = transfer->EntityFromShapeResult(faces(f), 1);
    if (entity.IsNull()) {  // of a part in an assembly
      entity = transfer->EntityFromShapeResult(faces(f).Located(TopLoc_Location()), 1);
    }
    names.push_back(name_of(entity));
    any = any || !names.back().empty();
  }
  if (!any) names.clear();
  return names;
}

TopoDS_Shape read_step(const std::filesystem::path& path, Model& model) {
  STEPCAFControl_Reader all;  // with colours
  all.SetColorMode(true);
  all.SetNameMode(false);
  all.SetLayerMode(false);
  all.SetPropsMode(false);
  all.SetGDTMode(false);
  all.SetMatMode(false);
  all.SetViewMode(false);
  if (all.ReadFile(path.c_str()) != IFSelect_RetDone) cannot_read(model.name, "STEP");
  STEPControl_Reader& reader = all.ChangeReader();
  TColStd_SequenceOfAsciiString lengths, angles, solid_angles;
  reader.FileUnits(lengths, angles, solid_angles);
  keep_unit(lengths.IsEmpty() ? "" : lengths.First().ToCString(), model);
  const OpenDocument open;
  Handle(TDocStd_Document) filled = open.get();
  all.Transfer(filled);
  const TopoDS_Shape shape = reader.OneShape();
  if (!shape.IsNull()) {
    model.face_names = names_of_faces(reader, shape);
    model.face_colours = colours_of_faces(open, shape);
  }
  model.derivation = description_of(reader);
  return shape;
}

/// What was sewn, with its closed shells as solids, whose outside is outside, but for those that lie in the box of another shell
/// and may be its cavity.
TopoDS_Shape with_solids(const TopoDS_Shape& sewn, int& solids) {
  std::vector<TopoDS_Shape> pieces;
  if (sewn.ShapeType() == TopAbs_COMPOUND) {
    for (TopoDS_Iterator piece(sewn); piece.More(); piece.Next()) pieces.push_back(piece.Value());
  } else {
    pieces.push_back(sewn);
  }
  std::vector<Bnd_Box> boxes;
  for (const TopoDS_Shape& piece : pieces) BRepBndLib::Add(piece, boxes.emplace_back());
  const auto inside = [](const Bnd_Box& box, const Bnd_Box& other) {
    return !other.IsOut(box.CornerMin()) && !other.IsOut(box.CornerMax());
  };
  for (std::size_t i = 0; i < pieces.size(); ++i) {
    if (pieces[i].ShapeType() != TopAbs_SHELL || !BRep_Tool::IsClosed(pieces[i])) continue;
    const auto nested = [&](const Bnd_Box& other) {
      return &other != &boxes[i] && (inside(boxes[i], other) || inside(other, boxes[i]));
    };
    if (std::any_of(boxes.begin(), boxes.end(), nested)) continue;
    TopoDS_Solid solid = BRepBuilderAPI_MakeSolid(TopoDS::Shell(pieces[i])).Solid();
    if (!BRepLib::OrientClosedSolid(solid)) continue;
    pieces[i] = solid;
    ++solids;
  }
  if (pieces.size() == 1) return pieces.front();
  TopoDS_Compound all;
  const BRep_Builder builder;
  builder.MakeCompound(all);
  for (const TopoDS_Shape& piece : pieces) builder.Add(all, piece);
  return all;
}

/// Names or colours of faces, after they were sewn together.
template <typename Mark>
void keep_marks(const std::vector<Mark>& marks, const TopoDS_Shape& read, const BRepBuilderAPI_Sewing& sewing,
                const TopoDS_Shape& sewn, std::vector<Mark>& kept) {
  if (marks.empty()) return;
  TopTools_IndexedMapOfShape faces, images;
  TopExp::MapShapes(read, TopAbs_FACE, faces);
  TopExp::MapShapes(sewn, TopAbs_FACE, images);
  kept.resize(images.Extent());
  for (int f = 0; f < faces.Extent(); ++f) {
    const TopoDS_Shape& face = faces(f + 1);
    const int i = images.FindIndex(sewing.IsModifiedSubShape(face) ? sewing.ModifiedSubShape(face) : face) - 1;
    if (i >= 0) kept[i] = marks[f];
  }
}

TopoDS_Shape read_iges(const std::filesystem::path& path, Model& model) {
  Handle(TCollection_HAsciiString) unit;
  {
    IGESControl_Reader header;
    if (header.ReadFile(path.c_str()) != IFSelect_RetDone) cannot_read(model.name, "IGES");
    unit = header.IGESModel()->GlobalSection().UnitName();
  }
  keep_unit(unit.IsNull() ? "" : unit->ToCString(), model);
  IGESCAFControl_Reader reader;  // when a file is loaded, it takes the unit of that moment
  reader.SetColorMode(true);
  reader.SetNameMode(false);
  reader.SetLayerMode(false);
  reader.ReadFile(path.c_str());
  const OpenDocument open;
  Handle(TDocStd_Document) filled = open.get();
  reader.Transfer(filled);
  Bnd_Box box;
  const TopoDS_Shape read = reader.OneShape();
  if (read.IsNull()) cannot_read(model.name, "IGES");
  BRepBndLib::Add(read, box);
  BRepBuilderAPI_Sewing sewing(box.IsVoid() ? 1e-6 : 1e-5 * std::sqrt(box.SquareExtent()));
  sewing.Add(read);
  sewing.Perform();
  int solids = 0;
  const TopoDS_Shape sewn = with_solids(sewing.SewedShape(), solids);
  keep_marks(names_of_faces(reader, read), read, sewing, sewn, model.face_names);
  keep_marks(colours_of_faces(open, read), read, sewing, sewn, model.face_colours);
  model.notes.push_back(model.name + ": faces were sewn together, " + std::to_string(sewing.NbFreeEdges()) + " edges stay free" +
                        (solids == 0   ? "."
                         : solids == 1 ? "; they bound a solid."
                                       : "; they bound " + std::to_string(solids) + " solids."));
  return sewn;
}

TopoDS_Shape read_brep(const std::filesystem::path& path, Model& model) {
  TopoDS_Shape shape;
  std::ifstream file(path);
  const std::string note = brep_note;
  std::string line;
  std::getline(file, line);
  while (std::getline(file, line) && line.rfind(note, 0) == 0) model.derivation += line.substr(note.size());
  file.clear();
  file.seekg(0);
  BRepTools::Read(shape, file, BRep_Builder());
  if (shape.IsNull()) cannot_read(model.name, "BREP");
  model.notes.push_back(model.name + " names no unit of length.");
  return shape;
}

/// What all faces have in common of which a face of the merged model was made, such as their name.
template <typename Mark>
void keep_common(const Model& model, const std::vector<Mark>& marks, const Model& merged,
                 const Handle(BRepTools_History) & history, std::vector<Mark>& kept) {
  if (marks.empty()) return;
  std::vector<std::optional<Mark>> common(merged.face_count());
  for (int f = 0; f < model.face_count(); ++f) {
    TopTools_ListOfShape images = history->Modified(model.faces(f + 1));
    if (images.IsEmpty()) images.Append(model.faces(f + 1));
    for (const TopoDS_Shape& image : images) {
      const int g = merged.faces.FindIndex(image) - 1;
      if (g < 0) continue;
      if (!common[g]) {
        common[g] = marks[f];
      } else if (*common[g] != marks[f]) {
        common[g] = Mark();
      }
    }
  }
  for (const std::optional<Mark>& mark : common) kept.push_back(mark.value_or(Mark()));
}

}  // namespace

bool available() { return true; }
void require() {}

TopoDS_Face Model::face(int f) const { return TopoDS::Face(faces(f + 1).Oriented(TopAbs_FORWARD)); }
int Model::face_sense(int f) const { return faces(f + 1).Orientation() == TopAbs_REVERSED ? -1 : 1; }
TopoDS_Edge Model::edge(int e) const { return TopoDS::Edge(edges(e + 1).Oriented(TopAbs_FORWARD)); }
TopoDS_Vertex Model::vertex(int v) const { return TopoDS::Vertex(vertices(v + 1)); }
std::string Model::face_name(int f) const { return "face " + std::to_string(f + 1) + " (" + surface_type(face(f)) + ")"; }

std::string surface_type(const TopoDS_Face& face) { return surface_names[BRepAdaptor_Surface(face, false).GetType()]; }

Model make_model(const TopoDS_Shape& shape, const std::string& name) {
  Model model;
  model.name = name;
  model.shape = shape;
  if (!shape.IsNull()) {
    TopExp::MapShapes(shape, TopAbs_SOLID, model.solids);
    TopExp::MapShapes(shape, TopAbs_FACE, model.faces);
    for (int f = 1; f <= model.faces.Extent(); ++f) {  // edges and vertices without a face carry no node
      TopExp::MapShapes(model.faces(f), TopAbs_WIRE, model.wires);
      TopExp::MapShapes(model.faces(f), TopAbs_EDGE, model.edges);
      TopExp::MapShapes(model.faces(f), TopAbs_VERTEX, model.vertices);
    }
  }
  if (model.face_count() == 0) throw Error(ErrorCode::invalid_argument, name + ": the CAD model has no faces");
  model.coedges.resize(model.face_count());
  for (int f = 0; f < model.face_count(); ++f) {
    const TopoDS_Face face = model.face(f);
    for (TopoDS_Iterator wire(face); wire.More(); wire.Next()) {
      if (wire.Value().ShapeType() != TopAbs_WIRE) continue;
      for (TopoDS_Iterator edge(wire.Value()); edge.More(); edge.Next()) {
        const TopoDS_Edge used = TopoDS::Edge(edge.Value());
        if (used.Orientation() != TopAbs_FORWARD && used.Orientation() != TopAbs_REVERSED) continue;
        model.coedges[f].push_back(
            {model.edges.FindIndex(used) - 1, used.Orientation() == TopAbs_FORWARD ? 1 : -1, BRep_Tool::IsClosed(used, face)});
      }
    }
  }
  model.diagonal = diagonal_of(model);
  return model;
}

void silence_messages() {
  for (const auto& printer : Message::DefaultMessenger()->Printers()) printer->SetTraceLevel(Message_Alarm);
  Message::DefaultMessenger()->ChangePrinters().Clear();
}

void keep_unit(const std::string& unit, Model& model) {
  STEPControl_Controller::Init();  // before it, there are no settings in a process
  for (const Unit& known : units) {
    if (lower_case(unit) != known.name) continue;
    Interface_Static::SetCVal("xstep.cascade.unit", known.code);
    model.unit = known.metres;
    model.notes.push_back(model.name + " is in " + lower_case(unit) + ".");
    return;
  }
  Interface_Static::SetCVal("xstep.cascade.unit", "MM");
  model.notes.push_back(model.name + " names no known unit of length; millimetres are taken.");
}

TopoDS_Shape healed(const TopoDS_Shape& shape, Model& model) {
  if (BRepCheck_Analyzer(shape, true, true).IsValid()) return shape;
  ShapeFix_Shape fix(shape);
  fix.Perform();
  model.face_names.clear();  // faces may stand elsewhere
  model.face_colours.clear();
  const bool valid = BRepCheck_Analyzer(fix.Shape(), true, true).IsValid();
  model.notes.push_back(model.name + " is not valid; " + (valid ? "it was healed." : "healing did not mend all of it."));
  return fix.Shape();
}

TopoDS_Shape read_shape(const std::filesystem::path& path, Model& model) {
  const std::string extension = lower_case(path.extension().string());
  if (extension == ".step" || extension == ".stp") return read_step(path, model);
  if (extension == ".iges" || extension == ".igs") return read_iges(path, model);
  if (extension == ".brep") return read_brep(path, model);
  throw Error(ErrorCode::invalid_argument, model.name + ": CAD models are read from .step, .stp, .iges, .igs and .brep");
}

Model read_model(const std::filesystem::path& path, double scale) {
  if (const std::string why = why_unreadable(path); !why.empty()) {
    throw Error(ErrorCode::not_found, path.string() + ": the CAD file cannot be opened: " + why);
  }
  silence_messages();
  Model reading;
  reading.name = path.string();
  try {
    TopoDS_Shape shape = read_shape(path, reading);
    if (shape.IsNull()) throw Error(ErrorCode::invalid_argument, reading.name + ": the CAD model is empty");
    shape = healed(shape, reading);
    if (scale != 1) {
      gp_Trsf scaling;
      scaling.SetScale(gp_Pnt(0, 0, 0), scale);
      shape = BRepBuilderAPI_Transform(shape, scaling, true).Shape();
      reading.notes.push_back(reading.name + " is multiplied by " + number_digits(scale) + ".");
    }
    Model model = make_model(shape, reading.name);
    model.notes = reading.notes;
    model.unit = reading.unit;
    model.scale = scale;
    model.derivation = reading.derivation;
    if (static_cast<int>(reading.face_names.size()) == model.face_count()) model.face_names = reading.face_names;
    if (static_cast<int>(reading.face_colours.size()) == model.face_count()) model.face_colours = reading.face_colours;
    return model;
  } catch (const Standard_Failure& failure) {
    throw Error(ErrorCode::invalid_argument, reading.name + ": OpenCASCADE cannot read it: " + failure.GetMessageString());
  }
}

Model unified(const Model& model) {
  ShapeUpgrade_UnifySameDomain unify(model.shape, true, true, false);
  unify.Build();
  Model merged = make_model(unify.Shape(), model.name);
  merged.notes = model.notes;
  merged.unit = model.unit;
  merged.scale = model.scale;
  keep_common(model, model.face_names, merged, unify.History(), merged.face_names);
  keep_common(model, model.face_colours, merged, unify.History(), merged.face_colours);
  if (merged.face_count() != model.face_count() || merged.edge_count() != model.edge_count()) {
    merged.numbered = false;
    merged.notes.push_back(model.name + ": " + std::to_string(model.face_count()) + " faces and " +
                           std::to_string(model.edge_count()) + " edges were merged to " + std::to_string(merged.face_count()) +
                           " and " + std::to_string(merged.edge_count()) + ", where neighbours lie on one surface or curve.");
  }
  return merged;
}

}  // namespace deform::cad
