// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/mesh/inspect.h"

#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <iomanip>
#include <iostream>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>

#include "client/cli/commands/command.h"
#include "client/cli/commands/mesh_reading.h"
#include "client/cli/output/format.h"
#include "client/cli/output/result_json.h"
#include "core/base/model_size.h"
#include "core/base/text.h"
#include "core/mesh/elements.h"

namespace deform::cli {

namespace {

struct InspectOptions {
  std::string file;
};

std::map<std::string, std::size_t> elements_by_type(const Elements& elements) {
  std::map<std::string, std::size_t> counts;
  for (const ElementType type : elements.types) ++counts[shape(type).name];
  return counts;
}

nlohmann::ordered_json report_json(const MeshReport& report, const Mesh& mesh, const std::string& file) {
  nlohmann::ordered_json json;
  json["file"] = file;
  json["points"] = report.points;
  json["faces"] = report.faces;
  json["corners"] = report.corners;
  json["triangles"] = report.triangles;
  json["quads"] = report.quads;
  json["other_faces"] = report.other_faces;
  json["box_min"] = report.box.min;
  json["box_max"] = report.box.max;
  json["diagonal"] = report.box.diagonal();
  if (const ModelSize size = model_size(mesh.points); !size.stray.empty()) json["warning"] = size.stray;
  if (const std::size_t cells = mesh.cell_count(); cells > 0) json["cells"] = cells;
  if (mesh.elements) json["elements"] = elements_by_type(*mesh.elements);
  json["components"] = report.components;
  json["edges"] = report.edges;
  json["boundary_edges"] = report.boundary_edges;
  json["non_manifold_edges"] = report.non_manifold_edges;
  json["inconsistent_edges"] = report.inconsistent_edges;
  json["non_manifold_points"] = report.non_manifold_points;
  json["degenerate_faces"] = report.degenerate_faces;
  json["isolated_points"] = report.isolated_points;
  json["coincident_points"] = report.coincident_points;
  json["groups"] = nlohmann::ordered_json::array();
  for (const auto& group : report.groups) {
    json["groups"].push_back({{"name", group.name}, {"points", group.points}, {"faces", group.faces}});
  }
  return json;
}

void line(const char* label, const std::string& value) {
  std::cout << "  " << std::left << std::setw(22) << label << value << '\n';
}

std::string vector_text(const Vec3& v) {
  return "[" + number_text(v[0]) + ", " + number_text(v[1]) + ", " + number_text(v[2]) + "]";
}

std::string cells_text(const Mesh& mesh) {
  std::string text = std::to_string(mesh.cell_count());
  if (!mesh.elements) return text + " by their faces";
  std::string types;
  for (const auto& [type, count] : elements_by_type(*mesh.elements)) {
    types += (types.empty() ? "" : ", ") + std::to_string(count) + " " + type;
  }
  return text + " (" + types + ")";
}

void print_report(const MeshReport& report, const Mesh& mesh, const std::string& file) {
  std::cout << printable(file) << '\n';
  line("points", std::to_string(report.points));
  line("faces", std::to_string(report.faces) + " (" + std::to_string(report.triangles) + " triangles, " +
                    std::to_string(report.quads) + " quads, " + std::to_string(report.other_faces) + " others)");
  if (mesh.cell_count() > 0) line("cells", cells_text(mesh));
  line("box", vector_text(report.box.min) + " to " + vector_text(report.box.max));
  line("diagonal D", number_text(report.box.diagonal()));
  if (const ModelSize size = model_size(mesh.points); !size.stray.empty()) line("warning", size.stray);
  line("components", std::to_string(report.components));
  line("edges", std::to_string(report.edges));
  line("boundary edges", std::to_string(report.boundary_edges));
  line("non-manifold edges", std::to_string(report.non_manifold_edges));
  line("inconsistent edges", std::to_string(report.inconsistent_edges));
  line("non-manifold points", std::to_string(report.non_manifold_points));
  line("degenerate faces", std::to_string(report.degenerate_faces));
  line(mesh.cell_count() > 0 ? "points in no face" : "isolated points", std::to_string(report.isolated_points));
  line("coincident points", std::to_string(report.coincident_points));
  if (!report.groups.empty()) std::cout << "  groups\n";
  for (const auto& group : report.groups) {
    std::cout << "    " << std::left << std::setw(20) << printable(group.name) << group.points << " points, " << group.faces
              << " faces\n";
  }
  std::cout << std::flush;
}

ExitCode run_inspect(const InspectOptions& options, const CommonOptions& common) {
  const auto file = io::read_mesh_file(options.file, own_process());
  const auto mesh = file->mesh();
  const MeshReport report = inspect(*mesh);
  if (common.style() == Style::json) {
    print(report_json(report, *mesh, options.file));
  } else {
    print_report(report, *mesh, options.file);
  }
  return exit_ok;
}

}  // namespace

void add_inspect_command(CLI::App& app, const CommonOptions& common, Action& chosen) {
  const auto options = std::make_shared<InspectOptions>();
  auto* command = app.add_subcommand("inspect", "Show what a mesh file contains; needs no server");
  command->add_option("FILE", options->file, "Mesh: " + io::mesh_file_names())->required();
  command->callback([options, &common, &chosen] { chosen = [options, &common] { return run_inspect(*options, common); }; });
}

}  // namespace deform::cli
