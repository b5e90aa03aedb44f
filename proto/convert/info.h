#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/codec/block.h"
#include "core/deformers/system.h"
#include "deform/v1/deformation.pb.h"

namespace deform::server {

/// What a client is told about a prepared system.
v1::SystemInfo system_info(const SystemInfo& info, const v1::Setup& canonical, const std::string& id);
void add_handles(google::protobuf::RepeatedPtrField<v1::HandleInfo>& to, const Setup& setup, const SelectedRegions& regions);

/// Notes about the setup itself, which its system does not make.
void add_setup_notes(google::protobuf::RepeatedPtrField<std::string>& to, const Setup& setup);

v1::EstimateReply estimate_reply(const Estimate& estimate);
/// Of EstimateRequest.list_centres: ascending ids, or a note why they are not listed.
void list_centres(const std::optional<std::vector<PointId>>& centres, v1::EstimateReply& reply);

/// Of a design of a setup with constraints.
v1::ConstraintsReport constraints_report(const DesignReport& report, const Setup& setup);
/// A sentence when exact constraints were given up, else empty.
std::string given_up_warning(const DesignReport& report, const Setup& setup);

v1::EvaluationPath path_to_proto(EvaluationPath path);
EvaluationPath path_from_proto(v1::EvaluationPath path);

/// tolerance 0 becomes 1e-6 of the diagonal. Throws Error(invalid_argument) "output.tolerance: ...".
codec::EncodeOptions encode_options(const v1::Output& output, double diagonal);

/// Moves the bytes. Design and position are the caller's.
void block_to_proto(codec::Block&& block, v1::Block& message);

}  // namespace deform::server
