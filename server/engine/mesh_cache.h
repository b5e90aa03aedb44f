// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <condition_variable>
#include <cstddef>
#include <functional>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "core/mesh/mesh.h"
#include "server/engine/memory.h"

namespace deform::server {

/// Geometries in memory, by the key of tenant and id (store/tenant.h). Whoever holds a pointer keeps the mesh and its charge
/// alive; the cache itself holds on to the most recently used ones up to its budget. Concurrent requests for one geometry load it
/// once. Thread-safe; must outlive its meshes' charges' budget, not the meshes.
class MeshCache {
 public:
  using Load = std::function<std::shared_ptr<const Mesh>(const std::string& id)>;

  /// `load` is called without a lock; it throws when it cannot.
  MeshCache(std::size_t budget, Load load) : budget_(budget), load_(std::move(load)) {}

  std::shared_ptr<const Mesh> get(const std::string& id);
  /// Enters a mesh that is in memory anyway.
  void put(const std::string& id, std::shared_ptr<const Mesh> mesh);
  void forget(const std::string& id);
  /// The ids of the meshes that the cache holds.
  std::vector<std::string> ids() const;
  /// Lets go of meshes that no caller holds, least recently used first, until `bytes` are given back or none is left.
  void reclaim(std::size_t bytes);

  /// A mesh together with the memory charged for it.
  static std::shared_ptr<const Mesh> share(Mesh mesh, Charge charge);

 private:
  struct Entry {
    std::weak_ptr<const Mesh> mesh;
    bool loading = false;
  };
  struct Kept {
    std::string id;
    std::shared_ptr<const Mesh> mesh;
    std::size_t bytes;
  };
  using Doomed = std::vector<std::shared_ptr<const Mesh>>;  // released after the lock
  void keep(const std::string& id, const std::shared_ptr<const Mesh>& mesh, Doomed& doomed);

  const std::size_t budget_;
  const Load load_;
  mutable std::mutex mutex_;
  // guarded by mutex_
  std::condition_variable loaded_;
  std::map<std::string, Entry> entries_;
  std::list<Kept> kept_;  // most recently used first
  std::size_t kept_bytes_ = 0;
};

}  // namespace deform::server
