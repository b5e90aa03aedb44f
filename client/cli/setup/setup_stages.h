// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <optional>
#include <string>

#include "deform/v1/setup.pb.h"

namespace deform::cli {

/// One method of a setup as a setup of its own: with its handles, its fixed regions and the variables that move its handles. No
/// number: that of `method`, else that of then[number]. Throws Error(invalid_argument) for a number that the setup has not.
v1::Setup setup_of_method(const v1::Setup& setup, const std::optional<std::uint32_t>& then);

/// The same of the method that has the handle; std::nullopt if none has.
std::optional<v1::Setup> setup_of_handle(const v1::Setup& setup, const std::string& handle);

/// Throws Error(invalid_argument) "then: REASON" for setups with several methods.
void refuse_several_methods(const v1::Setup& setup, const std::string& reason);

}  // namespace deform::cli
