// SPDX-License-Identifier: GPL-3.0-or-later
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <algorithm>
#include <cctype>
#include <cmath>
#include <iomanip>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>

#include "client/cli/commands/command.h"
#include "client/cli/commands/mesh_reading.h"
#include "client/cli/commands/workspace.h"
#include "client/cli/output/detect_files.h"
#include "client/cli/output/detected_setup.h"
#include "client/cli/output/format.h"
#include "client/cli/output/result_json.h"
#include "client/cli/setup/region_points.h"
#include "client/setup/mirror_planes.h"
#include "core/base/text.h"
#include "core/base/vectors.h"

namespace deform::cli {

namespace {

struct DetectCommand {
  std::string file, setup, coloured;
  double tolerance = 0, minimum_area = 0, maximum_angle = 0;
  std::uint64_t seed = 0;
  std::vector<std::string> kinds;
  bool overwrite = false, exact = false;

  v1::DetectRequest request(const std::string& geometry) const {
    v1::DetectRequest message;
    message.set_geometry_id(geometry);
    message.set_tolerance(tolerance);
    message.set_minimum_area(minimum_area / 100);
    message.set_maximum_angle(maximum_angle * std::numbers::pi / 180);
    message.set_seed(seed);
    for (const auto& kind : kinds) {
      message.add_kinds(kind == "plane"      ? v1::PRIMITIVE_PLANE
                        : kind == "cylinder" ? v1::PRIMITIVE_CYLINDER
                        : kind == "sphere"   ? v1::PRIMITIVE_SPHERE
                                             : v1::PRIMITIVE_CONE);
    }
    return message;
  }
};

template <typename About>
nlohmann::ordered_json common_json(const About& about) {
  nlohmann::ordered_json json;
  json["name"] = about.name();
  json["constraint"] = about.constraint();
  json["implied_by"] = std::vector<std::string>(about.implied_by().begin(), about.implied_by().end());
  json["point"] = std::vector<double>(about.point().begin(), about.point().end());
  json["axis"] = std::vector<double>(about.axis().begin(), about.axis().end());
  json["radius"] = about.radius();
  json["rms"] = about.rms();
  json["largest"] = about.largest();
  return json;
}

nlohmann::ordered_json detected_json(const client::Detected& detected) {
  nlohmann::ordered_json json;
  json["primitives"] = nlohmann::ordered_json::array();
  for (const auto& primitive : detected.primitives) {
    auto entry = common_json(primitive.about);
    entry["half_angle"] = primitive.about.half_angle();
    entry["area"] = primitive.about.area();
    entry["faces"] = primitive.faces;
    entry["points"] = primitive.points;
    json["primitives"].push_back(std::move(entry));
  }
  json["edges"] = nlohmann::ordered_json::array();
  for (const auto& edge : detected.edges) {
    auto entry = common_json(edge.about);
    entry["length"] = edge.about.length();
    entry["lies_on"] = std::vector<std::string>(edge.about.lies_on().begin(), edge.about.lies_on().end());
    entry["points"] = edge.points;
    json["edges"].push_back(std::move(entry));
  }
  const v1::DetectSummary& summary = detected.summary;
  json["tolerance"] = summary.tolerance();
  json["minimum_area"] = summary.minimum_area();
  json["maximum_angle"] = summary.maximum_angle();
  json["noise"] = summary.noise();
  json["area"] = summary.area();
  json["coverage"] = summary.coverage();
  json["seconds"] = summary.seconds();
  json["notes"] = std::vector<std::string>(summary.notes().begin(), summary.notes().end());
  return json;
}

void print_detected(const client::Detected& detected) {
  const v1::DetectSummary& summary = detected.summary;
  std::cout << std::left << std::setw(20) << "name" << std::right << std::setw(9) << "area %" << std::setw(9) << "points"
            << std::setw(13) << "radius" << std::setw(13) << "rms" << std::setw(13) << "largest" << '\n';
  for (const auto& primitive : detected.primitives) {
    const auto& about = primitive.about;
    std::cout << std::left << std::setw(20) << printable(about.name()) << std::right << std::setw(9) << std::setprecision(3)
              << 100 * about.area() / summary.area() << std::setw(9) << about.points() << std::setw(13)
              << (about.radius() > 0 ? number_text(about.radius()) : "") << std::setw(13) << number_text(about.rms())
              << std::setw(13) << number_text(about.largest()) << '\n';
  }
  for (const auto& edge : detected.edges) {
    const auto& about = edge.about;
    std::cout << std::left << std::setw(20) << printable(about.name()) << std::right << std::setw(9) << "" << std::setw(9)
              << about.points() << std::setw(13) << (about.radius() > 0 ? number_text(about.radius()) : "") << std::setw(13)
              << number_text(about.rms()) << std::setw(13) << number_text(about.largest()) << '\n';
  }
  std::cout << "  " << std::setprecision(4) << 100 * summary.coverage() << " % of the surface belongs to primitives\n"
            << "  tolerance " << number_text(summary.tolerance()) << ", smallest area "
            << number_text(100 * summary.minimum_area()) << " %, largest angle "
            << number_text(summary.maximum_angle() * 180 / std::numbers::pi) << " degrees, noise " << number_text(summary.noise())
            << ", " << duration_text(summary.seconds()) << '\n';
  for (const auto& note : summary.notes()) std::cout << "  note: " << note << '\n';
}

/// What a setup file at `setup` calls the mesh file.
std::string geometry_name(const std::string& file, const std::string& setup) {
  std::filesystem::path folder = std::filesystem::absolute(setup).parent_path();
  const std::filesystem::path relative = std::filesystem::absolute(file).lexically_relative(folder);
  return relative.empty() ? std::filesystem::absolute(file).string() : relative.string();
}

/// Where the point ids of a setup go: "part.points.json" of "part.yaml".
std::filesystem::path points_path(const std::string& setup) {
  return std::filesystem::path(setup).replace_extension(".points.json");
}

void check_ids(const std::vector<PointId>& ids, const Mesh& mesh, const std::string& name) {
  for (const PointId id : ids) {
    if (id < mesh.point_count()) continue;
    throw Error(ErrorCode::data_loss,
                name + ": point " + std::to_string(id) + " is out of range, the mesh has " + std::to_string(mesh.point_count()));
  }
}

bool is_setup(const std::filesystem::path& file) {
  const std::string extension = file.extension().string();
  return extension == ".yaml" || extension == ".yml";
}

/// What the command works on: a mesh, and what a setup says about it.
struct Input {
  std::filesystem::path mesh;
  v1::Setup setup;
  DetectedSetupOptions written;
};

Input input_of(const DetectCommand& options) {
  Input input{options.file, {}, {}};
  if (!options.setup.empty()) input.written.points_file = points_path(options.setup).filename().string();
  if (!is_setup(options.file)) {
    if (!options.setup.empty()) input.written.geometry = geometry_name(options.file, options.setup);
    return input;
  }
  SetupFile file = read_setup_file(options.file, own_process());
  if (!file.geometry_file) {
    throw Error(ErrorCode::invalid_argument, options.file + ": it names its geometry by id; name the mesh file");
  }
  input.mesh = *file.geometry_file;
  input.setup = std::move(file.setup);
  if (options.setup.empty()) return input;
  const auto folder = [](const std::string& path) { return std::filesystem::absolute(path).lexically_normal().parent_path(); };
  if (folder(options.file) != folder(options.setup)) {
    throw Error(ErrorCode::invalid_argument,
                "--setup " + options.setup + ": must be in the folder of " + options.file + ", where its paths start");
  }
  input.written.beginning = continued_text(options.file);
  return input;
}

/// A setup is written to be edited, so one that is there is not replaced, unless by the same.
void keep_edited(const std::filesystem::path& path, const std::string& text) {
  if (!std::filesystem::exists(path) || io::read_file(path) == text) return;
  throw Error(ErrorCode::invalid_argument, "-o " + path.string() +
                                               ": is there and says something else than what was found now, so it may have been "
                                               "edited; name another file, or replace it by --overwrite");
}

/// Planes that were found where the model is mirrored: those of the setup or, of a mesh file, of groups that are called so.
void mark_symmetry(const client::Detected& detected, const v1::Setup& given, const Mesh& mesh, DetectedSetupOptions& written) {
  v1::Setup setup;
  *setup.mutable_symmetry() = given.symmetry();
  std::vector<std::string> names;
  for (const Group& group : mesh.groups) {
    std::string name = group.name;
    std::transform(name.begin(), name.end(), name.begin(), [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    if (!written.beginning.empty() || name.find("symm") == std::string::npos || (group.points.empty() && group.faces.empty()))
      continue;
    setup.add_symmetry()->mutable_region()->set_group(group.name);
    names.push_back(group.name);
  }
  const auto planes = client::mirror_planes(setup, mesh);
  const double near = client::MirrorPlane::flatness * bounding_box(mesh.points).diagonal();
  std::string entries;
  for (std::size_t k = 0; k < planes.size(); ++k) {
    bool found = false;
    for (const auto& primitive : detected.primitives) {
      const bool within = planes[k] && primitive.about.kind() == v1::PRIMITIVE_PLANE &&
                          std::all_of(primitive.points.begin(), primitive.points.end(), [&](PointId id) {
                            return std::abs(dot(planes[k]->normal, mesh.points[id] - planes[k]->point)) <= near;
                          });
      if (!within) continue;
      found = true;
      written.in_symmetry[primitive.about.name()] =
          names.empty() ? "lies in symmetry[" + std::to_string(k) + "]: its points slide there anyway"
                        : "is the symmetry plane of group " + yaml_text(names[k]) + ": its points slide there anyway";
    }
    if (found && !names.empty()) entries += (entries.empty() ? "" : ", ") + ("{region: {group: " + yaml_text(names[k]) + "}}");
  }
  if (!entries.empty()) {
    written.symmetry = "symmetry: [" + entries + "]  # of a half model; take it out, with the comment below, if it is none\n";
  }
}

DetectedSetup write_setup(const DetectCommand& options, const Input& input, const client::Detected& detected, const Mesh& mesh) {
  DetectedSetupOptions written = input.written;
  if (!written.beginning.empty()) {
    written.held.labels = region_labels(input.setup, mesh);
    for (const auto& handle : input.setup.handles()) written.held.handles.push_back(handle.name());
  }
  for (const auto& primitive : detected.primitives) check_ids(primitive.points, mesh, primitive.about.name());
  for (const auto& edge : detected.edges) check_ids(edge.points, mesh, edge.about.name());
  mark_symmetry(detected, input.setup, mesh, written);
  if (options.exact) written.kept = DetectedSetupOptions::Kept::exactly;
  const DetectedSetup result = detected_setup(detected, written);
  if (!options.overwrite) {
    keep_edited(options.setup, result.text);
    if (!result.points.empty()) keep_edited(points_path(options.setup), result.points);
  }
  // The ids first: the setup is never there without them.
  if (!result.points.empty()) io::write_file(points_path(options.setup), result.points);
  io::write_file(options.setup, result.text);
  return result;
}

ExitCode run_detect(const DetectCommand& options, const CommonOptions& common) {
  const Input input = input_of(options);
  keep_inputs("-o", options.setup, {input.mesh});
  check_folder("-o", options.setup);
  keep_inputs("--coloured", options.coloured, {input.mesh, options.file});
  Connection connection(common);
  Progress progress;
  const auto file = io::read_mesh_file(input.mesh, own_process(connection.interrupted()));
  const auto info = register_mesh(connection, file->mesh(), input.mesh.filename().string(), progress);
  progress.clear();
  const client::Detected detected = connection.client().detect(options.request(info.id()), connection.call());
  DetectedSetup written;
  if (!options.setup.empty()) written = write_setup(options, input, detected, *file->mesh());
  if (!options.coloured.empty()) write_detected(*file->mesh(), detected, options.coloured);
  if (common.style() == Style::json) {
    print(detected_json(detected));
  } else {
    print_detected(detected);
    if (!options.setup.empty()) {
      std::cout << "wrote " << options.setup << ": " << written.written << " constraints, " << written.left_out << " left out\n";
    }
    if (!written.points.empty()) std::cout << "wrote " << points_path(options.setup).string() << '\n';
    if (!options.coloured.empty()) std::cout << "wrote " << options.coloured << '\n';
  }
  std::cout << std::flush;
  return exit_ok;
}

}  // namespace

void add_detect_command(CLI::App& app, const CommonOptions& common, Action& chosen) {
  const auto options = std::make_shared<DetectCommand>();
  auto* command = app.add_subcommand("detect", "Find planes, cylinders, spheres, cones and sharp edges of a surface");
  command->add_option("FILE", options->file, "Mesh: " + io::mesh_file_names() + "; or a setup (.yaml, .yml) that names one")
      ->required();
  command->add_option(
      "-o,--setup", options->setup,
      "Setup file to write, with a constraint for each of them, to be pruned; long lists of points go into a file "
      "beside it (.points.json)");
  command->add_flag("--overwrite", options->overwrite, "Replace a setup file that is there and may have been edited")
      ->needs("--setup");
  command
      ->add_flag(
          "--exact", options->exact,
          "Constraints with exact: true, which put their points on planes, cylinders, ... to the last digits; without it they "
          "are as near as their weight puts them")
      ->needs("--setup");
  command->add_option("--coloured", options->coloured, "File to write, .ply or .vtp: every primitive in its colour");
  command->add_option("--tolerance", options->tolerance, "Distance of a point from its primitive, model units; 0: automatic")
      ->check(not_negative())
      ->capture_default_str();
  command->add_option("--min-area", options->minimum_area, "Smallest area of a primitive, percent of the surface; 0: automatic")
      ->check(CLI::Range(0.0, 100.0))
      ->capture_default_str();
  command
      ->add_option("--max-angle", options->maximum_angle,
                   "Largest angle between neighbouring faces of a curved primitive, degrees; 0: automatic")
      ->check(CLI::Range(0.0, 90.0))
      ->capture_default_str();
  command->add_option("--seed", options->seed, "Seed of the random samples")->capture_default_str();
  command->add_option("--kind", options->kinds, "What to look for; may be repeated; default: all")
      ->take_all()
      ->expected(1)
      ->allow_extra_args(false)
      ->transform(CLI::IsMember({"plane", "cylinder", "sphere", "cone"}, CLI::ignore_case));
  command->footer(
      "The same mesh, options and seed give the same result and the same names.\n"
      "A setup without constraints is continued by -o with what is found; sets that its handles and fixed regions hold as a\n"
      "whole are left out. What follows from other sets (a line on two planes) is left out, too, as a comment.\n"
      "Example: deform detect part.obj -o part.yaml --coloured part_primitives.ply");
  command->callback([options, &common, &chosen] { chosen = [options, &common] { return run_detect(*options, common); }; });
}

}  // namespace deform::cli
