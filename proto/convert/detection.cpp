// SPDX-License-Identifier: GPL-3.0-or-later
#include "proto/convert/detection.h"

#include <algorithm>
#include <cstring>
#include <span>
#include <string>

#include "proto/convert/base/fields.h"

namespace deform::convert {

namespace {

constexpr std::size_t ids_per_message = std::size_t{1} << 16;

constexpr std::pair<v1::PrimitiveKind, PrimitiveKind> kinds[] = {{v1::PRIMITIVE_PLANE, PrimitiveKind::plane},
                                                                 {v1::PRIMITIVE_CYLINDER, PrimitiveKind::cylinder},
                                                                 {v1::PRIMITIVE_SPHERE, PrimitiveKind::sphere},
                                                                 {v1::PRIMITIVE_CONE, PrimitiveKind::cone}};

v1::PrimitiveKind to_proto(PrimitiveKind kind) {
  for (const auto& [message, own] : kinds) {
    if (own == kind) return message;
  }
  return v1::PRIMITIVE_UNKNOWN;
}

v1::EdgeKind to_proto(EdgeKind kind) {
  return kind == EdgeKind::line ? v1::EDGE_LINE : kind == EdgeKind::circle ? v1::EDGE_CIRCLE : v1::EDGE_ARC;
}

void add(const Vec3& x, google::protobuf::RepeatedField<double>& to) { to.Add(x.begin(), x.end()); }

void add_ids(std::span<const std::uint32_t> ids, v1::DetectedIds::Of of, std::vector<v1::DetectReply>& replies) {
  for (std::size_t first = 0; first < ids.size(); first += ids_per_message) {
    const std::size_t count = std::min(ids_per_message, ids.size() - first);
    v1::DetectedIds& message = *replies.emplace_back().mutable_ids();
    message.set_of(of);
    message.mutable_ids()->resize(count * sizeof(std::uint32_t));
    std::memcpy(message.mutable_ids()->data(), ids.data() + first, count * sizeof(std::uint32_t));
  }
}

}  // namespace

DetectOptions detect_options(const v1::DetectRequest& request) {
  DetectOptions options;
  options.tolerance = request.tolerance();
  options.minimum_area = request.minimum_area();
  options.maximum_angle = request.maximum_angle();
  options.seed = request.seed();
  for (int i = 0; i < request.kinds_size(); ++i) {
    const auto* row =
        std::find_if(std::begin(kinds), std::end(kinds), [&](const auto& k) { return k.first == request.kinds(i); });
    if (row == std::end(kinds)) {
      refuse_unknown("kinds[" + std::to_string(i) + "]", request.kinds(i));
    }
    if (std::find(options.kinds.begin(), options.kinds.end(), row->second) == options.kinds.end()) {
      options.kinds.push_back(row->second);
    }
  }
  options.validate();
  return options;
}

std::vector<v1::DetectReply> detect_replies(const Detection& detection) {
  std::vector<v1::DetectReply> replies;
  for (const Primitive& primitive : detection.primitives) {
    v1::DetectedPrimitive& message = *replies.emplace_back().mutable_primitive();
    message.set_name(primitive.name);
    message.set_kind(to_proto(primitive.kind));
    add(primitive.point, *message.mutable_point());
    if (primitive.kind != PrimitiveKind::sphere) add(primitive.axis, *message.mutable_axis());
    message.set_radius(primitive.radius);
    message.set_half_angle(primitive.half_angle);
    message.set_area(primitive.area);
    message.set_rms(primitive.rms);
    message.set_largest(primitive.max);
    message.set_faces(primitive.faces.size());
    message.set_points(primitive.points.size());
    message.set_constraint(primitive.constraint);
    message.mutable_implied_by()->Assign(primitive.implied_by.begin(), primitive.implied_by.end());
    add_ids(primitive.faces, v1::DetectedIds::FACES, replies);
    add_ids(primitive.points, v1::DetectedIds::POINTS, replies);
  }
  for (const EdgeFeature& edge : detection.edges) {
    v1::DetectedEdge& message = *replies.emplace_back().mutable_edge();
    message.set_name(edge.name);
    message.set_kind(to_proto(edge.kind));
    add(edge.point, *message.mutable_point());
    add(edge.axis, *message.mutable_axis());
    message.set_radius(edge.radius);
    message.set_length(edge.length);
    message.set_rms(edge.rms);
    message.set_largest(edge.max);
    message.set_points(edge.points.size());
    message.set_constraint(edge.constraint);
    message.mutable_implied_by()->Assign(edge.implied_by.begin(), edge.implied_by.end());
    message.mutable_lies_on()->Assign(edge.lies_on.begin(), edge.lies_on.end());
    add_ids(edge.points, v1::DetectedIds::POINTS, replies);
  }
  v1::DetectSummary& summary = *replies.emplace_back().mutable_summary();
  summary.set_tolerance(detection.tolerance);
  summary.set_minimum_area(detection.minimum_area);
  summary.set_maximum_angle(detection.maximum_angle);
  summary.set_noise(detection.noise);
  summary.set_area(detection.area);
  summary.set_coverage(detection.coverage);
  for (const auto& note : detection.notes) summary.add_notes(note);
  return replies;
}

}  // namespace deform::convert
