// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "core/base/error.h"

namespace deform::cli {

/// What --json prints on stdout of an error: {"code", "message", "field"}, and "request_id" of a call that was
/// sent. The codes are those of gRPC, and two of our own.
/// `field` is what the message names at its start when that is a field of a request or setup ("designs[3].variables[0]"), else
/// empty.
nlohmann::ordered_json error_json(ErrorCode code, const std::string& message);
/// The same with the id of its call.
nlohmann::ordered_json error_json(const Error& error);
nlohmann::ordered_json usage_error_json(const std::string& message);
/// The command was carried out, but a gate or verdict failed.
nlohmann::ordered_json verdict_error_json(const std::string& message);

}  // namespace deform::cli
