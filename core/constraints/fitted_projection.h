// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

#include "core/constraints/fitting.h"
#include "core/constraints/projection.h"

namespace deform {

/// The projection onto a fitted shape. A Model has
///   static constexpr int rows, sizes          residuals per point and parameters besides the motion of the frame
///   std::string_view kind() const
///   const std::vector<int>& active() const    the free parameters of the shape, ascending
///   void residual(i, y, sizes, LocalResidual&) const
///   Fit<sizes> fitted(x, const Fit<sizes>* last) const    the least-squares fit; `last` is an earlier one to start from, or null
/// The shape parameters are those of Fit::packed().
template <class Model>
class FittedProjection : public Projection {
 public:
  FittedProjection(Model model, std::size_t points) : model_(std::move(model)), points_(points) {}

  std::string_view kind() const override { return model_.kind(); }
  std::size_t point_count() const override { return points_; }

  double project(std::span<const Vec3> x, std::span<Vec3> out, ShapeParameters& shape) const override {
    const bool warm = shape.size() == FitType::length;
    const FitType last = warm ? FitType::unpacked(shape) : FitType{};
    const FitType fit = model_.fitted(x, warm ? &last : nullptr);
    shape = fit.packed();
    double energy = 0;
    LocalType local;
    for (std::size_t i = 0; i < x.size(); ++i) {
      model_.residual(i, fit.frame.local(x[i]), fit.size, local);
      const Eigen::Vector3d away = fit.frame.axes * (local.gradient.template leftCols<3>().transpose() * local.value);
      out[i] = to_vec3(to_eigen(x[i]) - away);
      energy += local.value.squaredNorm();
    }
    return energy;
  }

  void derivative(std::span<const Vec3> x, const ShapeParameters& shape, std::span<const Vec3> dx,
                  std::span<Vec3> out) const override {
    const FitType fit = FitType::unpacked(shape);
    const std::vector<int>& active = model_.active();
    const ActiveDerivatives at = active_derivatives(fit_derivatives(model_, {x}, fit), active);
    const double points = std::sqrt(static_cast<double>(x.size()));
    const Eigen::VectorXd scale = residual_scale(at.gauss_newton, natural_scale(active, points, spread({x}).reach()));
    Parameters turn = Parameters::Zero();
    for (std::size_t i = 0; i < x.size(); ++i) {
      const auto second = second_derivatives(i, x[i], fit);
      turn.noalias() += second.xq.transpose() * to_eigen(dx[i]);
    }
    solve_active(at.newton, scale, active, {turn.data(), motions + Model::sizes});
    for (std::size_t i = 0; i < x.size(); ++i) {
      const auto second = second_derivatives(i, x[i], fit);
      const Eigen::Vector3d d = to_eigen(dx[i]);
      out[i] = to_vec3(d - second.xx * d + second.xq * turn);
    }
  }

  Linearization linearize(std::span<const Vec3> x, const ShapeParameters& shape) const override {
    const FitType fit = FitType::unpacked(shape);
    const std::vector<int>& active = model_.active();
    const auto columns = static_cast<Eigen::Index>(active.size());
    Linearization result;
    result.rows_per_point = Model::rows;
    result.normals.resize(Model::rows * x.size());
    result.residual.resize(static_cast<Eigen::Index>(result.normals.size()));
    result.parameters.resize(result.residual.size(), columns);
    LocalType local;
    for (std::size_t i = 0; i < x.size(); ++i) {
      const Eigen::Vector3d y = fit.frame.local(x[i]);
      model_.residual(i, y, fit.size, local);
      const Eigen::Matrix<double, Model::rows, motions + Model::sizes> J = local.gradient * chart<Model::sizes>(y);
      for (int s = 0; s < Model::rows; ++s) {
        const std::size_t row = i * Model::rows + static_cast<std::size_t>(s);
        result.normals[row] = to_vec3(fit.frame.axes * local.gradient.row(s).template head<3>().transpose());
        result.residual[static_cast<Eigen::Index>(row)] = local.value[s];
        for (Eigen::Index k = 0; k < columns; ++k) {
          result.parameters(static_cast<Eigen::Index>(row), k) = J(s, active[static_cast<std::size_t>(k)]);
        }
      }
    }
    return result;
  }

 private:
  using FitType = Fit<Model::sizes>;
  using LocalType = LocalResidual<Model::rows, Model::sizes>;
  using Parameters = Eigen::Matrix<double, motions + Model::sizes, 1>;

  SecondDerivatives<Model::sizes> second_derivatives(std::size_t i, const Vec3& x, const FitType& fit) const {
    LocalType local;
    const Eigen::Vector3d y = fit.frame.local(x);
    model_.residual(i, y, fit.size, local);
    return deform::second_derivatives(local, y, fit.frame);
  }

  Model model_;
  std::size_t points_;
};

}  // namespace deform
