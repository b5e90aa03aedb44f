// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/cad/cad_regions.h"

#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <algorithm>
#include <array>
#include <iomanip>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "client/cli/cad/program_with_cad.h"
#include "client/cli/commands/command.h"
#include "client/cli/commands/interrupt.h"
#include "client/cli/commands/mesh_reading.h"
#include "client/cli/output/detected_setup.h"
#include "client/cli/output/format.h"
#include "client/cli/output/result_json.h"
#include "client/cli/setup/reading.h"
#include "client/cli/setup/region_points.h"
#include "core/base/text.h"

namespace deform::cli {

namespace {

using cad::CadShape;
using ShapeKind = cad::CadShape::Kind;

struct CadRegionsCommand {
  std::string file, setup;
  bool exact = false;
  cad::RegionsRequest request;
};

/// The kind of Constraint for a shape, and how many points it needs at least.
struct ShapeConstraint {
  const char* name;
  std::size_t points;
};

ShapeConstraint constraint_of(ShapeKind kind) {
  switch (kind) {
    case ShapeKind::plane:
      return {"planar", 4};
    case ShapeKind::cylinder:
      return {"cylindrical", 6};
    case ShapeKind::cone:
      return {"conical", 7};
    case ShapeKind::sphere:
      return {"spherical", 5};
    case ShapeKind::line:
      return {"straight", 3};
    case ShapeKind::circle:
      return {"circular", 4};
    default:
      return {"", 0};
  }
}

template <typename About>
void describe(const CadShape& shape, About& about) {
  const ShapeConstraint constraint = constraint_of(shape.kind);
  about.set_name(shape.name);
  for (const double x : shape.point) about.add_point(x);
  if (shape.kind != ShapeKind::sphere) {
    for (const double x : shape.axis) about.add_axis(x);
  }
  about.set_radius(shape.radius);
  about.set_rms(shape.rms);
  about.set_largest(shape.largest);
  about.set_points(shape.points.size());
  if (shape.points.size() >= constraint.points) about.set_constraint(constraint.name);
}

v1::PrimitiveKind primitive_kind(ShapeKind kind) {
  return kind == ShapeKind::plane      ? v1::PRIMITIVE_PLANE
         : kind == ShapeKind::cylinder ? v1::PRIMITIVE_CYLINDER
         : kind == ShapeKind::cone     ? v1::PRIMITIVE_CONE
                                       : v1::PRIMITIVE_SPHERE;
}

/// What `deform detect` would have found, for the writer of setups.
client::Detected detected_shapes(const cad::CadRegions& regions) {
  client::Detected detected;
  detected.summary.set_area(regions.area);
  for (const CadShape& face : regions.faces) {
    if (face.kind == ShapeKind::other_face) continue;
    client::Detected::Primitive primitive;
    describe(face, primitive.about);
    primitive.about.set_kind(primitive_kind(face.kind));
    primitive.about.set_half_angle(face.half_angle);
    primitive.about.set_area(face.size);
    primitive.points = face.points;
    detected.primitives.push_back(std::move(primitive));
  }
  for (const CadShape& shape : regions.edges) {
    if (shape.kind == ShapeKind::other_edge) continue;
    client::Detected::Edge edge;
    describe(shape, edge.about);
    edge.about.set_kind(shape.kind == ShapeKind::line ? v1::EDGE_LINE : shape.closed ? v1::EDGE_CIRCLE : v1::EDGE_ARC);
    edge.about.set_length(shape.size);
    std::size_t planes = 0, spheres = 0;
    for (const int f : shape.lies_on) {
      const CadShape& face = regions.faces.at(static_cast<std::size_t>(f));
      edge.about.add_lies_on(face.name);
      planes += face.kind == ShapeKind::plane ? 1 : 0;
      spheres += face.kind == ShapeKind::sphere ? 1 : 0;
    }
    // What faces that keep their types imply, whatever happens to them.
    const bool implied = shape.kind == ShapeKind::line ? planes == 2 : spheres == 2 || (spheres == 1 && planes == 1);
    if (implied) *edge.about.mutable_implied_by() = edge.about.lies_on();
    edge.points = shape.points;
    detected.edges.push_back(std::move(edge));
  }
  return detected;
}

std::filesystem::path sets_path(const std::string& setup) {
  return std::filesystem::path(setup).replace_extension(".points.json");
}

std::string numbers_text(const Vec3& x) {
  std::string text = "[";
  for (int k = 0; k < 3; ++k) text += (k == 0 ? "" : ", ") + number_text(std::abs(x[k]) < 1e-12 ? 0 : x[k]);
  return text + "]";
}

/// Faces without a constraint, and planes of symmetry, as comments.
std::string further_text(const cad::CadRegions& regions, const std::string& points_file) {
  std::string text = "  # every face and edge of the CAD model is a set of " + yaml_text(points_file) + "\n";
  for (const CadShape& face : regions.faces) {
    if (face.kind != ShapeKind::other_face || face.points.empty()) continue;
    text += "  # {ids: {file: " + yaml_text(points_file) + ", set: " + yaml_text(face.name) + "}}  # " + face.type + ", " +
            std::to_string(face.points.size()) + " points\n";
  }
  std::size_t count = 0;
  for (const cad::MirrorPlane& mirror : regions.mirrors) {
    ++count;
    const std::string name = "mirror" + (regions.mirrors.size() > 1 ? "_" + std::to_string(count) : "");
    text += "  # the CAD model is its own mirror image in the plane through " + numbers_text(mirror.point) + ", normal " +
            numbers_text(mirror.normal) + "; to be kept, with a mesh that is so, too:\n  # - {name: " + name +
            ", symmetric: {point: " + numbers_text(mirror.point) + ", normal: " + numbers_text(mirror.normal) +
            "}, regions: [{boundary: true}]}\n";
  }
  return text;
}

/// One line for every face and edge that holds points.
std::string all_sets_text(const cad::CadRegions& regions) {
  std::string text;
  for (const std::vector<CadShape>* shapes : {&regions.faces, &regions.edges}) {
    for (const CadShape& shape : *shapes) {
      if (shape.points.empty()) continue;
      text += (text.empty() ? "{\n" : ",\n") + nlohmann::json(shape.name).dump() + ": " + nlohmann::json(shape.points).dump();
    }
  }
  return text + "\n}\n";
}

/// The mesh, and the setup that is continued.
struct RegionsInput {
  std::filesystem::path mesh;
  std::optional<SetupFile> setup;
};

RegionsInput regions_input(const CadRegionsCommand& options) {
  const std::string extension = std::filesystem::path(options.file).extension().string();
  if (extension != ".yaml" && extension != ".yml") return {options.file, std::nullopt};
  SetupFile file = read_setup_file(options.file, own_process());
  if (!file.geometry_file) refuse(options.file + ": it names its geometry by id; name the mesh file");
  const auto folder = [](const std::string& path) { return std::filesystem::absolute(path).lexically_normal().parent_path(); };
  if (folder(options.file) != folder(options.setup)) {
    refuse("-o " + options.setup + ": must be in the folder of " + options.file + ", where its paths start");
  }
  const std::filesystem::path mesh = *file.geometry_file;
  return {mesh, std::move(file)};
}

void print_regions(const cad::CadRegions& regions, const DetectedSetup& written, const CadRegionsCommand& options) {
  for (const std::string& note : regions.notes) std::cout << printable(note) << '\n';
  std::cout << std::left << std::setw(24) << "name" << std::setw(14) << "type" << std::right << std::setw(9) << "points"
            << std::setw(13) << "radius" << std::setw(13) << "largest" << '\n';
  for (const std::vector<CadShape>* shapes : {&regions.faces, &regions.edges}) {
    for (const CadShape& shape : *shapes) {
      std::cout << std::left << std::setw(24) << printable(shape.name) << std::setw(14) << shape.type << std::right
                << std::setw(9) << shape.points.size() << std::setw(13) << (shape.radius > 0 ? number_text(shape.radius) : "")
                << std::setw(13) << number_text(shape.largest) << '\n';
    }
  }
  for (const cad::MirrorPlane& mirror : regions.mirrors) {
    std::cout << "  plane of symmetry through " << numbers_text(mirror.point) << ", normal " << numbers_text(mirror.normal)
              << '\n';
  }
  std::cout << "wrote " << printable(options.setup) << ": " << written.written << " constraints, " << written.left_out
            << " left out; " << regions.nodes << " nodes at most " << number_text(regions.farthest) << " from the model\n"
            << "wrote " << printable(sets_path(options.setup).string()) << '\n'
            << std::flush;
}

nlohmann::ordered_json regions_json(const cad::CadRegions& regions, const DetectedSetup& written) {
  nlohmann::ordered_json json;
  json["constraints"] = written.written;
  json["left_out"] = written.left_out;
  json["nodes"] = regions.nodes;
  json["farthest"] = regions.farthest;
  json["diagonal"] = regions.diagonal;
  for (const auto& [key, shapes] : {std::pair{"faces", &regions.faces}, std::pair{"edges", &regions.edges}}) {
    json[key] = nlohmann::ordered_json::array();
    for (const CadShape& shape : *shapes) {
      nlohmann::ordered_json entry{
          {"name", shape.name}, {"type", shape.type}, {"numbers", shape.numbers}, {"points", shape.points}};
      if (constraint_of(shape.kind).points > 0) {
        entry["point"] = shape.point;
        entry["axis"] = shape.axis;
        entry["radius"] = shape.radius;
        entry["half_angle"] = shape.half_angle;
        entry["rms"] = shape.rms;
        entry["largest"] = shape.largest;
      }
      json[key].push_back(std::move(entry));
    }
  }
  json["mirrors"] = nlohmann::ordered_json::array();
  for (const cad::MirrorPlane& mirror : regions.mirrors)
    json["mirrors"].push_back({{"point", mirror.point}, {"normal", mirror.normal}});
  json["notes"] = regions.notes;
  return json;
}

ExitCode run_cad_regions(const CadRegionsCommand& options, const CommonOptions& common) {
  need_cad(common);
  const RegionsInput input = regions_input(options);
  keep_inputs("-o", options.setup, {input.mesh, options.request.model});
  check_folder("-o", options.setup);
  DetectedSetupOptions writing;
  if (options.exact) writing.kept = DetectedSetupOptions::Kept::exactly;
  writing.points_file = sets_path(options.setup).filename().string();
  writing.origin =
      "Faces and edges of the CAD model " + printable(options.request.model.filename().string()) + ", by deform cad-regions.";
  const Interrupt interrupt;
  const auto file = io::read_mesh_file(input.mesh, own_process(interrupt.token()));
  if (input.setup) {
    writing.beginning = continued_text(options.file);
    writing.held.labels = region_labels(input.setup->setup, *file->mesh());
    for (const auto& handle : input.setup->setup.handles()) writing.held.handles.push_back(handle.name());
  } else {
    const auto folder = std::filesystem::absolute(options.setup).parent_path();
    writing.geometry = std::filesystem::absolute(input.mesh).lexically_proximate(folder).string();
  }
  RunContext context;
  context.stop = interrupt.token();
  const cad::CadRegions regions = cad::cad_regions(*file->mesh(), options.request, context);
  const client::Detected detected = detected_shapes(regions);
  const DetectedSetup written = detected_setup(detected, writing);
  // The sets first: the setup is never there without them.
  io::write_file(sets_path(options.setup), all_sets_text(regions));
  io::write_file(options.setup, written.text + further_text(regions, writing.points_file));
  if (common.style() == Style::json) {
    print(regions_json(regions, written));
  } else {
    print_regions(regions, written, options);
  }
  return exit_ok;
}

constexpr char cad_regions_footer[] =
    R"(The nodes on the boundary of the mesh are sorted by the faces and edges of the CAD model on which they lie. Planes, cylinders,
spheres, cones, straight edges and circles become constraints, to be pruned; what follows from others (a line on two planes) is left out, as
a comment. Every face and edge is a set of point ids in a file beside the setup (.points.json), by its name in the CAD file or its type and
number: {ids: {file: part.points.json, set: cylinder_7}}. Of a setup without constraints, -o continues it; sets that its handles and
fixed regions hold as a whole are left out. Nothing is asked of a server.
CAD files: .step .stp .iges .igs .brep. The command needs deform-cad beside deform, which is built with OpenCASCADE (-DDEFORM_WITH_CAD=ON).
Examples:
  deform cad-regions part.step part.msh -o part.yaml
  deform cad-regions part.step moves.yaml -o constrained.yaml)";

}  // namespace

void add_cad_regions_command(CLI::App& app, const CommonOptions& common, Action& chosen) {
  const auto options = std::make_shared<CadRegionsCommand>();
  auto* command = app.add_subcommand("cad-regions", "Write a setup with regions and constraints from the faces of a CAD model");
  command->add_option("MODEL", options->request.model, "CAD model on which the mesh lies")->required();
  command->add_option("FILE", options->file, "Mesh file; or a setup (.yaml, .yml) that names one")->required();
  command->add_option("-o,--setup", options->setup, "Setup file to write; lists of points go into a file beside it")->required();
  command->add_flag(
      "--exact", options->exact,
      "Constraints with exact: true, which put their points on planes, cylinders, ... to the last digits; without it they "
      "are as near as their weight puts them");
  command->add_option("--scale", options->request.scale, "Factor from the unit of the CAD model to that of the mesh")
      ->check(positive())
      ->capture_default_str();
  command
      ->add_option("--tolerance", options->request.tolerance,
                   "Largest distance of a node from the model, unit of the mesh; 0: automatic, 1e-4 D")
      ->check(not_negative())
      ->capture_default_str();
  command->footer(cad_regions_footer);
  command->callback([options, &common, &chosen] { chosen = [options, &common] { return run_cad_regions(*options, common); }; });
}

}  // namespace deform::cli
