// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <filesystem>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "core/deformers/system.h"
#include "server/engine/system_cache.h"
#include "server/store/tenant.h"

namespace deform::server {

/// A directory of its own for each test, removed at the end.
class TemporaryDirectory {
 public:
  TemporaryDirectory() {
    std::string pattern = (std::filesystem::temp_directory_path() / "deform_test_XXXXXX").string();
    path_ = mkdtemp(pattern.data());
  }
  ~TemporaryDirectory() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  TemporaryDirectory(const TemporaryDirectory&) = delete;
  TemporaryDirectory& operator=(const TemporaryDirectory&) = delete;
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

/// The id for the tenant of callers without an identity.
inline OwnedId own(const std::string& id) { return {default_tenant, id}; }

/// Waits for a condition that other threads bring about; false after a minute, which also a busy machine
/// under a sanitizer keeps.
template <typename Condition>
bool eventually(const Condition& condition) {
  const auto limit = std::chrono::steady_clock::now() + std::chrono::seconds(60);
  while (!condition()) {
    if (std::chrono::steady_clock::now() > limit) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return true;
}

/// A gate that threads wait at until it is opened.
class Gate {
 public:
  void open() {
    const std::lock_guard lock(mutex_);
    open_ = true;
    opened_.notify_all();
  }
  void pass() {
    std::unique_lock lock(mutex_);
    ++waiting_;
    opened_.wait(lock, [&] { return open_; });
    --waiting_;
  }
  int waiting() const {
    const std::lock_guard lock(mutex_);
    return waiting_;
  }

 private:
  mutable std::mutex mutex_;
  std::condition_variable opened_;
  bool open_ = false;
  int waiting_ = 0;
};

/// A system whose points all move by (design + 1) along x; every evaluated slice can be made to wait.
class FakeSystem : public System {
 public:
  FakeSystem(std::size_t points, std::size_t bytes) {
    info_.points = points;
    info_.bytes = bytes;
    info_.diagonal = 1;
  }
  const SystemInfo& info() const override { return info_; }
  void set_design_bytes(std::size_t bytes) { info_.design_bytes = bytes; }

  std::unique_ptr<const Evaluation> bind(std::span<const Design> designs, EvaluationPath,
                                         const RunContext& context) const override {
    context.check();
    return std::make_unique<FakeEvaluation>(designs.size(), *this);
  }
  Points jacobian_vector(std::span<const double>, std::span<const double>, const RunContext&) const override {
    return Points(info_.points, Vec3{1, 2, 3});
  }
  std::vector<double> vector_jacobian(std::span<const double>, const Points&, const RunContext&) const override { return {}; }

  static Vec3 rest(std::size_t i) { return {0.001 * static_cast<double>(i), std::sin(0.01 * static_cast<double>(i)), 0}; }
  static Vec3 moved(std::size_t i, std::size_t design) {
    const Vec3 p = rest(i);
    return {p[0] + static_cast<double>(design + 1), p[1], p[2]};
  }

  mutable std::atomic<int> slices{0};       ///< evaluated so far
  std::shared_ptr<Gate> gate;               ///< set: every slice passes it
  std::shared_ptr<std::atomic<int>> alive;  ///< set: counts living systems

 private:
  class FakeEvaluation : public Evaluation {
   public:
    FakeEvaluation(std::size_t designs, const FakeSystem& system) : designs_(designs), system_(system) {}
    std::size_t design_count() const override { return designs_; }
    const DesignReport& report(std::size_t) const override { return report_; }
    void evaluate(std::size_t begin, std::size_t end, std::size_t first, std::span<Vec3* const> out) const override {
      ++system_.slices;
      if (system_.gate) system_.gate->pass();
      for (std::size_t d = 0; d < out.size(); ++d) {
        for (std::size_t i = begin; i < end; ++i) out[d][i - begin] = moved(i, first + d);
      }
    }

   private:
    const std::size_t designs_;
    const FakeSystem& system_;
    const DesignReport report_;
  };
  SystemInfo info_;
};

inline std::shared_ptr<ResidentSystem> fake_resident(std::size_t points, std::size_t bytes) {
  auto resident = std::make_shared<ResidentSystem>();
  auto mesh = std::make_shared<Mesh>();
  for (std::size_t i = 0; i < points; ++i) mesh->points.push_back(FakeSystem::rest(i));
  resident->mesh = mesh;
  resident->system = std::make_shared<FakeSystem>(points, bytes);
  resident->info.set_points(points);
  resident->info.set_diagonal(1);
  return resident;
}

}  // namespace deform::server
