// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/handle_shapes.h"

#include <algorithm>
#include <utility>
#include <variant>

#include "core/compiled/motion.h"

namespace deform {

namespace {

/// The scalings that take part in the motion of a handle.
std::vector<compiled::Scale> scales_of(const Setup& setup, const std::vector<double>& values, const std::string& handle) {
  std::vector<compiled::Scale> scales;
  for (std::size_t k = 0; k < values.size(); ++k) {
    const DesignVariable& variable = setup.variables[k];
    const auto add = [&](const std::string& moved, const VariableMotion& kind) {
      if (moved == handle && values[k] != 0 && std::holds_alternative<Scaling>(kind)) {
        scales.push_back({variable.name, values[k]});
      }
    };
    add(variable.handle, variable.kind);
    for (const DrivenHandle& driven : variable.also) add(driven.handle, driven.kind);
  }
  return scales;
}

/// Else no handle can change its shape.
bool scales_something(const Setup& setup, const std::vector<double>& values) {
  const auto is_scaling = [](const auto& one) { return std::holds_alternative<Scaling>(one.kind); };
  for (std::size_t k = 0; k < values.size() && k < setup.variables.size(); ++k) {
    const DesignVariable& variable = setup.variables[k];
    if (values[k] == 0) continue;
    if (is_scaling(variable) || std::any_of(variable.also.begin(), variable.also.end(), is_scaling)) return true;
  }
  return false;
}

}  // namespace

std::vector<std::string> handle_shape_doubts(const Setup& setup, const Design& design) {
  std::vector<std::string> doubts;
  const auto look = [&](std::size_t h, const Affine& map, const std::vector<double>& values) {
    if (compiled::shape_under(map) == compiled::Shape::kept) return;
    doubts.push_back(compiled::shape_doubt(setup.handles[h].name, map, scales_of(setup, values, setup.handles[h].name)));
  };
  if (scales_something(setup, design.variables)) {
    const std::vector<Affine> maps = handle_motions(setup, design.variables);
    for (std::size_t h = 0; h < maps.size(); ++h) look(h, maps[h], design.variables);
  }
  for (const Motion& motion : design.motions) {
    if (const auto* map = std::get_if<Affine>(&motion.value)) look(motion.handle, *map, {});
  }
  return compiled::first_doubts(std::move(doubts));
}

}  // namespace deform
