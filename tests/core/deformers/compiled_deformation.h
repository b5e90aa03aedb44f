// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "core/compiled/deformation.h"
#include "core/compiled/reader.h"
#include "core/compiled/records.h"
#include "core/deformers/compiled_form.h"

namespace deform::test {

/// The compiled deformation of a system, as it comes out of a file.
inline compiled::Deformation compiled_deformation(const std::shared_ptr<const System>& system) {
  CompiledForm form(system);
  form.content().geometry_id = std::string(64, 'a');
  form.content().system_id = std::string(64, 'b');
  compiled::Records records(form.content(),
                            [&](std::size_t basis, std::size_t first, std::span<double> out) { form.values(basis, first, out); });
  std::vector<std::byte> bytes, piece;
  while (records.next(piece)) bytes.insert(bytes.end(), piece.begin(), piece.end());
  return compiled::Deformation(compiled::read_content(bytes));
}

}  // namespace deform::test
