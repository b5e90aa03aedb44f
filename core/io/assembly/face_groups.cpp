// SPDX-License-Identifier: Apache-2.0
#include "core/io/assembly/face_groups.h"

#include <algorithm>

#include "core/base/text.h"

namespace deform::io {

namespace {

constexpr const char* prefixes[FaceGroups::kinds] = {
    "group:", "object:", "material:", "patchGroup:", "pointZone:", "faceZone:", "cellZone:", "family:", "section:"};

bool is_utf8(std::string_view text) {
  while (!text.empty()) {
    const std::size_t length = utf8_length(text);
    if (length == 0) return false;
    text.remove_prefix(length);
  }
  return true;
}

std::string printable(std::string_view name) {
  const bool latin = !is_utf8(name);
  std::string text;
  for (const char c : name) {
    const auto code = static_cast<unsigned char>(c);
    if (code < ' ' || code == 0x7f) {
      text += '_';
    } else if (latin && code >= 0x80) {
      text += static_cast<char>(0xc0 | (code >> 6));
      text += static_cast<char>(0x80 | (code & 0x3f));
    } else {
      text += c;
    }
  }
  return text;
}

void make_unique(std::vector<std::uint32_t>& ids) {
  std::sort(ids.begin(), ids.end());
  ids.erase(std::unique(ids.begin(), ids.end()), ids.end());
}

bool same_members(const Group& a, const Group& b) { return a.points == b.points && a.faces == b.faces; }

}  // namespace

std::size_t FaceGroups::find_or_add(Kind kind, std::string_view original) {
  const std::string name = printable(original);
  auto& index = index_[static_cast<int>(kind)];
  const auto [entry, added] = index.try_emplace(name, entries_.size());
  if (added) entries_.push_back({kind, {name, {}, {}}});
  return entry->second;
}

std::vector<Group> FaceGroups::finish() {
  std::vector<std::string> names(entries_.size());  // empty: left out
  std::unordered_map<std::string, std::size_t> taken;
  // Kind by kind, so that names do not depend on the order in the file.
  for (int number = 0; number < kinds; ++number) {
    const auto kind = static_cast<Kind>(number);
    for (std::size_t i = 0; i < entries_.size(); ++i) {
      Group& members = entries_[i].members;
      if (entries_[i].kind != kind || (members.faces.empty() && members.points.empty())) continue;
      make_unique(members.points);
      make_unique(members.faces);
      std::string name = members.name;
      if (const auto other = taken.find(name); other != taken.end()) {
        if (same_members(entries_[other->second].members, members)) continue;
        name = prefixes[static_cast<int>(kind)] + members.name;
        for (int copy = 2; taken.count(name); ++copy) {
          name = prefixes[static_cast<int>(kind)] + members.name + "_" + std::to_string(copy);
        }
      }
      taken.emplace(name, i);
      names[i] = name;
    }
  }
  std::vector<Group> groups;
  for (std::size_t i = 0; i < entries_.size(); ++i) {
    if (names[i].empty()) continue;
    groups.push_back(std::move(entries_[i].members));
    groups.back().name = names[i];
  }
  return groups;
}

}  // namespace deform::io
