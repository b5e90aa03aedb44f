// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace deform::test {

/// A text cut into words and what stands between them, in turn: even entries are separators (maybe empty), odd ones words.
inline std::vector<std::string_view> cut(std::string_view text) {
  const auto is_word = [](char c) { return static_cast<unsigned char>(c) > ' '; };
  std::vector<std::string_view> parts;
  std::size_t at = 0;
  while (at <= text.size()) {
    std::size_t end = at;
    const bool word = parts.size() % 2 == 1;
    while (end < text.size() && is_word(text[end]) == word) ++end;
    parts.push_back(text.substr(at, end - at));
    if (end == text.size()) break;
    at = end;
  }
  return parts;
}

/// Numbers of the words in which two texts differ; {-1} when anything but words differs. Words count from 0.
inline std::vector<long> changed_words(std::string_view before, std::string_view after) {
  const auto a = cut(before), b = cut(after);
  if (a.size() != b.size()) return {-1};
  std::vector<long> changed;
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (a[i] == b[i]) continue;
    if (i % 2 == 0) return {-1};
    changed.push_back(static_cast<long>(i / 2));
  }
  return changed;
}

}  // namespace deform::test
