// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "core/mesh/mesh.h"
#include "deform/v1/geometry.pb.h"
#include "deform/v1/service.pb.h"
#include "server/store/catalog.h"
#include "server/store/disk_space.h"
#include "server/store/store_directory.h"

namespace deform::server {

struct StoreOptions {
  DiskOptions disk;
  /// Called after every step that a crash could follow; for tests.
  std::function<void(const char* step)> on_step = [](const char*) {};
};

/// Durable, content-addressed geometries and the setups prepared on them, in one directory that belongs to the server's user
/// alone:
///
///   deformd-store     the mark: this folder is a store, and of which format. Without it, only an empty folder becomes one
///   lock              held by flock while the store is open: one process per directory
///   catalog.sqlite    names, setups, intents; a row decides what is visible, and has a checksum
///   geometries/<id>   the content whose SHA-256 is its id, immutable
///   names/<id>        the row of the geometry (name, time, description), with a checksum
///   setups/<id>       the row of a setup: its canonical form, whose hash is its id, and its description, with a checksum
///   tmp/              files of uploads under way, named after their intent
///   damaged/          files and catalogs that were damaged; never touched again
///   unclaimed/        what stood among the files and is nothing of the store's; never touched again
///   reserve           room for deleting on a full disk
///   catalog.sqlite.schema-1   the catalog as deformd 0.1 left it
///
/// Put: intent, file in tmp/, synced, renamed, directory synced, the small file in the same way, row (which ends the intent).
/// Remove: rows away and intent (one step), files away, directories synced, intent ended. So a crash at any point leaves what was
/// visible before or after. At the start, files named by an intent and by no row are removed, and nothing else ever is: a file
/// without a row is adopted when its hash is its name, and moved to unclaimed/ when not. The catalog is checked; if it is damaged
/// it is moved to damaged/ and rebuilt from names/, setups/, geometries/ and what can still be read of it.
/// A row whose file is missing or damaged is listed with `damage`, an Error(data_loss) when used, and healed by registering
/// again. Where the disk is full, what is there is served, and deleting works; adding is an Error(out_of_budget). Thread-safe.
class GeometryStore {
 public:
  /// Throws Error(unavailable) when another process has the directory or it cannot be written, Error(failed_precondition) when it
  /// is a folder of something else.
  explicit GeometryStore(const std::filesystem::path& directory, StoreOptions options = {});
  ~GeometryStore();
  GeometryStore(const GeometryStore&) = delete;
  GeometryStore& operator=(const GeometryStore&) = delete;

  /// Stores a validated mesh; `existed` of the answer tells whether it was there.
  v1::GeometryInfo put(const Mesh& mesh, const std::string& id, const std::string& name);
  /// The row and the file are there.
  bool contains(const std::string& id);
  /// Throws Error(not_found).
  v1::GeometryInfo info(const std::string& id);
  /// Reads and verifies; throws Error(not_found), Error(data_loss).
  Mesh load(const std::string& id);
  /// Also the setups when the policy says so; returns their ids. Throws Error(not_found), Error(failed_precondition). Whoever has
  /// loaded the mesh keeps it.
  std::vector<std::string> remove(const std::string& id, WithSetups policy);

  /// Adds or replaces; returns when the setup was stored first. Where nothing can be written, a setup that is there stays as it
  /// is.
  std::int64_t put_setup(SetupRecord record);
  /// Throws Error(data_loss) when neither the row nor the small file is whole.
  std::optional<SetupRecord> find_setup(const std::string& id);
  /// False when there was none.
  bool remove_setup(const std::string& id);

  /// Throws Error(out_of_budget) when so many bytes cannot be added now.
  void require_room(std::size_t bytes) const { disk_.require(bytes); }
  /// Whether the store may be added to, and what was set aside. Also takes back the reserve when there is room again.
  v1::StoreInfo state();

  v1::ListGeometriesReply list(const v1::ListGeometriesRequest& request);

  /// Full ids from full ids or unique prefixes of at least 8 digits. Throws Error(invalid_argument) for what is no such prefix or
  /// has several answers, Error(not_found).
  std::string resolve_geometry(const std::string& id_or_prefix);
  std::string resolve_setup(const std::string& id_or_prefix);

  /// For listings of setups and counts; what changes files goes through the store.
  Catalog& catalog() { return *catalog_; }

 private:
  v1::GeometryInfo described(const GeometryRecord& record);
  std::optional<GeometryRecord> put_content(const Mesh& mesh, const GeometryRecord& record, std::int64_t intent);
  void take_back(const GeometryRecord& record, std::int64_t intent);
  Intent remove_rows(const std::string& id, WithSetups policy);
  void finish(const Intent& removal);
  void quarantine(const std::string& id);
  void step(const char* what) const { options_.on_step(what); }

  const StoreOptions options_;
  const StoreDirectory directory_;
  DiskSpace disk_;
  std::unique_ptr<Catalog> catalog_;
  std::mutex visibility_;  // file and row change together
};

/// "<created_ms>:<id>" and back; page sizes. Shared by the listings.
std::string page_token(std::int64_t created_ms, const std::string& id);
std::optional<PageStart> parse_page_token(const std::string& token);
std::size_t page_size(std::uint32_t requested);

/// Now, in milliseconds since 1970.
std::int64_t unix_ms();

}  // namespace deform::server
