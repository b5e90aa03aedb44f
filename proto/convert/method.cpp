// SPDX-License-Identifier: GPL-3.0-or-later
#include "proto/convert/method.h"

#include <cctype>
#include <optional>
#include <string>

#include "proto/convert/base/fields.h"
#include "proto/convert/mesh/region.h"

namespace deform::convert {

namespace {

constexpr std::uint32_t default_rings = 3;
constexpr int most_samples = 1000;
constexpr double incremental_tolerance = 1e-4;

/// Kernels have the same names on the wire and in the core, there in lower case.
std::optional<Kernel> kernel_named_as(std::string name) {
  for (char& c : name) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return kernel_named(name);
}

Kernel kernel_from_proto(v1::Kernel kernel) {
  if (kernel == v1::KERNEL_DEFAULT) return RbfOptions().kernel;
  if (const auto found = kernel_named_as(v1::Kernel_Name(kernel))) return *found;
  refuse_unknown("method.rbf.kernel", kernel);
}

/// None: moving least squares.
std::optional<Kernel> subspace_kernel(v1::SubspaceKernel kernel) {
  if (kernel == v1::SUBSPACE_DEFAULT || kernel == v1::SUBSPACE_MLS) return std::nullopt;
  const std::string name = v1::SubspaceKernel_Name(kernel), prefix = "SUBSPACE_";
  if (name.starts_with(prefix)) {
    if (const auto found = kernel_named_as(name.substr(prefix.size()))) return found;
  }
  refuse_unknown("method.subspace.kernel", kernel);
}

BasisMode basis_mode(v1::BasisMode mode, const std::string& path) {
  known(mode, path);
  return mode == v1::BASIS_ALWAYS ? BasisMode::always : mode == v1::BASIS_NEVER ? BasisMode::never : BasisMode::automatic;
}

RbfOptions rbf_options(const v1::RbfMethod& message) {
  RbfOptions options;
  options.kernel = kernel_from_proto(message.kernel());
  options.shape = message.shape();
  if (message.has_polynomial_degree())
    options.polynomial_degree = fitting_int(message.polynomial_degree(), "method.rbf.polynomial_degree");
  switch (message.solver()) {
    case v1::SOLVER_AUTOMATIC:
      options.solver = Solver::automatic;
      break;
    case v1::CHOLESKY:
      options.solver = Solver::cholesky;
      break;
    case v1::LDLT:
    case v1::LU:
      options.solver = Solver::ldlt;
      break;
    case v1::ITERATIVE:
      options.solver = Solver::iterative;
      break;
    case v1::INCREMENTAL_QR:
      options.solver = Solver::incremental_qr;
      options.tolerance = incremental_tolerance;
      break;
    default:
      refuse_unknown("method.rbf.solver", message.solver());
  }
  if (message.tolerance() != 0) options.tolerance = message.tolerance();
  options.centre_order =
      known(message.centre_order(), "method.rbf.centre_order") == v1::GREEDY ? CentreOrder::greedy : CentreOrder::farthest_point;
  if (message.samples_size() > most_samples) {
    refuse_field("method.rbf.samples",
                 std::to_string(message.samples_size()) + " entries are more than the limit of " + std::to_string(most_samples));
  }
  for (const auto& sample : message.samples()) {
    options.samples.emplace_back(sample.variables().begin(), sample.variables().end());
  }
  options.reduction =
      known(message.reduction(), "method.rbf.reduction") == v1::REDUCTION_OFF ? CentreReduction::off : CentreReduction::automatic;
  if (message.reduction_rings() != 0)
    options.reduction_rings = fitting_int(message.reduction_rings(), "method.rbf.reduction_rings");
  options.basis = basis_mode(message.basis(), "method.rbf.basis");
  return options;
}

/// ShellOptions, SubspaceOptions or MlsOptions.
template <typename Options>
void take_energy(const v1::Energy& message, const std::string& path, Options& options) {
  options.stretching = finite(message.stretching(), path + ".stretching");
  if (message.has_bending()) options.bending = finite(message.bending(), path + ".bending");
  options.handles = known(message.handles(), path + ".handles") == v1::HANDLES_SOFT ? HandleMode::soft : HandleMode::hard;
  if (message.fixing() != 0) options.fixing = finite(message.fixing(), path + ".fixing");
  options.basis = basis_mode(message.basis(), path + ".basis");
}

ShellOptions shell_options(const v1::ShellMethod& message) {
  ShellOptions options;
  take_energy(message.energy(), "method.shell.energy", options);
  return options;
}

/// Kernels that decay need more than moving least squares (thesis 8.3.2).
double default_cover(v1::SubspaceKernel message) {
  const std::optional<Kernel> kernel = subspace_kernel(message);
  return kernel && properties(*kernel).local_shape > 0 ? 50 : SubspaceOptions().cover;
}

SubspaceOptions subspace_options(const v1::SubspaceMethod& message) {
  SubspaceOptions options;
  take_energy(message.energy(), "method.subspace.energy", options);
  options.kernel = subspace_kernel(message.kernel());
  if (message.centres() != 0) options.centres = message.centres();
  options.cover = message.cover() == 0 ? default_cover(message.kernel()) : message.cover();
  return options;
}

MlsOptions mls_options(const v1::MlsMethod& message) {
  MlsOptions options;
  take_energy(message.energy(), "method.mls.energy", options);
  options.surface_samples = message.surface_samples();
  options.volume_samples = message.volume_samples();
  if (message.cubature() != 0) options.cubature = message.cubature();
  if (message.cover() != 0) options.cover = message.cover();
  for (int i = 0; i < message.weights_size(); ++i) {
    const auto& weights = message.weights(i);
    const std::string path = "method.mls.weights[" + std::to_string(i) + "]";
    if (!weights.has_region()) refuse_field(path + ".region", "is missing");
    options.weights.push_back({region_from_proto(weights.region(), path + ".region"),
                               finite(weights.stretching(), path + ".stretching"), finite(weights.bending(), path + ".bending")});
  }
  return options;
}

void canonicalize_rbf(v1::RbfMethod& rbf) {
  const KernelProperties kernel = properties(kernel_from_proto(rbf.kernel()));
  if (rbf.kernel() == v1::KERNEL_DEFAULT) rbf.set_kernel(v1::TRIHARMONIC);
  if (!kernel.has_shape || rbf.shape() == 0) rbf.set_shape(0);  // ignored by the others: one value for all
  const bool incremental = rbf.solver() == v1::INCREMENTAL_QR;
  const bool may_iterate = rbf.solver() == v1::ITERATIVE || rbf.solver() == v1::SOLVER_AUTOMATIC;
  if (rbf.tolerance() == 0) rbf.set_tolerance(incremental ? incremental_tolerance : RbfOptions().tolerance);
  if (!may_iterate && !incremental) rbf.set_tolerance(0);
  if (!incremental) rbf.clear_samples();
  rbf.set_centre_order(incremental && rbf.centre_order() == v1::GREEDY ? v1::GREEDY : v1::CENTRE_ORDER_DEFAULT);
  if (!rbf.has_polynomial_degree()) rbf.set_polynomial_degree(static_cast<std::uint32_t>(kernel.default_degree()));
  if (rbf.reduction() == v1::REDUCTION_OFF || rbf.reduction_rings() == 0) rbf.set_reduction_rings(default_rings);
}

void canonicalize_energy(v1::Energy& energy) {
  if (!energy.has_bending()) energy.set_bending(ShellOptions().bending);
  if (energy.handles() != v1::HANDLES_SOFT) {
    energy.set_handles(v1::HANDLES_HARD);
    energy.set_fixing(0);  // ignored
  } else if (energy.fixing() == 0) {
    energy.set_fixing(ShellOptions().fixing);
  }
}

void canonicalize_subspace(v1::SubspaceMethod& subspace) {
  const SubspaceOptions defaults;
  canonicalize_energy(*subspace.mutable_energy());
  if (subspace.kernel() == v1::SUBSPACE_DEFAULT) subspace.set_kernel(v1::SUBSPACE_MLS);
  if (subspace.centres() == 0) subspace.set_centres(static_cast<std::uint32_t>(defaults.centres));
  const std::optional<Kernel> kernel = subspace_kernel(subspace.kernel());
  if (kernel && !properties(*kernel).has_shape) {
    subspace.set_cover(0);
  } else if (subspace.cover() == 0) {
    subspace.set_cover(default_cover(subspace.kernel()));
  }
}

void canonicalize_mls(v1::MlsMethod& mls) {
  const MlsOptions defaults;
  canonicalize_energy(*mls.mutable_energy());
  if (mls.cubature() == 0) mls.set_cubature(defaults.cubature);
  if (mls.cover() == 0) mls.set_cover(defaults.cover);
  for (auto& weights : *mls.mutable_weights()) canonicalize_region(*weights.mutable_region());
}

}  // namespace

decltype(Setup::method) method_from_proto(const v1::Method& message) {
  switch (message.kind_case()) {
    case v1::Method::kShell:
      return shell_options(message.shell());
    case v1::Method::kSubspace:
      return subspace_options(message.subspace());
    case v1::Method::kMls:
      return mls_options(message.mls());
    case v1::Method::kRbf:
    case v1::Method::KIND_NOT_SET:
      break;
  }
  return rbf_options(message.rbf());
}

void canonicalize_method(v1::Method& message) {
  switch (message.kind_case()) {
    case v1::Method::kShell:
      return canonicalize_energy(*message.mutable_shell()->mutable_energy());
    case v1::Method::kSubspace:
      return canonicalize_subspace(*message.mutable_subspace());
    case v1::Method::kMls:
      return canonicalize_mls(*message.mutable_mls());
    case v1::Method::kRbf:
    case v1::Method::KIND_NOT_SET:
      break;
  }
  canonicalize_rbf(*message.mutable_rbf());
}

}  // namespace deform::convert
