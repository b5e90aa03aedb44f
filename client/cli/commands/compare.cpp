// SPDX-License-Identifier: GPL-3.0-or-later
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <algorithm>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "client/cli/commands/command.h"
#include "client/cli/commands/mesh_reading.h"
#include "client/cli/commands/workspace.h"
#include "client/cli/compare/compared.h"
#include "client/cli/compare/compared_output.h"
#include "client/cli/output/error_json.h"
#include "client/cli/output/format.h"
#include "client/cli/output/result_json.h"
#include "client/cli/setup/motions.h"
#include "client/cli/setup/setup_stages.h"
#include "client/cli/sweep/sweep_designs.h"
#include "client/design.h"

namespace deform::cli {

namespace {

struct CompareOptions {
  PrepareInput input;
  std::vector<std::string> methods;
  std::vector<std::string> settings;
  std::string designs;
  std::string output;
};

constexpr std::size_t most_designs = 100;
constexpr std::size_t drawn_designs = 4;  ///< that have pictures

std::string values_text(const v1::Setup& setup, const std::vector<double>& values) {
  std::string text;
  for (std::size_t k = 0; k < values.size(); ++k) {
    if (values[k] == 0) continue;
    text += (text.empty() ? "" : ", ") + setup.variables(static_cast<int>(k)).name() + " = " + number_text(values[k]);
  }
  return text.empty() ? "all variables 0" : text;
}

std::vector<NamedDesign> designs_of(const CompareOptions& options, const v1::Setup& setup) {
  if (options.designs.empty()) {
    const std::vector<double> values = parse_settings(options.settings, setup);
    for (std::size_t k = 0; k < values.size(); ++k) {
      const auto& variable = setup.variables(static_cast<int>(k));
      const auto problem = out_of_bounds(variable, values[k]);
      if (problem) throw Error(ErrorCode::invalid_argument, "--set " + variable.name() + ": " + *problem);
    }
    return {{"design", values}};
  }
  DesignTable table = read_designs(read_csv(options.designs), setup);
  if (!table.bad.empty()) throw Error(ErrorCode::invalid_argument, table.bad[0].reason);
  if (table.designs.size() > most_designs) {
    throw Error(ErrorCode::invalid_argument, "--designs " + options.designs + ": " + std::to_string(table.designs.size()) +
                                                 " designs, at most " + std::to_string(most_designs) + " are compared");
  }
  return std::move(table.designs);
}

/// Prepares and deforms by one method after the other.
class Comparer {
 public:
  Comparer(Connection& connection, const LoadedSetup& loaded, const std::vector<NamedDesign>& designs, Progress& progress)
      : connection_(connection), loaded_(loaded), designs_(designs), progress_(progress) {}

  ComparedMethod run(const MethodChoice& choice) {
    ComparedMethod method{choice, {}, {}, 0, 0, {}};
    if (choice.method.has_cage() && choice.method.cage().vertices_size() == 0) {
      method.refusals = {
          "a cage method needs a cage, which the setup has none of: name a file that holds method: {cage: {file: cage.obj}} in "
          "--methods; deform cage mesh makes the cage"};
      return method;
    }
    try {
      v1::Setup setup = loaded_.setup;
      *setup.mutable_method() = choice.method;
      estimate(setup, method);
      if (!method.refusals.empty()) return method;
      method.system = connection_.client().prepare(
          setup, connection_.call(),
          [&](const std::string& stage, double fraction) { progress_.fraction(choice.label + ", " + stage, fraction); },
          client::SetupInInfo::omit);
      for (const NamedDesign& design : designs_) method.designs.push_back(deformed(design, method));
      if (method.works()) method.seconds_per_design = seconds_per_design(method);
    } catch (const Error& error) {
      if (exit_code_of(error) != exit_failed) throw;
      method.refusals = {error.what()};
      method.designs.clear();
    }
    return method;
  }

  /// Null when no method was accepted.
  const DesignMeasurer* measurer() const { return measurer_.get(); }

 private:
  void estimate(const v1::Setup& setup, ComparedMethod& method) {
    v1::EstimateRequest request;
    *request.mutable_setup() = setup;
    request.set_list_problems(true);
    const auto reply = connection_.client().estimate(request, connection_.call());
    for (const auto& problem : reply.problems()) {
      const bool named = !field_of(problem.message()).empty();
      method.refusals.push_back(named || problem.field().empty() ? problem.message()
                                                                 : problem.field() + ": " + problem.message());
    }
    if (reply.problems_left_out() > 0) method.refusals.push_back("and " + std::to_string(reply.problems_left_out()) + " more");
    if (method.refusals.empty() && !reply.fits()) {
      method.refusals.push_back("preparing takes up to " + bytes_text(reply.peak_bytes()) +
                                " beside the mesh, the memory budget of the server is " + bytes_text(reply.budget_bytes()));
    }
    method.peak_bytes = reply.peak_bytes();
  }

  v1::DeformRequest request(const ComparedMethod& method, const NamedDesign& design, v1::CellCheck check) {
    v1::DeformRequest request;
    request.set_system_id(method.system.id());
    OutputOptions().named(connection_.client(), method.system).set(request);
    request.set_check(check);
    request.set_failures(v1::FAILURES_PER_DESIGN);
    *request.add_designs() = client::variables_design(design.values);
    return request;
  }

  ComparedDesign deformed(const NamedDesign& design, const ComparedMethod& method) {
    progress_.count(method.choice.label, method.designs.size(), designs_.size());
    auto outcome = connection_.client().deform(request(method, design, v1::CELL_QUALITY), connection_.call());
    auto& made = outcome.designs.at(0);
    if (made.error) {
      ComparedDesign failed;
      failed.error = made.error->what();
      return failed;
    }
    if (!measurer_) measurer_ = std::make_unique<DesignMeasurer>(loaded_.setup, *loaded_.source);
    const bool drawn = method.designs.size() < drawn_designs;
    return measurer_->measured(made.result, std::move(made.points), design.values,
                               drawn ? DesignMeasurer::Keep::pictures : DesignMeasurer::Keep::nothing);
  }

  /// The median of three runs of the first design that has a deformation.
  double seconds_per_design(const ComparedMethod& method) {
    constexpr std::size_t runs = 3;
    std::size_t first = 0;
    while (!method.designs[first].error.empty()) ++first;
    std::vector<double> seconds;
    for (std::size_t k = 0; k < runs; ++k) {
      const auto outcome = connection_.client().deform(request(method, designs_[first], v1::CELL_CHECK_OFF), connection_.call());
      seconds.push_back(1e-3 * outcome.summary.wall_ms());
    }
    std::nth_element(seconds.begin(), seconds.begin() + runs / 2, seconds.end());
    return seconds[runs / 2];
  }

  Connection& connection_;
  const LoadedSetup& loaded_;
  const std::vector<NamedDesign>& designs_;
  Progress& progress_;
  std::unique_ptr<const DesignMeasurer> measurer_;
};

void check_page_name(const std::filesystem::path& path) {
  if (path.empty() || path.extension() == ".html" || path.extension() == ".htm") return;
  throw Error(ErrorCode::invalid_argument,
              "--output " + path.string() + ": the page is HTML, its name must end in .html or .htm");
}

ExitCode run_compare(const CompareOptions& options, const CommonOptions& common) {
  if (options.settings.empty() == options.designs.empty()) {
    throw Error(ErrorCode::invalid_argument, "expected exactly one of --set, --designs: the designs that are compared");
  }
  Connection connection(common);
  Progress progress;
  const LoadedSetup loaded = load_setup(connection, options.input, progress);
  if (!loaded.source) {
    throw Error(ErrorCode::invalid_argument,
                "the setup names its geometry by id: give the mesh file that results are measured against, --source FILE");
  }
  keep_inputs("--output", options.output, {options.input.setup, loaded.source_path, options.designs});
  check_folder("--output", options.output);
  check_page_name(options.output);
  refuse_several_methods(loaded.setup, "setups with one method are compared; leave the further ones out");
  const std::vector<MethodChoice> choices = method_choices(options.methods, loaded.setup, loaded.source->mesh());
  const std::vector<NamedDesign> designs = designs_of(options, loaded.setup);
  Comparer comparer(connection, loaded, designs, progress);
  MethodComparison comparison;
  comparison.setup = options.input.setup;
  comparison.mesh = loaded.source->mesh();
  for (const NamedDesign& design : designs) {
    comparison.designs.push_back(design.name);
    comparison.values.push_back(values_text(loaded.setup, design.values));
  }
  std::optional<Error> ended;  // by the user, or with the server: what was compared before is printed
  for (const MethodChoice& choice : choices) {
    try {
      comparison.methods.push_back(comparer.run(choice));
    } catch (const Error& error) {
      if (comparison.methods.empty()) throw;
      ended.emplace(error.code(),
                    std::string(error.what()) + "; only " + std::to_string(comparison.methods.size()) + " of " +
                        std::to_string(choices.size()) + " methods were compared",
                    error.retry_after_ms());
      break;
    }
  }
  progress.clear();
  if (comparer.measurer() != nullptr) {
    comparison.measures = comparer.measurer()->measures();
    comparison.hidden = faces_without_handles(loaded.setup, *comparison.mesh);
  }
  const bool works = std::any_of(comparison.methods.begin(), comparison.methods.end(), [](const auto& m) { return m.works(); });
  const Error failure =
      ended.value_or(Error(ErrorCode::invalid_argument, options.input.setup + ": no method gave a deformation"));
  if (common.style() == Style::json) {
    auto json = comparison_json(comparison);
    if (!works || ended) json["error"] = error_json(failure.code(), failure.what());
    print(json);
  } else {
    print_comparison(comparison, std::cout);
  }
  if (!options.output.empty()) write_comparison_page(comparison, options.output);
  if (works && !ended) return exit_ok;
  complain(failure.what());
  return exit_code_of(failure);
}

constexpr char compare_footer[] =
    R"(The same handles, fixed regions, variables and constraints by several methods: what each makes of them, and what it costs. Methods
are rbf, shell, subspace, mls, ffd and cage, with the options that the setup has for its own method and the defaults for the others,
or files like {method: {ffd: {lattice: {points: [9, 7, 7]}}}}; a cage needs such a file. A method that refuses the setup is listed
with the reasons; the exit code is 1 only when none gave a deformation. The systems stay on the server.
Examples:
  deform compare setup.yaml --set roof_up=0.03 -o report.html
  deform compare setup.yaml --methods rbf,shell,fine.yaml --designs designs.csv -o report.html --json)";

}  // namespace

void add_compare_command(CLI::App& app, const CommonOptions& common, Action& chosen) {
  const auto options = std::make_shared<CompareOptions>();
  auto* command = app.add_subcommand("compare", "Deform by several methods and compare quality, smoothness, time and memory");
  command->add_option("SETUP", options->input.setup, "Setup file, or the id of a system")->required();
  command
      ->add_option("--methods", options->methods,
                   "Methods, or files that hold one, separated by commas; unless given that of the setup and all others but cage")
      ->delimiter(',')
      ->take_all()
      ->expected(1)
      ->allow_extra_args(false);
  command->add_option("--set", options->settings, "NAME=VALUE of a design variable; may be repeated")
      ->take_all()
      ->expected(1)
      ->allow_extra_args(false);
  command->add_option("--designs", options->designs, "CSV file with a design per line, as of sweep; at most 100");
  command->add_option("-o,--output", options->output, "Page to write, one file of HTML with pictures of the first four designs");
  command->add_option("--source", options->input.source, "Mesh file of a setup that names its geometry by id");
  command->footer(compare_footer);
  command->callback([options, &common, &chosen] { chosen = [options, &common] { return run_compare(*options, common); }; });
}

}  // namespace deform::cli
