// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <map>
#include <nlohmann/json.hpp>
#include <span>
#include <string>

// Test vectors of the wire contract: what the code writes, for implementations in other languages. Made of sums, products and
// quotients only, so that every machine makes the same ones. README.md says what the files hold.

namespace deform::wire {

using Json = nlohmann::ordered_json;

/// Files by their names.
using Vectors = std::map<std::string, Json>;

void add_block_vectors(Vectors& vectors);
void add_reply_vectors(Vectors& vectors);
void add_upload_vectors(Vectors& vectors);
void add_setup_vectors(Vectors& vectors);

std::string base64(std::string_view bytes);

template <typename T>
std::string base64_of(std::span<const T> numbers) {
  return base64({reinterpret_cast<const char*>(numbers.data()), numbers.size_bytes()});
}

}  // namespace deform::wire
