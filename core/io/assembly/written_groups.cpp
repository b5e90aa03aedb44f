// SPDX-License-Identifier: Apache-2.0
#include "core/io/assembly/written_groups.h"

#include <unordered_set>

namespace deform::io {

std::vector<std::string> writable_names(const Mesh& mesh, std::string_view reserved) {
  std::vector<std::string> names;
  std::unordered_set<std::string> taken;
  for (const Group& group : mesh.groups) {
    std::string name = group.name;
    for (char& c : name) {
      if ((c >= 0 && c < ' ') || reserved.find(c) != std::string_view::npos) c = '_';
    }
    const std::string first = name;
    for (int copy = 2; !taken.insert(name).second; ++copy) name = first + "_" + std::to_string(copy);
    names.push_back(name);
  }
  return names;
}

FaceMembership::FaceMembership(const Mesh& mesh) : offsets_(mesh.face_count() + 1, 0) {
  for (const Group& group : mesh.groups) {
    for (const FaceId face : group.faces) ++offsets_[face + 1];
  }
  for (std::size_t i = 1; i < offsets_.size(); ++i) offsets_[i] += offsets_[i - 1];
  groups_.resize(offsets_.back());
  std::vector<std::uint64_t> next(offsets_.begin(), offsets_.end() - 1);
  for (std::size_t g = 0; g < mesh.groups.size(); ++g) {
    for (const FaceId face : mesh.groups[g].faces) groups_[next[face]++] = static_cast<std::uint32_t>(g);
  }
}

}  // namespace deform::io
