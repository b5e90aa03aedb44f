#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <functional>
#include <iomanip>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "client/cli/command.h"
#include "client/cli/format.h"
#include "client/cli/numbers.h"
#include "client/cli/result_json.h"
#include "core/base/error.h"
#include "core/io/mesh_file.h"
#include "core/quality/polyhedral_quality.h"

namespace deform::cli {

namespace {

struct QualityOptions {
  std::string file, before;
  std::vector<std::string> fail_on;
};

/// A row of the table, and a name for --fail-on.
struct Measure {
  const char* name;
  const char* label;
  double (*value)(const PolyhedralQuality&);
  const Extreme* (*where)(const PolyhedralQuality&);  ///< null: no single place
};

using Q = PolyhedralQuality;

const std::vector<Measure>& measures() {
  constexpr auto nowhere = nullptr;
  static const std::vector<Measure> rows = {
      {"non_orthogonality", "non-orthogonality, largest (degrees)", [](const Q& q) { return q.largest_non_orthogonality.value; },
       [](const Q& q) { return &q.largest_non_orthogonality; }},
      {"average_non_orthogonality", "non-orthogonality, average", [](const Q& q) { return q.average_non_orthogonality; },
       nowhere},
      {"skewness", "skewness of a face, largest", [](const Q& q) { return q.largest_skewness.value; },
       [](const Q& q) { return &q.largest_skewness; }},
      {"aspect_ratio", "aspect ratio of a cell, largest", [](const Q& q) { return q.largest_aspect_ratio.value; },
       [](const Q& q) { return &q.largest_aspect_ratio; }},
      {"openness", "openness of a cell, largest", [](const Q& q) { return q.largest_openness.value; },
       [](const Q& q) { return &q.largest_openness; }},
      {"flatness", "flatness of a face, least", [](const Q& q) { return q.least_flatness.value; },
       [](const Q& q) { return &q.least_flatness; }},
      {"volume", "volume of a cell, least", [](const Q& q) { return q.least_volume.value; },
       [](const Q& q) { return &q.least_volume; }},
      {"largest_volume", "volume of a cell, largest", [](const Q& q) { return q.largest_volume.value; },
       [](const Q& q) { return &q.largest_volume; }},
      {"total_volume", "volume, total", [](const Q& q) { return q.total_volume; }, nowhere},
      {"area", "area of a face, least", [](const Q& q) { return q.least_area.value; }, [](const Q& q) { return &q.least_area; }},
      {"inverted_cells", "cells without positive volume", [](const Q& q) { return static_cast<double>(q.inverted_cells); },
       nowhere},
      {"wrong_pyramids", "faces that look the wrong way", [](const Q& q) { return static_cast<double>(q.wrong_pyramids); },
       nowhere},
      {"non_orthogonal_faces", "faces beyond 70 degrees", [](const Q& q) { return static_cast<double>(q.non_orthogonal_faces); },
       nowhere},
      {"skew_faces", "faces of skewness beyond 4", [](const Q& q) { return static_cast<double>(q.skew_faces); }, nowhere},
      {"failed_checks", "failed checks", [](const Q& q) { return static_cast<double>(q.failed_checks()); }, nowhere},
  };
  return rows;
}

/// NAME>NUMBER or NAME<NUMBER.
struct Threshold {
  const Measure* measure;
  bool above;
  double limit;
  std::string text;

  bool exceeded(const Q& quality) const {
    const double value = measure->value(quality);
    return above ? value > limit : value < limit;
  }
};

Threshold parse_threshold(const std::string& text) {
  const std::size_t sign = text.find_first_of("<>");
  if (sign == std::string::npos)
    throw Error(ErrorCode::invalid_argument, "--fail-on " + text + ": expected NAME>NUMBER or NAME<NUMBER");
  const std::string name = text.substr(0, sign);
  const auto limit = parse_number(text.substr(sign + 1));
  if (!limit)
    throw Error(ErrorCode::invalid_argument, "--fail-on " + text + ": \"" + text.substr(sign + 1) + "\" is not a number");
  std::vector<std::string> names;
  for (const Measure& measure : measures()) {
    if (name == measure.name) return {&measure, text[sign] == '>', *limit, text};
    names.emplace_back(measure.name);
  }
  const std::string near = nearest_names(name, names);
  std::string all;
  for (const auto& known : names) all += (all.empty() ? "" : ", ") + known;
  throw Error(ErrorCode::invalid_argument, "--fail-on " + text + ": there is no measure \"" + name + "\"; " +
                                               (near.empty() ? "there are " + all : "did you mean " + near + "?"));
}

Q quality_of(const std::string& path) {
  const auto file = io::read_mesh_file(path);
  const auto cells = file->cells();
  if (cells == nullptr)
    throw Error(ErrorCode::invalid_argument, path + ": this is a surface, quality is that of the cells of a volume mesh");
  return polyhedral_quality(file->mesh()->points, *cells);
}

nlohmann::ordered_json quality_json(const Q& quality) {
  nlohmann::ordered_json json;
  json["points"] = quality.points;
  json["faces"] = quality.faces;
  json["cells"] = quality.cells;
  for (const Measure& measure : measures()) {
    json[measure.name] = measure.value(quality);
    if (measure.where != nullptr) json[std::string(measure.name) + "_at"] = measure.where(quality)->id;
  }
  json["inverted"] = quality.inverted;
  json["wrong_faces"] = quality.wrong_faces;
  return json;
}

void print_quality(const std::string& file, const Q& after, const Q* before) {
  std::cout << file << ": " << after.cells << " cells, " << after.faces << " faces, " << after.points << " points\n";
  constexpr int label_width = 42, width = 16;
  if (before != nullptr)
    std::cout << std::left << std::setw(label_width) << "" << std::setw(width) << "  before"
              << "  after\n";
  for (const Measure& measure : measures()) {
    std::cout << "  " << std::left << std::setw(label_width) << measure.label;
    if (before != nullptr) std::cout << std::setw(width) << number_text(measure.value(*before));
    std::cout << number_text(measure.value(after));
    if (measure.where != nullptr) std::cout << "  (" << measure.where(after)->id << ")";
    std::cout << '\n';
  }
  std::cout << std::flush;
}

ExitCode run_quality(const QualityOptions& options, const CommonOptions& common) {
  std::vector<Threshold> thresholds;
  for (const auto& text : options.fail_on) thresholds.push_back(parse_threshold(text));
  const Q after = quality_of(options.file);
  std::unique_ptr<const Q> before;
  if (!options.before.empty()) before = std::make_unique<const Q>(quality_of(options.before));
  if (common.style() == Style::json) {
    nlohmann::ordered_json json = quality_json(after);
    json["file"] = options.file;
    if (before) json["before"] = quality_json(*before);
    print(json);
  } else {
    print_quality(options.file, after, before.get());
  }
  for (const Threshold& threshold : thresholds) {
    if (!threshold.exceeded(after)) continue;
    throw Error(ErrorCode::failed_precondition,
                options.file + ": " + threshold.text + ": it is " + number_text(threshold.measure->value(after)));
  }
  return exit_ok;
}

}  // namespace

void add_quality_command(CLI::App& app, const CommonOptions& common, Action& chosen) {
  const auto options = std::make_shared<QualityOptions>();
  auto* command =
      app.add_subcommand("quality", "Measure the cells of a volume mesh, as OpenFOAM's checkMesh does; needs no server");
  command->add_option("FILE", options->file, "Volume mesh: the folder of an OpenFOAM case or of one of its times")->required();
  command->add_option("--before", options->before, "The undeformed mesh, shown beside it");
  command->add_option("--fail-on", options->fail_on, "Exit code 1 when NAME>NUMBER or NAME<NUMBER holds; may be repeated");
  command->footer(
      "Names for --fail-on are the keys of --json. Numbers in parentheses are the ids of the face or cell.\n"
      "Example: deform quality case/0.15 --before case --fail-on \"non_orthogonality>70\" --fail-on \"inverted_cells>0\"");
  command->callback([options, &common, &chosen] { chosen = [options, &common] { return run_quality(*options, common); }; });
}

}  // namespace deform::cli
