// SPDX-License-Identifier: GPL-3.0-or-later
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <algorithm>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "client/cli/cad/program_with_cad.h"
#include "client/cli/commands/apply.h"
#include "client/cli/commands/command.h"
#include "client/cli/commands/interrupt.h"
#include "client/cli/commands/mesh_reading.h"
#include "client/cli/output/format.h"
#include "client/cli/output/result_json.h"
#include "client/cli/setup/reading.h"
#include "core/base/number_text.h"
#include "core/base/text.h"
#include "core/cad/cad_move.h"

namespace deform::cli {

namespace {

struct CadMoveCommand {
  std::string mesh, output, setup, map, handle = "boundary";
  cad::MoveRequest request;
  ApplyOptions apply;  ///< of volume meshes: how the interior follows
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

/// Where the motions go that the interior of a volume mesh follows: beside the setup.
std::string motions_beside(const std::string& setup) {
  return setup.empty() ? "" : std::filesystem::path(setup).replace_extension(".motions.csv").string();
}

/// Whether points of the mesh are off its boundary, which follow only by a method.
bool has_interior(const Mesh& mesh, const cad::CarriedNodes& carried) {
  return mesh.cell_count() > 0 && carried.nodes.size() != mesh.point_count();
}

std::string motions_text(const cad::CarriedNodes& carried, const Mesh& mesh, const std::string& handle) {
  std::string text = "handle,point,dx,dy,dz\n";
  for (std::size_t i = 0; i < carried.nodes.size(); ++i) {
    text += handle + "," + std::to_string(carried.nodes[i]);
    for (int k = 0; k < 3; ++k) text += "," + number_digits(carried.places[i][k] - mesh.points[carried.nodes[i]][k]);
    text += "\n";
  }
  return text;
}

/// A surface mesh is done, points without a face stay.
void write_moved_mesh(const CadMoveCommand& options, const io::MeshFile& file, const cad::CarriedNodes& carried) {
  io::check_output(options.mesh, options.output);
  Points moved = file.mesh()->points;
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

void print_carried(const cad::CarriedNodes& carried, const std::string& written) {
  for (const std::string& note : carried.notes) std::cout << printable(note) << '\n';
  std::cout << "wrote " << printable(written) << ": " << carried.nodes.size() << " nodes, " << carried.on_vertices
            << " on vertices, " << carried.on_edges << " on edges, " << carried.on_faces << " in faces\n"
            << "  farthest from the old model " << number_text(carried.farthest) << ", from the new one "
            << number_text(carried.distance) << " (" << number_text(carried.distance / carried.diagonal) << " D, "
            << carried.checked << " nodes checked)\n"
            << "  flipped triangles: " << carried.flipped() << ", nodes outside of their face: " << carried.outside() << '\n';
  for (const cad::FaceOutcome& face : carried.faces) {
    if (face.warp_flipped + face.warp_outside + face.flipped + face.outside == 0) continue;
    std::cout << "  face " << face.before << " (" << face.type << ") to face " << face.after << ": ";
    if (face.flipped + face.outside == 0) {
      std::cout << face.warp_flipped << " flipped triangles and " << face.warp_outside << " nodes outside were mended\n";
    } else {
      std::cout << face.flipped << " of " << face.triangles << " triangles flipped, " << face.outside << " of " << face.nodes
                << " nodes outside, after " << face.warp_flipped << " and " << face.warp_outside << " by the warp\n";
    }
  }
  std::cout.flush();
}

nlohmann::ordered_json carried_json(const cad::CarriedNodes& carried, const std::string& written) {
  nlohmann::ordered_json json;
  json["file"] = written;
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
                             {"outside", face.outside},
                             {"warp_flipped", face.warp_flipped},
                             {"warp_outside", face.warp_outside}});
  }
  return json;
}

/// How a server lets the interior follow the motions.
ApplyOptions interior_options(const CadMoveCommand& options) {
  ApplyOptions apply = options.apply;
  apply.input.setup = options.setup;
  apply.design.motion_files = {motions_beside(options.setup)};
  apply.output = options.output;
  return apply;
}

ExitCode run_cad_move(const CadMoveCommand& options, const CommonOptions& common) {
  need_cad(common);
  const std::filesystem::path before = options.request.before, after = options.request.after;
  keep_inputs("--output", options.output, {before, after, options.mesh, options.map});
  keep_inputs("--setup", options.setup, {before, after, options.mesh, options.map, options.output});
  keep_inputs("--setup: motions", motions_beside(options.setup), {before, after, options.mesh, options.map});
  if (options.handle.find_first_of(",\"\n\r") != std::string::npos) refuse("--handle: no commas, quotes and ends of lines");
  cad::MoveRequest request = options.request;
  if (!options.map.empty()) request.pairs = read_pairs(options.map);
  std::shared_ptr<const io::MeshFile> file;
  cad::CarriedNodes carried;
  {
    const Interrupt interrupt;
    file = io::read_mesh_file(options.mesh, own_process(interrupt.token()));
    request.face_entities = file->face_entities;
    RunContext context;
    context.stop = interrupt.token();
    carried = cad::carry_nodes(*file->mesh(), request, context);
  }
  const bool follows = !writes_motions(options.output) && has_interior(*file->mesh(), carried);
  if (follows && options.setup.empty()) {
    refuse(
        "--output: " + std::to_string(file->mesh()->point_count() - carried.nodes.size()) + " of " +
        std::to_string(file->mesh()->point_count()) +
        " points of the mesh are not on its boundary, and follow only by a method: name a setup to write with --setup, by which "
        "a server moves them");
  }
  if (follows) io::check_output(options.mesh, options.output);
  const std::string written = follows ? motions_beside(options.setup) : options.output;
  if (follows || writes_motions(options.output)) {
    io::write_file(written, motions_text(carried, *file->mesh(), options.handle));
  } else {
    write_moved_mesh(options, *file, carried);
  }
  if (!options.setup.empty()) io::write_file(options.setup, cad_setup_text(options));
  const ExitCode code = carried.flipped() + carried.outside() > 0 ? exit_verdict : exit_ok;
  if (common.style() != Style::json) print_carried(carried, written);
  nlohmann::ordered_json json = carried_json(carried, written);
  if (!follows) {
    if (common.style() == Style::json) print(json);
    return code;
  }
  const Applied applied = apply_by_server(interior_options(options), common);
  json["applied"] = applied_json(applied);
  if (common.style() == Style::json) {
    print(json);
  } else {
    print_applied(applied, std::cout);
  }
  return std::max(complain_about(applied), code);
}

constexpr char cad_move_footer[] =
    R"(The nodes on the boundary of MESH, which lies on the CAD model BEFORE, go to the model AFTER: those on vertices to the partners of
these, those on edges along them, those in faces by a warp of (u, v), around whose flipped triangles nodes are slid until there are none.
Partners are found by structure, then by what stays in place, by places and by names of faces; models that differ in structure, or fit in
more than one way, are refused. Nodes on what deform cad-apply made of BEFORE go where deform apply moves them. A map is a CSV with the columns kind (face, edge, vertex), before and after, numbers from 1.
A surface mesh is done then, and nothing is asked of a server. The interior of a volume mesh follows by the setup that is written to
--setup, with the motions beside it, through a server as with deform apply: verdict, --split and --fail-on are those of apply.
Exit code 4: triangles are flipped, or nodes left their face (the file is written all the same), or what deform apply says.
CAD files: .step .stp .iges .igs .brep. The command needs deform-cad beside deform, which is built with OpenCASCADE (-DDEFORM_WITH_CAD=ON).
Examples:
  deform cad-move old.step new.step wing.stl -o moved.stl
  deform cad-move old.step new.step wing.msh --setup wing.yaml -o moved.msh --split adaptive
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
  command->add_option("--setup", options->setup, "Setup file to write, by which the interior of a volume mesh follows");
  command->add_option("--handle", options->handle, "Name of the handle in motions and setup")->capture_default_str();
  command->add_option("--map", options->map, "CSV of partners that are given instead of found");
  command->add_option("--scale", options->request.scale, "Factor from the unit of the CAD models to that of the mesh")
      ->check(positive())
      ->capture_default_str();
  command
      ->add_option("--tolerance", options->request.tolerance,
                   "Largest distance of a node from the old model, model units; 0: automatic, 1e-4 D")
      ->check(not_negative())
      ->capture_default_str();
  command->add_flag("--keep-bad", options->apply.keep_bad, "Write bad designs, too; the exit code stays 4");
  options->apply.cells.check = "intersections";
  options->apply.cells.add_to(*command);
  options->apply.gates.add_to(*command);
  command->footer(cad_move_footer);
  command->callback([options, &common, &chosen] { chosen = [options, &common] { return run_cad_move(*options, common); }; });
}

}  // namespace deform::cli
