// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <functional>
#include <map>
#include <mutex>
#include <string>

#include "deform/v1/admin.pb.h"

namespace deform::server {

/// The limits of a server in force, by the names of its options, and which of them change while it runs. Thread-safe.
class RunningLimits {
 public:
  /// Takes a value over; throws Error(invalid_argument) for one that is wrong.
  using Change = std::function<void(const std::string& value)>;
  using Current = std::function<std::string()>;

  /// Names that are there already stay as they are. Without `change` a limit stays as it is until a restart. `current` is asked
  /// for the value of what others change, too.
  void add(const std::string& name, const std::string& value, Change change = {}, Current current = {});

  v1::ListLimitsReply list() const;
  bool is_changeable(const std::string& name) const;
  /// Who sets a limit: a request, whose value is gone after a restart, or the options, which are read again then.
  enum class By { request, options };
  /// Throws Error(not_found) for an unknown name, Error(invalid_argument) for what takes a restart, and what the change throws.
  v1::SetLimitReply set(const std::string& name, const std::string& value, By by);

 private:
  struct Limit {
    std::string value;
    Change change;
    Current current;
    bool changed = false;
  };
  static v1::LimitInfo described(const std::string& name, const Limit& limit);

  mutable std::mutex mutex_;
  std::map<std::string, Limit> limits_;  // under mutex_
};

}  // namespace deform::server
