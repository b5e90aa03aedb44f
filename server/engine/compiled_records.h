// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "core/compiled/records.h"
#include "core/deformers/compiled_form.h"
#include "server/engine/engine.h"
#include "server/engine/memory.h"
#include "server/engine/system_cache.h"

namespace deform::server {

/// The file of a compiled deformation, straight from its system. Pins the system in the cache.
class CompiledRecords : public BasisRecords {
 public:
  /// Bytes of the records that are being made and sent.
  static constexpr std::size_t working_bytes = 4 * compiled::Records::piece_bytes;

  /// mesh: the name that stands in the file. Throws what CompiledForm throws.
  CompiledRecords(const SystemCache::Handle& system, const std::string& mesh, Charge charge);

  const v1::BasisHeader& header() const override { return header_; }
  bool next(std::string& records) override;

 private:
  const Charge charge_;
  const SystemCache::Handle system_;
  CompiledForm form_;
  compiled::Records records_;
  v1::BasisHeader header_;
  std::vector<std::byte> piece_;
};

}  // namespace deform::server
