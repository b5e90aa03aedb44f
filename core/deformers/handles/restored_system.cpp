// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/handles/restored_system.h"

#include <utility>

#include "core/base/error.h"
#include "core/deformers/handles/handle_evaluation.h"
#include "core/deformers/handles/motion_warnings.h"

namespace deform {

namespace {

constexpr const char* only_basis = "only its handle basis was restored; prepare the system";

}  // namespace

/// Designs bound to a RestoredSystem.
class RestoredEvaluation : public HandleEvaluation {
 public:
  RestoredEvaluation(std::shared_ptr<const RestoredSystem> system, std::span<const Design> designs, EvaluationPath path,
                     const RunContext& context)
      : HandleEvaluation(system, designs, path, context) {
    require_basis();
    for (std::size_t i = 0; i < designs.size(); ++i) {
      add_motion_warnings(system->held(), system->traits_.motions, designs_[i], reports_[i]);
    }
    judge();
  }
  RestoredEvaluation(std::shared_ptr<const RestoredSystem> system, const std::vector<Affine>& derivatives)
      : HandleEvaluation(std::move(system), derivatives) {
    require_basis();
  }

 private:
  void require_basis() const {
    if (direct_designs() > 0) throw Error(ErrorCode::failed_precondition, only_basis);
  }
  void direct_tile(std::size_t, std::size_t, std::size_t, double*) const override {
    throw Error(ErrorCode::internal, only_basis);
  }
};

RestoredSystem::RestoredSystem(std::shared_ptr<const Mesh> mesh, const Setup& setup, const BasisTraits& traits,
                               StoredBasis&& stored, const RunContext& context)
    : HandleSystem(std::move(mesh), setup, traits.handles, traits.unit, context), traits_(traits) {
  stored.check_fits(*this);
  if (traits_.may_crack) points_.coincident.clear();
  std::size_t errors = 0;
  for (const HandleBasis& basis : stored.bases) errors += (basis.errors.size() + basis.more.size()) * sizeof(double);
  basis_ = std::move(stored.bases);
  info_ = std::move(stored.info);
  info_.basis_bytes = 0;
  set_bytes(0, errors + (hard_handles() ? 0 : following().size() * sizeof(PointId)));
}

std::unique_ptr<const Evaluation> RestoredSystem::bind(std::span<const Design> designs, EvaluationPath path,
                                                       const RunContext& context) const {
  return std::make_unique<RestoredEvaluation>(std::static_pointer_cast<const RestoredSystem>(shared_from_this()), designs, path,
                                              context);
}

std::unique_ptr<const Evaluation> RestoredSystem::derivative(std::span<const double>, const std::vector<Affine>& maps,
                                                             const RunContext&) const {
  return std::make_unique<RestoredEvaluation>(std::static_pointer_cast<const RestoredSystem>(shared_from_this()), maps);
}

HandleSystem::Fields RestoredSystem::adjoint(std::span<const double>, Cotangents, const RunContext&) const {
  throw Error(ErrorCode::internal, only_basis);
}

std::string RestoredSystem::only_on_mesh() const { return only_basis; }

}  // namespace deform
