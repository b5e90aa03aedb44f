#include "core/deformers/system.h"

#include "core/base/error.h"
#include "core/base/parallel.h"
#include "core/deformers/energy/energy_system.h"
#include "core/deformers/rbf/rbf_system.h"

namespace deform {

namespace {

constexpr std::size_t points_per_task = 8192;
constexpr std::size_t designs_per_pass = 16;  // as many as keep a tile's results in the first-level cache

std::string gibibytes(std::size_t bytes) {
  const std::size_t tenths = (bytes * 10 + (std::size_t{1} << 30) - 1) >> 30;
  return std::to_string(tenths / 10) + "." + std::to_string(tenths % 10) + " GiB";
}

}  // namespace

std::unique_ptr<const Evaluation> System::bind_sequence(std::span<const Design> designs, EvaluationPath path, WarmStart&,
                                                        const RunContext& context) const {
  return bind(designs, path, context);
}

Points System::evaluate(const Design& design, const RunContext& context) const {
  return std::move(evaluate(std::span<const Design>(&design, 1), EvaluationPath::automatic, context).front());
}

std::vector<Points> System::evaluate(std::span<const Design> designs, EvaluationPath path, const RunContext& context) const {
  const std::unique_ptr<const Evaluation> evaluation = bind(designs, path, context);
  std::vector<Points> result(designs.size(), Points(info().points));
  for (std::size_t first = 0; first < designs.size(); first += designs_per_pass) {
    const std::size_t count = std::min(designs_per_pass, designs.size() - first);
    parallel_for(context, info().points, points_per_task, [&](std::size_t begin, std::size_t end) {
      std::vector<Vec3*> out(count);
      for (std::size_t k = 0; k < count; ++k) out[k] = result[first + k].data() + begin;
      evaluation->evaluate(begin, end, first, out);
    });
  }
  return result;
}

Estimate estimate(const Mesh& mesh, const Setup& setup) {
  return std::holds_alternative<RbfOptions>(setup.method) ? estimate_rbf(mesh, setup) : estimate_energy(mesh, setup);
}

std::shared_ptr<const System> prepare(std::shared_ptr<const Mesh> mesh, const Setup& setup, const RunContext& context,
                                      std::size_t memory_budget) {
  if (memory_budget != 0) {
    const Estimate expected = estimate(*mesh, setup);
    if (expected.peak_bytes > memory_budget) {
      const std::string constraints = setup.constraints.empty() ? "" : ", smaller regions of constraints";
      const bool rbf = std::holds_alternative<RbfOptions>(setup.method);
      throw Error(
          ErrorCode::out_of_budget,
          "preparing needs up to " + gibibytes(expected.peak_bytes) + " (" + std::to_string(expected.centres) +
              (rbf ? " centres: factor " : " centres or held points: factor ") + gibibytes(expected.factor_bytes) + ", basis " +
              gibibytes(expected.basis_bytes) + "), available are " + gibibytes(memory_budget) +
              (rbf ? "; use solver ITERATIVE, smaller handle and fixed regions, fewer handles or basis BASIS_NEVER"
                   : "; use a larger fixed region, fewer samples, fewer handles" + constraints + " or basis BASIS_NEVER"));
    }
  }
  if (!std::holds_alternative<RbfOptions>(setup.method)) {
    return std::make_shared<const EnergySystem>(std::move(mesh), setup, context, memory_budget);
  }
  return std::make_shared<const RbfSystem>(std::move(mesh), setup, context, memory_budget);
}

}  // namespace deform
