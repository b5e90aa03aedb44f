// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/commands/workspace.h"

#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <algorithm>
#include <atomic>
#include <chrono>

#include "client/cli/commands/mesh_reading.h"
#include "client/cli/output/format.h"
#include "client/cli/setup/compiled_file.h"

namespace deform::cli {

namespace {

constexpr double written_tolerance = 1e-9;  // of D: below the first cell of any boundary layer

constexpr std::int64_t seconds_between_warnings = 30;

double seconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

/// Says once in a while what a call waits for.
client::ClientOptions telling(client::ClientOptions options) {
  const auto last_warning = std::make_shared<std::atomic<std::int64_t>>(0);
  options.on_wait = [last_warning](const Error& error) {
    const auto now =
        std::chrono::duration_cast<std::chrono::seconds>(std::chrono::steady_clock::now().time_since_epoch()).count();
    std::int64_t last = last_warning->load();
    if ((last != 0 && now - last < seconds_between_warnings) || !last_warning->compare_exchange_strong(last, now)) return;
    warn("waiting for the server: " + std::string(error.what()));
  };
  return options;
}

client::ClientOptions with_patience(client::ClientOptions options, std::chrono::duration<double> patience) {
  options.patience = std::chrono::duration_cast<std::chrono::milliseconds>(patience);
  return options;
}

}  // namespace

Connection::Connection(const CommonOptions& common) : common_(common), client_(telling(common.client_options())) {}

Connection::Connection(const CommonOptions& common, std::chrono::duration<double> patience)
    : common_(common), client_(with_patience(telling(common.client_options()), patience)) {}

client::CallOptions Connection::call() const {
  client::CallOptions options = common_.call_options();
  options.stop = interrupt_.token();
  return options;
}

v1::GeometryInfo register_mesh(Connection& connection, const std::shared_ptr<const Mesh>& mesh, const std::string& label,
                               Progress& progress) {
  client::GeometryArrays arrays;
  arrays.points = mesh->points;
  arrays.face_sizes = mesh->face_sizes;
  arrays.face_points = mesh->face_points;
  for (const auto& group : mesh->groups) arrays.groups.push_back({group.name, group.points, group.faces});
  arrays.name = label;
  arrays.cells = mesh->cells_view();
  auto info = connection.client().register_geometry(arrays, connection.call(),
                                                    [&](double fraction) { progress.fraction("upload", fraction); });
  // The points of the mesh itself, so that no copy stays.
  connection.client().keep_points(info.id(), std::shared_ptr<const Points>(mesh, &mesh->points));
  if (mesh->face_count() == 0 && mesh->cell_count() == 0 && !info.existed()) {
    progress.clear();
    warn(label + ": no faces and no cells, only " + std::to_string(mesh->point_count()) +
         " points: faces that fold are not found, and methods on a surface are refused");
  }
  return info;
}

std::string group_size_text(const v1::GroupInfo& group) {
  const std::uint64_t points = std::max(group.all_points(), group.points());
  const std::string faces = std::to_string(group.faces()) + " faces";
  return points == 0 && group.faces() > 0 ? faces : std::to_string(points) + " points, " + faces;
}

namespace {

void read_source(LoadedSetup& loaded, const std::filesystem::path& path, const PrepareInput& input, const std::stop_token& stop) {
  const auto start = std::chrono::steady_clock::now();
  io::ReadOptions reading = own_process(stop);
  reading.turn_normals = input.turn_normals;
  loaded.source = io::read_mesh_file(path, reading);
  loaded.source_path = path;
  loaded.times.read = seconds_since(start);
}

}  // namespace

void add_turn_normals(CLI::App& command, PrepareInput& input) {
  command.add_flag(
      "--turn-normals", input.turn_normals,
      "For OBJ files: write vertex normals turned with their faces (those of STL facets are, always); else they stay");
}

LoadedSetup load_setup(Connection& connection, const PrepareInput& input, Progress& progress) {
  LoadedSetup loaded;
  if (is_compiled_file(input.setup)) {
    throw Error(ErrorCode::invalid_argument,
                input.setup +
                    ": is a compiled deformation, and this command needs a setup file or the id of a system, and a server. "
                    "Without a server deform apply evaluates one design of it, and deformd.load() of the Python package "
                    "any number of them");
  }
  if (!std::filesystem::exists(input.setup) && looks_like_id(input.setup)) {
    loaded.system = connection.client().get_system(input.setup, connection.call());
    loaded.setup = loaded.system->setup();
  } else {
    SetupFile file = read_setup_file(input.setup, own_process(connection.interrupted()));
    loaded.setup = std::move(file.setup);
    if (file.geometry_file) {
      if (!input.source.empty()) {
        throw Error(ErrorCode::invalid_argument, "--source: the setup names its mesh file itself; remove one of the two");
      }
      read_source(loaded, *file.geometry_file, input, connection.interrupted());
    }
  }
  if (!input.source.empty()) read_source(loaded, input.source, input, connection.interrupted());
  if (!loaded.source) return loaded;
  const auto start = std::chrono::steady_clock::now();
  const auto info = register_mesh(connection, loaded.source->mesh(), loaded.source_path.filename().string(), progress);
  loaded.times.register_geometry = seconds_since(start);
  if (!info.id().starts_with(loaded.setup.geometry())) {
    throw Error(ErrorCode::invalid_argument,
                "--source " + input.source + ": holds geometry " + info.id() + ", the setup is for " + loaded.setup.geometry());
  }
  loaded.setup.set_geometry(info.id());  // in place of nothing, or of a part of it
  return loaded;
}

PreparedSetup prepare_loaded(Connection& connection, LoadedSetup&& loaded, Progress& progress, client::SetupInInfo in_info) {
  PreparedSetup prepared;
  const auto start = std::chrono::steady_clock::now();
  if (loaded.system) {
    prepared.system = std::move(*loaded.system);
  } else {
    prepared.system = connection.client().prepare(
        loaded.setup, connection.call(), [&](const std::string& stage, double fraction) { progress.fraction(stage, fraction); },
        in_info);
  }
  progress.clear();
  prepared.source = std::move(loaded.source);
  prepared.source_path = std::move(loaded.source_path);
  prepared.times = loaded.times;
  prepared.times.prepare = seconds_since(start);
  return prepared;
}

PreparedSetup prepare_setup(Connection& connection, const PrepareInput& input, Progress& progress) {
  LoadedSetup loaded = load_setup(connection, input, progress);
  loaded.system.reset();
  return prepare_loaded(connection, std::move(loaded), progress);
}

PreparedSetup open_setup(Connection& connection, const PrepareInput& input, Progress& progress) {
  return prepare_loaded(connection, load_setup(connection, input, progress), progress);
}

const io::MeshFile& source_of(const PreparedSetup& prepared) {
  if (prepared.source) return *prepared.source;
  throw Error(ErrorCode::invalid_argument,
              "the setup names its geometry by id: give the mesh file that results are written into, --source FILE");
}

void OutputOptions::add_to(CLI::App& command) {
  command
      .add_option("--encoding", encoding,
                  "How points travel: raw_f64 (bit-exact), raw_f32, draco or delta_zstd (both within the tolerance); automatic: "
                  "raw_f64 when the server is on this machine, else delta_zstd with a tolerance of 1e-9 of the diagonal")
      ->transform(CLI::IsMember({"automatic", "raw_f64", "raw_f32", "draco", "delta_zstd"}, CLI::ignore_case))
      ->capture_default_str();
  command
      .add_option(
          "--tolerance", tolerance,
          "Largest error of a coordinate for draco and delta_zstd, model units; 0: 1e-6 of the bounding-box diagonal where "
          "they are named")
      ->check(not_negative())
      ->capture_default_str();
  command
      .add_option("--solver-tolerance", solver_tolerance,
                  "For setups with solver ITERATIVE or INCREMENTAL_QR: another tolerance for these designs, as a fraction of the "
                  "bounding-box diagonal; 0: that of the setup")
      ->check(CLI::Range(0.0, 1e-2))
      ->capture_default_str();
}

std::string OutputOptions::identity() const {
  return solver_tolerance == 0 ? "" : " solver tolerance " + number_text(solver_tolerance);
}

OutputOptions OutputOptions::named(const client::Client& client, const v1::SystemInfo& system) const {
  OutputOptions result = *this;
  if (encoding != "automatic") return result;
  result.encoding = client.encoding() == v1::RAW_F64 ? "raw_f64" : "delta_zstd";
  if (tolerance == 0 && result.encoding != "raw_f64") result.tolerance = written_tolerance * system.diagonal();
  return result;
}

void OutputOptions::set(v1::DeformRequest& request) const {
  request.set_solver_tolerance(solver_tolerance);
  v1::Output& output = *request.mutable_output();
  output.set_tolerance(tolerance);
  output.set_encoding(encoding == "raw_f64"   ? v1::RAW_F64
                      : encoding == "raw_f32" ? v1::RAW_F32
                      : encoding == "draco"   ? v1::DRACO
                                              : v1::DELTA_ZSTD);
}

}  // namespace deform::cli
