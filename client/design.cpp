// SPDX-License-Identifier: Apache-2.0
#include "client/design.h"

namespace deform::client {

v1::Design variables_design(std::span<const double> values) {
  v1::Design design;
  design.mutable_variables()->Add(values.begin(), values.end());
  return design;
}

v1::Motion affine_motion(const std::string& handle, const Affine& map) {
  v1::Motion motion;
  motion.set_handle(handle);
  motion.mutable_affine()->Add(map.begin(), map.end());
  return motion;
}

v1::Motion displacement_motion(const std::string& handle, std::span<const Vec3> displacements) {
  v1::Motion motion;
  motion.set_handle(handle);
  auto& all = *motion.add_displacements();
  all.set_xyz(displacements.data(), displacements.size_bytes());
  return motion;
}

}  // namespace deform::client
