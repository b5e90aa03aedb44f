// SPDX-License-Identifier: Apache-2.0
// Reads a mesh file, deforms the mesh on a server, does the same without it and writes the file with its new coordinates:
//   deform_file HOST:PORT IN OUT GROUP_THAT_RISES GROUP_THAT_STAYS HEIGHT
#include <deform/base/version.h>
#include <deform/client.h>
#include <deform/compiled/deformation.h>
#include <deform/compiled/reader.h>
#include <deform/design.h>
#include <deform/io/mesh_file.h>
#include <deform/measures/integrals.h>
#include <deform/quality/displacement.h>

#include <cstdio>
#include <cstdlib>

int main(int argc, char** argv) try {
  if (argc != 7) return 2;
  const auto file = deform::io::read_mesh_file(argv[2]);
  const deform::Mesh& mesh = *file->mesh();

  deform::client::ClientOptions options;
  options.address = argv[1];
  deform::client::Client client(options);
  deform::client::GeometryArrays arrays{mesh.points, mesh.face_sizes, mesh.face_points, {}, argv[2]};
  for (const auto& group : mesh.groups) arrays.groups.push_back({group.name, group.points, group.faces});
  const auto geometry = client.register_geometry(arrays);

  deform::v1::Setup setup;
  setup.set_geometry(geometry.id());
  auto& handle = *setup.add_handles();
  handle.set_name("rising");
  handle.mutable_region()->set_group(argv[4]);
  setup.add_fixed()->set_group(argv[5]);
  auto& rise = *setup.add_variables();
  rise.set_name("rise");
  rise.set_handle("rising");
  for (const double x : {0.0, 0.0, 1.0}) rise.add_translate(x);
  const auto system = client.prepare(setup);

  deform::v1::DeformRequest request;
  request.set_system_id(system.id());
  *request.add_designs() = deform::client::variables_design(std::vector<double>{std::atof(argv[6])});
  const auto outcome = client.deform(request);
  const deform::Points& points = outcome.designs.at(0).points;

  std::vector<std::byte> basis;
  client.get_basis(system.id(),
                   [&](std::span<const std::byte> records) { basis.insert(basis.end(), records.begin(), records.end()); });
  const deform::compiled::Deformation deformation(deform::compiled::read_content(basis));
  deform::Points same(points.size());
  deformation.evaluate(std::vector<double>{std::atof(argv[6])}, std::span(same[0].data(), 3 * same.size()));
  const double apart = deform::largest_displacement(same, points).value;
  if (apart > 1e-13) {
    std::fprintf(stderr, "the compiled deformation is %g off\n", apart);
    return 1;
  }

  using namespace deform::measures;
  const auto volume = make_volume(mesh, {}, Rims::refuse);
  const double grown =
      volume->evaluate(points, Gradients::left_out).values[0] - volume->evaluate(mesh.points, Gradients::left_out).values[0];
  if (!(grown > 0)) {
    std::fprintf(stderr, "the volume did not grow: %g\n", grown);
    return 1;
  }

  deform::io::write_mesh_file(*file, points, argv[3]);
  std::printf("deform %s: %zu points, the largest displacement is %.3f\n", deform::version(), points.size(),
              deform::largest_displacement(points, mesh.points).value);
  return 0;
} catch (const deform::Error& error) {
  std::fprintf(stderr, "%s: %s\n", deform::to_string(error.code()), error.what());
  return 1;
}
