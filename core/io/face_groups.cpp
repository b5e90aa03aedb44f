#include "core/io/face_groups.h"

#include <algorithm>

namespace deform::io {

namespace {

constexpr const char* prefixes[] = {"group:", "object:", "material:"};

bool same_members(const Group& a, const Group& b) { return a.points == b.points && a.faces == b.faces; }

}  // namespace

std::size_t FaceGroups::find_or_add(Kind kind, std::string_view name) {
  auto& index = index_[static_cast<int>(kind)];
  const auto [entry, added] = index.try_emplace(std::string(name), entries_.size());
  if (added) entries_.push_back({kind, {std::string(name), {}, {}}});
  return entry->second;
}

std::vector<Group> FaceGroups::finish() {
  std::vector<std::string> names(entries_.size());  // empty: left out
  std::unordered_map<std::string, std::size_t> taken;
  // Kind by kind, so that a name does not depend on what stands first in the file.
  for (const Kind kind : {Kind::group, Kind::object, Kind::material}) {
    for (std::size_t i = 0; i < entries_.size(); ++i) {
      Group& members = entries_[i].members;
      if (entries_[i].kind != kind || (members.faces.empty() && members.points.empty())) continue;
      std::sort(members.points.begin(), members.points.end());
      members.points.erase(std::unique(members.points.begin(), members.points.end()), members.points.end());
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
