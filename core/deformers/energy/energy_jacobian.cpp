// Derivatives with respect to the design variables (thesis 4.2, eq. 4.2).
#include "core/base/parallel.h"
#include "core/deformers/energy/energy_evaluation.h"
#include "core/deformers/energy/energy_system.h"

namespace deform {

/// Of the design of some variables, which is solved for.
EnergySystem::Constrained EnergySystem::constrained_at(std::span<const double> variables, const RunContext& context) const {
  const Design design{{variables.begin(), variables.end()}, {}};
  const BoundDesign bound = held().bound(design, 0);
  const Prescribed told = prescribed(bound, MotionKind::position);
  ConstrainedResult result = constrained_->solve(told.h, told.offsets, context);
  if (!placement_) return {std::move(result), {}};
  Solution solution = completed(told.h * box_.scale, result.w * box_.scale, context);
  place_exactly(bound, solution, context);
  return {std::move(result), std::move(solution.exact)};
}

Points EnergySystem::jacobian_vector(std::span<const double> variables, std::span<const double> direction,
                                     const RunContext& context) const {
  const std::vector<Affine> motion = motion_derivative(setup_, variables, direction);
  Constrained at;
  if (constrained_) at = constrained_at(variables, context);
  const EnergyEvaluation evaluation(std::static_pointer_cast<const EnergySystem>(shared_from_this()), motion, at, context);
  Points result(mesh_->point_count());
  parallel_for(context, result.size(), 8192, [&](std::size_t begin, std::size_t end) {
    Vec3* out = result.data() + begin;
    evaluation.evaluate(begin, end, 0, std::span<Vec3* const>(&out, 1));
  });
  return result;
}

/// Handle fields at the held points, transposed, times `back` (m x 3): 4H x 3.
std::vector<double> EnergySystem::contract_fields(const Eigen::MatrixXd& back) const {
  std::vector<double> result;
  for (std::size_t h = 0; h < frames_.size(); ++h) {
    const Eigen::MatrixXd G = handle_fields(h).transpose() * back;
    for (Eigen::Index f = 0; f < 4; ++f) {
      for (Eigen::Index k = 0; k < 3; ++k) result.push_back(G(f, k));
    }
  }
  return result;
}

/// Adjoint of "handle fields to following points": 4H x 3.
std::vector<double> EnergySystem::pull_back(std::span<const double> variables, const Points& cotangent,
                                            const RunContext& context) const {
  std::vector<Vec3> X;
  X.reserve(following_.size());
  for (const PointId id : following_) X.push_back(cotangent[id]);
  if (basis_) return basis_->transposed_product(X, context);
  Constrained at;
  std::vector<Vec3> told;
  if (constrained_) at = constrained_at(variables, context);
  if (placement_ && at.exact.any()) told = pull_back_exact(at.exact, X, context);
  Eigen::MatrixXd g = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(solver_->unknowns()), 3);
  for (std::size_t s = 0; s < following_.size(); ++s) {
    for (SparseRows::InnerIterator it(model_.space.values, following_[s]); it; ++it) {
      for (Eigen::Index k = 0; k < 3; ++k) g(it.col(), k) += it.value() * X[s][static_cast<std::size_t>(k)];
    }
  }
  Eigen::MatrixXd direct = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(model_.held.size()), 3);
  if (correction_) {
    // The correction interpolates h - B w, so it acts on h directly and through w.
    direct = correction_->adjoint(unit_places(following_), X, context);
    g -= solver_->problem().coupling * direct;
  }
  if (!constrained_) return contract_fields(direct + solver_->adjoint(g, context));

  const ConstrainedSolver::Adjoint back = constrained_->adjoint(at.result, g, context);
  std::vector<double> result = contract_fields(direct + back.h);
  std::size_t i = 0;
  for (const ConstraintSet& set : constrained_->sets()) {
    for (const PointId id : set.ids) {
      const Vec3& y = back.offsets[i++];
      if (model_.eliminated) add_fields(id, y, result);
    }
  }
  for (std::size_t u = 0; u < told.size(); ++u) {
    if (!placement_->moves(u)) add_fields(placement_->ids()[u], told[u], result);
  }
  return result;
}

/// Of a point that goes where its handle is told to.
void EnergySystem::add_fields(PointId id, const Vec3& cotangent, std::vector<double>& fields) const {
  const RegionIndex region = region_of_[id];
  if (region == deformable_region || region == fixed_region) return;
  const Vec3 x = box_.to_unit(mesh_->points[id]);
  for (std::size_t f = 0; f < 4; ++f) {
    const double field = f == 0 ? 1 : x[f - 1] - frames_[region].reference[f - 1];
    for (std::size_t k = 0; k < 3; ++k) fields[3 * (4 * region + f) + k] += field * cotangent[k];
  }
}

std::vector<double> EnergySystem::vector_jacobian(std::span<const double> variables, const Points& cotangent,
                                                  const RunContext& context) const {
  check_cotangent(cotangent, mesh_->point_count());
  handle_motions(setup_, variables);  // checks them
  const std::vector<double> fields = pull_back(variables, cotangent, context);
  // Soft handles follow the solution: nothing goes where it is told directly.
  return variable_gradient(held(), variables, exact() ? cotangent : Points(cotangent.size()), fields, frames_, box_);
}

}  // namespace deform
