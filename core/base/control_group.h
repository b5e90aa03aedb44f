// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>

namespace deform {

/// What the kernel lets the control group of this process use, as containers, Kubernetes and systemd set it (cgroup version 2, 1
/// or both; `man 7 cgroups`). The limits of a group hold for those within it, so the least of the group and those around it
/// counts.
struct ControlGroup {
  std::optional<double> cores;          ///< processor time per time: 1.5 = one and a half cores; none: no quota
  std::optional<std::uint64_t> memory;  ///< bytes; none: no limit

  /// Reads the files below `root`, a folder that stands for "/". What cannot be read limits nothing.
  static ControlGroup read(const std::filesystem::path& root = "/");
};

/// The number of threads that can compute at once: the processors that this process may run on, or the quota of its control group
/// rounded up where that is less. At least 1; determined at the first call. Any thread.
int available_cores();

}  // namespace deform
