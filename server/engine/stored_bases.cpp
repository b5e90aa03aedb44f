// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/engine/stored_bases.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>

#include "core/deformers/stored_form.h"

namespace deform::server {

namespace {

/// What a restored system takes per point beside its basis, at most: regions, ranks, ids, planes.
constexpr std::size_t bytes_per_point = 128;
constexpr std::size_t bytes_besides = std::size_t{1} << 20;

class FileSource : public compiled::ByteSource {
 public:
  explicit FileSource(BasisFileReader& reader) : reader_(reader) {}
  std::uint64_t size() const override { return reader_.size(); }
  void read(std::span<std::byte> out) override { reader_.read(out.data(), out.size()); }

 private:
  BasisFileReader& reader_;
};

/// Whether a file that was not read to its end is whole.
bool is_whole(BasisFileReader& reader) {
  try {
    reader.verify();
    return true;
  } catch (const Error&) {
    return false;
  }
}

}  // namespace

StoredBases::StoredBases(Store& store, MemoryBudget& memory) : store_(store), memory_(memory) {
  if (store_.bases().wanted()) writer_ = std::jthread([this](const std::stop_token& stop) { run(stop); });
}

StoredBases::~StoredBases() {
  if (!writer_.joinable()) return;
  writer_.request_stop();
  writer_.join();
}

// ---- writing ----

void StoredBases::keep(const OwnedId& id, const std::shared_ptr<const ResidentSystem>& system, const Quota& quota) {
  if (!writer_.joinable() || stored_source(system->setup, *system->system) == nullptr) return;
  const std::lock_guard lock(mutex_);
  tasks_.push_back({id, system, quota});
  changed_.notify_all();
}

Engine::StoredBasisCounts StoredBases::counts() const {
  return {restored_, refused_, written_, not_written_, store_.bases().bytes()};
}

bool StoredBases::wait_until_written(RunContext::Clock::time_point limit) {
  std::unique_lock lock(mutex_);
  return changed_.wait_until(lock, limit, [this] { return tasks_.empty() && !writing_; });
}

void StoredBases::run(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  while (changed_.wait(lock, stop, [this] { return !tasks_.empty(); }) && !stop.stop_requested()) {
    Task task = std::move(tasks_.front());
    tasks_.pop_front();
    writing_ = true;
    lock.unlock();
    write(task, stop);
    task.system = nullptr;
    lock.lock();
    writing_ = false;
    changed_.notify_all();
  }
}

void StoredBases::write(const Task& task, const std::stop_token& stop) {
  BasisFiles& files = store_.bases();
  const std::string key = key_of(task.id);
  try {
    if (files.contains(task.id)) return;
    const HandleSystem& source = *stored_source(task.system->setup, *task.system->system);
    const std::uint64_t bytes = StoredBasis::bytes(source);
    if (task.quota.stored_bytes != 0) {
      StoredAmount has = store_.amount_of(task.id.tenant);
      has.bytes += files.bytes_of(task.id.tenant);
      check_quota(task.id.tenant, has, {0, 0, bytes}, task.quota);
    }
    RunContext context;
    context.stop = stop;
    files.put(
        task.id, bytes, [&](const BasisFiles::Sink& sink) { StoredBasis::write(source, sink); }, context);
    // What was deleted meanwhile does not come back.
    ++written_;
    if (store_.catalog().setup_ids(task.id.tenant, task.id.id, 1).empty()) files.remove(task.id);
    spdlog::debug("engine: the basis of system {} is stored, {} bytes", key, bytes);
  } catch (const Error& error) {
    if (error.code() == ErrorCode::cancelled) return;
    ++not_written_;
    spdlog::warn(
        "engine: the basis of system {} is not stored, so that the system is prepared again when it is not in memory: {}", key,
        error.what());
  } catch (const std::exception& error) {
    ++not_written_;
    spdlog::warn("engine: the basis of system {} is not stored: {}", key, error.what());
  }
}

// ---- reading ----

std::shared_ptr<ResidentSystem> StoredBases::restore(const OwnedId& id, std::shared_ptr<ResidentSystem> resident,
                                                     const RunContext& context) {
  BasisFiles& files = store_.bases();
  const std::string key = key_of(id);
  std::unique_ptr<BasisFileReader> reader;
  bool whole = false;
  try {
    reader = files.open(id);
    if (!reader) return nullptr;
    // What the system had beside factor and basis.
    const v1::SystemInfo& info = resident->told;
    const std::size_t rest = info.bytes() - std::min(info.bytes(), info.factor_bytes() + info.basis_bytes());
    const std::size_t bytes = reader->size() + std::max(rest, bytes_per_point * resident->mesh->point_count()) + bytes_besides;
    resident->charge = memory_.charge(bytes + resident->setup_bytes,
                                      {"restoring system " + id.id.substr(0, 16), "raise the server's memory budget", 0});
    FileSource source(*reader);
    StoredBasis stored = StoredBasis::read(source);
    reader->verify();
    whole = true;
    context.check();
    resident->system = deform::restore(resident->mesh, resident->setup, std::move(stored), context);
    resident->extent = ResidentSystem::Extent::basis;
    resident->charge.shrink(resident->bytes());
    resident->memory_return.bytes = resident->charge.bytes();
    ++restored_;
    spdlog::debug("engine: restored system {} from its basis", key);
    return resident;
  } catch (const Error& error) {
    if (error.code() == ErrorCode::out_of_budget || error.code() == ErrorCode::cancelled ||
        error.code() == ErrorCode::deadline_exceeded) {
      throw;
    }
    ++refused_;
    spdlog::warn("engine: the stored basis of system {} is of no use, the system is prepared: {}", key, error.what());
    if (error.code() != ErrorCode::data_loss) return nullptr;
    // It is of another version of this program, or damaged.
    whole || (reader && is_whole(*reader)) ? files.remove(id) : files.set_aside(id);
  }
  return nullptr;
}

}  // namespace deform::server
