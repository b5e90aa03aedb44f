// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "core/deformers/handles/handle_system.h"
#include "core/deformers/handles/stored_basis.h"

namespace deform {

/// A prepared system without its solution: the handle basis that it had, with the code that evaluates it there, too. Designs on
/// the basis path, their reports, derivatives and fields have the same bits as those of the system that was stored. What needs
/// the solution (the direct path, points off the mesh) is an Error(failed_precondition).
class RestoredSystem : public HandleSystem {
 public:
  /// Throws the errors of HandleSystem and of StoredBasis::check_fits().
  RestoredSystem(std::shared_ptr<const Mesh> mesh, const Setup& setup, const BasisTraits& traits, StoredBasis&& stored,
                 const RunContext& context);

  std::unique_ptr<const Evaluation> bind(std::span<const Design> designs, EvaluationPath path,
                                         const RunContext& context) const override;

 private:
  friend class RestoredEvaluation;

  std::unique_ptr<const Evaluation> derivative(std::span<const double> variables, const std::vector<Affine>& maps,
                                               const RunContext& context) const override;
  Fields adjoint(std::span<const double> variables, Cotangents at_following, const RunContext& context) const override;
  std::string only_on_mesh() const override;

  const BasisTraits traits_;
};

}  // namespace deform
