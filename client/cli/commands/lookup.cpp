// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/commands/lookup.h"

#include <exception>

namespace deform::cli {

namespace {

/// One of several servers that cannot be reached is no obstacle where another one knows the id.
template <typename Get>
auto if_known(const Get& get, std::exception_ptr& unreachable) -> std::optional<decltype(get())> {
  try {
    return get();
  } catch (const Error& error) {
    if (error.code() == ErrorCode::unavailable) {
      unreachable = std::current_exception();
    } else if (error.code() != ErrorCode::not_found) {
      throw;
    }
    return std::nullopt;
  }
}

}  // namespace

Found look_up(Connection& connection, const std::string& id) {
  if (!looks_like_id(id)) {
    throw Error(ErrorCode::invalid_argument,
                "\"" + id + "\" is no id: expected 8 to 64 hexadecimal digits; deform list shows them");
  }
  Found found;
  std::exception_ptr unreachable;
  found.geometry = if_known([&] { return connection.client().get_geometry(id, connection.call()); }, unreachable);
  if (found.geometry && found.geometry->id() == id) return found;
  found.system =
      if_known([&] { return connection.client().get_system(id, connection.call(), client::SetupInInfo::omit); }, unreachable);
  if (found.geometry && found.system) {
    throw Error(ErrorCode::invalid_argument, "\"" + id + "\" begins the ids of a geometry and of a system; give more digits");
  }
  if (!found.geometry && !found.system) {
    if (unreachable) std::rethrow_exception(unreachable);
    throw Error(ErrorCode::not_found, "no geometry and no system has the id " + id + "; deform list shows what there is");
  }
  return found;
}

}  // namespace deform::cli
