// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <chrono>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "client/cli/commands/command.h"
#include "client/cli/commands/interrupt.h"
#include "client/cli/output/progress.h"
#include "client/cli/setup/reading.h"
#include "client/client.h"
#include "core/io/mesh_file.h"

namespace deform::cli {

/// A connection whose calls Ctrl-C cancels, here and on the server.
class Connection {
 public:
  explicit Connection(const CommonOptions& common);
  /// Calls that may be repeated wait about so long for a server that is gone.
  Connection(const CommonOptions& common, std::chrono::duration<double> patience);

  client::Client& client() { return client_; }
  /// Fresh timeout, cancelled by Ctrl-C.
  client::CallOptions call() const;
  std::stop_token interrupted() const { return interrupt_.token(); }

 private:
  const CommonOptions& common_;
  Interrupt interrupt_;  // before the client's threads
  client::Client client_;
};

/// Where the seconds went.
struct StageTimes {
  double read = 0, register_geometry = 0, prepare = 0;
};

/// Registers the mesh and lets the client keep its points. `label` is the name people see.
v1::GeometryInfo register_mesh(Connection& connection, const std::shared_ptr<const Mesh>& mesh, const std::string& label,
                               Progress& progress);

/// "12 points, 20 faces": the points that a region of this group selects; "20 faces" where an older server has not counted them.
std::string group_size_text(const v1::GroupInfo& group);

/// A setup that stands ready on the server, and the file that results are written into.
struct PreparedSetup {
  v1::SystemInfo system;
  std::shared_ptr<const io::MeshFile> source;  ///< null without a file
  std::filesystem::path source_path;
  StageTimes times;
};

struct PrepareInput {
  std::string setup;          ///< a setup file, or the id of a system
  std::string source;         ///< the mesh file of a setup that names its geometry by id; else empty
  bool turn_normals = false;  ///< io::ReadOptions::turn_normals
};

/// --turn-normals
void add_turn_normals(CLI::App& command, PrepareInput& input);

/// The setup with its geometry registered, not prepared yet.
struct LoadedSetup {
  v1::Setup setup;
  std::shared_ptr<const io::MeshFile> source;
  std::filesystem::path source_path;
  StageTimes times;
  std::optional<v1::SystemInfo> system;  ///< when it was named by its id
};
LoadedSetup load_setup(Connection& connection, const PrepareInput& input, Progress& progress);

/// Prepares what was loaded; a system that was named by its id is taken as it is. `in_info`: whether the setup of the system is
/// read afterwards.
PreparedSetup prepare_loaded(Connection& connection, LoadedSetup&& loaded, Progress& progress,
                             client::SetupInInfo in_info = client::SetupInInfo::include);

/// Reads, registers, prepares.
PreparedSetup prepare_setup(Connection& connection, const PrepareInput& input, Progress& progress);
/// The same, but a system that is named by its id is taken as it is: the server prepares it again when it has to.
PreparedSetup open_setup(Connection& connection, const PrepareInput& input, Progress& progress);

/// Throws Error(invalid_argument) when there is no file that results could be written into.
const io::MeshFile& source_of(const PreparedSetup& prepared);

/// --encoding, --tolerance.
struct OutputOptions {
  std::string encoding = "automatic";
  double tolerance = 0;
  double solver_tolerance = 0;

  void add_to(CLI::App& command);
  /// With an encoding in the place of "automatic": the one that the client takes for its server. Files are to hold what was
  /// computed, so one that rounds gets 1e-9 of the diagonal where no tolerance was given.
  OutputOptions named(const client::Client& client, const v1::SystemInfo& system) const;
  /// Sets the output of a request; the options are those that named() gave.
  void set(v1::DeformRequest& request) const;
  /// What of it determines the points before they are encoded; empty by default.
  std::string identity() const;
};

}  // namespace deform::cli
