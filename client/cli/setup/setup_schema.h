// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <nlohmann/json_fwd.hpp>

namespace deform::cli {

/// A JSON schema (2020-12) of setup files, generated from the descriptors of the messages, for completion in editors.
/// What it refuses is refused as well when a setup is read; it knows names, types and what excludes each other, not the limits of
/// numbers.
nlohmann::ordered_json setup_schema();

}  // namespace deform::cli
