// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <memory>
#include <span>

#include "core/compiled/content.h"
#include "core/deformers/system.h"

namespace deform {

class HandleSystem;

/// What a system with a handle basis computes without its solver (thesis 4.2), as a compiled deformation has it. Keeps the system
/// alive; any thread.
class CompiledForm {
 public:
  /// Throws Error(failed_precondition) with the reason for a system that has no such form: with constraints, without a basis, of
  /// a setup without design variables.
  explicit CompiledForm(const std::shared_ptr<const System>& system);

  /// All but the values of the bases, the ids and the names that come from elsewhere (creator, mesh, setup).
  const compiled::Content& content() const { return content_; }
  /// To fill these in.
  compiled::Content& content() { return content_; }
  /// Values [first, first + out.size()) of a basis, in the order of compiled::Basis::values. Of bases
  /// that are stored in doubles; others have their codes in the content.
  void values(std::size_t basis, std::size_t first, std::span<double> out) const;

  /// About what one takes beside the system.
  static std::size_t bytes_for(const System& system);

 private:
  void check_sector() const;
  void set_variables();
  void set_points();
  void set_bases();

  std::shared_ptr<const HandleSystem> system_;
  compiled::Content content_;
};

}  // namespace deform
