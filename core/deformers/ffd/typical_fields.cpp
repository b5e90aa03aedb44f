// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/ffd/typical_fields.h"

#include <algorithm>
#include <array>
#include <cstddef>

#include "core/base/vectors.h"

namespace deform {

namespace {

constexpr double new_direction = 1e-9;  // of a column: what is left of it without those before

/// FieldColumns, and orthonormal ones with the same span.
class FieldColumns {
 public:
  void add(const Eigen::VectorXd& column) {
    columns_.push_back(column);
    const Eigen::VectorXd rest = without_span(column);
    if (rest.norm() > new_direction * column.norm()) span_.push_back(rest.normalized());
  }
  /// Adds what the span does not contain.
  void add_rest(const Eigen::VectorXd& column) {
    const Eigen::VectorXd rest = without_span(column);
    if (rest.norm() <= new_direction * column.norm()) return;
    columns_.push_back(rest);
    span_.push_back(rest.normalized());
  }
  const std::vector<Eigen::VectorXd>& columns() const { return columns_; }

 private:
  /// Twice is enough (Parlett, The Symmetric Eigenvalue Problem, 6.9).
  Eigen::VectorXd without_span(Eigen::VectorXd column) const {
    for (int pass = 0; pass < 2; ++pass) {
      for (const Eigen::VectorXd& q : span_) column -= q.dot(column) * q;
    }
    return column;
  }

  std::vector<Eigen::VectorXd> columns_, span_;
};

/// The handles of one group and their held points, as positions in `ids`.
struct DrivenGroup {
  std::vector<std::size_t> handles;
  std::vector<std::size_t> points;
};

std::vector<DrivenGroup> driven_groups_of(const HeldHandles& of) {
  const std::vector<std::size_t> group_of = driven_groups(of.setup);
  std::vector<DrivenGroup> groups(group_of.empty() ? 0 : *std::max_element(group_of.begin(), group_of.end()) + 1);
  for (std::size_t h = 0; h < group_of.size(); ++h) groups[group_of[h]].handles.push_back(h);
  for (std::size_t j = 0; j < of.ids.size(); ++j) {
    const RegionIndex region = of.region_of[of.ids[j]];
    if (region != fixed_region) groups[group_of[region]].points.push_back(j);
  }
  return groups;
}

HandleFrame group_frame(const HeldHandles& of, const DrivenGroup& group) {
  if (group.handles.size() == 1) return of.frames[group.handles[0]];
  Box extent;
  for (const std::size_t j : group.points) extent.add(of.box.to_unit(of.mesh.points[of.ids[j]]));
  return {0.5 * (extent.min + extent.max)};
}

void add_fields(const HeldHandles& of, const DrivenGroup& group, FieldColumns& columns) {
  const HandleFrame frame = group_frame(of, group);
  std::array<Eigen::VectorXd, 4> fields;
  for (auto& field : fields) field = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(of.ids.size()));
  for (const std::size_t j : group.points) {
    const Vec3 x = of.box.to_unit(of.mesh.points[of.ids[j]]) - frame.reference;
    fields[0][static_cast<Eigen::Index>(j)] = 1;
    for (std::size_t k = 0; k < 3; ++k) fields[k + 1][static_cast<Eigen::Index>(j)] = dot(frame.axes[k], x);
  }
  for (const auto& field : fields) columns.add(field);
}

Vec3 linear_part(const Affine& map, const Vec3& v) { return transformed(map, v) - Vec3{map[3], map[7], map[11]}; }

/// Components of height 1 of the rates of a variable at rest, and of their own rates.
void add_rates(const HeldHandles& of, const DrivenGroup& group, std::size_t variable, FieldColumns& columns) {
  const std::vector<double> rest(of.setup.variables.size(), 0.0);
  const std::vector<Affine> rates = handle_motion_derivative(of.setup, rest, variable);
  const auto m = static_cast<Eigen::Index>(of.ids.size());
  Eigen::MatrixXd values = Eigen::MatrixXd::Zero(m, 6);
  for (const std::size_t j : group.points) {
    const PointId id = of.ids[j];
    const Affine& rate = rates[of.region_of[id]];
    const Vec3 u = transformed(rate, of.mesh.points[id]), turned = linear_part(rate, u);
    for (std::size_t k = 0; k < 3; ++k) {
      values(static_cast<Eigen::Index>(j), static_cast<Eigen::Index>(k)) = u[k];
      values(static_cast<Eigen::Index>(j), static_cast<Eigen::Index>(3 + k)) = turned[k];
    }
  }
  for (Eigen::Index c = 0; c < values.cols(); ++c) {
    const double height = values.col(c).cwiseAbs().maxCoeff();
    if (height > 0) columns.add_rest(values.col(c) / height);
  }
}

bool moves_handle(const DesignVariable& variable, const std::string& handle) {
  return variable.handle == handle ||
         std::any_of(variable.also.begin(), variable.also.end(), [&](const auto& also) { return also.handle == handle; });
}

}  // namespace

Eigen::MatrixXd typical_fields(const HeldHandles& of) {
  std::vector<Eigen::VectorXd> all;
  for (const DrivenGroup& group : driven_groups_of(of)) {
    FieldColumns columns;
    add_fields(of, group, columns);
    for (std::size_t k = 0; k < of.setup.variables.size() && group.handles.size() > 1; ++k) {
      if (moves_handle(of.setup.variables[k], of.setup.handles[group.handles[0]].name)) add_rates(of, group, k, columns);
    }
    all.insert(all.end(), columns.columns().begin(), columns.columns().end());
  }
  Eigen::MatrixXd result(static_cast<Eigen::Index>(of.ids.size()), static_cast<Eigen::Index>(all.size()));
  for (std::size_t c = 0; c < all.size(); ++c) result.col(static_cast<Eigen::Index>(c)) = all[c];
  return result;
}

}  // namespace deform
