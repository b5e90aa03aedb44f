// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/rpc/running_limits.h"

#include <utility>
#include <vector>

#include "core/base/error.h"

namespace deform::server {

void RunningLimits::add(const std::string& name, const std::string& value, Change change, Current current) {
  const std::lock_guard lock(mutex_);
  limits_.emplace(name, Limit{value, std::move(change), std::move(current)});
}

v1::LimitInfo RunningLimits::described(const std::string& name, const Limit& limit) {
  v1::LimitInfo info;
  info.set_name(name);
  info.set_value(limit.current ? limit.current() : limit.value);
  info.set_changeable(static_cast<bool>(limit.change));
  info.set_changed(limit.changed);
  return info;
}

v1::ListLimitsReply RunningLimits::list() const {
  const std::lock_guard lock(mutex_);
  v1::ListLimitsReply reply;
  for (const auto& [name, limit] : limits_) *reply.add_limits() = described(name, limit);
  return reply;
}

bool RunningLimits::is_changeable(const std::string& name) const {
  const std::lock_guard lock(mutex_);
  const auto found = limits_.find(name);
  return found != limits_.end() && found->second.change;
}

v1::SetLimitReply RunningLimits::set(const std::string& name, const std::string& value, By by) {
  const std::lock_guard lock(mutex_);
  const auto found = limits_.find(name);
  if (found == limits_.end()) {
    std::vector<std::string> names;
    for (const auto& [known, limit] : limits_) names.push_back(known);
    const std::string near = nearest_names(name, names);
    throw Error(ErrorCode::not_found,
                "limit \"" + name + "\": there is none of that name" + (near.empty() ? "" : "; did you mean " + near + "?"));
  }
  Limit& limit = found->second;
  if (!limit.change) {
    throw Error(ErrorCode::invalid_argument, "limit " + name + ": takes a restart; it stays " + limit.value);
  }
  v1::SetLimitReply reply;
  reply.set_before(described(name, limit).value());
  try {
    limit.change(value);
  } catch (const Error& error) {
    throw Error(error.code(), "limit " + name + ": " + error.what());
  }
  limit.value = value;
  limit.changed = by == By::request;
  *reply.mutable_limit() = described(name, limit);
  return reply;
}

}  // namespace deform::server
