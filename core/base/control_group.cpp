// SPDX-License-Identifier: Apache-2.0
#include "core/base/control_group.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

namespace deform {

namespace {

/// Absent where the file is or does not begin with a number, such as "max".
template <typename T>
std::optional<T> number_in(const std::filesystem::path& file) {
  std::ifstream in(file);
  T value{};
  return in >> value ? std::optional<T>(value) : std::nullopt;
}

template <typename T>
void lower(std::optional<T>& limit, T value) {
  limit = limit ? std::min(*limit, value) : value;
}

/// Quota and period, in microseconds.
void lower_cores(ControlGroup& limits, double quota, double period) {
  if (quota > 0 && period > 0) lower(limits.cores, quota / period);
}

void read_version_2(const std::filesystem::path& group, ControlGroup& limits) {
  std::ifstream in(group / "cpu.max");
  double quota = 0, period = 0;
  if (in >> quota >> period) lower_cores(limits, quota, period);
  if (const auto bytes = number_in<std::uint64_t>(group / "memory.max")) lower(limits.memory, *bytes);
}

void read_version_1(const std::filesystem::path& group, ControlGroup& limits) {
  const auto quota = number_in<double>(group / "cpu.cfs_quota_us"), period = number_in<double>(group / "cpu.cfs_period_us");
  if (quota && period) lower_cores(limits, *quota, *period);  // -1: no quota
  if (const auto bytes = number_in<std::uint64_t>(group / "memory.limit_in_bytes")) {
    constexpr std::uint64_t none = std::uint64_t{1} << 62;  // pages that no machine has
    if (*bytes < none) lower(limits.memory, *bytes);
  }
}

/// Calls read(folder) for the group and all around it. In a container the path may be that of the host: the group is the mount
/// itself then.
template <typename Read>
void for_each_level(const std::filesystem::path& mount, const std::filesystem::path& path, const Read& read) {
  std::filesystem::path group = mount;
  read(group);
  for (const auto& part : path.relative_path()) {
    if (part == "..") return;  // outside of the namespace
    group /= part;
    read(group);
  }
}

}  // namespace

ControlGroup ControlGroup::read(const std::filesystem::path& root) {
  ControlGroup limits;
  const std::filesystem::path mounts = root / "sys/fs/cgroup";
  std::ifstream lines(root / "proc/self/cgroup");
  for (std::string line; std::getline(lines, line);) {  // "hierarchy:controllers:path"
    const auto first = line.find(':'), second = line.find(':', first + 1);
    if (first == std::string::npos || second == std::string::npos) continue;
    const std::string controllers = line.substr(first + 1, second - first - 1), path = line.substr(second + 1);
    if (controllers.empty()) {
      for (const auto& mount : {mounts, mounts / "unified"}) {
        for_each_level(mount, path, [&](const auto& group) { read_version_2(group, limits); });
      }
      continue;
    }
    std::istringstream names(controllers);
    for (std::string name; std::getline(names, name, ',');) {
      if (name != "cpu" && name != "memory") continue;
      for (const std::string& mount : {controllers, name}) {
        for_each_level(mounts / mount, path, [&](const auto& group) { read_version_1(group, limits); });
      }
    }
  }
  return limits;
}

int available_cores() {
  static const int cores = [] {
    const int processors = std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
    const auto quota = ControlGroup::read().cores;
    return quota ? std::clamp(static_cast<int>(std::ceil(std::min(*quota, 1e6))), 1, processors) : processors;
  }();
  return cores;
}

}  // namespace deform
