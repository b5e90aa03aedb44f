// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/setup/setup_stages.h"

#include <algorithm>
#include <set>

#include "client/cli/setup/reading.h"

namespace deform::cli {

namespace {

/// The motion of another handle of a variable; without one of its own it is that of the first.
template <typename To, typename From>
void take_motion(const From& from, To& to) {
  to.clear_translate();
  to.clear_rotate();
  to.clear_scale();
  *to.mutable_translate() = from.translate();
  if (from.has_rotate()) *to.mutable_rotate() = from.rotate();
  if (from.has_scale()) *to.mutable_scale() = from.scale();
}

/// How a variable moves handles with these names; std::nullopt if it moves none of them.
std::optional<v1::DesignVariable> on_handles(const v1::DesignVariable& variable, const std::set<std::string>& names) {
  v1::DesignVariable result = variable;
  result.clear_also();
  bool first = names.contains(variable.handle());
  for (const v1::DrivenHandle& driven : variable.also()) {
    if (!names.contains(driven.handle())) continue;
    const bool own = driven.translate_size() > 0 || driven.has_rotate() || driven.has_scale();
    v1::DrivenHandle full = driven;
    if (!own) take_motion(variable, full);
    if (first) {
      *result.add_also() = full;
    } else {
      result.set_handle(full.handle());
      take_motion(full, result);
      first = true;
    }
  }
  return first ? std::optional(result) : std::nullopt;
}

void keep_own_variables(v1::Setup& setup) {
  std::set<std::string> names;
  for (const auto& handle : setup.handles()) names.insert(handle.name());
  const auto variables = setup.variables();
  setup.clear_variables();
  for (const auto& variable : variables) {
    if (const auto own = on_handles(variable, names)) *setup.add_variables() = *own;
  }
}

}  // namespace

v1::Setup setup_of_method(const v1::Setup& setup, const std::optional<std::uint32_t>& then) {
  v1::Setup result = setup;
  result.clear_then();
  if (setup.then_size() == 0 && !then) return result;
  if (!then) {
    keep_own_variables(result);
    return result;
  }
  if (*then >= static_cast<std::uint32_t>(setup.then_size())) {
    refuse("--then " + std::to_string(*then) + ": the setup has " + std::to_string(setup.then_size()) +
           (setup.then_size() == 1 ? " further method" : " further methods") + ", numbered from 0");
  }
  const v1::Stage& stage = setup.then(static_cast<int>(*then));
  *result.mutable_method() = stage.method();
  *result.mutable_handles() = stage.handles();
  *result.mutable_fixed() = stage.fixed();
  keep_own_variables(result);
  return result;
}

std::optional<v1::Setup> setup_of_handle(const v1::Setup& setup, const std::string& handle) {
  const auto has = [&](const auto& handles) {
    return std::any_of(handles.begin(), handles.end(), [&](const v1::Handle& candidate) { return candidate.name() == handle; });
  };
  if (has(setup.handles())) return setup_of_method(setup, std::nullopt);
  for (int i = 0; i < setup.then_size(); ++i) {
    if (has(setup.then(i).handles())) return setup_of_method(setup, static_cast<std::uint32_t>(i));
  }
  return std::nullopt;
}

void refuse_several_methods(const v1::Setup& setup, const std::string& reason) {
  if (setup.then_size() > 0) refuse("then: " + reason);
}

}  // namespace deform::cli
