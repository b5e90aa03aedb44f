// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/commands/lookup.h"

namespace deform::cli {

namespace {

template <typename Get>
auto if_known(const Get& get) -> std::optional<decltype(get())> {
  try {
    return get();
  } catch (const Error& error) {
    if (error.code() != ErrorCode::not_found) throw;
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
  found.geometry = if_known([&] { return connection.client().get_geometry(id, connection.call()); });
  found.system = if_known([&] { return connection.client().get_system(id, connection.call()); });
  if (found.geometry && found.system) {
    throw Error(ErrorCode::invalid_argument, "\"" + id + "\" begins the ids of a geometry and of a system; give more digits");
  }
  if (!found.geometry && !found.system) {
    throw Error(ErrorCode::not_found, "no geometry and no system has the id " + id + "; deform list shows what there is");
  }
  return found;
}

}  // namespace deform::cli
