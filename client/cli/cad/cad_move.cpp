// SPDX-License-Identifier: GPL-3.0-or-later
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "client/cli/commands/command.h"
#include "client/cli/commands/interrupt.h"
#include "client/cli/commands/mesh_reading.h"
#include "client/cli/output/format.h"
#include "client/cli/output/result_json.h"
#include "client/cli/setup/reading.h"
#include "core/base/number_text.h"
#include "core/base/text.h"
#include "core/cad/availability.h"
#include "core/cad/cad_move.h"

namespace deform::cli {

namespace {

struct CadMoveCommand {
  std::string mesh, output, setup, map, handle = "boundary";
  cad::MoveRequest request;
};

/// Columns kind (face, edge, vertex), before and after (numbers from 1).
std::vector<cad::ForcedPair> read_pairs(const std::string& path) {
  const Csv csv = read_csv(path);
  if (csv.header != std::vector<std::string>{"kind", "before", "after"}) {
    refuse(csv.name + ": the header line must be kind,before,after");
  }
  std::vector<cad::ForcedPair> pairs;
  for (const Csv::Row& row : csv.rows) {
    cad::ForcedPair pair;
    const std::string& kind = row.fields[0];
    if (kind == "edge") pair.kind = cad::ForcedPair::Kind::edge;
    if (kind == "vertex") pair.kind = cad::ForcedPair::Kind::vertex;
    if (kind != "face" && kind != "edge" && kind != "vertex") {
      refuse(csv.where(row, 0) + "\"" + kind + "\" is none of face, edge, vertex");
    }
    for (const std::size_t column : {1, 2}) {
      const double number = csv.number(row, column);
      if (!(number >= 1 && number <= 1e9) || number != static_cast<int>(number)) {
        refuse(csv.where(row, column) + "\"" + row.fields[column] + "\" is no number of an entity, they count from 1");
      }
      (column == 1 ? pair.before : pair.after) = static_cast<int>(number);
    }
    pairs.push_back(pair);
  }
  return pairs;
}

bool writes_motions(const std::string& output) { return std::filesystem::path(output).extension() == ".csv"; }

std::string motions_text(const cad::CarriedNodes& carried, const Mesh& mesh, const std::string& handle) {
  std::string text = "handle,point,dx,dy,dz\n";
  for (std::size_t i = 0; i < carried.nodes.size(); ++i) {
    text += handle + "," + std::to_string(carried.nodes[i]);
    for (int k = 0; k < 3; ++k) text += "," + number_digits(carried.places[i][k] - mesh.points[carried.nodes[i]][k]);
    text += "\n";
  }
  return text;
}

/// A surface mesh is done, points without a face stay; of volume meshes the interior must follow.
void write_moved_mesh(const CadMoveCommand& options, const io::MeshFile& file, const cad::CarriedNodes& carried) {
  const Mesh& mesh = *file.mesh();
  if (mesh.cell_count() > 0 && carried.nodes.size() != mesh.point_count()) {
    refuse(
        "--output: " + std::to_string(mesh.point_count() - carried.nodes.size()) + " of " + std::to_string(mesh.point_count()) +
        " points of the mesh are not on its boundary, and follow only by a method: write motions (.csv) with --setup, then run "
        "deform apply SETUP --motions FILE");
  }
  io::check_output(options.mesh, options.output);
  Points moved = mesh.points;
  for (std::size_t i = 0; i < carried.nodes.size(); ++i) moved[carried.nodes[i]] = carried.places[i];
  io::write_mesh_file(file, moved, options.output);
}

std::string quoted_yaml(const std::string& text) { return nlohmann::json(text).dump(); }

std::string cad_setup_text(const CadMoveCommand& options) {
  const auto folder = std::filesystem::absolute(options.setup).parent_path();
  const auto mesh = std::filesystem::absolute(options.mesh).lexically_proximate(folder);
  return "# The boundary is carried by motions, everything else follows: deform apply SETUP --motions FILE -o MESH\n"
         "geometry: " +
         quoted_yaml(mesh.string()) +
         "\n"
         "method:\n"
         "  rbf: {kernel: TRIHARMONIC}\n"
         "handles:\n"
         "  - name: " +
         quoted_yaml(options.handle) + "\n    region: {boundary: true}\n";
}

void print_carried(const cad::CarriedNodes& carried, const CadMoveCommand& options) {
  for (const std::string& note : carried.notes) std::cout << printable(note) << '\n';
  std::cout << "wrote " << printable(options.output) << ": " << carried.nodes.size() << " nodes, " << carried.on_vertices
            << " on vertices, " << carried.on_edges << " on edges, " << carried.on_faces << " in faces\n"
            << "  farthest from the old model " << number_text(carried.farthest) << ", from the new one "
            << number_text(carried.distance) << " (" << number_text(carried.distance / carried.diagonal) << " D, "
            << carried.checked << " nodes checked)\n"
            << "  flipped triangles: " << carried.flipped() << ", nodes outside of their face: " << carried.outside() << '\n';
  for (const cad::FaceOutcome& face : carried.faces) {
    if (face.flipped + face.outside == 0) continue;
    std::cout << "  face " << face.before << " (" << face.type << ") to face " << face.after << ": " << face.flipped << " of "
              << face.triangles << " triangles flipped, " << face.outside << " of " << face.nodes << " nodes outside\n";
  }
  std::cout.flush();
}

nlohmann::ordered_json carried_json(const cad::CarriedNodes& carried, const CadMoveCommand& options) {
  nlohmann::ordered_json json;
  json["file"] = options.output;
  json["nodes"] = carried.nodes.size();
  json["on_vertices"] = carried.on_vertices;
  json["on_edges"] = carried.on_edges;
  json["on_faces"] = carried.on_faces;
  json["diagonal"] = carried.diagonal;
  json["farthest"] = carried.farthest;
  json["distance"] = carried.distance;
  json["checked"] = carried.checked;
  json["flipped"] = carried.flipped();
  json["outside"] = carried.outside();
  json["notes"] = carried.notes;
  json["faces"] = nlohmann::ordered_json::array();
  for (const cad::FaceOutcome& face : carried.faces) {
    json["faces"].push_back({{"before", face.before},
                             {"after", face.after},
                             {"type", face.type},
                             {"nodes", face.nodes},
                             {"triangles", face.triangles},
                             {"max_displacement", face.largest},
                             {"flipped", face.flipped},
                             {"outside", face.outside}});
  }
  return json;
}

ExitCode run_cad_move(const CadMoveCommand& options, const CommonOptions& common) {
  cad::require();
  const std::filesystem::path before = options.request.before, after = options.request.after;
  keep_inputs("--output", options.output, {before, after, options.mesh, options.map});
  keep_inputs("--setup", options.setup, {before, after, options.mesh, options.map, options.output});
  if (options.handle.find_first_of(",\"\n\r") != std::string::npos) refuse("--handle: no commas, quotes and ends of lines");
  cad::MoveRequest request = options.request;
  if (!options.map.empty()) request.pairs = read_pairs(options.map);
  const Interrupt interrupt;
  const auto file = io::read_mesh_file(options.mesh, own_process(interrupt.token()));
  RunContext context;
  context.stop = interrupt.token();
  const cad::CarriedNodes carried = cad::carry_nodes(*file->mesh(), request, context);
  if (writes_motions(options.output)) {
    io::write_file(options.output, motions_text(carried, *file->mesh(), options.handle));
  } else {
    write_moved_mesh(options, *file, carried);
  }
  if (!options.setup.empty()) io::write_file(options.setup, cad_setup_text(options));
  if (common.style() == Style::json) {
    print(carried_json(carried, options));
  } else {
    print_carried(carried, options);
  }
  return carried.flipped() + carried.outside() > 0 ? exit_verdict : exit_ok;
}

constexpr char cad_move_footer[] =
    R"(The nodes on the boundary of MESH, which lies on the CAD model BEFORE, go to the model AFTER: those on vertices to the partners of
these, those on edges along them, those in faces by a warp of (u, v). Partners are found by structure; models that differ in it, or fit in
more than one way, are refused. A map is a CSV with the columns kind (face, edge, vertex), before and after, numbers from 1.
Nothing is asked of a server. Exit code 4: triangles are flipped, or nodes left their face; the file is written all the same.
CAD files: .step .stp .iges .igs .brep. The command needs a program that was built with OpenCASCADE (-DDEFORM_WITH_CAD=ON).
Examples:
  deform cad-move old.step new.step wing.stl -o moved.stl
  deform cad-move old.step new.step wing.msh -o motions.csv --setup wing.yaml
  deform apply wing.yaml --motions motions.csv -o moved.msh)";

}  // namespace

void add_cad_move_command(CLI::App& app, const CommonOptions& common, Action& chosen) {
  const auto options = std::make_shared<CadMoveCommand>();
  auto* command =
      app.add_subcommand("cad-move", "Carry the boundary of a mesh from one CAD model to another of the same structure");
  command->add_option("BEFORE", options->request.before, "CAD model on which the mesh lies")->required();
  command->add_option("AFTER", options->request.after, "CAD model to which it goes")->required();
  command->add_option("MESH", options->mesh, "Mesh file")->required();
  command->add_option("-o,--output", options->output, "File to write: .csv of motions, or the moved mesh in its format")
      ->required();
  command->add_option("--setup", options->setup, "Setup file to write, for deform apply --motions");
  command->add_option("--handle", options->handle, "Name of the handle in motions and setup")->capture_default_str();
  command->add_option("--map", options->map, "CSV of partners that are given instead of found");
  command->add_option("--scale", options->request.scale, "Factor from the unit of the CAD models to that of the mesh")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  command
      ->add_option("--tolerance", options->request.tolerance,
                   "Largest distance of a node from the old model, model units; 0: automatic, 1e-4 D")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  command->footer(cad_move_footer);
  command->callback([options, &common, &chosen] { chosen = [options, &common] { return run_cad_move(*options, common); }; });
}

}  // namespace deform::cli
