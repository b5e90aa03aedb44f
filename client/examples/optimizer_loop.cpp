// SPDX-License-Identifier: Apache-2.0
// An evolution strategy over a pipelined session: whole generations are submitted, answers come as they get done.
// Finds roof and slant positions that give the Ahmed body 2 % more volume with the smallest motion.
//   optimizer_loop [HOST:PORT]
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <future>
#include <random>

#include "client/client.h"
#include "client/design.h"
#include "core/mesh/ahmed.h"

using namespace deform;

namespace {

double volume(const Mesh& mesh, const Points& p) {  // of a closed triangle mesh
  double six_times = 0;
  for (std::size_t i = 0; i < mesh.face_points.size(); i += 3) {
    const Vec3 &a = p[mesh.face_points[i]], &b = p[mesh.face_points[i + 1]], &c = p[mesh.face_points[i + 2]];
    six_times += a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0]);
  }
  return six_times / 6;
}

void add_variable(v1::Setup& setup, const std::string& handle, const Vec3& direction) {
  auto& variable = *setup.add_variables();
  variable.set_name(handle + "_shift");
  variable.set_handle(handle);
  variable.mutable_translate()->Add(direction.begin(), direction.end());
  variable.set_lower(-0.05);
  variable.set_upper(0.05);
}

v1::Setup make_setup(const std::string& geometry_id) {
  v1::Setup setup;
  setup.set_geometry(geometry_id);
  auto& roof = *setup.add_handles();
  roof.set_name("roof");
  auto& above = *roof.mutable_region()->mutable_half_space();
  for (const double x : {0.0, 0.0, 0.33}) above.add_point(x);
  for (const double x : {0.0, 0.0, 1.0}) above.add_normal(x);
  auto& base = *setup.add_handles();
  base.set_name("base");
  base.mutable_region()->set_group("base");
  setup.add_fixed()->set_group("stilts");
  add_variable(setup, "roof", {0, 0, 1});
  add_variable(setup, "base", {1, 0, 0});
  return setup;
}

}  // namespace

int main(int argc, char** argv) try {
  client::ClientOptions options;
  if (argc > 1) options.address = argv[1];
  client::Client client(options);
  const Mesh mesh = ahmed_body({25, 3000});
  client::GeometryArrays arrays{mesh.points, mesh.face_sizes, mesh.face_points, {}, "ahmed"};
  for (const auto& group : mesh.groups) arrays.groups.push_back({group.name, group.points, group.faces});
  const auto system = client.prepare(make_setup(client.register_geometry(arrays).id()));
  const double wanted = 1.02 * volume(mesh, mesh.points);
  const auto cost = [&](const std::vector<double>& x, const Points& points) {
    const double miss = (volume(mesh, points) - wanted) / wanted;
    return 1e4 * miss * miss + x[0] * x[0] + x[1] * x[1];
  };

  std::mt19937_64 random(1);
  std::normal_distribution<double> normal;
  std::vector<double> best(2, 0.0);
  double best_cost = cost(best, mesh.points), step = 0.01;
  const auto session = client.open_session();
  for (int generation = 0; generation < 15; ++generation) {
    std::vector<std::vector<double>> population;
    std::vector<std::future<client::DeformOutcome>> answers;
    for (int k = 0; k < 10; ++k) {
      std::vector<double> x = best;
      for (double& value : x) value = std::clamp(value + step * normal(random), -0.05, 0.05);
      v1::DeformRequest request;
      request.set_system_id(system.id());
      request.set_failures(v1::FAILURES_PER_DESIGN);  // a bad candidate is no reason to end
      *request.add_designs() = client::variables_design(x);
      answers.push_back(session->submit(request));
      population.push_back(std::move(x));
    }
    bool better = false;
    for (std::size_t k = 0; k < population.size(); ++k) {
      const client::DeformedDesign design = std::move(answers[k].get().designs[0]);
      const double value = design.error ? HUGE_VAL : cost(population[k], design.points);
      if (value >= best_cost) continue;
      best_cost = value;
      best = population[k];
      better = true;
    }
    step *= better ? 1.3 : 0.6;
    std::printf("generation %2d  cost %.6f  roof %+.4f  base %+.4f\n", generation, best_cost, best[0], best[1]);
  }
  session->finish();
  const bool reached = best_cost < 0.01;  // it began at 4
  std::puts(reached ? "reached 2 % more volume" : "not reached");
  return reached ? 0 : 1;
} catch (const Error& error) {
  std::fprintf(stderr, "%s: %s\n", to_string(error.code()), error.what());
  return 1;
}
