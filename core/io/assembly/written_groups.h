// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "core/mesh/mesh.h"

namespace deform::io {

/// The names of the groups with `reserved` characters replaced by underscores, still unique.
std::vector<std::string> writable_names(const Mesh& mesh, std::string_view reserved);

/// The groups of each face as compressed rows.
class FaceMembership {
 public:
  explicit FaceMembership(const Mesh& mesh);
  std::span<const std::uint32_t> of(std::size_t face) const {
    return {groups_.data() + offsets_[face], groups_.data() + offsets_[face + 1]};
  }

 private:
  std::vector<std::uint64_t> offsets_;
  std::vector<std::uint32_t> groups_;
};

}  // namespace deform::io
