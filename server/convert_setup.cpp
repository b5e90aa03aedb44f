#include "server/convert_setup.h"

#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/io/zero_copy_stream_impl_lite.h>

#include <algorithm>

#include "core/base/error.h"
#include "core/codec/geometry_id.h"
#include "server/convert.h"
#include "server/convert_region.h"

namespace deform::server {

namespace {

constexpr std::size_t variables_per_handle = 12;  // an affine map has no more degrees of freedom
constexpr std::size_t most_planes = 3;
constexpr std::size_t longest_name = 4096;
constexpr std::uint32_t default_rings = 3;
constexpr int most_samples = 1000;
constexpr double incremental_tolerance = 1e-4;

struct KernelRow {
  v1::Kernel message;
  Kernel kernel;
  std::uint32_t default_degree;  // max(1, order of conditional positive definiteness - 1)
  bool has_shape;
};
constexpr KernelRow kernels[] = {
    {v1::TRIHARMONIC, Kernel::triharmonic, 1, false},  {v1::BIHARMONIC, Kernel::biharmonic, 1, false},
    {v1::QUINTIC, Kernel::quintic, 2, false},          {v1::GAUSSIAN, Kernel::gaussian, 1, true},
    {v1::MULTIQUADRIC, Kernel::multiquadric, 1, true}, {v1::INVERSE_MULTIQUADRIC, Kernel::inverse_multiquadric, 1, true},
    {v1::WENDLAND_C2, Kernel::wendland_c2, 1, true},   {v1::THIN_PLATE, Kernel::thin_plate, 1, false},
};

const KernelRow& kernel_row(v1::Kernel kernel) {
  if (kernel == v1::KERNEL_DEFAULT) return kernels[0];
  for (const auto& row : kernels) {
    if (row.message == kernel) return row;
  }
  refuse_field("method.rbf.kernel", "unknown value " + std::to_string(static_cast<int>(kernel)));
}

RbfOptions rbf_options(const v1::RbfMethod& message) {
  RbfOptions options;
  options.kernel = kernel_row(message.kernel()).kernel;
  options.shape = finite(message.shape(), "method.rbf.shape");
  if (message.has_polynomial_degree()) {
    if (message.polynomial_degree() > 2) {
      refuse_field("method.rbf.polynomial_degree", std::to_string(message.polynomial_degree()) + " is more than 2");
    }
    options.polynomial_degree = static_cast<int>(message.polynomial_degree());
  }
  switch (message.solver()) {
    case v1::SOLVER_AUTOMATIC:
      options.solver = Solver::automatic;
      break;
    case v1::CHOLESKY:
      options.solver = Solver::cholesky;
      break;
    case v1::LDLT:
      options.solver = Solver::ldlt;
      break;
    case v1::LU:
      options.solver = Solver::lu;
      break;
    case v1::ITERATIVE:
      options.solver = Solver::iterative;
      break;
    case v1::INCREMENTAL_QR:
      options.solver = Solver::incremental_qr;
      options.tolerance = incremental_tolerance;
      break;
    default:
      refuse_field("method.rbf.solver", "unknown value " + std::to_string(static_cast<int>(message.solver())));
  }
  if (message.tolerance() != 0) options.tolerance = finite(message.tolerance(), "method.rbf.tolerance");
  if (!v1::CentreOrder_IsValid(message.centre_order())) {
    refuse_field("method.rbf.centre_order", "unknown value " + std::to_string(static_cast<int>(message.centre_order())));
  }
  options.centre_order = message.centre_order() == v1::GREEDY ? CentreOrder::greedy : CentreOrder::farthest_point;
  for (const auto& sample : message.samples()) {
    options.samples.emplace_back(sample.variables().begin(), sample.variables().end());
  }
  if (!v1::CentreReduction_IsValid(message.reduction())) {
    refuse_field("method.rbf.reduction", "unknown value " + std::to_string(static_cast<int>(message.reduction())));
  }
  options.reduction = message.reduction() == v1::REDUCTION_OFF ? CentreReduction::off : CentreReduction::automatic;
  if (message.reduction_rings() > 100) {
    refuse_field("method.rbf.reduction_rings", std::to_string(message.reduction_rings()) + " is more than 100");
  }
  if (message.reduction_rings() != 0) options.reduction_rings = static_cast<int>(message.reduction_rings());
  if (!v1::BasisMode_IsValid(message.basis())) {
    refuse_field("method.rbf.basis", "unknown value " + std::to_string(static_cast<int>(message.basis())));
  }
  options.basis = message.basis() == v1::BASIS_ALWAYS  ? BasisMode::always
                  : message.basis() == v1::BASIS_NEVER ? BasisMode::never
                                                       : BasisMode::automatic;
  return options;
}

Vec3 point_or_origin(const google::protobuf::RepeatedField<double>& numbers, const std::string& path) {
  return numbers.empty() ? Vec3{} : vec3(numbers, path);
}

void check_name(const std::string& name, const std::string& path) {
  if (name.empty()) refuse_field(path, "must not be empty");
  if (name.size() > longest_name) refuse_field(path, "longer than " + std::to_string(longest_name) + " bytes");
}

using VariableKind = decltype(DesignVariable::kind);

VariableKind variable_kind(const v1::DesignVariable& message, const std::string& path) {
  const int kinds = (message.translate().empty() ? 0 : 1) + (message.has_rotate() ? 1 : 0) + (message.has_scale() ? 1 : 0);
  if (kinds != 1) {
    refuse_field(path, "expected exactly one of translate, rotate, scale, got " + std::to_string(kinds));
  }
  if (message.has_rotate()) {
    const std::string field = path + ".rotate";
    return DesignVariable::Rotate{vec3(message.rotate().axis(), field + ".axis"),
                                  point_or_origin(message.rotate().centre(), field + ".centre")};
  }
  if (message.has_scale()) {
    const std::string field = path + ".scale";
    return DesignVariable::Scale{point_or_origin(message.scale().centre(), field + ".centre"),
                                 point_or_origin(message.scale().axis(), field + ".axis")};
  }
  return DesignVariable::Translate{vec3(message.translate(), path + ".translate")};
}

DesignVariable variable(const v1::DesignVariable& message, const std::string& path) {
  check_name(message.name(), path + ".name");
  check_name(message.handle(), path + ".handle");
  DesignVariable result{message.name(), message.handle(), variable_kind(message, path)};
  if (message.has_lower()) result.lower = finite(message.lower(), path + ".lower");
  if (message.has_upper()) result.upper = finite(message.upper(), path + ".upper");
  return result;
}

SymmetryPlane symmetry_plane(const v1::SymmetryPlane& message, const std::string& path) {
  const bool plane = !message.point().empty() || !message.normal().empty();
  if (plane == message.has_region()) {
    refuse_field(path, std::string("expected either point and normal or a region, got ") + (plane ? "both" : "neither"));
  }
  if (!plane) return {region_from_proto(message.region(), path + ".region")};
  return {SymmetryPlane::Plane{vec3(message.point(), path + ".point"), vec3(message.normal(), path + ".normal")}};
}

void fill_point(google::protobuf::RepeatedField<double>& numbers) {
  if (numbers.empty()) numbers.Resize(3, 0.0);
}

}  // namespace

Setup setup_from_proto(const v1::Setup& message, std::size_t max_handles) {
  const auto check_count = [&](const char* field, int count, std::size_t limit) {
    if (static_cast<std::size_t>(count) > limit) {
      refuse_field(field, std::to_string(count) + " entries are more than the limit of " + std::to_string(limit));
    }
  };
  check_count("handles", message.handles_size(), max_handles);
  check_count("fixed", message.fixed_size(), max_handles);
  check_count("symmetry", message.symmetry_size(), most_planes);
  check_count("variables", message.variables_size(), variables_per_handle * max_handles);

  check_count("method.rbf.samples", message.method().rbf().samples_size(), most_samples);

  Setup setup;
  setup.method = rbf_options(message.method().rbf());
  setup.seed = message.seed();
  for (int i = 0; i < message.handles_size(); ++i) {
    const std::string path = "handles[" + std::to_string(i) + "]";
    check_name(message.handles(i).name(), path + ".name");
    if (!message.handles(i).has_region()) refuse_field(path + ".region", "is missing");
    setup.handles.push_back({message.handles(i).name(), region_from_proto(message.handles(i).region(), path + ".region")});
  }
  for (int i = 0; i < message.fixed_size(); ++i) {
    setup.fixed.push_back(region_from_proto(message.fixed(i), "fixed[" + std::to_string(i) + "]"));
  }
  for (int i = 0; i < message.variables_size(); ++i) {
    setup.variables.push_back(variable(message.variables(i), "variables[" + std::to_string(i) + "]"));
  }
  for (int i = 0; i < message.symmetry_size(); ++i) {
    setup.symmetry.push_back(symmetry_plane(message.symmetry(i), "symmetry[" + std::to_string(i) + "]"));
  }
  return setup;
}

v1::Setup canonical_setup(const v1::Setup& message, const std::string& geometry_id) {
  v1::Setup canonical = message;
  canonical.DiscardUnknownFields();
  canonical.set_geometry(geometry_id);
  v1::RbfMethod& rbf = *canonical.mutable_method()->mutable_rbf();
  const KernelRow& kernel = kernel_row(rbf.kernel());
  rbf.set_kernel(kernel.message);
  if (!kernel.has_shape || rbf.shape() == 0) rbf.set_shape(0);  // ignored by the others: one value for all
  const bool incremental = rbf.solver() == v1::INCREMENTAL_QR;
  const bool may_iterate = rbf.solver() == v1::ITERATIVE || rbf.solver() == v1::SOLVER_AUTOMATIC;
  if (rbf.tolerance() == 0) rbf.set_tolerance(incremental ? incremental_tolerance : RbfOptions().tolerance);
  if (!may_iterate && !incremental) rbf.set_tolerance(0);
  if (!incremental) rbf.clear_samples();
  rbf.set_centre_order(incremental && rbf.centre_order() == v1::GREEDY ? v1::GREEDY : v1::CENTRE_ORDER_DEFAULT);
  if (!rbf.has_polynomial_degree()) rbf.set_polynomial_degree(kernel.default_degree);
  if (rbf.reduction() == v1::REDUCTION_OFF || rbf.reduction_rings() == 0) rbf.set_reduction_rings(default_rings);
  for (auto& handle : *canonical.mutable_handles()) canonicalize_region(*handle.mutable_region());
  for (auto& region : *canonical.mutable_fixed()) canonicalize_region(region);
  for (auto& plane : *canonical.mutable_symmetry()) {
    if (plane.has_region()) canonicalize_region(*plane.mutable_region());
  }
  for (auto& variable : *canonical.mutable_variables()) {
    if (variable.has_rotate()) fill_point(*variable.mutable_rotate()->mutable_centre());
    if (variable.has_scale()) fill_point(*variable.mutable_scale()->mutable_centre());
  }
  return canonical;
}

std::string system_id(const v1::Setup& canonical) {
  std::string bytes;
  {
    google::protobuf::io::StringOutputStream stream(&bytes);
    google::protobuf::io::CodedOutputStream coded(&stream);
    coded.SetSerializationDeterministic(true);
    canonical.SerializeToCodedStream(&coded);
  }
  constexpr char tag[] = "deform.setup.1";  // with its terminating zero
  codec::Sha256 hash;
  hash.add(tag, sizeof(tag));
  hash.add(bytes.data(), bytes.size());
  return hash.hex();
}

}  // namespace deform::server
