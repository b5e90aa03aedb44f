// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/engine/system_cache.h"

#include <algorithm>
#include <chrono>

namespace deform::server {

namespace {

/// The seconds of a flight while they are unknown: half of what a short one may take, so that who asks for many does not go
/// before those whose work is known.
constexpr double unknown_seconds = Scheduler::short_seconds / 2;

}  // namespace

const ModelSize& ResidentSystem::size() const {
  std::call_once(measured_, [this] { size_ = model_size(mesh->points); });
  return size_;
}

SystemCache::Ticket& SystemCache::Ticket::operator=(Ticket&& other) noexcept {
  if (this != &other) {
    leave();
    cache_ = std::move(other.cache_);
    flight_ = std::move(other.flight_);
    asker_ = other.asker_;
  }
  return *this;
}

void SystemCache::Ticket::leave() {
  const auto flight = std::move(flight_);
  flight_ = nullptr;
  if (!flight) return;
  if (const auto cache = cache_.lock()) cache->leave(flight, asker_);
}

/// Lands the flight whatever happens to the preparation, so that no asker waits for ever.
class SystemCache::FlightGuard {
 public:
  FlightGuard(SystemCache& cache, std::shared_ptr<Flight> flight) : cache_(cache), flight_(std::move(flight)) {}
  ~FlightGuard() {
    if (flight_) cache_.land(flight_, std::move(resident_), error_);
  }
  FlightGuard(const FlightGuard&) = delete;
  FlightGuard& operator=(const FlightGuard&) = delete;

  void succeed(std::shared_ptr<ResidentSystem> resident) {
    resident_ = std::move(resident);
    error_.reset();
  }
  void fail(const Error& error) { error_ = error; }
  /// It flies on.
  void dismiss() { flight_ = nullptr; }

 private:
  SystemCache& cache_;
  std::shared_ptr<Flight> flight_;
  std::shared_ptr<ResidentSystem> resident_;
  std::optional<Error> error_ = Error(ErrorCode::internal, "the preparation ended without an outcome");
};

bool SystemCache::contains(const std::string& id) const {
  const std::lock_guard lock(mutex_);
  return entries_.count(id) > 0;
}

bool SystemCache::would_find(const std::string& id, const Source& source) const {
  const std::lock_guard lock(mutex_);
  const auto found = entries_.find(id);
  return found != entries_.end() && serves(found->second, source);
}

std::vector<std::string> SystemCache::ids() const {
  const std::lock_guard lock(mutex_);
  std::vector<std::string> ids;
  for (const auto& [id, entry] : entries_) ids.push_back(id);
  return ids;
}

std::pair<SystemCache::Handle, SystemCache::Ticket> SystemCache::acquire(const std::string& id, const Source& source,
                                                                         Asker asker) {
  std::unique_lock lock(mutex_);
  if (const auto found = entries_.find(id); found != entries_.end() && serves(found->second, source)) {
    ++counters_.hits;
    return {pin(id, found->second), Ticket()};
  }
  ++counters_.misses;
  const FlightKey key{id, source.restore ? Aim::restores : Aim::prepares};
  const bool begin = !flights_.contains(key);
  if (begin) check_preparations(asker);
  std::shared_ptr<Flight>& flight = flights_[key];
  if (begin) {
    flight = std::make_shared<Flight>();
    flight->key = key;
    flight->client = asker.client;
    flight->tenant = asker.tenant;
    flight->source = source;
  }
  Ticket ticket;
  ticket.cache_ = weak_from_this();
  ticket.flight_ = flight;
  ticket.asker_ = next_asker_++;
  flight->askers.emplace(ticket.asker_, std::move(asker));
  const std::shared_ptr<Flight> begun = flight;
  lock.unlock();
  if (begin) schedule(begun, unknown_seconds);
  return {nullptr, std::move(ticket)};
}

void SystemCache::check_preparations(const Asker& asker) const {
  constexpr std::uint32_t retry_quota_ms = 500;
  if (asker.most_preparations == 0) return;
  const auto own =
      std::count_if(flights_.begin(), flights_.end(), [&](const auto& flight) { return flight.second->tenant == asker.tenant; });
  if (static_cast<std::uint64_t>(own) < asker.most_preparations) return;
  throw Error(ErrorCode::out_of_budget,
              "quota preparations of tenant \"" + asker.tenant + "\": " + std::to_string(own) +
                  " systems are being prepared or wait for it, the limit is " + std::to_string(asker.most_preparations) +
                  "; try again later",
              retry_quota_ms)
      .refused_for(Refusal::quota);
}

void SystemCache::schedule(const std::shared_ptr<Flight>& flight, double seconds) {
  schedule_(flight->client, flight.get(), seconds, [self = shared_from_this(), flight] { self->run(flight); });
}

void SystemCache::run(const std::shared_ptr<Flight>& flight) {
  FlightGuard guard(*this, flight);
  try {
    RunContext context;
    context.stop = flight->stop.get_token();
    context.on_progress = [this, flight](const std::string& stage, double fraction) { report(flight, stage, fraction); };
    context.check();
    if (flight->source.restore) {
      auto restored = flight->source.restore(context);
      if (restored) {
        guard.succeed(std::move(restored));
      } else {
        guard.dismiss();
        prepare_instead(flight);
      }
      return;
    }
    Prepared prepared = flight->source.prepare(context);
    if (auto* const rest = std::get_if<Long>(&prepared)) {
      context.progress("queue", 0);
      flight->source.prepare = [make = std::move(rest->rest)](const RunContext& later) { return make(later); };
      schedule(flight, rest->seconds);
      guard.dismiss();
      // Who left before that has not found it among what is scheduled.
      if (flight->stop.stop_requested()) unschedule_(flight.get());
      return;
    }
    guard.succeed(std::get<std::shared_ptr<ResidentSystem>>(std::move(prepared)));
  } catch (const Error& error) {
    guard.fail(error);
  } catch (const std::bad_alloc&) {
    guard.fail(Error(ErrorCode::out_of_budget, "the machine is out of memory; lower the server's memory budget")
                   .refused_for(Refusal::memory));
  } catch (const std::exception& error) {
    guard.fail(Error(ErrorCode::internal, error.what()));
  }
}

void SystemCache::prepare_instead(const std::shared_ptr<Flight>& flight) {
  std::vector<std::pair<Asker, Handle>> answers;
  {
    const std::lock_guard lock(mutex_);
    if (flight->askers.empty()) return;  // all have left
    flight->source.restore = nullptr;
    const auto current = flights_.find(flight->key);
    // Else its setup is gone: it flies on for those who asked before.
    if (current != flights_.end() && current->second == flight) {
      flights_.erase(current);
      const std::string& id = flight->key.first;
      if (const auto found = entries_.find(id); found != entries_.end()) {  // a preparation has landed meanwhile
        for (auto& [key, asker] : flight->askers) answers.emplace_back(std::move(asker), pin(id, found->second));
        flight->askers.clear();
      } else {
        std::shared_ptr<Flight>& preparation = flights_[{id, Aim::prepares}];
        if (preparation) {
          preparation->askers.merge(flight->askers);
          flight->joined = preparation;
          return;
        }
        flight->key.second = Aim::prepares;
        preparation = flight;
      }
    }
  }
  if (!answers.empty()) {
    flight->source = {};
    for (auto& [asker, handle] : answers) asker.on_done(std::move(handle), std::nullopt);
    return;
  }
  schedule(flight, unknown_seconds);
  // Who left before that has not found it among what is scheduled.
  if (flight->stop.stop_requested()) unschedule_(flight.get());
}

/// What is there of that id gives way, unless it is whole and the new one is not.
SystemCache::Entry& SystemCache::enter(const std::string& id, std::shared_ptr<ResidentSystem> resident, Doomed& doomed) {
  const auto [found, is_new] = entries_.try_emplace(id);
  Entry& entry = found->second;
  if (!is_new) {
    const bool is_less = resident->extent == ResidentSystem::Extent::basis;
    if (is_less) {
      doomed.push_back(std::move(resident));
      return entry;
    }
    bytes_ -= entry.resident->bytes();
    if (entry.pins == 0) idle_.erase(entry.idle);
    doomed.push_back(std::move(entry.resident));
  }
  entry.resident = std::move(resident);
  entry.pins = 0;
  entry.idle = idle_.insert(idle_.end(), id);
  bytes_ += entry.resident->bytes();
  return entry;
}

void SystemCache::land(const std::shared_ptr<Flight>& flight, std::shared_ptr<ResidentSystem> resident,
                       const std::optional<Error>& error) {
  Doomed doomed;
  std::vector<std::pair<Asker, Handle>> answers;
  {
    const std::lock_guard lock(mutex_);
    const auto current = flights_.find(flight->key);
    // Else all askers have left, or its setup is gone.
    const bool wanted = current != flights_.end() && current->second == flight;
    if (wanted) flights_.erase(current);
    if (wanted && !error) {
      const std::string& id = flight->key.first;
      if (resident->extent == ResidentSystem::Extent::basis) ++counters_.restored;
      Entry& entry = enter(id, std::move(resident), doomed);
      for (auto& [key, asker] : flight->askers) answers.emplace_back(std::move(asker), pin(id, entry));
      evict_down_to(budget_, doomed);
    } else {
      for (auto& [key, asker] : flight->askers) answers.emplace_back(std::move(asker), error ? nullptr : resident);
    }
    flight->askers.clear();
  }
  flight->source = {};
  for (auto& [asker, handle] : answers) asker.on_done(std::move(handle), error);
}

void SystemCache::report(const std::shared_ptr<Flight>& flight, const std::string& stage, double fraction) {
  constexpr auto interval = std::chrono::milliseconds(100);
  std::vector<std::function<void(const std::string&, double)>> listeners;
  {
    const std::lock_guard lock(mutex_);
    const auto now = RunContext::Clock::now();
    if (stage == flight->last_stage && now - flight->last_progress < interval) return;
    flight->last_stage = stage;
    flight->last_progress = now;
    for (const auto& [key, asker] : flight->askers) {
      if (asker.on_progress) listeners.push_back(asker.on_progress);
    }
  }
  for (const auto& listener : listeners) listener(stage, fraction);
}

void SystemCache::leave(const std::shared_ptr<Flight>& asked, std::uint64_t asker) {
  Asker gone;
  std::shared_ptr<Flight> flight = asked;
  {
    const std::lock_guard lock(mutex_);
    while (flight->joined) flight = flight->joined;
    const auto found = flight->askers.find(asker);
    if (found == flight->askers.end()) return;  // it has landed
    gone = std::move(found->second);
    flight->askers.erase(found);
    if (!flight->askers.empty()) return;
    // No caller waits for it any more. Out of the map at once, so that the next asker begins a new flight.
    const auto current = flights_.find(flight->key);
    if (current != flights_.end() && current->second == flight) flights_.erase(current);
  }
  flight->stop.request_stop();
  unschedule_(flight.get());
}

std::size_t SystemCache::release(const std::string& id) {
  Doomed doomed;
  const std::lock_guard lock(mutex_);
  const auto found = entries_.find(id);
  if (found == entries_.end()) return 0;
  const std::size_t bytes = found->second.resident->bytes();
  if (found->second.pins == 0) idle_.erase(found->second.idle);
  doomed.push_back(std::move(found->second.resident));
  entries_.erase(found);
  bytes_ -= bytes;
  return bytes;
}

SystemCache::Forgotten SystemCache::forget(const std::vector<std::string>& ids) {
  Forgotten forgotten;
  const std::lock_guard lock(mutex_);
  for (const auto& id : ids) {
    flights_.erase({id, Aim::prepares});
    flights_.erase({id, Aim::restores});
    const auto found = entries_.find(id);
    if (found == entries_.end()) continue;
    const std::size_t bytes = found->second.resident->bytes();
    if (found->second.pins == 0) idle_.erase(found->second.idle);
    forgotten.systems.push_back(std::move(found->second.resident));
    entries_.erase(found);
    forgotten.bytes += bytes;
    bytes_ -= bytes;
  }
  return forgotten;
}

SystemCache::Evicted SystemCache::release_if(const std::function<bool(const std::string& id)>& wanted) {
  Evicted evicted;
  Doomed doomed;
  const std::lock_guard lock(mutex_);
  for (auto it = entries_.begin(); it != entries_.end();) {
    Entry& entry = it->second;
    if (!wanted(it->first)) {
      ++it;
      continue;
    }
    const std::size_t bytes = entry.resident->bytes();
    if (entry.pins == 0) idle_.erase(entry.idle);
    ++evicted.systems;
    evicted.in_use += entry.pins > 0 ? 1 : 0;
    evicted.bytes += bytes;
    bytes_ -= bytes;
    doomed.push_back(std::move(entry.resident));
    it = entries_.erase(it);
  }
  counters_.evictions += evicted.systems;
  return evicted;
}

void SystemCache::set_budget(std::size_t bytes) {
  Doomed doomed;
  const std::lock_guard lock(mutex_);
  budget_ = bytes;
  evict_down_to(budget_, doomed);
}

std::size_t SystemCache::budget() const {
  const std::lock_guard lock(mutex_);
  return budget_;
}

void SystemCache::reclaim(std::size_t bytes) {
  Doomed doomed;
  const std::lock_guard lock(mutex_);
  evict_down_to(bytes_ - std::min(bytes, bytes_), doomed);
}

SystemCache::Stats SystemCache::stats() const {
  const std::lock_guard lock(mutex_);
  Stats stats = counters_;
  stats.systems = entries_.size();
  stats.bytes = bytes_;
  return stats;
}

SystemCache::Handle SystemCache::pin(const std::string& id, Entry& entry) {
  if (entry.pins++ == 0) idle_.erase(entry.idle);
  // The deleter holds the system itself, so that it outlives even the cache.
  return {entry.resident.get(), [cache = weak_from_this(), id, resident = entry.resident](const ResidentSystem*) mutable {
            if (const auto self = cache.lock()) self->unpin(id, resident.get());
            resident.reset();
          }};
}

void SystemCache::unpin(const std::string& id, const ResidentSystem* resident) {
  Doomed doomed;
  const std::lock_guard lock(mutex_);
  const auto found = entries_.find(id);
  if (found == entries_.end() || found->second.resident.get() != resident) return;  // released meanwhile
  if (--found->second.pins > 0) return;
  found->second.idle = idle_.insert(idle_.end(), id);
  evict_down_to(budget_, doomed);
}

void SystemCache::evict_down_to(std::size_t bytes, Doomed& doomed) {
  while (bytes_ > bytes && !idle_.empty()) {
    const auto found = entries_.find(idle_.front());
    idle_.pop_front();
    bytes_ -= found->second.resident->bytes();
    doomed.push_back(std::move(found->second.resident));
    entries_.erase(found);
    ++counters_.evictions;
  }
}

}  // namespace deform::server
