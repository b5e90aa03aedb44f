// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "core/base/error.h"
#include "core/base/model_size.h"
#include "core/base/run_context.h"
#include "core/deformers/symmetry_sides.h"
#include "core/deformers/system.h"
#include "deform/v1/deformation.pb.h"
#include "server/engine/design_checks.h"
#include "server/engine/memory.h"
#include "server/engine/scheduler.h"

namespace deform::server {

/// A prepared system with what belongs to it. Immutable.
struct ResidentSystem {
  /// Destroyed last.
  struct MemoryReturn {
    std::size_t bytes = 0;
    ~MemoryReturn() { return_freed_memory(bytes); }
  } memory_return;
  /// What its system can do: everything, or what its handle basis is enough for (core/deformers/stored_form.h).
  enum class Extent { whole, basis };
  Extent extent = Extent::whole;
  std::shared_ptr<const System> system;
  std::shared_ptr<const Mesh> mesh;
  Setup setup;
  v1::SystemInfo info;          ///< `resident` is set by whoever answers
  v1::SystemInfo told;          ///< the same without the setup where an answer would be too large with it
  std::size_t setup_bytes = 0;  ///< of a large setup, as it is kept
  Charge charge;                ///< of bytes(); the mesh has its own
  PlaneSides sides;             ///< of its symmetry planes
  CellCheckCache cell_check;
  FaceCheckCache<FlipCheck> flip_check;
  FaceCheckCache<IntersectionCheck> intersection_check;
  FaceCheckCache<SevereFaces> severe_check;

  /// model_size() of its mesh, asked once. Thread-safe.
  const ModelSize& size() const;
  std::size_t bytes() const { return system->bytes() + setup_bytes; }
  /// The cost of one design for Scheduler::start(), in points; with constraints mostly that of solving for it.
  double design_work() const {
    return static_cast<double>(Scheduler::least_cost + mesh->point_count()) +
           Scheduler::points_per_second * info.design_seconds();
  }

 private:
  mutable std::once_flag measured_;
  mutable ModelSize size_;  // once measured
};

/// Prepared systems by the key of tenant and id (store/tenant.h), bounded by bytes.
///
///       requests                        SystemCache
///   +--------------+   strong   +--------------------------------------------+
///   | SystemHandle |----------->| Entry {pins} --strong--> ResidentSystem    |
///   | (one pin)    |            |                            |-strong-> System --strong--+
///   +--------------+            |                            |-strong-> Mesh <-----------+
///   +--------------+   leaves   |                            '-owns---> Charge           |
///   | Ticket       |----------->| Flight {askers} --runs--> Prepare (a preparation worker)
///   | (one asker)  |            +--------------------------------------------+
///   +--------------+                 weak from handles back to the cache
///   MeshCache ---- weak or, recently used, strong ----> Mesh
///
/// - A handle pins its entry: it is never evicted while a request computes with it, and its bytes stay charged. When the last
///   handle goes, the entry becomes the most recently used of the idle ones; what exceeds the budget goes then. A budget of 0 is
///   legal: systems live as long as somebody uses them.
/// - One preparation per id: later askers join it, all hear its progress and its outcome, a failure is never cached. An asker
///   that leaves leaves alone; when the last one has left, the preparation is cancelled. It is scheduled as work of the client
///   who asked first.
/// - Who needs no more than a handle basis says how to restore one, which takes no time to speak of. There is a flight of its own
///   for that; where there is nothing to restore it becomes the preparation, or joins the one that is under way. A whole system
///   replaces a restored one of its id.
///
/// Thread-safe. No lock is held while preparing or calling back. Must be held by shared_ptr.
class SystemCache : public std::enable_shared_from_this<SystemCache> {
 public:
  using Handle = std::shared_ptr<const ResidentSystem>;
  /// The rest of a preparation that takes long, and about how long: it waits for its turn.
  struct Long {
    double seconds;
    std::function<std::shared_ptr<ResidentSystem>(const RunContext&)> rest;
  };
  using Prepared = std::variant<std::shared_ptr<ResidentSystem>, Long>;
  /// Makes the system, or finds out how long that takes; runs once per flight, throws Error.
  using Prepare = std::function<Prepared(const RunContext&)>;
  /// Makes a system of Extent::basis of what is stored; null when there is nothing. Throws Error for what would keep a
  /// preparation from succeeding, too.
  using Restore = std::function<std::shared_ptr<ResidentSystem>(const RunContext&)>;
  /// Runs work of a client later on a thread of its own kind; `owner` names it to Unschedule.
  using Schedule = std::function<void(const std::string& client, const void* owner, double seconds, std::function<void()> work)>;
  using Unschedule = std::function<void(const void* owner)>;

  /// Where a system comes from that is not there.
  struct Source {
    Source() = default;
    Source(Prepare preparing, Restore restoring = {}) : prepare(std::move(preparing)), restore(std::move(restoring)) {}
    Prepare prepare;
    Restore restore;  ///< empty for who needs a whole system
  };

  struct Asker {
    std::string client;
    std::string tenant;
    std::uint64_t most_preparations = 0;                                         ///< of the tenant at once; 0: any number
    std::function<void(const std::string& stage, double fraction)> on_progress;  ///< may be empty
    /// Exactly once, unless the ticket left before: a handle, or the error.
    std::function<void(Handle handle, const std::optional<Error>& error)> on_done;
  };

 private:
  struct Flight;
  using Doomed = std::vector<std::shared_ptr<ResidentSystem>>;  // destroyed after the lock

 public:
  /// Destroying it leaves the flight. Movable.
  class Ticket {
   public:
    Ticket() = default;
    Ticket(Ticket&& other) noexcept = default;
    Ticket& operator=(Ticket&& other) noexcept;
    ~Ticket() { leave(); }
    void leave();

   private:
    friend class SystemCache;
    std::weak_ptr<SystemCache> cache_;
    std::shared_ptr<Flight> flight_;
    std::uint64_t asker_ = 0;
  };

  SystemCache(std::size_t budget, Schedule schedule, Unschedule unschedule)
      : schedule_(std::move(schedule)), unschedule_(std::move(unschedule)), budget_(budget) {}

  /// Whether the entry is there now. Counts neither as a hit nor as a use.
  bool contains(const std::string& id) const;
  /// Whether acquire() would find it now: who needs a whole system is not served by a basis.
  bool would_find(const std::string& id, const Source& source) const;
  std::vector<std::string> ids() const;

  /// The entry if it is there (the ticket stays empty, nothing is called back), otherwise joins or begins a flight. Callbacks
  /// come from other threads, never from inside this call. Throws Error(out_of_budget) with a retry hint when a flight would have
  /// to begin beyond what the tenant may have.
  std::pair<Handle, Ticket> acquire(const std::string& id, const Source& source, Asker asker);

  /// Takes an entry out: new requests do not find it; those that use it finish. Returns the bytes that will be given back.
  std::size_t release(const std::string& id);

  /// What forget() took out; destroying it gives back the memory.
  struct Forgotten {
    std::size_t bytes = 0;
    Doomed systems;
  };
  /// release() of systems whose setups are gone. What is being prepared goes to those who asked so far, is not kept, and is not
  /// joined any more.
  Forgotten forget(const std::vector<std::string>& ids);

  struct Evicted {
    std::size_t systems = 0, in_use = 0;  ///< of these, with handles
    std::size_t bytes = 0;
  };
  /// release() of all entries that are wanted.
  Evicted release_if(const std::function<bool(const std::string& id)>& wanted);

  /// Evicts what exceeds the new budget.
  void set_budget(std::size_t bytes);
  std::size_t budget() const;

  /// Evicts idle entries, least recently used first, until `bytes` are given back or none is idle.
  void reclaim(std::size_t bytes);

  struct Stats {
    std::size_t systems = 0, bytes = 0;
    std::uint64_t hits = 0, misses = 0, evictions = 0;
    std::uint64_t restored = 0;  ///< of the misses' flights, those that found a basis
  };
  Stats stats() const;

 private:
  struct Entry {
    std::shared_ptr<ResidentSystem> resident;
    std::size_t pins = 0;
    std::list<std::string>::iterator idle;  // valid when pins == 0
  };
  enum class Aim { prepares, restores };
  using FlightKey = std::pair<std::string, Aim>;
  struct Flight {
    FlightKey key;
    std::string client, tenant;
    Source source;  // without `restore` once there was nothing to restore
    std::stop_source stop;
    std::map<std::uint64_t, Asker> askers;  // guarded by the cache's mutex
    std::shared_ptr<Flight> joined;         // likewise: where its askers are now
    RunContext::Clock::time_point last_progress{};
    std::string last_stage;
  };
  class FlightGuard;

  void schedule(const std::shared_ptr<Flight>& flight, double seconds);
  void run(const std::shared_ptr<Flight>& flight);
  void prepare_instead(const std::shared_ptr<Flight>& flight);
  void land(const std::shared_ptr<Flight>& flight, std::shared_ptr<ResidentSystem> resident, const std::optional<Error>& error);
  void report(const std::shared_ptr<Flight>& flight, const std::string& stage, double fraction);
  void check_preparations(const Asker& asker) const;  // with mutex_ held
  void leave(const std::shared_ptr<Flight>& asked, std::uint64_t asker);
  static bool serves(const Entry& entry, const Source& source) {
    return source.restore || entry.resident->extent == ResidentSystem::Extent::whole;
  }
  Entry& enter(const std::string& id, std::shared_ptr<ResidentSystem> resident, Doomed& doomed);
  Handle pin(const std::string& id, Entry& entry);
  void unpin(const std::string& id, const ResidentSystem* resident);
  void evict_down_to(std::size_t bytes, Doomed& doomed);

  const Schedule schedule_;
  const Unschedule unschedule_;
  mutable std::mutex mutex_;
  // guarded by mutex_
  std::size_t budget_;
  std::map<std::string, Entry> entries_;
  std::map<FlightKey, std::shared_ptr<Flight>> flights_;
  std::list<std::string> idle_;  // least recently used first
  std::size_t bytes_ = 0;        // of all entries
  std::uint64_t next_asker_ = 1;
  Stats counters_;
};

}  // namespace deform::server
