// Derivatives with respect to the design variables (thesis 4.2, eq. 4.2).
#include <algorithm>
#include <cmath>
#include <sstream>

#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/base/parallel.h"
#include "core/deformers/rbf/rbf_evaluation.h"
#include "core/deformers/rbf/rbf_system.h"

namespace deform {

void RbfSystem::check_sliding(const std::vector<Affine>& derivative, const std::string& what) const {
  const Symmetry& symmetry = regions_.symmetry;
  for (const PointId id : sliding_) {
    const RegionIndex handle = centres_.region_of[id];
    const Affine& m = derivative[handle];
    if (m == Affine{}) continue;
    const Vec3& x = mesh_->points[id];
    const Vec3 u = transformed(m, x);
    double size = 0;  // of the terms of u
    for (std::size_t i = 0; i < 12; ++i) size = std::max(size, std::abs(m[i] * (i % 4 == 3 ? 1.0 : x[i % 4])));
    const Vec3 across = symmetry.to_frame(u);
    for (std::size_t k = 0; k < symmetry.planes(); ++k) {
      if ((symmetry.on(id) >> k & 1u) == 0 || std::abs(across[k]) * info_.diagonal <= symmetry.reach(k) * size) {
        continue;
      }
      std::ostringstream text;
      text << what << ": moves point " << id << " (handle \"" << setup_.handles[handle].name << "\") out of symmetry[" << k
           << "] at a rate of " << number_digits(across[k])
           << "; points on a symmetry plane only slide in it: take them out of the handle with "
           << "`difference`";
      throw Error(ErrorCode::invalid_argument, text.str());
    }
  }
}

Points RbfSystem::jacobian_vector(std::span<const double> variables, std::span<const double> direction,
                                  const RunContext& context) const {
  const std::vector<Affine> motion = motion_derivative(setup_, variables, direction);
  check_sliding(motion, "direction");
  const RbfEvaluation evaluation(std::static_pointer_cast<const RbfSystem>(shared_from_this()), motion, context);
  Points result(mesh_->point_count());
  parallel_for(context, result.size(), 8192, [&](std::size_t begin, std::size_t end) {
    Vec3* out = result.data() + begin;
    evaluation.evaluate(begin, end, 0, std::span<Vec3* const>(&out, 1));
  });
  return result;
}

/// Adjoint of "handle fields to deformable points" for one part: 4H x 3, of which the columns of its components count.
std::vector<double> RbfSystem::pull_back(const RbfPart& part, std::span<const Vec3> at_deformable,
                                         const RunContext& context) const {
  if (part.basis) return part.basis->transposed_product(at_deformable, context);

  // u = [Phi P] S [fields; 0] with the symmetric S, so the adjoint is fields^T times the first rows of S [Phi^T; P^T].
  std::vector<Vec3> unit;
  unit.reserve(centres_.deformable.size());
  for (const PointId id : centres_.deformable) unit.push_back(coordinates(id));
  const std::size_t m = part.system->size();
  const auto q = static_cast<Eigen::Index>(part.system->polynomials().terms());
  const std::span<const double> weights(unit.empty() ? nullptr : at_deformable[0].data(), 3 * unit.size());
  const std::vector<double> sums = part.system->sums_at_centres(unit, weights, 3, context);
  Eigen::MatrixXd B = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(m) + q, 3);
  for (std::size_t j = 0; j < m; ++j) {
    for (int k = 0; k < 3; ++k) B(static_cast<Eigen::Index>(j), k) = sums[3 * j + static_cast<std::size_t>(k)];
  }
  std::vector<double> terms(static_cast<std::size_t>(q));
  for (std::size_t i = 0; i < unit.size(); ++i) {
    part.system->polynomials().values(unit[i], terms.data());
    for (Eigen::Index t = 0; t < q; ++t) {
      for (int k = 0; k < 3; ++k)
        B(static_cast<Eigen::Index>(m) + t, k) += terms[static_cast<std::size_t>(t)] * at_deformable[i][k];
    }
  }
  const Eigen::MatrixXd G = part.plan.data(handle_fields()).transpose() * part.system->adjoint(std::move(B), context);
  std::vector<double> result(3 * static_cast<std::size_t>(G.rows()));
  for (Eigen::Index r = 0; r < G.rows(); ++r) {
    for (int k = 0; k < 3; ++k) result[static_cast<std::size_t>(3 * r + k)] = G(r, k);
  }
  return result;
}

/// The same for all parts: 4H x 3 from a field (n x 3) of which the deformable points count.
std::vector<double> RbfSystem::pull_back(std::span<const Vec3> field, const RunContext& context) const {
  const Symmetry& symmetry = regions_.symmetry;
  std::vector<Vec3> at_deformable;
  at_deformable.reserve(centres_.deformable.size());
  for (const PointId id : centres_.deformable) {
    at_deformable.push_back(symmetry.empty() ? field[id] : components(symmetry.to_frame(field[id]), id));
  }
  if (symmetry.empty()) return pull_back(parts_.front(), at_deformable, context);
  std::vector<Vec3> in_frame(4 * frames_.size());
  for (const RbfPart& part : parts_) {
    const std::vector<double> G = pull_back(part, at_deformable, context);
    for (std::size_t f = 0; f < in_frame.size(); ++f) {
      for (const std::size_t k : part.plan.components) in_frame[f][k] = G[3 * f + k];
    }
  }
  std::vector<double> result;
  result.reserve(3 * in_frame.size());
  for (const Vec3& row : in_frame) {
    const Vec3 back = symmetry.from_frame(row);
    result.insert(result.end(), back.begin(), back.end());
  }
  return result;
}

std::vector<double> RbfSystem::vector_jacobian(std::span<const double> variables, const Points& cotangent,
                                               const RunContext& context) const {
  check_cotangent(cotangent, mesh_->point_count());
  for (std::size_t k = 0; k < setup_.variables.size() && !sliding_.empty(); ++k) {
    check_sliding(handle_motion_derivative(setup_, variables, k), "variable \"" + setup_.variables[k].name + "\"");
  }
  return variable_gradient(held(), variables, cotangent, pull_back(cotangent, context), frames_, box_);
}

}  // namespace deform
