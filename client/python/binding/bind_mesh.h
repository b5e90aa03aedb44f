// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <pybind11/pybind11.h>

#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "core/io/mesh_file.h"
#include "core/mesh/mesh.h"
#include "deform/v1/setup.pb.h"

namespace deform::python {

namespace py = pybind11;

/// A mesh, and the file that it was read from, if it was.
struct MeshSource {
  std::shared_ptr<const Mesh> mesh;
  std::shared_ptr<const io::MeshFile> file;
  std::filesystem::path path;
};

/// A setup as it is sent, and the mesh file that it named.
struct ReadSetup {
  v1::Setup setup;
  std::optional<std::filesystem::path> geometry_file;
};

void bind_meshes(py::module_& module);
void bind_setups(py::module_& module);

}  // namespace deform::python
