// SPDX-License-Identifier: GPL-3.0-or-later
#include "proto/convert/info.h"

#include <google/protobuf/io/coded_stream.h>

#include <algorithm>
#include <utility>

#include "core/base/model_size.h"
#include "core/deformers/composed/composed_setup.h"
#include "core/deformers/methods.h"
#include "core/deformers/setup_hints.h"
#include "core/deformers/unheld_bodies.h"
#include "proto/convert/base/fields.h"

namespace deform::convert {

namespace {

v1::Solver solver_to_proto(Solver solver) {
  switch (solver) {
    case Solver::cholesky:
      return v1::CHOLESKY;
    case Solver::ldlt:
      return v1::LDLT;
    case Solver::iterative:
      return v1::ITERATIVE;
    case Solver::incremental_qr:
      return v1::INCREMENTAL_QR;
    case Solver::automatic:
      break;
  }
  return v1::SOLVER_AUTOMATIC;
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
  message.set_centres(info.centres + info.held_points + info.samples);
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
  message.set_reduction_tolerance(info.reduction_tolerance);
  message.set_reduction_misfit(info.reduction_misfit);
  message.set_reduction_error(info.reduction_error);
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
  message.set_setup_bytes(canonical.ByteSizeLong());
  return message;
}

void add_handles(google::protobuf::RepeatedPtrField<v1::HandleInfo>& to, const Setup& setup, const SelectedRegions& regions) {
  for (std::size_t h = 0; h < setup.handles.size(); ++h) {
    auto* entry = to.Add();
    entry->set_name(setup.handles[h].name);
    entry->set_points(regions.handles[h].size());
  }
}

void add_setup_notes(google::protobuf::RepeatedPtrField<std::string>& to, const Setup& setup, const Mesh& mesh,
                     const SelectedRegions& regions, const RunContext& context) {
  context.check();
  if (const ModelSize size = model_size(mesh.points); !size.stray.empty()) *to.Add() = "Stray points: " + size.stray + ".";
  context.check();
  if (std::string note = unheld_bodies_note(mesh, regions); !note.empty()) *to.Add() = std::move(note);
  if (setup.fixed.empty() && !selects_controls(setup)) *to.Add() = "Nothing is fixed, so everything that is no handle may move.";
  for (std::size_t s = 1; s <= setup.then.size(); ++s) {
    const Setup own = stage_setup(setup, s).setup;
    if (!own.fixed.empty() || selects_controls(own)) continue;
    *to.Add() = stage_field(s) + ": Nothing is fixed, so everything that is no handle of this method may move.";
  }
}

void add_setup_hints(google::protobuf::RepeatedPtrField<std::string>& to, const Setup& setup, const Mesh& mesh,
                     const SelectedRegions& regions, const RunContext& context) {
  for (std::string& note : variable_notes(mesh, setup, regions, context)) *to.Add() = std::move(note);
  context.check();
  if (std::string note = half_model_note(mesh, setup, regions); !note.empty()) *to.Add() = std::move(note);
}

v1::EstimateReply estimate_reply(const Estimate& estimate) {
  v1::EstimateReply reply;
  reply.set_constraint_points(estimate.constraint_points);
  reply.set_centres(estimate.size());
  reply.set_factor_bytes(estimate.factor_bytes);
  reply.set_basis_bytes(estimate.basis_bytes);
  reply.set_resident_bytes(estimate.resident_bytes);
  reply.set_peak_bytes(estimate.peak_bytes);
  reply.set_seconds(estimate.seconds);
  reply.set_design_seconds(estimate.design_seconds);
  for (const auto& note : estimate.notes) reply.add_notes(note);
  return reply;
}

v1::EstimateReply problems_reply(const Problems& problems) {
  constexpr std::size_t most_bytes = std::size_t{1} << 19;
  v1::EstimateReply reply;
  std::size_t bytes = 0;
  for (const Problem& problem : problems.list()) {
    bytes += problem.field.size() + problem.message.size() + 16;
    if (bytes > most_bytes) break;
    v1::SetupProblem& message = *reply.add_problems();
    message.set_field(problem.field);
    message.set_message(problem.message);
  }
  reply.set_problems_left_out(problems.list().size() - static_cast<std::size_t>(reply.problems_size()));
  return reply;
}

void list_centres(const std::optional<std::vector<PointId>>& centres, v1::EstimateReply& reply) {
  if (!centres) {
    reply.add_notes("The centres are not listed: this method chooses them while preparing.");
    return;
  }
  constexpr std::size_t most_bytes = 900'000;  // the message stays below 1 MiB
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

}  // namespace deform::convert
