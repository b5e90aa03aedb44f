#pragma once

#include <atomic>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "core/mesh/mesh.h"
#include "deform/v1/geometry.pb.h"
#include "server/catalog.h"

namespace deform::server {

/// Durable, content-addressed geometries and the setups prepared on them, in one directory:
///
///   lock              held by flock while the store is open: one process per directory
///   catalog.sqlite    names, setups; a row decides what is visible
///   geometries/<id>   immutable files, written to tmp/ first, synced, renamed, directory synced, and only then entered
///   tmp/              emptied at the start
///
/// A crash at any point leaves what was visible before or after, never something in between; files without a row are collected at
/// the start. A row whose file is missing or damaged is an Error(data_loss) when used and healed by registering again.
/// Thread-safe.
class GeometryStore {
 public:
  /// Throws Error(unavailable) when another process has the directory or it cannot be written.
  explicit GeometryStore(const std::filesystem::path& directory);
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
  /// See Catalog::remove_geometry. Whoever has loaded the mesh keeps it.
  std::vector<std::string> remove(const std::string& id, WithSetups policy);

  v1::ListGeometriesReply list(const v1::ListGeometriesRequest& request);

  /// Full ids from full ids or unique prefixes of at least 8 digits. Throws Error(invalid_argument) for what is no such prefix or
  /// has several answers, Error(not_found).
  std::string resolve_geometry(const std::string& id_or_prefix);
  std::string resolve_setup(const std::string& id_or_prefix);

  /// Setups are kept here too.
  Catalog& catalog() { return *catalog_; }

 private:
  void collect_orphans();
  std::filesystem::path file_of(const std::string& id) const;
  void quarantine(const std::string& id);

  const std::filesystem::path directory_;
  int lock_descriptor_ = -1;
  std::unique_ptr<Catalog> catalog_;
  std::atomic<std::uint64_t> next_temporary_{0};
  std::mutex visibility_;  // file and row change together
};

/// "<created_ms>:<id>" and back; page sizes. Shared by the listings.
std::string page_token(std::int64_t created_ms, const std::string& id);
std::optional<PageStart> parse_page_token(const std::string& token);
std::size_t page_size(std::uint32_t requested);

/// Now, in milliseconds since 1970.
std::int64_t unix_ms();

}  // namespace deform::server
