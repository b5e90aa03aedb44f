// SPDX-License-Identifier: GPL-3.0-or-later
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <filesystem>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "client/cli/commands/command.h"
#include "client/cli/commands/mesh_reading.h"
#include "client/cli/commands/workspace.h"
#include "client/cli/output/error_json.h"
#include "client/cli/output/format.h"
#include "client/cli/output/result_json.h"
#include "client/cli/setup/control_lattice.h"
#include "client/cli/setup/plane_variables.h"
#include "core/base/text.h"
#include "proto/convert/method_traits.h"

namespace deform::cli {

namespace {

struct PrepareOptions {
  PrepareInput input;
  bool check = false;
};

/// All that is wrong with a setup.
struct Findings {
  std::vector<Problem> problems;
  std::uint64_t left_out = 0;  ///< problems that the server found besides
};

Findings findings_in(const v1::EstimateReply& reply) {
  Findings findings{{}, reply.problems_left_out()};
  for (const auto& problem : reply.problems()) findings.problems.push_back({problem.field(), problem.message()});
  return findings;
}

/// The problem with its field, which many messages name themselves.
std::string problem_text(const Problem& problem, const std::string& setup) {
  const bool named = problem.field.empty() || problem.message.starts_with(setup) || !field_of(problem.message).empty();
  return named ? problem.message : problem.field + ": " + problem.message;
}

/// One line each, unless there is only one, which is the error itself.
ExitCode tell(const Findings& findings, const std::string& setup, Style style) {
  const std::uint64_t count = findings.problems.size() + findings.left_out;
  const std::string first = problem_text(findings.problems[0], setup);
  const Error error(ErrorCode::invalid_argument,
                    count == 1 ? first : setup + ": " + std::to_string(count) + " problems, the first is: " + first);
  if (style == Style::json) {
    nlohmann::ordered_json json;
    json["problems"] = nlohmann::ordered_json::array();
    for (const Problem& problem : findings.problems) {
      json["problems"].push_back({{"field", problem.field}, {"message", problem.message}});
    }
    json["problems_left_out"] = findings.left_out;
    json["error"] = error_json(error.code(), error.what());
    print(json);
  } else if (count > 1) {
    for (const Problem& problem : findings.problems) std::cout << printable(problem_text(problem, setup)) << '\n';
    if (findings.left_out > 0) std::cout << "and " << findings.left_out << " more\n";
    std::cout << std::flush;
  }
  complain(error.what());
  return exit_code_of(error);
}

/// Prints the time of a design with constraints; other setups evaluate designs in no time.
void print_design_time(double seconds) {
  if (seconds > 0) std::cout << "  time of a design with its constraints: about " << duration_text(seconds) << '\n';
}

void print_estimate(const v1::EstimateReply& estimate, const v1::Setup& setup) {
  const char* held = selects_controls(setup) ? " control points" : " points";
  std::cout << "valid\n";
  for (const auto& handle : estimate.handles()) {
    std::cout << "  handle " << printable(handle.name()) << ": " << handle.points() << held << '\n';
  }
  std::cout << "  fixed: " << estimate.fixed_points() << held << '\n'
            << (convert::method_features(setup.method()).control_points ? "  control points: " : "  centres: at most ")
            << estimate.centres() << '\n'
            << "  memory: " << bytes_text(estimate.resident_bytes()) << " kept, " << bytes_text(estimate.peak_bytes())
            << " while preparing, budget " << bytes_text(estimate.budget_bytes()) << (estimate.fits() ? "" : ": DOES NOT FIT")
            << '\n'
            << "  time: about " << duration_text(estimate.seconds())
            << (estimate.resident() ? ", but it is prepared already" : "") << '\n';
  print_design_time(estimate.design_seconds());
  for (const auto& note : estimate.notes()) std::cout << "  note: " << printable(note) << '\n';
  std::cout << std::flush;
}

void print_counts(const v1::SystemInfo& system) {
  const std::string held =
      std::to_string(system.handle_points()) + " in handles, " + std::to_string(system.fixed_points()) + " fixed";
  if (selects_controls(system.setup())) {
    std::cout << "  control points: " << system.centres() << ", of these " << held << "\n  points: " << system.points() << '\n';
    return;
  }
  if (convert::method_features(system.setup().method()).control_points) {
    std::cout << "  control points: " << system.centres() << '\n';
  } else {
    std::cout << "  centres: " << system.centres() << (system.reduced() ? " (reduced from " : " (of ")
              << system.constraint_points() << " constraint points)\n";
  }
  std::cout << "  points: " << system.points() << ", of these " << held << ", " << system.deformable_points() << " deformable\n";
}

void print_system(const v1::SystemInfo& system) {
  std::cout << system.id() << '\n';
  print_counts(system);
  std::cout << "  memory: " << bytes_text(system.bytes()) << '\n';
  // Where control points are moved nothing is solved for, or by a pseudo-inverse that the notes tell about.
  if (system.solver() != v1::SOLVER_AUTOMATIC) {
    std::cout << "  solver: " << v1::Solver_Name(system.solver());
    if (system.condition() > 0) std::cout << ", condition " << number_text(system.condition());
    if (system.tolerance() > 0) std::cout << ", tolerance " << number_text(system.tolerance()) << " D";
    std::cout << '\n';
  } else if (system.condition() > 0) {
    std::cout << "  condition: " << number_text(system.condition()) << '\n';
  }
  std::cout << "  prepared in " << duration_text(system.seconds()) << '\n';
  for (const auto& stage : system.stages())
    std::cout << "    " << stage.stage() << ": " << duration_text(stage.seconds()) << '\n';
  print_design_time(system.design_seconds());
  for (const auto& note : system.notes()) std::cout << "  note: " << printable(note) << '\n';
  std::cout << std::flush;
}

ExitCode run_check(const PrepareOptions& options, const CommonOptions& common) {
  if (std::filesystem::is_regular_file(options.input.setup)) {
    Problems problems(Problems::Mode::collect);
    read_setup_file(options.input.setup, problems, own_process());
    if (!problems.empty()) return tell({problems.list()}, options.input.setup, common.style());
  }
  Connection connection(common);
  Progress progress;
  const LoadedSetup loaded = load_setup(connection, options.input, progress);
  progress.clear();
  v1::EstimateRequest request;
  *request.mutable_setup() = loaded.setup;
  request.set_list_problems(true);
  const auto estimate = connection.client().estimate(request, connection.call());
  Findings findings = findings_in(estimate);
  if (findings.problems.empty() && loaded.source && loaded.source->two_dimensional()) {
    Problems problems(Problems::Mode::collect);
    check_plane_variables(loaded.setup, *loaded.source->mesh(), problems);
    findings.problems = problems.list();
  }
  if (!findings.problems.empty()) return tell(findings, options.input.setup, common.style());
  const Error too_large(ErrorCode::out_of_budget, "it does not fit: preparing takes " + bytes_text(estimate.peak_bytes()) +
                                                      " beside the mesh, the budget of the server is " +
                                                      bytes_text(estimate.budget_bytes()));
  if (common.style() == Style::json) {
    auto json = to_json(estimate);
    if (!estimate.fits()) json["error"] = error_json(too_large.code(), too_large.what());
    print(json);
  } else {
    print_estimate(estimate, loaded.setup);
  }
  if (estimate.fits()) return exit_ok;
  complain(too_large.what());
  return exit_code_of(too_large);
}

ExitCode run_prepare(const PrepareOptions& options, const CommonOptions& common) {
  if (options.check) return run_check(options, common);
  Connection connection(common);
  Progress progress;
  const PreparedSetup prepared = prepare_setup(connection, options.input, progress);
  if (common.style() == Style::json) {
    print(to_json(prepared.system));
  } else {
    print_system(prepared.system);
  }
  return exit_ok;
}

/// Names of the contract, so that a new kernel, method or constraint is in the help by itself.
std::string names_of(const google::protobuf::EnumDescriptor& values) {
  std::string names;
  for (int i = 1; i < values.value_count(); ++i) names += (i > 1 ? ", " : "") + values.value(i)->name();  // 0 is the default
  return names;
}
std::string names_of(const google::protobuf::Descriptor& message) {
  const auto& kinds = *message.FindOneofByName("kind");
  std::string names;
  for (int i = 0; i < kinds.field_count(); ++i) names += (i > 0 ? ", " : "") + kinds.field(i)->name();
  return names;
}

std::string setup_help() {
  return R"(A setup file is YAML:
  geometry: ahmed.obj                     # a mesh file next to the setup file, or a geometry id
  method: {rbf: {kernel: TRIHARMONIC}}
  handles:
    - {name: slant, region: {group: slant}}
    - {name: roof,  region: {intersection: [{group: roof}, {box: {min: [0.4, -1, 0], max: [0.6, 1, 1]}}]}}
  fixed: [{group: nose}, {group: underbody}, {group: stilts}]
  variables:
    - {name: roof_up,    handle: roof,  translate: [0, 0, 1], lower: -0.04, upper: 0.04}
    - {name: slant_turn, handle: slant, rotate: {axis: [0, 1, 0], centre: [0.843, 0, 0.338]}, lower: -0.1, upper: 0.1}
Regions: group, box {min, max}, sphere {centre, radius}, cylinder {start, end, radius}, half_space {point, normal},
ids [..] or ids {file: part.points.json, set: bore} (a list in JSON, or lists by name), open_boundary: true, boundary: true (the surface of a volume mesh), all: true, union [..], intersection [..],
difference [..], complement {..}, grow {region, rings}, patch {seed: [x, y, z], angle: 30} or {point: 7} (over edges of at most that many
degrees). `deform regions` shows them in colours. Variables: translate [x, y, z], rotate {axis, centre} in radians or with unit: DEGREES,
scale {centre, axis}; also: [{handle: right, translate: [0, 1, 0]}] for other handles at the same time. Numbers may be expressions of pi
and the lengths of the mesh: upper: 0.05*L, with L the diagonal of its box and Lx, Ly, Lz its sides. `deform schema` is for editors.
A half model: symmetry: [{region: {group: symmetry}}] or [{point: [0, 0, 0], normal: [0, 1, 0]}], up to three planes that stay
planes while their points slide. A blade passage: symmetry: [{sector: {axis: [0, 0, 1], count: 36}}], whose periodic patches stay periodic.
)" + ("Methods: " + names_of(*v1::Method::descriptor()) + ".\nKernels of rbf: " + names_of(*v1::Kernel_descriptor())) +
         R"(; THIN_PLATE is the default for 2D meshes.
Solvers: SOLVER_AUTOMATIC, CHOLESKY, LDLT, ITERATIVE with a tolerance (automatic beyond 20,000
centres), as in method: {rbf: {solver: ITERATIVE, tolerance: 1e-6}}; INCREMENTAL_QR, as few centres as a tolerance needs (centre_order:
GREEDY with samples: [{variables: [0.05, 0]}] puts them where those designs need them). Energies: {shell: {}}, {mls: {}},
{subspace: {}}, {ffd: {lattice: {points: [9, 7, 7]}}}, each with energy: {stretching: 0, bending: 1}; {ffd: {control: MESH}}
manipulates a lattice directly (thesis 3.3), with clamp: 1e-4 and without constraints; {ffd: {control: CONTROLS}} is the classical FFD
whose handles and fixed regions select control points: region: {lattice: {i: [0, 2], k: [4, 4]}} (first and last, all j) or
{control: {ids: [7]}}, and lattice: {control_points: {file: moved.vtp}} starts from a lattice that was moved (`deform lattice`);
{cage: {file: cage.obj}}, a closed mesh of triangles (`deform cage mesh` makes one) whose vertices handles move in the same way, control: {ids: [7]}; with control: MESH handles are regions of the mesh, and
with coordinates: GREEN points also follow the normals of the cage, around all of them. With energies constraints: [{name: bore, circular: {}, regions: [{group: bore}]}];
kinds )" +
         names_of(*v1::Constraint::descriptor()) +
         R"(;
{rigid: {layers: 3}} keeps three layers of cells on a wall of a volume mesh; exact: true puts the points
on their shape to the last digits; constraint_options: {tolerance: 1e-7, iterations: 3000}. More in setup.proto.
Examples:
  deform prepare setup.yaml --check
  deform prepare setup.yaml --json)";
}

}  // namespace

void add_prepare_command(CLI::App& app, const CommonOptions& common, Action& chosen) {
  const auto options = std::make_shared<PrepareOptions>();
  auto* command = app.add_subcommand("prepare", "Factorize the system of a setup on the server and print its id");
  command->add_option("SETUP", options->input.setup, "Setup file, or the id of a system")->required();
  command->add_option("--source", options->input.source, "Mesh file of a setup that names its geometry by id");
  command->add_flag("--check", options->check,
                    "Only validate, and print all that is wrong or the estimate of centres, memory and time");
  command->footer(setup_help());
  command->callback([options, &common, &chosen] { chosen = [options, &common] { return run_prepare(*options, common); }; });
}

}  // namespace deform::cli
