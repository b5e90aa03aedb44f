// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <nlohmann/json_fwd.hpp>

namespace deform::cli {

/// A JSON schema (2020-12) of setup files, made from the descriptors of the messages: what editors complete keys and names from.
/// What it refuses is refused as well when a setup is read; it knows names, types and what excludes each other, not the limits of
/// numbers.
nlohmann::ordered_json setup_schema();

}  // namespace deform::cli
