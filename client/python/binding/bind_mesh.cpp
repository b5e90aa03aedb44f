// SPDX-License-Identifier: Apache-2.0
#include "client/python/binding/bind_mesh.h"

#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <utility>
#include <vector>

#include "client/python/binding/arrays.h"
#include "client/python/binding/calls.h"
#include "client/python/binding/record.h"
#include "client/setup/setup_file.h"
#include "core/mesh/elements.h"

namespace deform::python {

namespace {

MeshSource read_mesh(const std::filesystem::path& path, const std::string& isolated_reader, const CallLimits& limits) {
  return run_call(limits, [&](const client::CallOptions& call) {
    io::ReadOptions options;
    options.isolated_reader = {isolated_reader};
    options.stop = call.stop;
    const std::shared_ptr<const io::MeshFile> file = io::read_mesh_file(path, options);
    return MeshSource{file->mesh(), file, path};
  });
}

template <typename Id>
std::vector<Id> copied(const Ids& ids, const std::string& what) {
  const auto view = ids_view(ids, what);
  return {view.begin(), view.end()};
}

std::shared_ptr<const Elements> elements_of(const py::array_t<std::uint8_t>& types, const Ids& points) {
  if (types.size() == 0) return nullptr;
  auto elements = std::make_shared<Elements>();
  const auto nodes = ids_view(points, "element_points");
  std::size_t first = 0;
  for (py::ssize_t i = 0; i < types.size(); ++i) {
    const std::string what = "element_types[" + std::to_string(i) + "]";
    if (types.at(i) >= element_types) throw Error(ErrorCode::invalid_argument, what + ": no element type");
    const auto type = static_cast<ElementType>(types.at(i));
    if (nodes.size() - first < shape(type).nodes)
      throw Error(ErrorCode::invalid_argument, what + ": element_points ends before it");
    elements->add(type, nodes.subspan(first, shape(type).nodes));
    first += shape(type).nodes;
  }
  if (first != nodes.size()) throw Error(ErrorCode::invalid_argument, "element_points: longer than its elements");
  return elements;
}

struct Arrays {
  Doubles points;
  Ids face_sizes, face_points;
  py::array_t<std::uint8_t> element_types;
  Ids element_points;
};

MeshSource mesh_from_arrays(const Arrays& arrays, const std::vector<std::tuple<std::string, Ids, Ids>>& groups) {
  auto mesh = std::make_shared<Mesh>();
  const auto points = points_view(arrays.points, "points");
  mesh->points.assign(points.begin(), points.end());
  mesh->face_sizes = copied<std::uint32_t>(arrays.face_sizes, "face_sizes");
  mesh->face_points = copied<PointId>(arrays.face_points, "face_points");
  for (const auto& [name, point_ids, face_ids] : groups) {
    mesh->groups.push_back(
        {name, copied<PointId>(point_ids, "group \"" + name + "\""), copied<FaceId>(face_ids, "group \"" + name + "\"")});
  }
  mesh->elements = elements_of(arrays.element_types, arrays.element_points);
  const py::gil_scoped_release release;
  if (mesh->elements && mesh->face_sizes.empty()) {
    mesh->elements->validate(mesh->points.size());
    BoundaryFaces boundary = boundary_faces(*mesh->elements);
    mesh->face_sizes = std::move(boundary.sizes);
    mesh->face_points = std::move(boundary.points);
  }
  mesh->validate();
  return {mesh, nullptr, {}};
}

py::dict groups_of(const MeshSource& source) {
  py::dict groups;
  for (const auto& group : source.mesh->groups) {
    groups[py::str(group.name)] = py::make_tuple(ids_array(group.points), ids_array(group.faces));
  }
  return groups;
}

void write_mesh(const MeshSource& source, const std::filesystem::path& path, const Doubles& points) {
  const auto view = points_view(points, "points");
  const py::gil_scoped_release release;
  if (source.file) {
    io::check_output(source.path, path);
    return io::write_mesh_file(*source.file, view, path);
  }
  if (view.size() != source.mesh->point_count()) {
    throw Error(ErrorCode::invalid_argument,
                "points: " + std::to_string(view.size()) + ", the geometry has " + std::to_string(source.mesh->point_count()));
  }
  Mesh moved = *source.mesh;
  moved.points.assign(view.begin(), view.end());
  moved.validate();
  io::write_new_file(moved, path);
}

ReadSetup taken(client::SetupFile&& file) { return {std::move(file.setup), std::move(file.geometry_file)}; }

client::GeometryEntry entry(bool given) { return given ? client::GeometryEntry::left_out : client::GeometryEntry::needed; }

}  // namespace

void bind_meshes(py::module_& module) {
  py::class_<MeshSource>(module, "Mesh")
      .def_static("read", &read_mesh, py::arg("path"), py::arg("isolated_reader"), py::arg("limits"))
      .def_static(
          "from_arrays",
          [](const Doubles& points, const Ids& face_sizes, const Ids& face_points,
             const std::vector<std::tuple<std::string, Ids, Ids>>& groups, const py::array_t<std::uint8_t>& element_types,
             const Ids& element_points) {
            return mesh_from_arrays({points, face_sizes, face_points, element_types, element_points}, groups);
          },
          py::arg("points"), py::arg("face_sizes"), py::arg("face_points"), py::arg("groups"), py::arg("element_types"),
          py::arg("element_points"))
      .def_property_readonly("points", [](const MeshSource& source) { return points_array(source.mesh, source.mesh->points); })
      .def_property_readonly("face_sizes", [](const MeshSource& source) { return ids_array(source.mesh->face_sizes); })
      .def_property_readonly("face_points", [](const MeshSource& source) { return ids_array(source.mesh->face_points); })
      .def_property_readonly("groups", &groups_of)
      .def_property_readonly("cell_count", [](const MeshSource& source) { return source.mesh->cell_count(); })
      .def("replaced_by",
           [](const MeshSource& source, const std::filesystem::path& path) {
             return source.file ? io::replaced_source(source.path, path) : std::nullopt;
           })
      .def("write", &write_mesh, py::arg("path"), py::arg("points"));
}

void bind_setups(py::module_& module) {
  py::class_<ReadSetup>(module, "Setup")
      .def_static(
          "read",
          [](const std::filesystem::path& path, bool geometry_given) {
            const py::gil_scoped_release release;
            Problems problems(Problems::Mode::throw_first);
            constexpr std::size_t max_bytes = std::size_t{1} << 26;
            return taken(client::parse_setup(
                {io::read_file(path, nullptr, max_bytes), path.string(), path.parent_path(), entry(geometry_given)}, problems));
          },
          py::arg("path"), py::arg("geometry_given"))
      .def_static(
          "parse",
          [](const std::string& text, const std::string& name, const std::filesystem::path& folder, bool geometry_given) {
            const py::gil_scoped_release release;
            Problems problems(Problems::Mode::throw_first);
            return taken(client::parse_setup({text, name, folder, entry(geometry_given)}, problems));
          },
          py::arg("text"), py::arg("name"), py::arg("folder"), py::arg("geometry_given"))
      .def_readonly("geometry_file", &ReadSetup::geometry_file)
      .def_property(
          "geometry", [](const ReadSetup& setup) { return setup.setup.geometry(); },
          [](ReadSetup& setup, const std::string& id) { setup.setup.set_geometry(id); })
      .def_property_readonly("record", [](const ReadSetup& setup) { return Record(setup.setup); });
}

}  // namespace deform::python
