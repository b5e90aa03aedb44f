// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace deform::io {

bool is_gzip(std::string_view bytes);
/// Whether the name ends in .gz, in any case.
bool has_gzip_extension(const std::string& name);

/// Decompresses all members of a gzip file. Throws Error(invalid_argument) for damaged or truncated data and Error(out_of_budget)
/// if the result has more than max_bytes; never allocates more than that.
std::string gunzip(std::string_view bytes, const std::string& name, std::size_t max_bytes);

/// Compresses to one gzip member without time stamp or name, so that the result is deterministic.
std::string gzip(std::string_view bytes);

}  // namespace deform::io
