// SPDX-License-Identifier: GPL-3.0-or-later
#include "proto/convert/method.h"

#include <optional>
#include <string>

#include "core/base/error.h"
#include "proto/convert/base/fields.h"
#include "proto/convert/controls/controls.h"
#include "proto/convert/mesh/region.h"
#include "proto/convert/method_traits.h"

namespace deform::convert {

namespace {

constexpr std::uint32_t default_rings = 3;
constexpr int most_samples = 1000;

/// None: the default of the mesh.
std::optional<Kernel> kernel_from_proto(v1::Kernel kernel) {
  if (kernel == v1::KERNEL_DEFAULT) return std::nullopt;
  if (const auto found = kernel_named_as(v1::Kernel_Name(kernel))) return found;
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

/// Setups were stored with REDUCTION_AUTOMATIC and rings when rings were the default.
CentreReduction centre_reduction(const v1::RbfMethod& message) {
  switch (known(message.reduction(), "method.rbf.reduction")) {
    case v1::REDUCTION_OFF:
      return CentreReduction::off;
    case v1::REDUCTION_RINGS:
      return CentreReduction::rings;
    case v1::REDUCTION_TOLERANCE:
      return CentreReduction::tolerance;
    default:
      return message.reduction_rings() != 0 ? CentreReduction::rings : CentreReduction::tolerance;
  }
}

BasisMode basis_mode(v1::BasisMode mode, const std::string& path) {
  known(mode, path);
  return mode == v1::BASIS_ALWAYS ? BasisMode::always : mode == v1::BASIS_NEVER ? BasisMode::never : BasisMode::automatic;
}

/// How setups were stored before there was `automatic_shape`: without it, but with what else has a default.
bool stored_without_shape_rule(const v1::RbfMethod& message) {
  return message.automatic_shape() == v1::AUTOMATIC_SHAPE_DEFAULT && message.has_polynomial_degree() &&
         (message.reduction_rings() != 0 || message.reduction_tolerance() != 0);
}

ShapeRule shape_rule(const v1::RbfMethod& message) {
  const bool median =
      known(message.automatic_shape(), "method.rbf.automatic_shape") == v1::SHAPE_OF_MEDIAN || stored_without_shape_rule(message);
  return median ? ShapeRule::median : ShapeRule::densest;
}

Solver solver_from_proto(v1::Solver solver) {
  switch (solver) {
    case v1::SOLVER_AUTOMATIC:
      return Solver::automatic;
    case v1::CHOLESKY:
      return Solver::cholesky;
    case v1::LDLT:
    case v1::LU:
      return Solver::ldlt;
    case v1::ITERATIVE:
      return Solver::iterative;
    case v1::INCREMENTAL_QR:
      return Solver::incremental_qr;
    default:
      refuse_unknown("method.rbf.solver", solver);
  }
}

void take_samples(const v1::RbfMethod& message, RbfOptions& options) {
  if (message.samples_size() > most_samples) {
    refuse_field("method.rbf.samples",
                 std::to_string(message.samples_size()) + " entries are more than the limit of " + std::to_string(most_samples));
  }
  for (const auto& sample : message.samples()) {
    options.samples.emplace_back(sample.variables().begin(), sample.variables().end());
  }
}

// Options that cannot be converted keep their defaults.

RbfOptions rbf_options(const v1::RbfMethod& message, Problems& problems) {
  const std::string path = "method.rbf.";
  RbfOptions options;
  problems.check(path + "kernel", [&] { options.kernel = kernel_from_proto(message.kernel()); });
  options.shape = message.shape();
  problems.check(path + "automatic_shape", [&] { options.shape_rule = shape_rule(message); });
  problems.check(path + "polynomial_degree", [&] {
    if (message.has_polynomial_degree())
      options.polynomial_degree = fitting_int(message.polynomial_degree(), path + "polynomial_degree");
  });
  problems.check(path + "solver", [&] { options.solver = solver_from_proto(message.solver()); });
  options.tolerance = message.tolerance() != 0 ? message.tolerance() : default_tolerance(options.solver);
  problems.check(path + "centre_order", [&] {
    const bool greedy = known(message.centre_order(), path + "centre_order") == v1::GREEDY;
    options.centre_order = greedy ? CentreOrder::greedy : CentreOrder::farthest_point;
  });
  problems.check(path + "samples", [&] { take_samples(message, options); });
  problems.check(path + "reduction", [&] { options.reduction = centre_reduction(message); });
  problems.check(path + "reduction_rings", [&] {
    if (message.reduction_rings() != 0)
      options.reduction_rings = fitting_int(message.reduction_rings(), path + "reduction_rings");
  });
  options.reduction_tolerance = message.reduction_tolerance();
  problems.check(path + "basis", [&] { options.basis = basis_mode(message.basis(), path + "basis"); });
  problems.check(path + "basis_tolerance",
                 [&] { options.basis_tolerance = finite(message.basis_tolerance(), path + "basis_tolerance"); });
  return options;
}

/// ShellOptions, SubspaceOptions, MlsOptions or FfdOptions.
template <typename Options>
void take_energy(const v1::Energy& message, const std::string& path, Options& options, Problems& problems) {
  const auto take = [&](const char* name, const auto& conversion) {
    const std::string field = path + "." + name;
    problems.check(field, [&] { conversion(field); });
  };
  take("stretching", [&](const std::string& field) { options.stretching = finite(message.stretching(), field); });
  take("bending", [&](const std::string& field) {
    if (message.has_bending()) options.bending = finite(message.bending(), field);
  });
  take("handles", [&](const std::string& field) {
    options.handles = known(message.handles(), field) == v1::HANDLES_SOFT ? HandleMode::soft : HandleMode::hard;
  });
  take("fixing", [&](const std::string& field) {
    if (message.fixing() != 0) options.fixing = finite(message.fixing(), field);
  });
  take("basis", [&](const std::string& field) { options.basis = basis_mode(message.basis(), field); });
  take("basis_tolerance", [&](const std::string& field) { options.basis_tolerance = finite(message.basis_tolerance(), field); });
}

/// How setups were stored before there was `misfit`: without it, but with what else has a default.
bool stored_without_misfit(const v1::Energy& energy) {
  return energy.misfit() == v1::MISFIT_DEFAULT && energy.has_bending() && energy.handles() != v1::HANDLES_DEFAULT;
}
bool stored_without_misfit(const v1::SubspaceMethod& message) {
  return stored_without_misfit(message.energy()) && message.kernel() != v1::SUBSPACE_DEFAULT && message.centres() != 0;
}
bool stored_without_misfit(const v1::MlsMethod& message) {
  return stored_without_misfit(message.energy()) && message.cubature() != 0 && message.cover() != 0;
}
bool stored_without_misfit(const v1::FfdMethod& message) {
  return stored_without_misfit(message.energy()) && message.control() != v1::FFD_CONTROL_DEFAULT &&
         message.lattice().basis() != v1::LATTICE_BASIS_DEFAULT;
}

/// SubspaceMethod, MlsMethod or FfdMethod.
template <typename Message>
MisfitRule misfit_rule(const Message& message, const std::string& path) {
  const bool centres =
      known(message.energy().misfit(), path + ".misfit") == v1::MISFIT_AT_CENTRES || stored_without_misfit(message);
  return centres ? MisfitRule::centres : MisfitRule::joins;
}

ShellOptions shell_options(const v1::ShellMethod& message, Problems& problems) {
  const std::string path = "method.shell.energy";
  ShellOptions options;
  take_energy(message.energy(), path, options, problems);
  problems.check(path + ".misfit", [&] { known(message.energy().misfit(), path + ".misfit"); });
  return options;
}

/// How setups of kernels that decay were stored before there was `linear`: without it, but with what else has a default.
bool stored_without_linear(const v1::SubspaceMethod& message) {
  return message.linear() == v1::LINEAR_DEFAULT && message.centres() != 0 && message.cover() != 0 &&
         message.energy().has_bending() && message.energy().handles() != v1::HANDLES_DEFAULT;
}

SubspaceLinear subspace_linear(const v1::SubspaceMethod& message) {
  const bool left_out =
      known(message.linear(), "method.subspace.linear") == v1::LINEAR_LEFT_OUT || stored_without_linear(message);
  const std::optional<Kernel> kernel = subspace_kernel(message.kernel());
  const bool decays = kernel && properties(*kernel).local_shape > 0;
  return left_out || !decays ? SubspaceLinear::left_out : SubspaceLinear::added;
}

SubspaceOptions subspace_options(const v1::SubspaceMethod& message, Problems& problems) {
  const std::string path = "method.subspace.";
  SubspaceOptions options;
  take_energy(message.energy(), path + "energy", options, problems);
  problems.check(path + "energy.misfit", [&] { options.misfit = misfit_rule(message, path + "energy"); });
  const bool has_kernel = problems.check(path + "kernel", [&] { options.kernel = subspace_kernel(message.kernel()); });
  if (has_kernel) problems.check(path + "linear", [&] { options.linear = subspace_linear(message); });
  if (message.centres() != 0) options.centres = message.centres();
  options.cover = message.cover() == 0 ? default_cover(options.kernel) : message.cover();
  return options;
}

/// How setups were stored before there was a domain: without it, but with what else has a default.
bool stored_without_domain(const v1::MlsMethod& message) {
  return message.domain() == v1::DOMAIN_DEFAULT && message.cubature() != 0 && message.cover() != 0 &&
         message.energy().has_bending() && message.energy().handles() != v1::HANDLES_DEFAULT;
}

MlsDomain mls_domain(const v1::MlsMethod& message) {
  const v1::MlsDomain domain = known(message.domain(), "method.mls.domain");
  if (domain == v1::DOMAIN_SURFACE || stored_without_domain(message)) return MlsDomain::surface;
  if (domain == v1::DOMAIN_ENCLOSED) return MlsDomain::enclosed;
  // The same with numbers of samples: by the former default these setups have the ids that stores hold.
  const bool numbers = domain == v1::DOMAIN_DEFAULT && message.surface_samples() != 0 && message.volume_samples() != 0;
  return domain == v1::DOMAIN_CONNECTED || numbers ? MlsDomain::connected : MlsDomain::body;
}

MlsOptions mls_options(const v1::MlsMethod& message, Problems& problems) {
  const std::string path = "method.mls.";
  MlsOptions options;
  take_energy(message.energy(), path + "energy", options, problems);
  problems.check(path + "energy.misfit", [&] { options.misfit = misfit_rule(message, path + "energy"); });
  problems.check(path + "domain", [&] { options.domain = mls_domain(message); });
  options.surface_samples = message.surface_samples();
  options.volume_samples = message.volume_samples();
  if (message.cubature() != 0) options.cubature = message.cubature();
  options.cover = message.cover() != 0 ? message.cover() : default_cover(options.domain);
  for (int i = 0; i < message.weights_size(); ++i) {
    const auto& from = message.weights(i);
    auto& weights = options.weights.emplace_back(MlsOptions::Weights{{Region::All{}}, 0, 1});
    const std::string own = path + "weights[" + std::to_string(i) + "]";
    problems.check(own + ".region", [&] {
      if (!from.has_region()) refuse_field(own + ".region", "is missing");
      weights.region = region_from_proto(from.region(), own + ".region");
    });
    problems.check(own + ".stretching", [&] { weights.stretching = finite(from.stretching(), own + ".stretching"); });
    problems.check(own + ".bending", [&] { weights.bending = finite(from.bending(), own + ".bending"); });
  }
  return options;
}

FfdControl ffd_control(v1::FfdControl control) {
  switch (known(control, "method.ffd.control")) {
    case v1::MESH:
      return FfdControl::mesh;
    case v1::CONTROLS:
      return FfdControl::controls;
    default:
      return FfdControl::energy;
  }
}

FfdOptions ffd_options(const v1::FfdMethod& message, Problems& problems) {
  const std::string path = "method.ffd.";
  FfdOptions options;
  take_energy(message.energy(), path + "energy", options, problems);
  problems.check(path + "energy.misfit", [&] { options.misfit = misfit_rule(message, path + "energy"); });
  problems.check(path + "lattice", [&] { options.lattice = lattice_from_proto(message.lattice()); });
  problems.check(path + "control", [&] { options.control = ffd_control(message.control()); });
  problems.check(path + "clamp", [&] { options.clamp = finite(message.clamp(), path + "clamp"); });
  return options;
}

void take_cage(const v1::CageMethod& message, CageOptions& options) {
  const std::string path = "method.cage";
  if (!message.file().empty()) {
    refuse_field(path + ".file",
                 "only setup files name one; send the points and triangles of the cage as vertices and triangles");
  }
  if (message.has_generate()) {
    refuse_field(path + ".generate",
                 "only setup files have it, and whoever reads one makes the cage; send its points and triangles as vertices and "
                 "triangles");
  }
  const auto threes = [&](int numbers, const char* field) {
    if (numbers % 3 != 0) refuse_field(path + field, std::to_string(numbers) + " numbers are not a multiple of 3");
    return static_cast<std::size_t>(numbers) / 3;
  };
  options.vertices.resize(threes(message.vertices_size(), ".vertices"));
  options.triangles.resize(threes(message.triangles_size(), ".triangles"));
  for (std::size_t i = 0; i < 3 * options.vertices.size(); ++i) {
    options.vertices[i / 3][i % 3] = message.vertices(static_cast<int>(i));
  }
  for (std::size_t i = 0; i < 3 * options.triangles.size(); ++i) {
    options.triangles[i / 3][i % 3] = message.triangles(static_cast<int>(i));
  }
}

CageOptions cage_options(const v1::CageMethod& message, Problems& problems) {
  const std::string path = "method.cage";
  CageOptions options;
  problems.check(path + ".coordinates", [&] {
    const bool green = known(message.coordinates(), path + ".coordinates") == v1::GREEN;
    options.coordinates = green ? CageCoordinates::green : CageCoordinates::mean_value;
  });
  problems.check(path + ".control", [&] {
    const v1::FfdControl control = known(message.control(), path + ".control");
    if (control == v1::ENERGY) refuse_field(path + ".control", "a cage has no ENERGY; use CONTROLS or MESH");
    options.control = control == v1::MESH ? CageControl::mesh : CageControl::controls;
  });
  problems.check(path, [&] { take_cage(message, options); });
  problems.check(path + ".clamp", [&] { options.clamp = finite(message.clamp(), path + ".clamp"); });
  problems.check(path + ".basis", [&] { options.basis = basis_mode(message.basis(), path + ".basis"); });
  problems.check(path + ".basis_tolerance",
                 [&] { options.basis_tolerance = finite(message.basis_tolerance(), path + ".basis_tolerance"); });
  return options;
}

/// A method that a newer contract has.
[[noreturn]] void refuse_kind(const v1::Method& message) {
  throw Error(ErrorCode::internal,
              "method: no conversion of the method with field number " + std::to_string(message.kind_case()));
}

/// Ignored without a basis; 0 also for -0.0.
double canonical_basis_tolerance(v1::BasisMode basis, double tolerance) {
  return basis == v1::BASIS_NEVER || tolerance == 0 ? 0 : tolerance;
}

void canonicalize_reduction(v1::RbfMethod& rbf) {
  CentreReduction reduction = centre_reduction(rbf);
  const bool rings = reduction == CentreReduction::rings;
  if (reduction == CentreReduction::tolerance && rbf.solver() == v1::INCREMENTAL_QR) reduction = CentreReduction::off;
  if (reduction == CentreReduction::tolerance) {
    rbf.set_reduction(v1::REDUCTION_TOLERANCE);
    rbf.set_reduction_rings(0);
    if (rbf.reduction_tolerance() == 0)
      rbf.set_reduction_tolerance(default_reduction_tolerance(*kernel_from_proto(rbf.kernel())));
    return;
  }
  rbf.set_reduction(rings ? v1::REDUCTION_AUTOMATIC : v1::REDUCTION_OFF);
  if (!rings || rbf.reduction_rings() == 0) rbf.set_reduction_rings(default_rings);
  rbf.set_reduction_tolerance(0);
}

void canonicalize_rbf(v1::RbfMethod& rbf) {
  if (rbf.kernel() == v1::KERNEL_DEFAULT) rbf.set_kernel(v1::TRIHARMONIC);
  const KernelProperties kernel = properties(*kernel_from_proto(rbf.kernel()));
  if (!kernel.has_shape || rbf.shape() == 0) rbf.set_shape(0);  // ignored by the others: one value for all
  const bool by_spacing = kernel.has_shape && std::isfinite(kernel.spacings) && rbf.shape() == 0;
  rbf.set_automatic_shape(by_spacing && shape_rule(rbf) == ShapeRule::densest ? v1::SHAPE_OF_DENSEST
                                                                              : v1::AUTOMATIC_SHAPE_DEFAULT);
  const bool incremental = rbf.solver() == v1::INCREMENTAL_QR;
  const bool may_iterate = rbf.solver() == v1::ITERATIVE || rbf.solver() == v1::SOLVER_AUTOMATIC;
  if (rbf.tolerance() == 0) rbf.set_tolerance(default_tolerance(incremental ? Solver::incremental_qr : Solver::iterative));
  if (!may_iterate && !incremental) rbf.set_tolerance(0);
  if (!incremental) rbf.clear_samples();
  rbf.set_centre_order(incremental && rbf.centre_order() == v1::GREEDY ? v1::GREEDY : v1::CENTRE_ORDER_DEFAULT);
  if (!rbf.has_polynomial_degree()) rbf.set_polynomial_degree(static_cast<std::uint32_t>(kernel.default_degree()));
  rbf.set_basis_tolerance(canonical_basis_tolerance(rbf.basis(), rbf.basis_tolerance()));
  canonicalize_reduction(rbf);
}

void canonicalize_energy(v1::Energy& energy) {
  if (!energy.has_bending()) energy.set_bending(ShellOptions().bending);
  if (energy.handles() != v1::HANDLES_SOFT) {
    energy.set_handles(v1::HANDLES_HARD);
    energy.set_fixing(0);  // ignored
  } else if (energy.fixing() == 0) {
    energy.set_fixing(ShellOptions().fixing);
  }
  energy.set_basis_tolerance(canonical_basis_tolerance(energy.basis(), energy.basis_tolerance()));
  energy.set_misfit(v1::MISFIT_DEFAULT);
}

/// With the rule that the method had, to which the canonical defaults of all else were added.
void canonicalize_energy(v1::Energy& energy, MisfitRule misfit) {
  canonicalize_energy(energy);
  if (misfit == MisfitRule::joins && energy.handles() == v1::HANDLES_HARD) energy.set_misfit(v1::MISFIT_AT_JOINS);
}

void canonicalize_subspace(v1::SubspaceMethod& subspace) {
  const SubspaceOptions defaults;
  subspace.set_linear(subspace_linear(subspace) == SubspaceLinear::added ? v1::LINEAR_ADDED : v1::LINEAR_DEFAULT);
  canonicalize_energy(*subspace.mutable_energy(), misfit_rule(subspace, "method.subspace.energy"));
  if (subspace.kernel() == v1::SUBSPACE_DEFAULT) subspace.set_kernel(v1::SUBSPACE_MLS);
  if (subspace.centres() == 0) subspace.set_centres(static_cast<std::uint32_t>(defaults.centres));
  const std::optional<Kernel> kernel = subspace_kernel(subspace.kernel());
  if (kernel && !properties(*kernel).has_shape) {
    subspace.set_cover(0);
  } else if (subspace.cover() == 0) {
    subspace.set_cover(default_cover(kernel));
  }
}

void canonicalize_mls(v1::MlsMethod& mls) {
  const MlsOptions defaults;
  const MlsDomain domain = mls_domain(mls);
  if (domain == MlsDomain::surface) mls.set_domain(v1::DOMAIN_DEFAULT);
  if (domain == MlsDomain::connected) mls.set_domain(v1::DOMAIN_CONNECTED);
  if (domain == MlsDomain::body) mls.set_domain(v1::DOMAIN_BODY);
  canonicalize_energy(*mls.mutable_energy(), misfit_rule(mls, "method.mls.energy"));
  if (mls.cubature() == 0) mls.set_cubature(defaults.cubature);
  if (mls.cover() == 0) mls.set_cover(default_cover(domain));
  for (auto& weights : *mls.mutable_weights()) canonicalize_region(*weights.mutable_region());
}

void canonicalize_ffd(v1::FfdMethod& ffd) {
  const MisfitRule misfit = misfit_rule(ffd, "method.ffd.energy");
  if (ffd.control() == v1::MESH || ffd.control() == v1::CONTROLS) {
    const v1::Energy given = ffd.energy();
    ffd.clear_energy();
    ffd.mutable_energy()->set_basis(given.basis());
    ffd.mutable_energy()->set_basis_tolerance(given.basis_tolerance());
  } else {
    ffd.set_control(v1::ENERGY);
  }
  if (ffd.control() != v1::MESH || ffd.clamp() == 0) ffd.set_clamp(0);  // ignored, or -0.0
  if (ffd.control() == v1::ENERGY) {
    canonicalize_energy(*ffd.mutable_energy(), misfit);
  } else {
    canonicalize_energy(*ffd.mutable_energy());
  }
  v1::Lattice& lattice = *ffd.mutable_lattice();
  if (lattice.basis() == v1::LATTICE_BASIS_DEFAULT) lattice.set_basis(v1::UNIFORM_CUBIC);
}

void canonicalize_cage(v1::CageMethod& cage) {
  cage.clear_file();
  cage.clear_generate();
  if (cage.coordinates() != v1::GREEN) cage.set_coordinates(v1::MEAN_VALUE);
  if (cage.control() != v1::MESH) cage.set_control(v1::CONTROLS);
  if (cage.control() != v1::MESH || cage.clamp() == 0) cage.set_clamp(0);  // ignored, or -0.0
  cage.set_basis_tolerance(canonical_basis_tolerance(cage.basis(), cage.basis_tolerance()));
}

}  // namespace

MethodOptions method_from_proto(const v1::Method& message) {
  Problems problems(Problems::Mode::throw_first);
  return method_from_proto(message, problems);
}

MethodOptions method_from_proto(const v1::Method& message, Problems& problems) {
  switch (message.kind_case()) {
    case v1::Method::kShell:
      return shell_options(message.shell(), problems);
    case v1::Method::kSubspace:
      return subspace_options(message.subspace(), problems);
    case v1::Method::kMls:
      return mls_options(message.mls(), problems);
    case v1::Method::kFfd:
      return ffd_options(message.ffd(), problems);
    case v1::Method::kCage:
      return cage_options(message.cage(), problems);
    case v1::Method::kRbf:
    case v1::Method::KIND_NOT_SET:
      return rbf_options(message.rbf(), problems);
  }
  refuse_kind(message);
}

void set_default_kernel(v1::Method& message, const v1::GeometryInfo& geometry) {
  const bool rbf = message.has_rbf() || message.kind_case() == v1::Method::KIND_NOT_SET;
  if (!rbf || message.rbf().kernel() != v1::KERNEL_DEFAULT || geometry.box_min_size() != 3 || geometry.box_max_size() != 3)
    return;
  Box box;
  box.add({geometry.box_min(0), geometry.box_min(1), geometry.box_min(2)});
  box.add({geometry.box_max(0), geometry.box_max(1), geometry.box_max(2)});
  message.mutable_rbf()->set_kernel(default_kernel(box) == Kernel::thin_plate ? v1::THIN_PLATE : v1::TRIHARMONIC);
}

void canonicalize_method(v1::Method& message) {
  switch (message.kind_case()) {
    case v1::Method::kShell:
      return canonicalize_energy(*message.mutable_shell()->mutable_energy());
    case v1::Method::kSubspace:
      return canonicalize_subspace(*message.mutable_subspace());
    case v1::Method::kMls:
      return canonicalize_mls(*message.mutable_mls());
    case v1::Method::kFfd:
      return canonicalize_ffd(*message.mutable_ffd());
    case v1::Method::kCage:
      return canonicalize_cage(*message.mutable_cage());
    case v1::Method::kRbf:
    case v1::Method::KIND_NOT_SET:
      return canonicalize_rbf(*message.mutable_rbf());
  }
  refuse_kind(message);
}

}  // namespace deform::convert
