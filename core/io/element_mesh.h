#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "core/io/mesh_file.h"
#include "core/mesh/elements.h"

namespace deform::io {

/// What a reader of a finite-element format collects: points, elements, and named surface elements.
struct ElementMesh {
  struct Face {
    std::vector<PointId> corners;
    std::string name;  ///< of the group it belongs to
  };
  std::vector<Vec3> points;
  Elements elements;
  std::vector<std::string> volume_names;  ///< of the elements' groups; one per element
  std::vector<Face> faces;
};

/// A file of it. Its faces are those of the boundary of the elements, or the surface elements where there are no others; a
/// surface element that is a face of the boundary belongs to its group as a face, any other with its points. Groups of elements
/// hold their points; they are left out when there is one only. `make` makes the part that writes points. Throws
/// Error(invalid_argument) naming the file.
std::unique_ptr<MeshFile> with_elements(ElementMesh&& source, const std::string& name,
                                        const std::function<std::unique_ptr<MeshFile>(std::shared_ptr<const Mesh>)>& make);

}  // namespace deform::io
