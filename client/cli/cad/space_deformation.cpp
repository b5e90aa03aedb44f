// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/cad/space_deformation.h"

#include <algorithm>

#include "client/cli/output/gates.h"
#include "client/cli/setup/reading.h"
#include "client/design.h"
#include "core/base/vectors.h"
#include "core/mesh/region.h"
#include "proto/convert/mesh/region.h"

namespace deform::cli {

namespace {

constexpr std::size_t most_compared = 20'000;  ///< points of the mesh

}  // namespace

void check_space_method(const v1::Setup& setup) {
  if (!setup.method().has_shell()) return;
  refuse(
      "method.shell: it moves the surface of the mesh and no other point of space, so the CAD model does not follow; choose rbf, "
      "ffd, cage, mls or subspace");
}

SpaceDeformation::SpaceDeformation(Connection& connection, const PreparedSetup& prepared, const std::vector<double>& values)
    : connection_(connection) {
  check_space_method(prepared.system.setup());
  header_.set_system_id(prepared.system.id());
  *header_.mutable_design() = client::variables_design(values);
  header_.mutable_output()->set_encoding(v1::RAW_F64);
  compare(prepared);
}

void SpaceDeformation::compare(const PreparedSetup& prepared) {
  v1::DeformRequest request;
  request.set_system_id(header_.system_id());
  *request.mutable_output() = header_.output();
  request.set_check(v1::CELL_CHECK_OFF);
  *request.add_designs() = header_.design();
  client::DeformOutcome outcome = connection_.client().deform(request, connection_.call());
  result_ = outcome.designs.at(0).result;
  const std::vector<std::string> reasons = bad_reasons(result_);
  if (!reasons.empty()) throw Error(ErrorCode::failed_precondition, "the design is bad: " + reasons.front());
  moved_mesh_ = std::move(outcome.designs.at(0).points);
  const Points& rest = source_of(prepared).mesh()->points;
  Points some, expected;
  const std::size_t stride = rest.size() / most_compared + 1;
  for (std::size_t i = 0; i < rest.size(); i += stride) some.push_back(rest[i]), expected.push_back(moved_mesh_.at(i));
  const Points found = (*this)(some);
  for (std::size_t i = 0; i < some.size(); ++i) difference_ = std::max(difference_, distance(found[i], expected[i]));
  still_ = 0;
}

cad::MeshMotion SpaceDeformation::mesh_motion(const PreparedSetup& prepared) const {
  const Mesh& mesh = *source_of(prepared).mesh();
  cad::MeshMotion motion{mesh.points, moved_mesh_, select(Region{Region::Boundary{}}, mesh, "the boundary of the mesh"), {}};
  const v1::Setup& setup = prepared.system.setup();
  for (int i = 0; i < setup.constraints_size() && i < result_.constraints().residuals_size(); ++i) {
    const v1::Constraint& constraint = setup.constraints(i);
    if (!constraint.has_planar() && !constraint.has_cylindrical() && !constraint.has_conical() && !constraint.has_spherical())
      continue;
    const std::string what = "constraints[" + std::to_string(i) + "].regions[0]";
    motion.kept.push_back({select(convert::region_from_proto(constraint.regions(0), what), mesh, what),
                           result_.constraints().residuals(i).largest()});
  }
  return motion;
}

Points SpaceDeformation::operator()(std::span<const Vec3> points) {
  Points moved(points.size());
  const v1::EvaluateResult result = connection_.client().evaluate(header_, points, moved, connection_.call());
  if (!result.converged())
    throw Error(ErrorCode::failed_precondition, "the design is bad: the solver did not reach its tolerance");
  still_ += result.still();
  return moved;
}

}  // namespace deform::cli
