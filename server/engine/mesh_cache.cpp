// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/engine/mesh_cache.h"

#include <iterator>
#include <utility>
#include <vector>

#include "server/store/geometry_file.h"

namespace deform::server {

std::shared_ptr<const Mesh> MeshCache::share(Mesh mesh, Charge charge) {
  struct Charged {
    Mesh mesh;
    Charge charge;
  };
  auto charged = std::make_shared<Charged>();
  charged->mesh = std::move(mesh);
  charged->charge = std::move(charge);
  return {charged, &charged->mesh};
}

std::shared_ptr<const Mesh> MeshCache::get(const std::string& id) {
  Doomed doomed;
  std::unique_lock lock(mutex_);
  loaded_.wait(lock, [&] { return !entries_[id].loading; });
  if (auto mesh = entries_[id].mesh.lock()) {
    keep(id, mesh, doomed);
    lock.unlock();
    return mesh;
  }
  entries_[id].loading = true;
  lock.unlock();

  std::shared_ptr<const Mesh> mesh;
  try {
    mesh = load_(id);
  } catch (...) {
    lock.lock();
    entries_.erase(id);
    loaded_.notify_all();
    throw;
  }
  lock.lock();
  entries_[id] = {mesh, false};
  keep(id, mesh, doomed);
  loaded_.notify_all();
  lock.unlock();
  return mesh;
}

void MeshCache::put(const std::string& id, std::shared_ptr<const Mesh> mesh) {
  Doomed doomed;
  const std::lock_guard lock(mutex_);
  Entry& entry = entries_[id];
  if (entry.loading || !entry.mesh.expired()) return;
  entry.mesh = mesh;
  keep(id, mesh, doomed);
}

// Moves to the front, then lets the last ones go until the budget is kept.
void MeshCache::keep(const std::string& id, const std::shared_ptr<const Mesh>& mesh, Doomed& doomed) {
  for (auto it = kept_.begin(); it != kept_.end(); ++it) {
    if (it->id != id) continue;
    kept_.splice(kept_.begin(), kept_, it);
    return;
  }
  kept_.push_front({id, mesh, mesh_bytes(*mesh)});
  kept_bytes_ += kept_.front().bytes;
  while (kept_bytes_ > budget_ && !kept_.empty()) {
    kept_bytes_ -= kept_.back().bytes;
    doomed.push_back(std::move(kept_.back().mesh));
    kept_.pop_back();
  }
  for (auto it = entries_.begin(); it != entries_.end();) {
    it = !it->second.loading && it->second.mesh.expired() ? entries_.erase(it) : std::next(it);
  }
}

void MeshCache::forget(const std::string& id) {
  Doomed doomed;
  const std::lock_guard lock(mutex_);
  for (auto it = kept_.begin(); it != kept_.end(); ++it) {
    if (it->id != id) continue;
    kept_bytes_ -= it->bytes;
    doomed.push_back(std::move(it->mesh));
    kept_.erase(it);
    return;
  }
}

std::vector<std::string> MeshCache::ids() const {
  const std::lock_guard lock(mutex_);
  std::vector<std::string> ids;
  for (const auto& kept : kept_) ids.push_back(kept.id);
  return ids;
}

void MeshCache::reclaim(std::size_t bytes) {
  Doomed doomed;
  const std::lock_guard lock(mutex_);
  std::size_t released = 0;
  for (auto it = kept_.end(); it != kept_.begin() && released < bytes;) {
    --it;
    if (it->mesh.use_count() > 1) continue;  // somebody computes with it: letting go would free nothing
    released += it->bytes;
    kept_bytes_ -= it->bytes;
    doomed.push_back(std::move(it->mesh));
    it = kept_.erase(it);
  }
}

}  // namespace deform::server
