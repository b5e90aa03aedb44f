// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "core/compiled/reader.h"
#include "core/deformers/handles/handle_basis.h"
#include "core/deformers/handles/handle_motion.h"
#include "core/deformers/system.h"

namespace deform {

class HandleSystem;

/// What a prepared system has beyond its mesh and its setup to evaluate designs on the basis path, and a form of it in bytes. The
/// bytes are for the same program on another day or another machine, which checks them with a checksum of its own: there is no
/// other reader. In the order of this machine, doubles bit by bit.
class StoredBasis {
 public:
  using Sink = std::function<void(const void* data, std::size_t size)>;

  /// The source of a stored basis: `system` itself if it has a basis and no constraints, else null.
  static const HandleSystem* source(const System& system);
  /// Hands out the bytes piece by piece, the values straight from the system.
  static void write(const HandleSystem& system, const Sink& sink);
  /// How many bytes that are.
  static std::uint64_t bytes(const HandleSystem& system);

  /// Throws Error(data_loss) for bytes of another layout, too few or too many. Nothing is allocated that `from` is too short for.
  static StoredBasis read(compiled::ByteSource& from);

  /// Throws Error(data_loss) unless that is the basis of a system with the box, frames and points of this one, bit for bit.
  void check_fits(const HandleSystem& system) const;

  SystemInfo info;
  UnitBox box;
  std::vector<HandleFrame> frames;
  std::uint64_t following = 0;  ///< points
  std::vector<HandleBasis> bases;
};

}  // namespace deform
