// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/constraints/symmetric.h"

#include <utility>

#include "core/constraints/fitting.h"
#include "core/numerics/dense/decompositions.h"

namespace deform {

namespace {

class SymmetricProjection final : public Projection {
 public:
  explicit SymmetricProjection(std::vector<std::uint32_t> partner) : partner_(std::move(partner)) {}

  std::string_view kind() const override { return "symmetric"; }
  std::size_t point_count() const override { return partner_.size(); }

  double project(std::span<const Vec3> x, std::span<Vec3> out, ShapeParameters& shape) const override {
    const Plane plane = fitted(x);
    shape = {plane.point[0], plane.point[1], plane.point[2], plane.normal()[0], plane.normal()[1], plane.normal()[2]};
    double energy = 0;
    for (std::size_t i = 0; i < x.size(); ++i) {
      const Eigen::Vector3d away = residual(plane, i, x);
      out[i] = to_vec3(to_eigen(x[i]) - away);
      energy += away.squaredNorm();
    }
    return energy;
  }

  void derivative(std::span<const Vec3> x, const ShapeParameters&, std::span<const Vec3> dx, std::span<Vec3> out) const override {
    const Plane plane = fitted(x);
    const Eigen::Vector3d n = plane.normal();
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    for (std::size_t i = 0; i < x.size(); ++i) right += by_plane(plane, i, x).transpose() * to_eigen(dx[i]);
    // 1/2 sum t_i t_partner: the Hessian is diagonal in the turns towards the other eigenvectors and the shift.
    Eigen::Vector3d turn = Eigen::Vector3d::Zero();
    const double least = 1e-13 * plane.values.cwiseAbs().maxCoeff();
    for (int k = 0; k < 2; ++k) {
      const double gap = plane.values[k + 1] - plane.values[0];
      if (gap > least) turn[k] = right[k] / gap;
    }
    turn[2] = right[2] / static_cast<double>(x.size());
    for (std::size_t i = 0; i < x.size(); ++i) {
      const Eigen::Vector3d d = to_eigen(dx[i]), e = to_eigen(dx[partner_[i]]);
      const Eigen::Vector3d held = 0.5 * (d - (e - 2 * n.dot(e) * n));
      out[i] = to_vec3(d - held + by_plane(plane, i, x) * turn);
    }
  }

  Linearization linearize(std::span<const Vec3> x, const ShapeParameters&) const override {
    const Plane plane = fitted(x);
    Linearization result;
    result.rows_per_point = 3;
    result.normals.resize(3 * x.size());
    result.residual.resize(static_cast<Eigen::Index>(3 * x.size()));
    result.parameters.resize(result.residual.size(), 3);
    result.partners.resize(3 * x.size());
    result.partner_normals.resize(3 * x.size());
    const Eigen::Matrix3d image = Eigen::Matrix3d::Identity() - 2 * plane.normal() * plane.normal().transpose();
    for (std::size_t i = 0; i < x.size(); ++i) {
      for (std::size_t k = 0; k < 3; ++k) {
        result.normals[3 * i + k][k] = 0.5;
        result.partners[3 * i + k] = partner_[i];
        result.partner_normals[3 * i + k] = to_vec3(-0.5 * image.row(static_cast<Eigen::Index>(k)).transpose());
      }
      result.residual.segment<3>(static_cast<Eigen::Index>(3 * i)) = residual(plane, i, x);
      result.parameters.middleRows<3>(static_cast<Eigen::Index>(3 * i)) = by_plane(plane, i, x);
    }
    return result;
  }

 private:
  struct Plane {
    Eigen::Vector3d point;
    Eigen::Matrix3d axes;    ///< columns; the normal is the first
    Eigen::Vector3d values;  ///< eigenvalues, ascending
    Eigen::Vector3d normal() const { return axes.col(0); }
    double height(const Vec3& x) const { return axes.col(0).dot(to_eigen(x) - point); }
  };

  Plane fitted(std::span<const Vec3> x) const {
    Plane plane;
    plane.point = spread({x}).mean;
    Eigen::Matrix3d product = Eigen::Matrix3d::Zero();
    for (std::size_t i = 0; i < x.size(); ++i) {
      product.noalias() += (to_eigen(x[i]) - plane.point) * (to_eigen(x[partner_[i]]) - plane.point).transpose();
    }
    const SymmetricEigen<3> eigen = symmetric_eigen(Eigen::Matrix3d(0.5 * (product + product.transpose())));
    plane.axes = eigen.vectors;
    plane.values = eigen.values;
    return plane;
  }

  /// x_i - P_i = 1/2 (x_i - image of its partner)
  Eigen::Vector3d residual(const Plane& plane, std::size_t i, std::span<const Vec3> x) const {
    const Vec3& other = x[partner_[i]];
    return 0.5 * (to_eigen(x[i]) - to_eigen(other)) + plane.height(other) * plane.normal();
  }

  /// Its derivative when the normal turns towards the other axes and the plane moves along the normal.
  Eigen::Matrix3d by_plane(const Plane& plane, std::size_t i, std::span<const Vec3> x) const {
    const Eigen::Vector3d other = to_eigen(x[partner_[i]]) - plane.point;
    const Eigen::Vector3d n = plane.normal();
    Eigen::Matrix3d D;
    for (int k = 0; k < 2; ++k) {
      const Eigen::Vector3d e = plane.axes.col(k + 1);
      D.col(k) = e.dot(other) * n + n.dot(other) * e;
    }
    D.col(2) = -n;
    return D;
  }

  std::vector<std::uint32_t> partner_;
};

}  // namespace

std::unique_ptr<const Projection> symmetric_projection(std::vector<std::uint32_t> partner) {
  return std::make_unique<SymmetricProjection>(std::move(partner));
}

}  // namespace deform
