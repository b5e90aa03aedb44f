// SPDX-License-Identifier: Apache-2.0
// Registers a mesh, prepares a deformation, deforms once and looks at the result.
//   deform_once [HOST:PORT]
#include <cstdio>

#include "client/client.h"
#include "client/design.h"
#include "core/mesh/ahmed.h"

using namespace deform;

int main(int argc, char** argv) try {
  client::ClientOptions options;
  if (argc > 1) options.address = argv[1];
  client::Client client(options);

  // Any arrays will do; here a sample: the Ahmed body, with named groups of faces.
  const Mesh mesh = ahmed_body({25, 5000});
  client::GeometryArrays arrays{mesh.points, mesh.face_sizes, mesh.face_points, {}, "ahmed"};
  for (const auto& group : mesh.groups) arrays.groups.push_back({group.name, group.points, group.faces});
  const auto geometry = client.register_geometry(arrays);

  // Which points are moved, which stay, and by what number.
  v1::Setup setup;
  setup.set_geometry(geometry.id());
  auto& roof = *setup.add_handles();
  roof.set_name("roof");
  roof.mutable_region()->set_group("roof");
  setup.add_fixed()->set_group("underbody");
  auto& up = *setup.add_variables();
  up.set_name("roof_up");
  up.set_handle("roof");
  for (const double x : {0.0, 0.0, 1.0}) up.add_translate(x);
  const auto system = client.prepare(setup);  // once

  v1::DeformRequest request;  // as often as wanted
  request.set_system_id(system.id());
  request.mutable_output()->set_encoding(v1::RAW_F64);
  *request.add_designs() = client::variables_design(std::vector<double>{0.03});
  const auto outcome = client.deform(request);

  const Points& points = outcome.designs[0].points;  // n x 3, in the order of mesh.points
  std::printf("%zu points, box height %.3f -> %.3f\n", points.size(), bounding_box(mesh.points).max[2],
              bounding_box(points).max[2]);
  return 0;
} catch (const Error& error) {
  std::fprintf(stderr, "%s: %s\n", to_string(error.code()), error.what());
  return 1;
}
