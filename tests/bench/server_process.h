// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <sys/types.h>

#include <filesystem>
#include <string>

namespace deform::bench {

/// A deformd process of its own on a free port of 127.0.0.1, with its data under `folder`, which is stopped at the end.
class ServerProcess {
 public:
  /// Throws std::runtime_error when it does not come up; its log is then in folder/deformd.log.
  ServerProcess(const std::string& binary, const std::filesystem::path& folder);
  ~ServerProcess();
  ServerProcess(const ServerProcess&) = delete;
  ServerProcess& operator=(const ServerProcess&) = delete;

  const std::string& address() const { return address_; }
  /// Processor time of all its threads so far.
  double cpu_seconds() const;
  /// Resident set, from /proc.
  double resident_bytes() const;

 private:
  void wait_for_port(const std::filesystem::path& port_file);

  pid_t pid_ = 0;
  std::string address_;
};

/// Processor time of all threads of this process so far.
double own_cpu_seconds();

}  // namespace deform::bench
