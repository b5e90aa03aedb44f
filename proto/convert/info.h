// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/deformers/system.h"
#include "deform/v1/deformation.pb.h"

namespace deform::convert {

/// The reply about a prepared system.
v1::SystemInfo system_info(const SystemInfo& info, const v1::Setup& canonical, const std::string& id);
void add_handles(google::protobuf::RepeatedPtrField<v1::HandleInfo>& to, const Setup& setup, const SelectedRegions& regions);

/// Adds the notes on the setup itself and on what its regions, those of validate(), hold of the mesh, which are not in
/// SystemInfo.
void add_setup_notes(google::protobuf::RepeatedPtrField<std::string>& to, const Setup& setup, const Mesh& mesh,
                     const SelectedRegions& regions, const RunContext& context = {});

/// Adds what the bounds of variables do, and what is seldom meant by a setup on this mesh; see core/deformers/setup_hints.h.
void add_setup_hints(google::protobuf::RepeatedPtrField<std::string>& to, const Setup& setup, const Mesh& mesh,
                     const SelectedRegions& regions, const RunContext& context = {});

v1::EstimateReply estimate_reply(const Estimate& estimate);
/// The reply for EstimateRequest.list_problems.
v1::EstimateReply problems_reply(const Problems& problems);
/// Fills in the reply for EstimateRequest.list_centres: ascending ids, or a note that tells why they are not listed.
void list_centres(const std::optional<std::vector<PointId>>& centres, v1::EstimateReply& reply);

}  // namespace deform::convert
