// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <TDocStd_Document.hxx>
#include <TopoDS_Shape.hxx>
#include <XCAFDoc_ColorTool.hxx>
#include <XCAFDoc_ShapeTool.hxx>
#include <optional>
#include <vector>

#include "core/cad/document.h"
#include "core/cad/model.h"

namespace deform::cad {

/// A document of OpenCASCADE, which holds shapes with their names and colours; it is closed when this goes.
class OpenDocument {
 public:
  OpenDocument();
  ~OpenDocument();
  OpenDocument(const OpenDocument&) = delete;
  OpenDocument& operator=(const OpenDocument&) = delete;
  const Handle(TDocStd_Document) & get() const { return document_; }
  Handle(XCAFDoc_ShapeTool) shapes() const;
  Handle(XCAFDoc_ColorTool) colours() const;

 private:
  Handle(TDocStd_Document) document_;
};

/// Appends the parts of a document, where they stand, with their names and colours and those of their faces.
void read_parts(const OpenDocument& open, Document& document);

/// The colours of the faces of a shape that was read together with a document, in their order: that of the face, else of its
/// solid or shell, else of its part where it stands. Nothing when none has one.
std::vector<std::optional<FaceColour>> colours_of_faces(const OpenDocument& open, const TopoDS_Shape& shape);

}  // namespace deform::cad
