// SPDX-License-Identifier: GPL-3.0-or-later
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>

#include "client/cli/commands/command.h"
#include "client/cli/commands/mesh_reading.h"
#include "client/cli/commands/workspace.h"
#include "client/cli/output/format.h"
#include "client/cli/output/result_json.h"
#include "client/cli/setup/control_lattice.h"
#include "client/cli/sweep/durable_file.h"
#include "core/base/text.h"
#include "core/compiled/reader.h"
#include "core/io/mesh_file.h"
#include "proto/convert/method_traits.h"

namespace deform::cli {

namespace {

struct CompileOptions {
  PrepareInput input;
  std::string output;
};

/// What grows beside the file until it is complete, and is gone when it never is.
class Partial {
 public:
  explicit Partial(const std::filesystem::path& target) : path_(target.string() + ".part") {
    std::error_code error;
    std::filesystem::remove(path_, error);
    file_.emplace(path_);
  }
  ~Partial() {
    if (!file_) return;
    file_.reset();
    std::error_code error;
    std::filesystem::remove(path_, error);
  }
  Partial(const Partial&) = delete;
  Partial& operator=(const Partial&) = delete;

  const std::filesystem::path& path() const { return path_; }
  void append(std::span<const std::byte> bytes) { file_->append({reinterpret_cast<const char*>(bytes.data()), bytes.size()}); }
  void complete(const std::filesystem::path& target) {
    file_->sync();
    file_->rename(target);
    file_.reset();
  }

 private:
  const std::filesystem::path path_;
  std::optional<DurableFile> file_;
};

void print_compiled(const compiled::Content& content, const std::string& file, std::uint64_t bytes, double seconds) {
  std::cout << "wrote " << printable(file) << ": " << bytes_text(bytes) << ", " << content.points() << " points, "
            << content.fields() << " fields, in " << duration_text(seconds) << '\n';
  for (const compiled::Variable& variable : content.variables) {
    std::cout << "  " << printable(variable.name) << ": " << number_text(variable.lower) << " to " << number_text(variable.upper)
              << '\n';
  }
  for (const std::string& note : content.notes) std::cout << "  note: " << printable(note) << '\n';
  std::cout << std::flush;
}

nlohmann::ordered_json compiled_json(const compiled::Content& content, const std::string& file, std::uint64_t bytes,
                                     double seconds) {
  nlohmann::ordered_json json;
  json["file"] = file;
  json["bytes"] = bytes;
  json["system_id"] = content.system_id;
  json["geometry_id"] = content.geometry_id;
  json["mesh"] = content.mesh;
  json["method"] = content.method;
  json["points"] = content.points();
  json["fields"] = content.fields();
  json["variables"] = nlohmann::ordered_json::array();
  for (const compiled::Variable& variable : content.variables) {
    nlohmann::ordered_json one{{"name", variable.name}};
    if (std::isfinite(variable.lower)) one["lower"] = variable.lower;
    if (std::isfinite(variable.upper)) one["upper"] = variable.upper;
    json["variables"].push_back(std::move(one));
  }
  json["notes"] = content.notes;
  json["seconds"] = seconds;
  return json;
}

/// Refuses what the server would refuse after it was prepared.
void check_compilable(const v1::Setup& setup) {
  const auto refuse = [](const std::string& reason) {
    throw Error(ErrorCode::failed_precondition, "this setup cannot be compiled: " + reason);
  };
  if (setup.then_size() > 0) {
    refuse("it has several methods, one after the other; compile a setup with one method, or evaluate on the server");
  }
  if (setup.constraints_size() > 0) {
    refuse(
        "with constraints the points are no linear function of the motions of the handles, and every design is solved for; "
        "leave the constraints out, or evaluate on the server");
  }
  if (setup.variables_size() == 0) refuse("it has no design variables; add `variables` to it");
  // The server says more about handles that hold control points.
  if (setup.symmetry_size() > 0 && !convert::method_features(setup.method()).symmetry && !selects_controls(setup)) {
    refuse(
        "with symmetry planes or a sector its method deforms the model with its images; use method rbf, control CONTROLS of a "
        "lattice or cage, or compile the whole model");
  }
  if (setup.method().has_cage() && setup.method().cage().coordinates() == v1::GREEN) {
    refuse(
        "Green coordinates have no handle basis, as normals of the cage are no linear function of the motions of the handles; "
        "use "
        "coordinates MEAN_VALUE, or evaluate on the server");
  }
  if (convert::basis_of(setup.method()) == v1::BASIS_NEVER) {
    refuse("with BASIS_NEVER it has no handle basis; leave that out, or give BASIS_ALWAYS");
  }
}

ExitCode run_compile(const CompileOptions& options, const CommonOptions& common) {
  const auto start = std::chrono::steady_clock::now();
  keep_inputs("--output", options.output, {options.input.setup, options.input.source});
  check_folder("--output", options.output);
  Connection connection(common);
  Progress progress;
  LoadedSetup loaded = load_setup(connection, options.input, progress);
  keep_inputs("--output", options.output, {loaded.source_path});
  check_compilable(loaded.setup);
  const PreparedSetup prepared = prepare_loaded(connection, std::move(loaded), progress, client::SetupInInfo::omit);
  Partial partial(options.output);
  v1::GetBasisRequest request;
  request.set_system_id(prepared.system.id());
  const std::filesystem::path& path = prepared.source_path;
  request.set_mesh((path.has_filename() ? path : path.parent_path()).filename().string());
  connection.client().get_basis(
      request, [&](std::span<const std::byte> records) { partial.append(records); }, connection.call());
  const compiled::Content content = compiled::read_content(partial.path());
  partial.complete(options.output);
  const std::uint64_t size = std::filesystem::file_size(options.output);
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  if (common.style() == Style::json) {
    print(compiled_json(content, options.output, size, seconds));
  } else {
    print_compiled(content, options.output, size, seconds);
  }
  return exit_ok;
}

}  // namespace

void add_compile_command(CLI::App& app, const CommonOptions& common, Action& chosen) {
  const auto options = std::make_shared<CompileOptions>();
  auto* command = app.add_subcommand("compile", "Write a deformation that needs no server: a file for apply and for programs");
  command->add_option("SETUP", options->input.setup, "Setup file, or the id of a prepared system")->required();
  command->add_option("-o,--output", options->output, "File to write, mostly NAME.deformation")->required();
  command->add_option("--source", options->input.source, "Mesh file of a setup that names its geometry by id");
  command->footer(
      "The file holds the mesh's points, what the handles do to them, and the design variables with their bounds. Systems with\n"
      "constraints or without a basis (BASIS_NEVER, Green coordinates), and setups without design variables have no such form.\n"
      "Examples:\n"
      "  deform compile setup.yaml -o car.deformation\n"
      "  deform apply car.deformation --set roof_up=0.03 -o out.obj");
  command->callback([options, &common, &chosen] { chosen = [options, &common] { return run_compile(*options, common); }; });
}

}  // namespace deform::cli
