// SPDX-License-Identifier: GPL-3.0-or-later
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <algorithm>
#include <cstdint>
#include <initializer_list>
#include <iomanip>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "client/cli/commands/command.h"
#include "client/cli/commands/mesh_reading.h"
#include "client/cli/output/error_json.h"
#include "client/cli/output/format.h"
#include "client/cli/output/gates.h"
#include "client/cli/output/measured_mesh.h"
#include "client/cli/output/quality_files.h"
#include "client/cli/output/result_json.h"
#include "core/base/error.h"
#include "core/base/text.h"

namespace deform::cli {

namespace {

struct QualityOptions {
  ComparisonInput input;
  std::vector<Gate> fail_on;
  std::string html, vtk, result;
};

/// What a measure needs that was not given; empty if nothing is known to be missing.
std::string missing_option(const std::string& measure, const ComparisonInput& input) {
  const auto is = [&](std::initializer_list<const char*> names) {
    return std::any_of(names.begin(), names.end(), [&](const char* name) { return measure == name; });
  };
  if (input.before.empty() && is({"flipped_faces", "newly_intersecting_faces", "displacement"})) {
    return "--before, the undeformed mesh: it compares the two";
  }
  if (input.walls.empty() && measure.find("wall_") != std::string::npos) return "--wall, the group of its faces";
  if (input.setup.empty() && (measure.find("_jump") != std::string::npos)) return "--setup, whose regions it is measured between";
  return {};
}

/// What a gate says of the report. Throws CLI::ValidationError when there is no such measure: which there are depends on the
/// mesh.
QualityPage::Gate gate_of(const Gate& gate, const ComparisonInput& input, const QualityReport& report) {
  if (const QualityRow* row = report.find(gate.name)) return {gate.text, row->value, gate.holds_for(row->value)};
  const std::string option = missing_option(gate.name, input);
  if (!option.empty()) throw CLI::ValidationError("--fail-on " + gate.text + ": " + gate.name + " is measured with " + option);
  throw CLI::ValidationError("--fail-on " + gate.text + ": " + report.unknown(gate.name));
}

nlohmann::ordered_json report_json(const QualityReport& report) {
  nlohmann::ordered_json json;
  for (const auto& [name, count] : report.counts) json[name] = count;
  for (const QualityRow& row : report.rows) {
    if (row.counts) {
      json[row.name] = static_cast<std::uint64_t>(row.value);
    } else {
      json[row.name] = row.value;
    }
    if (row.id) json[row.name + "_at"] = *row.id;
  }
  for (const auto& [name, ids] : report.lists) json[name] = ids;
  if (!report.failed.empty()) json["failed"] = report.failed;
  for (const QualityHistogram& histogram : report.histograms) json[histogram.name] = histogram.counts;
  return json;
}

void print_comparison(const Comparison& comparison) {
  const QualityReport& after = comparison.after.report;
  std::cout << printable(comparison.after.path) << ":";
  for (const auto& [name, count] : after.counts) {
    std::string noun = name;
    std::replace(noun.begin(), noun.end(), '_', ' ');
    if (count > 0) std::cout << ' ' << count << ' ' << noun;
  }
  std::cout << '\n';
  constexpr int label_width = 54, width = 16;
  if (comparison.before) {
    std::cout << "  " << std::left << std::setw(label_width) << "" << std::setw(width) << "before"
              << "after\n";
  }
  for (const QualityRow& row : after.rows) {
    if (!row.in_table) continue;
    std::cout << "  " << std::left << std::setw(label_width) << row.label;
    if (comparison.before) {
      const QualityRow* same = comparison.before->report.find(row.name);
      std::cout << std::setw(width) << (same ? number_text(same->value) : "-");
    }
    std::cout << number_text(row.value);
    if (row.id) std::cout << "  (" << *row.id << ")";
    std::cout << '\n';
  }
  for (const std::string& failed : after.failed) std::cout << "  check failed: " << failed << '\n';
  for (const std::string& note : comparison.notes) std::cout << "  note: " << note << '\n';
  std::cout << std::flush;
}

void print_json(const Comparison& comparison, const std::string& failure) {
  nlohmann::ordered_json json = report_json(comparison.after.report);
  json["file"] = comparison.after.path;
  if (comparison.before) json["before"] = report_json(comparison.before->report);
  if (!comparison.notes.empty()) json["notes"] = comparison.notes;
  if (!failure.empty()) json["error"] = verdict_error_json(failure);
  print(json);
}

/// The message of the first gate that fails; empty when none does.
std::string failure_text(const std::vector<QualityPage::Gate>& gates, const std::string& file) {
  for (const auto& gate : gates) {
    if (gate.failed) return file + ": " + to_text({gate.condition, gate.value});
  }
  return {};
}

ExitCode run_quality(const QualityOptions& options, const CommonOptions& common) {
  ComparisonInput input = options.input;
  input.reading = own_process();
  for (const auto& [option, output] : {std::pair("--html", options.html), std::pair("--vtu", options.vtk)}) {
    keep_inputs(option, output, {input.file, input.before, input.setup, options.result});
  }
  PageExtras extras;
  if (!options.result.empty()) extras.constraints = constraints_of(options.result);
  const Comparison comparison = compare(input);
  std::vector<QualityPage::Gate>& gates = extras.gates;
  for (const auto& gate : options.fail_on) gates.push_back(gate_of(gate, input, comparison.after.report));
  const std::string failure = failure_text(gates, options.input.file);
  if (common.style() == Style::json) {
    print_json(comparison, failure);
  } else {
    print_comparison(comparison);
  }
  // Written also when a gate fails: that is when they are looked at.
  if (!options.html.empty()) write_quality_page(comparison, extras, options.html);
  if (!options.vtk.empty()) write_quality_arrays(comparison, options.vtk);
  if (failure.empty()) return exit_ok;
  complain(failure);
  return exit_verdict;
}

constexpr char quality_footer[] =
    R"(OpenFOAM meshes get the measures of its checkMesh, by the same formulas; elements the scaled Jacobian
(Knupp 2000; of quadratic elements that of their quadratic map at all nodes), also those of each type alone. It is 1
for cubes, 0.707 for regular tetrahedra and 0.866 for equilateral triangles, which Verdict and ParaView scale to 1.
Their aspect ratio is the longest edge over the smallest height: 1 for cubes, 1.22 for regular tetrahedra.
Inverted means the same as in `deform apply`: elements with a determinant that is not positive at a corner or a node, cells
whose volume or a pyramid is not positive. All of them count here; inverted_cells and least_determinant of `deform apply`
leave out those that were inverted at rest (inverted_at_rest). The checks of checkMesh that fail are named with their counts.
Surfaces: twice the radius of the inscribed over that of the circumscribed circle of faces (1: regular), angles at corners,
discrete mean curvature (cotangent weights, inside the surface), with --before the faces that turned by more than 90 degrees
against their surroundings: a part that turns as a whole has none. Triangles and quads in a plane z = constant (2D) also as
elements: scaled Jacobian, inverted elements, equiangle skewness.
--wall: the height of the first layer of cells (volume over wall face) and the angle of the edges that leave the wall to
its normal; all walls together.
--setup: how smoothly handles, fixed regions and the rest meet: jumps of normals and of mean curvature over their borders.
Names for --fail-on are keys of --json. Numbers in parentheses are the ids of the point, face, cell or element.
Examples:
  deform quality case/0.15 --before case --fail-on "non_orthogonality>70" --fail-on "inverted_cells>0" --wall car_body
  deform quality out.obj --before ahmed.obj --setup ahmed.yaml --html report.html --vtp out.vtp)";

}  // namespace

void add_quality_command(CLI::App& app, const CommonOptions& common, Action& chosen) {
  const auto options = std::make_shared<QualityOptions>();
  auto* command = app.add_subcommand("quality", "Measure a surface or the cells of a volume mesh; needs no server");
  command->add_option("FILE", options->input.file, "Mesh: surface or volume, or one of the time folders of an OpenFOAM case")
      ->required();
  command->add_option(
      "--before", options->input.before,
      "The undeformed mesh, shown beside it; lends its faces to points alone, as deform sweep writes them of OpenFOAM");
  add_gate_option(*command, options->fail_on, "Exit code 4 when NAME>NUMBER or NAME<NUMBER holds; may be repeated");
  command->add_option("--wall", options->input.walls, "Group of boundary faces whose first layer is measured; may be repeated")
      ->allow_extra_args(false);
  command->add_option("--setup", options->input.setup, "Setup file: measures where its regions meet");
  command->add_option("--html", options->html, "Writes a page for people, one file that needs no network");
  command->add_option("--result", options->result,
                      "What `deform apply --json` printed: its constraints are on the page of --html");
  command->add_option("--vtu,--vtp", options->vtk, "Writes the mesh with its measures for ParaView: .vtu, of surfaces .vtp");
  command->footer(quality_footer);
  command->callback([options, &common, &chosen] { chosen = [options, &common] { return run_quality(*options, common); }; });
}

}  // namespace deform::cli
