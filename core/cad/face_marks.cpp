// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/cad/face_marks.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <string>

namespace deform::cad {

namespace {

constexpr double same_colour = 0.01;  ///< of each channel: files have few digits

std::map<std::string, int> own_names(const Model& model) {
  std::map<std::string, int> first, count;
  for (int f = 0; f < static_cast<int>(model.face_names.size()); ++f) {
    const std::string& name = model.face_names[f];
    if (name.empty() || name == "NONE") continue;
    first.emplace(name, f);
    ++count[name];
  }
  for (const auto& [name, times] : count) {
    if (times > 1) first.erase(name);
  }
  return first;
}

}  // namespace

std::vector<std::array<int, 2>> common_names(const Model& before, const Model& after) {
  const std::map<std::string, int> old = own_names(before), now = own_names(after);
  std::vector<std::array<int, 2>> pairs;
  for (const auto& [name, f] : old) {
    const auto other = now.find(name);
    if (other != now.end()) pairs.push_back({f, other->second});
  }
  return pairs;
}

std::pair<std::vector<int>, std::vector<int>> numbered_colours(const Model& before, const Model& after) {
  std::pair<std::vector<int>, std::vector<int>> numbers;
  if (before.face_colours.empty() || after.face_colours.empty()) return numbers;
  std::vector<FaceColour> known;
  const auto number = [&](const std::optional<FaceColour>& colour) {
    if (!colour) return unpainted;
    for (std::size_t i = 0; i < known.size(); ++i) {
      double most = 0;
      for (std::size_t c = 0; c < colour->size(); ++c) most = std::max(most, std::abs(known[i][c] - (*colour)[c]));
      if (most < same_colour) return static_cast<int>(i);
    }
    known.push_back(*colour);
    return static_cast<int>(known.size()) - 1;
  };
  for (const auto& colour : before.face_colours) numbers.first.push_back(number(colour));
  for (const auto& colour : after.face_colours) numbers.second.push_back(number(colour));
  return numbers;
}

}  // namespace deform::cad
