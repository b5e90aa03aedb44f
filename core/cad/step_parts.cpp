// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/cad/step_parts.h"

#include <Quantity_ColorRGBA.hxx>
#include <TDF_Label.hxx>
#include <TDF_LabelSequence.hxx>
#include <TDataStd_Name.hxx>
#include <TopExp.hxx>
#include <TopTools_IndexedMapOfShape.hxx>
#include <XCAFApp_Application.hxx>
#include <XCAFDoc_DocumentTool.hxx>
#include <algorithm>
#include <string>
#include <utility>

namespace deform::cad {

namespace {

std::string name_of(const TDF_Label& label) {
  Handle(TDataStd_Name) name;
  if (!label.FindAttribute(TDataStd_Name::GetID(), name)) return {};
  const TCollection_ExtendedString& text = name->Get();
  std::string utf8(static_cast<std::size_t>(text.LengthOfCString()), '\0');
  Standard_PCharacter start = utf8.data();
  text.ToUTF8CString(start);
  return utf8;
}

/// The parts of a document, where they stand.
class PartReader {
 public:
  PartReader(const OpenDocument& open, Document& document)
      : shapes_(open.shapes()), colours_(open.colours()), document_(document) {}

  void read() {
    TDF_LabelSequence roots;
    shapes_->GetFreeShapes(roots);
    for (int i = 1; i <= roots.Length(); ++i) {
      if (roots.Length() == 1 && XCAFDoc_ShapeTool::IsAssembly(roots(i))) document_.name = name_of(roots(i));
      add(roots(i), Place());
    }
  }

 private:
  using Colour = std::optional<Quantity_ColorRGBA>;

  Colour colour_of(const TDF_Label& label) const {
    Quantity_ColorRGBA colour;
    for (const XCAFDoc_ColorType type : {XCAFDoc_ColorSurf, XCAFDoc_ColorGen}) {
      if (colours_->GetColor(label, type, colour)) return colour;
    }
    return std::nullopt;
  }

  /// Where a shape stands, and what the assemblies around it give it.
  struct Place {
    TopLoc_Location location;
    std::string name;   ///< of the place of a part in the innermost assembly
    Colour overriding;  ///< of the outermost place that has one
    Colour inherited;   ///< of the innermost assembly that has one
  };

  void add(const TDF_Label& label, Place place) {
    if (XCAFDoc_ShapeTool::IsReference(label)) {
      TDF_Label referred;
      XCAFDoc_ShapeTool::GetReferredShape(label, referred);
      place.location = place.location * XCAFDoc_ShapeTool::GetLocation(label);
      place.name = name_of(label);
      if (!place.overriding) place.overriding = colour_of(label);
      add(referred, std::move(place));
    } else if (XCAFDoc_ShapeTool::IsAssembly(label)) {
      if (const Colour own = colour_of(label)) place.inherited = own;
      TDF_LabelSequence components;
      XCAFDoc_ShapeTool::GetComponents(label, components);
      for (int i = 1; i <= components.Length(); ++i) add(components(i), place);
    } else {
      add_part(label, place);
    }
  }

  void add_part(const TDF_Label& label, const Place& place) {
    const TopoDS_Shape shape = XCAFDoc_ShapeTool::GetShape(label);
    if (shape.IsNull() || face_count(shape) == 0) return;
    const Colour own = colour_of(label);
    const Colour colour = place.overriding ? place.overriding : own ? own : place.inherited;
    Part part{shape.Moved(place.location), name_of(label), colour, {}, place.name};
    TopTools_IndexedMapOfShape faces;
    TopExp::MapShapes(shape, TopAbs_FACE, faces);
    TDF_LabelSequence marked;
    XCAFDoc_ShapeTool::GetSubShapes(label, marked);
    for (int i = 1; i <= marked.Length(); ++i) {
      const TopoDS_Shape sub = XCAFDoc_ShapeTool::GetShape(marked(i));
      if (sub.ShapeType() == TopAbs_FACE) mark(part, faces, sub, name_of(marked(i)), colour_of(marked(i)));
    }
    for (int i = 1; i <= marked.Length(); ++i) {  // a solid or shell gives its colour to its faces that have none
      const TopoDS_Shape sub = XCAFDoc_ShapeTool::GetShape(marked(i));
      const Colour given = colour_of(marked(i));
      if (sub.ShapeType() == TopAbs_FACE || !given) continue;
      TopTools_IndexedMapOfShape inside;
      TopExp::MapShapes(sub, TopAbs_FACE, inside);
      for (int f = 1; f <= inside.Extent(); ++f) mark(part, faces, inside(f), "", given);
    }
    name_solids(part, marked);
    document_.parts.push_back(std::move(part));
  }

  /// marked: labels of shapes in the part, where it stands in its own place.
  static void name_solids(Part& part, const TDF_LabelSequence& marked) {
    TopTools_IndexedMapOfShape solids;
    TopExp::MapShapes(part.shape, TopAbs_SOLID, solids);
    for (int i = 1; i <= marked.Length(); ++i) {
      const TopoDS_Shape sub = XCAFDoc_ShapeTool::GetShape(marked(i));
      const int s = sub.ShapeType() == TopAbs_SOLID ? solids.FindIndex(sub.Moved(part.shape.Location())) - 1 : -1;
      if (s < 0 || name_of(marked(i)).empty()) continue;
      part.solid_names.resize(solids.Extent());
      part.solid_names[s] = name_of(marked(i));
    }
  }

  static void mark(Part& part, const TopTools_IndexedMapOfShape& faces, const TopoDS_Shape& face, const std::string& name,
                   const Colour& colour) {
    const int f = faces.FindIndex(face) - 1;
    if (f < 0 || (name.empty() && !colour)) return;
    for (FaceMark& known : part.faces) {
      if (known.face != f) continue;
      if (!name.empty()) known.name = name;
      if (!known.colour) known.colour = colour;
      return;
    }
    part.faces.push_back({f, name, colour});
  }

  const Handle(XCAFDoc_ShapeTool) shapes_;
  const Handle(XCAFDoc_ColorTool) colours_;
  Document& document_;
};

FaceColour channels_of(const Quantity_ColorRGBA& colour) {
  FaceColour channels{};
  colour.GetRGB().Values(channels[0], channels[1], channels[2], Quantity_TOC_sRGB);
  channels[3] = colour.Alpha();
  return channels;
}

}  // namespace

OpenDocument::OpenDocument() { XCAFApp_Application::GetApplication()->NewDocument("MDTV-XCAF", document_); }
OpenDocument::~OpenDocument() { XCAFApp_Application::GetApplication()->Close(document_); }
Handle(XCAFDoc_ShapeTool) OpenDocument::shapes() const { return XCAFDoc_DocumentTool::ShapeTool(document_->Main()); }
Handle(XCAFDoc_ColorTool) OpenDocument::colours() const { return XCAFDoc_DocumentTool::ColorTool(document_->Main()); }

void read_parts(const OpenDocument& open, Document& document) { PartReader(open, document).read(); }

std::vector<std::optional<FaceColour>> colours_of_faces(const OpenDocument& open, const TopoDS_Shape& shape) {
  Document document;
  read_parts(open, document);
  TopTools_IndexedMapOfShape faces;
  TopExp::MapShapes(shape, TopAbs_FACE, faces);
  std::vector<std::optional<FaceColour>> found(faces.Extent());
  for (const Part& part : document.parts) {
    TopTools_IndexedMapOfShape own;
    TopExp::MapShapes(part.shape, TopAbs_FACE, own);
    std::vector<std::optional<Quantity_ColorRGBA>> colours(own.Extent(), part.colour);
    for (const FaceMark& mark : part.faces) {
      if (mark.colour) colours[mark.face] = mark.colour;
    }
    for (int i = 1; i <= own.Extent(); ++i) {
      const int f = faces.FindIndex(own(i)) - 1;
      if (f >= 0 && colours[i - 1]) found[f] = channels_of(*colours[i - 1]);
    }
  }
  if (std::none_of(found.begin(), found.end(), [](const auto& colour) { return colour.has_value(); })) found.clear();
  return found;
}

}  // namespace deform::cad
