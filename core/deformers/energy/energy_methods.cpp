// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/energy/energy_methods.h"

#include <string>

#include "core/base/number_text.h"
#include "core/deformers/energy/energy_estimate.h"
#include "core/deformers/energy/energy_system.h"
#include "core/deformers/energy/spaces/lattice_space.h"
#include "core/deformers/energy/spaces/mls.h"
#include "core/deformers/energy/spaces/model_lattice.h"
#include "core/deformers/energy/spaces/shell.h"
#include "core/deformers/energy/spaces/subspace.h"
#include "core/deformers/handles/handle_basis.h"
#include "core/deformers/option_checks.h"

namespace deform {

namespace {

constexpr double most_weight = 1e12;
constexpr double most_samples = 1e6;

void check_weights(Problems& problems, double stretching, double bending, const std::string& field) {
  check_option_range(problems, stretching, 0, most_weight, field + ".stretching");
  check_option_range(problems, bending, 0, most_weight, field + ".bending");
  problems.check(field, [&] {
    if (stretching == 0 && bending == 0) refuse_argument(field + ": stretching and bending must not both be 0");
  });
}

/// Under the names that setup files and messages have for them.
void check_energy(Problems& problems, const EnergyOptions& options, const std::string& field) {
  check_weights(problems, options.stretching, options.bending, field);
  problems.check(field + ".fixing", [&] {
    if (options.fixing > 0 && options.fixing <= most_weight) return;
    refuse_argument(field + ".fixing: " + number_digits(options.fixing) + " is out of range, must be over 0 and up to " +
                    number_digits(most_weight));
  });
  check_basis_tolerance(problems, options.basis_tolerance, field + ".basis_tolerance");
}

void check(Problems& problems, const ShellOptions& options, const Mesh&) {
  check_energy(problems, options, "method.shell.energy");
}

void check(Problems& problems, const SubspaceOptions& options, const Mesh&) {
  check_energy(problems, options, "method.subspace.energy");
  check_option_range(problems, static_cast<double>(options.centres), 4, 100000, "method.subspace.centres");
  if (options.cover != 0) check_option_range(problems, options.cover, 4, 1000, "method.subspace.cover");
  problems.check("method.subspace.kernel", [&] {
    if (!options.kernel) return;
    const KernelProperties kernel = properties(*options.kernel);
    if (kernel.has_shape && kernel.local_shape == 0) {
      refuse_argument(std::string("method.subspace.kernel: ") + kernel.name + " has a shape but does not decay");
    }
  });
}

void check(Problems& problems, const MlsOptions& options, const Mesh& mesh) {
  check_energy(problems, options, "method.mls.energy");
  check_option_range(problems, static_cast<double>(options.surface_samples), 0, most_samples, "method.mls.surface_samples");
  check_option_range(problems, static_cast<double>(options.volume_samples), 0, most_samples, "method.mls.volume_samples");
  check_option_range(problems, options.cubature, 1, 64, "method.mls.cubature");
  if (options.cover != 0) check_option_range(problems, options.cover, 5, 1000, "method.mls.cover");
  for (std::size_t i = 0; i < options.weights.size(); ++i) {
    const std::string field = "method.mls.weights[" + std::to_string(i) + "]";
    if (problems.concern(field)) continue;
    check_weights(problems, options.weights[i].stretching, options.weights[i].bending, field);
    problems.check(field, [&] {
      if (select(options.weights[i].region, mesh, field).empty()) refuse_argument(field + ": " + no_point_text(mesh));
    });
  }
}

void check(Problems& problems, const FfdOptions& options, const Mesh& mesh) {
  check_energy(problems, options, "method.ffd.energy");
  check_lattice(problems, options.lattice, mesh);
}

SharedMotions motions_of(const ShellOptions&) { return {Turns::of_shell}; }
SharedMotions motions_of(const SubspaceOptions& options) {
  const bool decays = options.kernel && properties(*options.kernel).has_shape;
  return {Turns::of_shell, decays && options.linear == SubspaceLinear::left_out};
}

/// Where all handles turned by 30 degrees, stretching missed up to 1e-3 D where its weight was that of bending, and in
/// proportion where it was another: less than that is not worth a warning.
bool is_stretched(double stretching, double bending) { return stretching > 0 && stretching >= bending; }
SharedMotions motions_of(const FfdOptions& options) {
  return {is_stretched(options.stretching, options.bending) ? Turns::stretched : Turns::followed};
}
SharedMotions motions_of(const MlsOptions& options) {
  bool stretched = is_stretched(options.stretching, options.bending);
  for (const auto& part : options.weights) stretched = stretched || is_stretched(part.stretching, part.bending);
  return {stretched ? Turns::stretched : Turns::followed};
}
/// As the models have it.
template <typename O>
constexpr bool may_crack = std::is_same_v<O, ShellOptions>;

EnergySpace space_of(const SubspaceOptions& options, const Mesh& mesh, std::uint64_t seed, const RunContext& context) {
  return shell_subspace(mesh, options, seed, context);
}
EnergySpace space_of(const MlsOptions& options, const Mesh& mesh, std::uint64_t seed, const RunContext& context) {
  return mls_space(mesh, options, seed, context);
}

}  // namespace

std::vector<OptionRegion> MlsMethod::regions(MlsOptions& options) {
  std::vector<OptionRegion> result;
  for (std::size_t i = 0; i < options.weights.size(); ++i) {
    result.push_back({"method.mls.weights[" + std::to_string(i) + "].region", &options.weights[i].region});
  }
  return result;
}

template <typename O>
void EnergyMethod<O>::validate(const O& options, const Setup&, const Mesh& mesh, Problems& problems) {
  check(problems, options, mesh);
}

template <typename O>
Estimate EnergyMethod<O>::estimate(const O& options, const Mesh& mesh, const Setup& setup, const SelectedRegions& regions,
                                   const RunContext& context) {
  return estimate_energy(options, mesh, setup, regions, context);
}

template <typename O>
std::shared_ptr<const System> EnergyMethod<O>::prepare(const O& options, const std::shared_ptr<const Mesh>& mesh,
                                                       const Setup& setup, const RunContext& context, std::size_t memory_budget) {
  const auto model = [&](const std::vector<RegionIndex>& region_of, double diagonal) {
    if constexpr (std::is_same_v<O, ShellOptions>) {
      EnergyModel result = shell_model(*mesh, region_of, options, diagonal, context);
      result.motions = motions_of(options);
      return result;
    } else if constexpr (std::is_same_v<O, FfdOptions>) {
      EnergyModel result = lattice_model(*mesh, options, region_of, context);
      result.motions = motions_of(options);
      return result;
    } else {
      EnergyModel result{space_of(options, *mesh, setup.seed, context), {}, false, {}};
      result.motions = motions_of(options);
      for (std::size_t i = 0; i < region_of.size(); ++i) {
        if (region_of[i] != deformable_region) result.held.push_back(static_cast<PointId>(i));
      }
      return result;
    }
  };
  return std::make_shared<const EnergySystem>(mesh, setup, options, model, context, memory_budget);
}

template <typename O>
BasisTraits EnergyMethod<O>::basis_traits(const O& options) {
  return {options.handles, UnitLength::diagonal, may_crack<O>, motions_of(options)};
}

template struct EnergyMethod<ShellOptions>;
template struct EnergyMethod<SubspaceOptions>;
template struct EnergyMethod<MlsOptions>;
template struct EnergyMethod<FfdOptions>;

}  // namespace deform
