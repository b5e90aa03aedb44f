#include "proto/convert/info.h"

#include <google/protobuf/io/coded_stream.h>

#include <algorithm>
#include <utility>

#include "proto/convert/fields.h"

namespace deform::server {

namespace {

constexpr double default_tolerance = 1e-6;  // of the diagonal

v1::Solver solver_to_proto(Solver solver) {
  switch (solver) {
    case Solver::cholesky:
      return v1::CHOLESKY;
    case Solver::ldlt:
      return v1::LDLT;
    case Solver::lu:
      return v1::LU;
    case Solver::iterative:
      return v1::ITERATIVE;
    case Solver::incremental_qr:
      return v1::INCREMENTAL_QR;
    case Solver::sparse_cholesky:
      return v1::CHOLESKY;
    case Solver::automatic:
      break;
  }
  return v1::SOLVER_AUTOMATIC;
}

v1::Encoding encoding_to_proto(codec::Encoding encoding) {
  switch (encoding) {
    case codec::Encoding::raw_f64:
      return v1::RAW_F64;
    case codec::Encoding::raw_f32:
      return v1::RAW_F32;
    case codec::Encoding::draco:
      return v1::DRACO;
    case codec::Encoding::delta_zstd:
      return v1::DELTA_ZSTD;
  }
  return v1::ENCODING_DEFAULT;
}

}  // namespace

v1::SystemInfo system_info(const SystemInfo& info, const v1::Setup& canonical, const std::string& id) {
  v1::SystemInfo message;
  message.set_id(id);
  message.set_geometry_id(canonical.geometry());
  message.set_points(info.points);
  message.set_fixed_points(info.fixed_points);
  message.set_handle_points(info.handle_points);
  message.set_deformable_points(info.deformable_points);
  message.set_constraint_points(info.constraint_points);
  message.set_centres(info.centres);
  message.set_functions(info.functions);
  message.set_cubature_points(info.cubature_points);
  message.set_merged_duplicates(info.merged_duplicates);
  message.set_polynomial_terms(static_cast<std::uint32_t>(info.polynomial_terms));
  message.set_affine_hull_dimension(static_cast<std::uint32_t>(info.affine_hull_dimension));
  message.set_basis_fields(info.basis_fields);
  message.set_bytes(info.bytes);
  message.set_factor_bytes(info.factor_bytes);
  message.set_basis_bytes(info.basis_bytes);
  message.set_diagonal(info.diagonal);
  message.set_condition(info.condition);
  message.set_tolerance(info.tolerance);
  message.set_solver(solver_to_proto(info.solver));
  message.set_reduced(info.reduced);
  for (const auto& note : info.notes) message.add_notes(note);
  double seconds = 0;
  for (const auto& [stage, time] : info.stage_seconds) {
    auto* entry = message.add_stages();
    entry->set_stage(stage);
    entry->set_seconds(time);
    seconds += time;
  }
  message.set_seconds(seconds);
  *message.mutable_setup() = canonical;
  return message;
}

void add_handles(google::protobuf::RepeatedPtrField<v1::HandleInfo>& to, const Setup& setup, const SelectedRegions& regions) {
  for (std::size_t h = 0; h < setup.handles.size(); ++h) {
    auto* entry = to.Add();
    entry->set_name(setup.handles[h].name);
    entry->set_points(regions.handles[h].size());
  }
}

void add_setup_notes(google::protobuf::RepeatedPtrField<std::string>& to, const Setup& setup) {
  if (setup.fixed.empty()) *to.Add() = "Nothing is fixed, so everything that is no handle may move.";
}

v1::EstimateReply estimate_reply(const Estimate& estimate) {
  v1::EstimateReply reply;
  reply.set_constraint_points(estimate.constraint_points);
  reply.set_centres(estimate.centres);
  reply.set_factor_bytes(estimate.factor_bytes);
  reply.set_basis_bytes(estimate.basis_bytes);
  reply.set_resident_bytes(estimate.resident_bytes);
  reply.set_peak_bytes(estimate.peak_bytes);
  reply.set_seconds(estimate.seconds);
  for (const auto& note : estimate.notes) reply.add_notes(note);
  return reply;
}

void list_centres(const std::optional<std::vector<PointId>>& centres, v1::EstimateReply& reply) {
  if (!centres) {
    reply.add_notes("The centres are not listed: this method chooses them while preparing.");
    return;
  }
  constexpr std::size_t most_bytes = std::size_t{1} << 20;
  std::size_t bytes = 0;
  PointId before = 0;
  for (const PointId id : *centres) {
    bytes += google::protobuf::io::CodedOutputStream::VarintSize32(id - before);
    before = id;
  }
  if (bytes > most_bytes) {
    reply.add_notes("The " + std::to_string(centres->size()) + " centres are not listed: they would take " +
                    std::to_string(bytes) + " bytes, at most " + std::to_string(most_bytes) + " are sent.");
    return;
  }
  before = 0;
  for (const PointId id : *centres) {
    reply.add_centre_steps(id - before);
    before = id;
  }
}

v1::ConstraintsReport constraints_report(const DesignReport& report, const Setup& setup) {
  v1::ConstraintsReport message;
  for (std::size_t i = 0; i < report.constraints.size(); ++i) {
    const ConstraintReport& of = report.constraints[i];
    v1::ConstraintResidual& residual = *message.add_residuals();
    residual.set_name(setup.constraints[i].name);
    residual.set_largest(of.max);
    residual.set_rms(of.rms);
    residual.set_free_largest(of.max_before);
    residual.set_free_rms(of.rms_before);
    residual.set_missed(of.missed);
  }
  message.set_converged(report.converged);
  message.set_iterations(static_cast<std::uint32_t>(report.iterations + report.newton_steps));
  message.set_newton_steps(static_cast<std::uint32_t>(report.newton_steps));
  message.set_convergence_error(report.convergence_error);
  message.set_energy(report.energy);
  const auto given_up = [](const ConstraintReport& of) { return of.given_up; };
  message.set_exact_given_up(std::any_of(report.constraints.begin(), report.constraints.end(), given_up));
  return message;
}

std::string given_up_warning(const DesignReport& report, const Setup& setup) {
  std::string names;
  for (std::size_t i = 0; i < report.constraints.size(); ++i) {
    if (report.constraints[i].given_up) names += (names.empty() ? "" : ", ") + ('"' + setup.constraints[i].name + '"');
  }
  if (names.empty()) return {};
  return "The exact constraints " + names +
         " contradict each other or points that are held: putting their points on the shapes made the deformation worse and was "
         "given up; they are met as far as their weight carries them.";
}

v1::EvaluationPath path_to_proto(EvaluationPath path) {
  return path == EvaluationPath::basis ? v1::PATH_BASIS : path == EvaluationPath::direct ? v1::PATH_DIRECT : v1::PATH_AUTOMATIC;
}

EvaluationPath path_from_proto(v1::EvaluationPath path) {
  switch (path) {
    case v1::PATH_AUTOMATIC:
      return EvaluationPath::automatic;
    case v1::PATH_BASIS:
      return EvaluationPath::basis;
    case v1::PATH_DIRECT:
      return EvaluationPath::direct;
    default:
      refuse_field("path", "unknown value " + std::to_string(static_cast<int>(path)));
  }
}

codec::EncodeOptions encode_options(const v1::Output& output, double diagonal) {
  codec::EncodeOptions options;
  switch (output.encoding()) {
    case v1::RAW_F64:
      options.encoding = codec::Encoding::raw_f64;
      break;
    case v1::RAW_F32:
      options.encoding = codec::Encoding::raw_f32;
      break;
    case v1::ENCODING_DEFAULT:
    case v1::DRACO:
      options.encoding = codec::Encoding::draco;
      break;
    case v1::DELTA_ZSTD:
      options.encoding = codec::Encoding::delta_zstd;
      break;
    default:
      refuse_field("output.encoding", "unknown value " + std::to_string(static_cast<int>(output.encoding())));
  }
  const double tolerance = finite(output.tolerance(), "output.tolerance");
  if (tolerance < 0) refuse_field("output.tolerance", "must not be negative");
  // A single point has no diagonal; any positive tolerance will do.
  options.tolerance = tolerance > 0 ? tolerance : diagonal > 0 ? default_tolerance * diagonal : default_tolerance;
  return options;
}

void block_to_proto(codec::Block&& block, v1::Block& message) {
  message.set_count(block.count);
  message.set_encoding(encoding_to_proto(block.encoding));
  message.set_fell_back(block.fell_back);
  message.set_step(block.step);
  if (block.step != 0) {
    for (const std::int64_t offset : block.offset) message.add_offset(offset);
  }
  message.set_max_error(block.max_error);
  message.set_checksum(block.checksum);
  message.set_data(std::move(block.bytes));
}

}  // namespace deform::server
