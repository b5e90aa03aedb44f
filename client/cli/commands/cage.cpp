// SPDX-License-Identifier: GPL-3.0-or-later
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <iostream>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <vector>

#include "client/cli/commands/command.h"
#include "client/cli/commands/interrupt.h"
#include "client/cli/commands/mesh_reading.h"
#include "client/cli/output/format.h"
#include "client/cli/output/result_json.h"
#include "client/cli/setup/reading.h"
#include "core/base/text.h"
#include "core/mesh/cages/cage_around.h"

namespace deform::cli {

namespace {

const std::map<std::string, CageKind> cage_kinds{{"box", CageKind::box}, {"hull", CageKind::hull}, {"wrap", CageKind::wrap}};

struct CageMeshCommand {
  std::string mesh, output, kind = "wrap";
  CageRequest request;
};

constexpr double far_offset = 1;  // of the diagonal

nlohmann::ordered_json json_of(const CagePlane& plane) { return {{"point", plane.point}, {"normal", plane.normal}}; }

/// Numbers of vertices are what setups select by: a file that merges corners or has no such numbers would change them.
void check_cage_output(const std::filesystem::path& path) {
  const std::filesystem::path name = path.extension() == ".gz" ? path.stem() : path;
  if (name.extension() != ".obj") refuse("--output: \"" + path.string() + "\": cages are written as .obj, also .obj.gz");
}

ExitCode run_cage_mesh(const CageMeshCommand& options, const CommonOptions& common) {
  check_cage_output(options.output);
  keep_inputs("--output", options.output, {options.mesh});
  check_folder("--output", options.output);
  CageRequest request = options.request;
  request.kind = cage_kinds.at(options.kind);
  const Interrupt interrupt;
  const auto mesh = io::read_mesh_file(options.mesh, own_process(interrupt.token()))->mesh();
  RunContext context;
  context.stop = interrupt.token();
  const CageAround cage = cage_around(*mesh, request, context);
  io::write_new_file(cage.mesh, options.output);
  if (request.kind == CageKind::box && cage.mesh.point_count() != request.points) {
    warn("--points " + std::to_string(request.points) + ": a box in rectangles has " + std::to_string(cage.mesh.point_count()) +
         " vertices here, within 5 % of that");
  }
  const double diagonal = bounding_box(mesh->points).diagonal();
  if (cage.offset > far_offset * diagonal) {
    warn("--offset " + number_text(request.offset) + ": the cage is " + number_text(cage.offset / diagonal) +
         " diagonals away from the mesh, from where its vertices move everything alike; offsets are in model units, of which the "
         "diagonal of the mesh is " +
         number_text(diagonal));
  }
  if (common.style() == Style::json) {
    nlohmann::ordered_json json;
    json["file"] = options.output;
    json["kind"] = options.kind;
    json["points"] = cage.mesh.point_count();
    json["triangles"] = cage.mesh.face_count();
    json["closed"] = true;
    json["components"] = cage.components;
    json["genus"] = cage.genus;
    json["offset"] = cage.offset;
    json["attempts"] = cage.attempts;
    json["clearance"] = cage.clearance;
    json["diagonal"] = diagonal;
    json["least_angle"] = cage.least_angle;
    json["outside"] = 0;
    json["symmetry"] = nlohmann::json::array();
    for (const CagePlane& plane : cage.planes) json["symmetry"].push_back(json_of(plane));
    if (!cage.planes.empty()) json["asymmetry"] = cage.asymmetry;
    if (!cage.without.empty()) json["not_symmetric"] = nlohmann::json::array();
    for (const CagePlane& plane : cage.without) json["not_symmetric"].push_back(json_of(plane));
    if (cage.nearly_symmetric) {
      json["nearly_symmetric"] = json_of(cage.nearly_symmetric->plane);
      json["nearly_symmetric"]["asymmetry"] = cage.nearly_symmetric->deviation;
    }
    print(json);
    return exit_ok;
  }
  std::cout << "wrote " << printable(options.output) << ": " << options.kind << " of " << cage.mesh.point_count()
            << " points and " << cage.mesh.face_count() << " triangles, closed, " << cage.components
            << (cage.components == 1 ? " component" : " components") << ", genus " << cage.genus << '\n'
            << "  offset " << number_text(cage.offset) << " (" << number_text(cage.offset / diagonal) << " D)";
  if (cage.attempts > 1) std::cout << " after " << cage.attempts << " attempts";
  std::cout << ", nearest point of the mesh at " << number_text(cage.clearance) << '\n'
            << "  least angle " << number_text(cage.least_angle) << " degrees\n"
            << "  points of the mesh outside: 0 of " << mesh->point_count() << '\n';
  if (!cage.without.empty()) {
    std::vector<CagePlane> with_more, never;
    for (const CagePlane& plane : cage.without) {
      (request.kind == CageKind::box && !axis_of(plane) ? never : with_more).push_back(plane);
    }
    if (!with_more.empty()) {
      std::cout << "  not symmetric to " << planes_text(with_more)
                << ", as the mesh is: no such cage of so few points was found; ask for more\n";
    }
    if (!never.empty()) {
      std::cout << "  not symmetric to " << planes_text(never)
                << ", as the mesh is: a box is along the axes; wraps and hulls are\n";
    }
  }
  if (!cage.planes.empty()) {
    std::cout << "  symmetric to " << planes_text(cage.planes) << ", as the mesh is, but for " << number_text(cage.asymmetry)
              << " (" << number_text(cage.asymmetry / diagonal) << " D)\n";
  } else if (cage.nearly_symmetric) {
    const SurfaceMirrors::Near& near = *cage.nearly_symmetric;
    std::cout << "  not symmetric, as the mesh is only nearly symmetric to " << plane_text(near.plane) << ": up to "
              << number_text(near.deviation) << " (" << number_text(near.deviation / diagonal) << " D) off, at "
              << place_text(near.at);
    if (const double enough = 1.01 * near.deviation / diagonal; enough < CageRequest::most_symmetry_tolerance) {
      std::cout << "; --symmetry-tolerance " << number_text(enough) << " makes a symmetric one";
    }
    std::cout << '\n';
  }
  std::cout << std::flush;
  return exit_ok;
}

constexpr char cage_mesh_footer[] =
    R"(box: a box along the axes, its faces in rectangles. hull: around the convex hull, rounded. wrap: follows the surface, with concavities
and holes that are wider than twice the offset; narrower ones are closed. The mesh may have holes, be a soup of triangles or a volume mesh.
Hull and wrap grow their offset until no point of the mesh is outside, all angles are 15 degrees or more, no triangles cross each
other and the number of points is met within 5 %. Nothing is asked of a server. Setups take the file with
method: {cage: {file: cage.obj, control: MESH}}. Cages of half models, for handles that hold their vertices, are made where the symmetry
planes are known: method: {cage: {generate: {points: 400}}} makes one that is its own mirror image, with kind: BOX one that ends there.
Examples:
  deform cage mesh car.obj --points 400 -o cage.obj
  deform cage mesh wing.stl --kind box --points 60 --offset 0.1 -o cage.obj)";

}  // namespace

void add_cage_command(CLI::App& app, const CommonOptions& common, Action& chosen) {
  auto* group = app.add_subcommand("cage", "Make a cage for method.cage: deform cage mesh");
  group->require_subcommand(1);
  const auto options = std::make_shared<CageMeshCommand>();
  auto* command = group->add_subcommand("mesh", "Write a closed mesh of triangles around a mesh");
  command->add_option("MESH", options->mesh, "Mesh file")->required();
  command->add_option("-o,--output", options->output, "File to write: .obj")->required();
  command->add_option("--kind", options->kind, "box, hull or wrap")
      ->check(CLI::IsMember({"box", "hull", "wrap"}))
      ->capture_default_str();
  command->add_option("--points", options->request.points, "Vertices of the cage")
      ->check(CLI::Range(CageRequest::least_points, CageRequest::most_points))
      ->capture_default_str();
  command->add_option("--offset", options->request.offset, "Distance from the mesh to begin with, model units; 0: automatic")
      ->check(not_negative())
      ->capture_default_str();
  command
      ->add_option("--symmetry-tolerance", options->request.symmetry_tolerance,
                   "A mesh that is this close to its own mirror image, as a fraction of its diagonal, gets a cage that is "
                   "its own; 0: none does")
      ->check(CLI::Range(0.0, CageRequest::most_symmetry_tolerance))
      ->capture_default_str();
  command->footer(cage_mesh_footer);
  command->callback([options, &common, &chosen] { chosen = [options, &common] { return run_cage_mesh(*options, common); }; });
}

}  // namespace deform::cli
