// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/rpc/metrics.h"

#include <prometheus/client_metric.h>
#include <prometheus/counter.h>
#include <prometheus/gauge.h>
#include <prometheus/histogram.h>
#include <prometheus/metric_family.h>
#include <prometheus/registry.h>
#include <prometheus/text_serializer.h>
#include <sys/resource.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <limits>
#include <utility>
#include <vector>

namespace deform::server {

namespace {

using prometheus::MetricFamily;
using prometheus::MetricType;

constexpr double seconds_per_millisecond = 1e-3;

/// Seconds: a design of a small mesh takes less than a millisecond, a preparation minutes.
const prometheus::Histogram::BucketBoundaries& duration_bounds() {
  static const prometheus::Histogram::BucketBoundaries bounds{0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25,
                                                              0.5,    1,     2.5,    5,     10,   30,    60,   300, 1800};
  return bounds;
}

MetricFamily one_value(const char* name, const char* help, MetricType type, double value) {
  MetricFamily family;
  family.name = name;
  family.help = help;
  family.type = type;
  prometheus::ClientMetric metric;
  (type == MetricType::Counter ? metric.counter.value : metric.gauge.value) = value;
  family.metric.push_back(std::move(metric));
  return family;
}

MetricFamily gauge_of(const char* name, const char* help, double value) {
  return one_value(name, help, MetricType::Gauge, value);
}
MetricFamily counter_of(const char* name, const char* help, double value) {
  return one_value(name, help, MetricType::Counter, value);
}

double processor_seconds() {
  struct rusage usage {};
  getrusage(RUSAGE_SELF, &usage);
  const auto seconds = [](const timeval& t) { return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec); };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

/// 0 where it cannot be seen.
double open_files() {
  std::error_code failed;
  double count = 0;
  for (std::filesystem::directory_iterator it("/proc/self/fd", failed), end; !failed && it != end; it.increment(failed)) ++count;
  return count > 0 ? count - 1 : 0;  // the folder itself was open
}

double max_open_files() {
  struct rlimit limit {};
  return getrlimit(RLIMIT_NOFILE, &limit) == 0 ? static_cast<double>(limit.rlim_cur) : 0;
}

void add_server(const v1::ServerInfo& info, std::vector<MetricFamily>& all) {
  MetricFamily build = gauge_of("deformd_build_info", "1, with the version of the server as a label.", 1);
  build.metric[0].label.push_back({"version", info.version()});
  all.push_back(std::move(build));
  all.push_back(gauge_of("deformd_uptime_seconds", "Time since the server started.",
                         seconds_per_millisecond * static_cast<double>(info.uptime_ms())));
  all.push_back(gauge_of("deformd_draining", "1 while the server shuts down.", info.draining() ? 1 : 0));
  all.push_back(gauge_of("deformd_workers", "Threads that compute.", info.workers()));
  all.push_back(gauge_of("deformd_queue_length", "Requests that wait for a worker.",
                         info.queue_length() - std::min(info.queue_length(), info.preparation_queue_length())));
  all.push_back(gauge_of("deformd_preparation_queue_length", "Requests that wait for a preparation or an estimate.",
                         info.preparation_queue_length()));
  all.push_back(gauge_of("deformd_queue_limit", "Requests that may wait, of either kind; more are refused.", info.queue_limit()));
  all.push_back(gauge_of("deformd_running", "Requests and preparations under way.", info.running()));
  all.push_back(counter_of("deformd_designs_served_total", "Designs that were computed and handed out.",
                           static_cast<double>(info.designs_served())));
}

void add_cache(const v1::ServerInfo& info, std::vector<MetricFamily>& all) {
  all.push_back(gauge_of("deformd_cache_systems", "Prepared systems in memory.", info.systems_resident()));
  all.push_back(gauge_of("deformd_cache_bytes", "Bytes that prepared systems take.", static_cast<double>(info.cache_bytes())));
  all.push_back(
      gauge_of("deformd_cache_budget_bytes", "Bytes that prepared systems may take.", static_cast<double>(info.cache_budget())));
  all.push_back(
      counter_of("deformd_cache_hits_total", "Requests whose system was in memory.", static_cast<double>(info.cache_hits())));
  all.push_back(counter_of("deformd_cache_misses_total", "Requests whose system had to be prepared.",
                           static_cast<double>(info.cache_misses())));
  all.push_back(counter_of("deformd_cache_evictions_total", "Systems that made room for others.",
                           static_cast<double>(info.cache_evictions())));
}

void add_memory(const Metrics::Levels& levels, std::vector<MetricFamily>& all) {
  const v1::ServerInfo& info = levels.server;
  all.push_back(gauge_of("deformd_memory_budget_bytes", "Memory for systems and requests, --memory-budget.",
                         static_cast<double>(info.memory_budget())));
  all.push_back(
      gauge_of("deformd_memory_charged_bytes", "Memory charged against the budget.", static_cast<double>(info.memory_in_use())));
  all.push_back(gauge_of("deformd_requests_held_bytes", "Memory of requests that are held, as bytes and parsed.",
                         static_cast<double>(levels.held_request_bytes)));
  all.push_back(gauge_of("deformd_memory_full", "1 while calls that compute or add are refused for the memory of the process.",
                         levels.memory_full ? 1 : 0));
  all.push_back(gauge_of("process_resident_memory_bytes", "Resident memory of the process.",
                         static_cast<double>(info.resident_set_bytes())));
}

MetricFamily times_of(const char* name, const char* help, const SyncTimes& times) {
  MetricFamily family;
  family.name = name;
  family.help = help;
  family.type = MetricType::Histogram;
  prometheus::ClientMetric& metric = family.metric.emplace_back();
  for (std::size_t i = 0; i < times.counts.size(); ++i) {
    metric.histogram.sample_count += times.counts[i];
    const double bound = i < SyncTimes::bounds.size() ? SyncTimes::bounds[i] : std::numeric_limits<double>::infinity();
    metric.histogram.bucket.push_back({metric.histogram.sample_count, bound});
  }
  metric.histogram.sample_sum = times.seconds;
  return family;
}

void add_store(const v1::ServerInfo& info, const SyncTimes& syncs, std::vector<MetricFamily>& all) {
  const v1::StoreInfo& store = info.store();
  all.push_back(gauge_of("deformd_store_writable", "1 while geometries and setups can be added.", store.writable() ? 1 : 0));
  all.push_back(
      gauge_of("deformd_store_free_bytes", "Free bytes on the disk of the store.", static_cast<double>(store.free_bytes())));
  all.push_back(gauge_of("deformd_store_needed_bytes", "Free bytes below which nothing is added any more.",
                         static_cast<double>(store.needed_bytes())));
  all.push_back(gauge_of("deformd_store_geometries", "Geometries that are stored.", static_cast<double>(info.geometries())));
  all.push_back(gauge_of("deformd_store_setups", "Setups that are stored.", static_cast<double>(info.setups())));
  all.push_back(
      gauge_of("deformd_store_damaged_files", "Files set aside in damaged/.", static_cast<double>(store.damaged_files())));
  all.push_back(times_of("deformd_store_sync_seconds",
                         "Time that a file or folder of the store took to be durable (fsync); the catalog not included.", syncs));
  all.push_back(
      gauge_of("deformd_store_unclaimed_files", "Files set aside in unclaimed/.", static_cast<double>(store.unclaimed_files())));
}

void add_bases(const Engine::StoredBasisCounts& bases, std::vector<MetricFamily>& all) {
  all.push_back(gauge_of("deformd_bases_bytes", "Bytes of the handle bases in the store.", static_cast<double>(bases.bytes)));
  all.push_back(counter_of("deformd_bases_restored_total",
                           "Systems that were restored from their basis instead of being prepared.",
                           static_cast<double>(bases.restored)));
  all.push_back(counter_of("deformd_bases_refused_total", "Bases that were damaged, or of another version of the server.",
                           static_cast<double>(bases.refused)));
  all.push_back(counter_of("deformd_bases_written_total", "Bases that were written.", static_cast<double>(bases.written)));
  all.push_back(counter_of("deformd_bases_not_written_total", "Bases that a quota or the disk did not take.",
                           static_cast<double>(bases.not_written)));
}

void add_process(const Metrics::Levels& levels, std::vector<MetricFamily>& all) {
  all.push_back(counter_of("process_cpu_seconds_total", "Processor time of the process.", processor_seconds()));
  all.push_back(gauge_of("process_open_fds", "Open files of the process, connections among them.", open_files()));
  all.push_back(gauge_of("process_max_fds", "Files that the process may have open.", max_open_files()));
  all.push_back(counter_of("deformd_connections_refused_total", "Connections beyond --max-connections.",
                           static_cast<double>(levels.refused_connections)));
  all.push_back(counter_of("deformd_connections_cut_off_total", "Connections that were closed because they flooded the server.",
                           static_cast<double>(levels.cut_off_connections)));
  all.push_back(gauge_of("deformd_connections_open", "Connections that are open.", static_cast<double>(levels.open_connections)));
  all.push_back(gauge_of("deformd_connections_limit", "Connections that may be open at once.",
                         static_cast<double>(levels.max_connections)));
}

/// Connections are refused by the listener, which counts them; they are a reason of the same figure.
void add_refused_connections(double count, std::vector<MetricFamily>& all) {
  for (MetricFamily& family : all) {
    if (family.name != "deformd_refusals_total") continue;
    prometheus::ClientMetric& metric = family.metric.emplace_back();
    metric.label.push_back({"reason", "connections"});
    metric.counter.value = count;
  }
}

constexpr Refusal refusal_reasons[] = {Refusal::queue, Refusal::memory, Refusal::held,    Refusal::quota,
                                       Refusal::rate,  Refusal::disk,   Refusal::draining};

const char* status_of(const CallRecord& record) { return record.error ? to_string(record.error->code()) : "ok"; }

}  // namespace

struct Metrics::Counted {
  prometheus::Registry registry;
  prometheus::Family<prometheus::Counter>& calls =
      prometheus::BuildCounter().Name("deformd_calls_total").Help("Calls that ended, by method and status.").Register(registry);
  prometheus::Family<prometheus::Histogram>& durations =
      prometheus::BuildHistogram().Name("deformd_call_seconds").Help("Time from a call's start to its end.").Register(registry);
  prometheus::Family<prometheus::Histogram>& stages = prometheus::BuildHistogram()
                                                          .Name("deformd_stage_seconds")
                                                          .Help("Time that a call spent in a stage, of calls that had it.")
                                                          .Register(registry);
  prometheus::Family<prometheus::Counter>& refusals = prometheus::BuildCounter()
                                                          .Name("deformd_refusals_total")
                                                          .Help(
                                                              "Calls and requests of streams that were refused for the state of "
                                                              "the server or a quota, and connections, by reason.")
                                                          .Register(registry);
  prometheus::Gauge& open = prometheus::BuildGauge()
                                .Name("deformd_calls_in_progress")
                                .Help("Calls that have begun and not ended.")
                                .Register(registry)
                                .Add({});
  prometheus::Counter& received = prometheus::BuildCounter()
                                      .Name("deformd_received_bytes_total")
                                      .Help("Bytes of the messages of calls that ended.")
                                      .Register(registry)
                                      .Add({});
  prometheus::Counter& sent = prometheus::BuildCounter()
                                  .Name("deformd_sent_bytes_total")
                                  .Help("Bytes of the replies of calls that ended.")
                                  .Register(registry)
                                  .Add({});

  /// From the beginning, so that the first of a kind is an increase.
  Counted() {
    for (const Refusal reason : refusal_reasons) refusals.Add({{"reason", to_string(reason)}});
  }

  /// Counts and times, of a method or of a request inside one.
  void ended(const std::string& method, const CallRecord& record) {
    calls.Add({{"method", method}, {"status", status_of(record)}}).Increment();
    if (record.error && record.error->refusal() != Refusal::none) {
      refusals.Add({{"reason", to_string(record.error->refusal())}}).Increment();
    }
    durations.Add({{"method", method}}, duration_bounds()).Observe(seconds_per_millisecond * record.wall_ms);
    const std::pair<const char*, double> spent[] = {{"queue", record.queue_ms},
                                                    {"prepare", record.prepare_ms},
                                                    {"solve", record.solve_ms},
                                                    {"encode", record.encode_ms},
                                                    {"stream", record.stream_ms}};
    for (const auto& [stage, milliseconds] : spent) {
      if (milliseconds <= 0) continue;
      stages.Add({{"stage", stage}}, duration_bounds()).Observe(seconds_per_millisecond * milliseconds);
    }
  }
};

Metrics::Metrics() : counted_(std::make_unique<Counted>()) {}
Metrics::~Metrics() = default;

void Metrics::call_begins() { counted_->open.Increment(); }

void Metrics::call_ends(const CallRecord& record) {
  counted_->open.Decrement();
  counted_->received.Increment(static_cast<double>(record.bytes_in));
  counted_->sent.Increment(static_cast<double>(record.bytes_out));
  counted_->ended(record.method, record);
}

void Metrics::request_ends(const CallRecord& record) { counted_->ended(record.method + ".request", record); }

std::string Metrics::text(const Levels& levels) const {
  std::vector<MetricFamily> all = counted_->registry.Collect();
  add_server(levels.server, all);
  add_cache(levels.server, all);
  add_memory(levels, all);
  add_store(levels.server, levels.syncs, all);
  add_bases(levels.bases, all);
  add_process(levels, all);
  add_refused_connections(static_cast<double>(levels.refused_connections), all);
  return prometheus::TextSerializer().Serialize(all);
}

}  // namespace deform::server
