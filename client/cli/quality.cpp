#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <algorithm>
#include <iomanip>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "client/cli/command.h"
#include "client/cli/format.h"
#include "client/cli/numbers.h"
#include "client/cli/result_json.h"
#include "core/base/error.h"
#include "core/io/mesh_file.h"
#include "core/quality/element_quality.h"
#include "core/quality/polyhedral_quality.h"

namespace deform::cli {

namespace {

struct QualityOptions {
  std::string file, before;
  std::vector<std::string> fail_on;
};

/// A row of the table, and a name for --fail-on.
struct Row {
  std::string name, label;
  double value = 0;
  std::optional<std::size_t> id;  ///< of the face, cell or element where it was found
  bool in_table = true;

  Row(const char* the_name, const char* the_label, const Extreme& extreme)
      : name(the_name), label(the_label), value(extreme.value), id(extreme.id) {}
  Row(const char* the_name, const char* the_label, double the_value) : name(the_name), label(the_label), value(the_value) {}
  Row(const char* the_name, const char* the_label, std::size_t count) : Row(the_name, the_label, static_cast<double>(count)) {}
};

struct Measures {
  std::vector<std::pair<std::string, std::size_t>> counts;
  std::vector<Row> rows;
  std::vector<std::pair<std::string, std::vector<std::size_t>>> lists;
};

Measures measures_of(const PolyhedralQuality& q) {
  Measures result;
  result.counts = {{"cells", q.cells}, {"faces", q.faces}, {"points", q.points}};
  result.rows = {{"non_orthogonality", "non-orthogonality, largest (degrees)", q.largest_non_orthogonality},
                 {"average_non_orthogonality", "non-orthogonality, average", q.average_non_orthogonality},
                 {"skewness", "skewness of a face, largest", q.largest_skewness},
                 {"aspect_ratio", "aspect ratio of a cell, largest", q.largest_aspect_ratio},
                 {"openness", "openness of a cell, largest", q.largest_openness},
                 {"flatness", "flatness of a face, least", q.least_flatness},
                 {"volume", "volume of a cell, least", q.least_volume},
                 {"largest_volume", "volume of a cell, largest", q.largest_volume},
                 {"total_volume", "volume, total", q.total_volume},
                 {"area", "area of a face, least", q.least_area},
                 {"inverted_cells", "cells without positive volume", q.inverted_cells},
                 {"wrong_pyramids", "faces that look the wrong way", q.wrong_pyramids},
                 {"non_orthogonal_faces", "faces beyond 70 degrees", q.non_orthogonal_faces},
                 {"skew_faces", "faces of skewness beyond 4", q.skew_faces},
                 {"failed_checks", "failed checks", q.failed_checks()}};
  result.lists = {{"inverted", q.inverted}, {"wrong_faces", q.wrong_faces}};
  return result;
}

/// Of all elements, or with a prefix of those of a type.
std::vector<Row> rows_of(const ElementMeasures& q, const std::string& name, const std::string& label) {
  std::vector<Row> rows = {{"scaled_jacobian", "scaled Jacobian, least", q.least_scaled_jacobian},
                           {"average_scaled_jacobian", "scaled Jacobian, average", q.average_scaled_jacobian},
                           {"aspect_ratio", "longest edge to least height, largest", q.largest_aspect_ratio},
                           {"edge_ratio", "longest to shortest edge, largest", q.largest_edge_ratio},
                           {"least_edge_ratio", "longest to shortest edge, least", q.least_edge_ratio},
                           {"volume", "volume of an element, least", q.least_volume},
                           {"largest_volume", "volume of an element, largest", q.largest_volume},
                           {"total_volume", "volume, total", q.total_volume},
                           {"inverted_elements", "inverted elements", q.inverted_elements}};
  for (Row& row : rows) {
    row.name = name + row.name;
    row.label = label + row.label;
  }
  return rows;
}

Measures measures_of(const ElementQuality& q) {
  Measures result;
  result.counts = {{"elements", q.elements}, {"points", q.points}};
  result.rows = rows_of(q, "", "");
  for (std::size_t i = 0; i < q.of_type.size(); ++i) {
    const std::string type = shape(static_cast<ElementType>(i)).name;
    result.counts.emplace_back(type, q.of_type[i].elements);
    if (q.of_type[i].elements == 0) continue;
    auto rows = rows_of(q.of_type[i], type + ".", type + ": ");
    for (Row& row : rows) row.in_table = q.of_type[i].elements < q.elements;  // the only type has the numbers of all
    result.rows.insert(result.rows.end(), rows.begin(), rows.end());
  }
  result.lists = {{"worst", q.worst}, {"histogram", {q.histogram.begin(), q.histogram.end()}}};
  return result;
}

Measures measures_of(const std::string& path) {
  const auto file = io::read_mesh_file(path);
  const auto& points = file->mesh()->points;
  if (const auto cells = file->cells()) return measures_of(polyhedral_quality(points, *cells));
  if (const auto elements = file->elements()) return measures_of(element_quality(points, *elements));
  throw Error(ErrorCode::invalid_argument, path + ": this is a surface; quality is that of the cells of a volume mesh");
}

/// Throws Error when the text, NAME>NUMBER or NAME<NUMBER, is none, or what it says holds.
void check_threshold(const std::string& text, const std::string& file, const Measures& measures) {
  const auto wrong = [&](const std::string& why) { throw Error(ErrorCode::invalid_argument, "--fail-on " + text + ": " + why); };
  const std::size_t sign = text.find_first_of("<>");
  if (sign == std::string::npos) wrong("expected NAME>NUMBER or NAME<NUMBER");
  const std::string name = text.substr(0, sign);
  const auto limit = parse_number(text.substr(sign + 1));
  if (!limit) wrong("\"" + text.substr(sign + 1) + "\" is not a number");
  std::vector<std::string> names;
  for (const Row& row : measures.rows) {
    names.push_back(row.name);
    if (row.name != name) continue;
    if (!(text[sign] == '>' ? row.value <= *limit : row.value >= *limit)) {  // what is not a number fails too
      throw Error(ErrorCode::failed_precondition, file + ": " + text + ": it is " + number_text(row.value));
    }
    return;
  }
  const std::string near = nearest_names(name, names);
  std::string all;
  for (const auto& known : names) all += (all.empty() ? "" : ", ") + known;
  wrong("there is no measure \"" + name + "\"; " + (near.empty() ? "there are " + all : "did you mean " + near + "?"));
}

nlohmann::ordered_json measures_json(const Measures& measures) {
  nlohmann::ordered_json json;
  for (const auto& [name, count] : measures.counts) json[name] = count;
  for (const Row& row : measures.rows) {
    json[row.name] = row.value;
    if (row.id) json[row.name + "_at"] = *row.id;
  }
  for (const auto& [name, ids] : measures.lists) json[name] = ids;
  return json;
}

void print_measures(const std::string& file, const Measures& after, const Measures* before) {
  std::cout << file << ":";
  for (const auto& [name, count] : after.counts) {
    if (count > 0) std::cout << ' ' << count << ' ' << name;
  }
  std::cout << '\n';
  constexpr int label_width = 54, width = 16;
  if (before != nullptr) {
    std::cout << "  " << std::left << std::setw(label_width) << "" << std::setw(width) << "before"
              << "after\n";
  }
  for (const Row& row : after.rows) {
    if (!row.in_table) continue;
    std::cout << "  " << std::left << std::setw(label_width) << row.label;
    if (before != nullptr) {
      const auto same = std::find_if(before->rows.begin(), before->rows.end(), [&](const Row& r) { return r.name == row.name; });
      std::cout << std::setw(width) << (same == before->rows.end() ? "-" : number_text(same->value));
    }
    std::cout << number_text(row.value);
    if (row.id) std::cout << "  (" << *row.id << ")";
    std::cout << '\n';
  }
  std::cout << std::flush;
}

ExitCode run_quality(const QualityOptions& options, const CommonOptions& common) {
  const Measures after = measures_of(options.file);
  std::unique_ptr<const Measures> before;
  if (!options.before.empty()) before = std::make_unique<const Measures>(measures_of(options.before));
  if (before && before->rows.front().name != after.rows.front().name) {
    throw Error(ErrorCode::invalid_argument,
                "--before " + options.before + ": not the kind of mesh that " + options.file + " is");
  }
  if (common.style() == Style::json) {
    nlohmann::ordered_json json = measures_json(after);
    json["file"] = options.file;
    if (before) json["before"] = measures_json(*before);
    print(json);
  } else {
    print_measures(options.file, after, before.get());
  }
  for (const auto& text : options.fail_on) check_threshold(text, options.file, after);
  return exit_ok;
}

}  // namespace

void add_quality_command(CLI::App& app, const CommonOptions& common, Action& chosen) {
  const auto options = std::make_shared<QualityOptions>();
  auto* command = app.add_subcommand("quality", "Measure the cells of a volume mesh; needs no server");
  command->add_option("FILE", options->file, "Volume mesh: an OpenFOAM case or one of its time folders, or .mesh")->required();
  command->add_option("--before", options->before, "The undeformed mesh, shown beside it");
  command->add_option("--fail-on", options->fail_on, "Exit code 1 when NAME>NUMBER or NAME<NUMBER holds; may be repeated");
  command->footer(
      "OpenFOAM meshes get the measures of its checkMesh, by the same formulas; elements the scaled Jacobian\n"
      "(Knupp 2000; of quadratic elements that of their quadratic map at all nodes), also those of each type alone.\n"
      "Names for --fail-on are keys of --json. Numbers in parentheses are the ids of the face, cell or element.\n"
      "Example: deform quality case/0.15 --before case --fail-on \"non_orthogonality>70\" --fail-on \"inverted_cells>0\"");
  command->callback([options, &common, &chosen] { chosen = [options, &common] { return run_quality(*options, common); }; });
}

}  // namespace deform::cli
