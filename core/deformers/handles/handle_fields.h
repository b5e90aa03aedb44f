// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/deformers/handles/handle_system.h"
#include "core/quality/displacement_fields.h"

namespace deform {

/// The fields of a HandleSystem with a basis at all points of its mesh: those of the basis at the following points, 1, x, y, z of
/// the handle at its own points, 0 elsewhere. With symmetry planes a basis of several components, of which points on a plane lack
/// one, has one field for each component. The system must outlive this object. Immutable; any thread.
class HandleFields : public DisplacementFields {
 public:
  explicit HandleFields(const HandleSystem& system);

  /// A field of a basis and the components, in the frame of the symmetry planes, to which it applies.
  struct Entry {
    std::size_t basis = 0;
    std::uint32_t field = 0;
    std::vector<std::size_t> components;
  };
  static std::vector<Entry> entries(const HandleSystem& system);

  std::size_t count() const override { return entries_.size(); }
  void values(std::size_t first, std::size_t count, std::span<double> values, const RunContext& context) const override;
  double error(std::size_t field) const override;

 private:
  void following_values(std::size_t first, std::size_t count, std::size_t stride, double* values,
                        const RunContext& context) const;
  bool is_dropped(const Entry& entry, PointId id) const;

  const HandleSystem& system_;
  const std::vector<Entry> entries_;
};

}  // namespace deform
