#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace deform::server {

/// What the catalog keeps of a geometry. `info` is opaque to it.
struct GeometryRecord {
  std::string id;
  std::string info;
  std::int64_t created_ms = 0;
};

/// What the catalog keeps of a prepared setup. `setup` and `info` are opaque to it.
struct SetupRecord {
  std::string id;
  std::string geometry_id;
  std::string setup;
  std::string info;
  std::int64_t created_ms = 0;
};

/// Position in a listing, newest first: the entry after which the page starts.
struct PageStart {
  std::int64_t created_ms = 0;
  std::string id;
};

enum class WithSetups { refuse, remove };

/// Names of what is durably stored. A record is visible when the call that adds it returned, and then survives a crash; no call
/// has a visible half-way state. Thread-safe. Errors: Error(unavailable) when the storage fails. Several servers could share
/// another implementation of this interface.
class Catalog {
 public:
  virtual ~Catalog() = default;

  /// False when the id is there already (the record stays as it was).
  virtual bool add_geometry(const GeometryRecord& record) = 0;
  virtual std::optional<GeometryRecord> find_geometry(const std::string& id) = 0;
  virtual std::vector<GeometryRecord> list_geometries(const std::optional<PageStart>& after, std::size_t limit) = 0;
  /// Removes a geometry and its setups; returns the ids of those setups. Throws Error(not_found), or Error(failed_precondition)
  /// when there are setups and the policy is to refuse.
  virtual std::vector<std::string> remove_geometry(const std::string& id, WithSetups policy) = 0;

  /// Adds or replaces. Throws Error(not_found) when the geometry is not there.
  virtual void put_setup(const SetupRecord& record) = 0;
  virtual std::optional<SetupRecord> find_setup(const std::string& id) = 0;
  /// geometry_id empty: of all.
  virtual std::vector<SetupRecord> list_setups(const std::string& geometry_id, const std::optional<PageStart>& after,
                                               std::size_t limit) = 0;
  /// False when there was none.
  virtual bool remove_setup(const std::string& id) = 0;
  virtual std::size_t setup_count(const std::string& geometry_id) = 0;

  /// At most `limit` ids that start with the prefix.
  virtual std::vector<std::string> geometry_ids(const std::string& prefix, std::size_t limit) = 0;
  virtual std::vector<std::string> setup_ids(const std::string& prefix, std::size_t limit) = 0;

  struct Counts {
    std::size_t geometries = 0, setups = 0;
  };
  virtual Counts counts() = 0;
};

}  // namespace deform::server
