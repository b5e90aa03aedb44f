// SPDX-License-Identifier: Apache-2.0
#include "client/request_splitter.h"

#include <algorithm>

#include "client/upload.h"
#include "core/base/error.h"

namespace deform::client {

namespace {

constexpr std::size_t point_bytes = 24;
constexpr std::size_t smallest_piece = 64 * point_bytes;
/// For tags, lengths, numbers of points: generous, the payload is far below 1 MiB.
constexpr std::size_t overhead = 64;

std::size_t spend(std::size_t& room, std::size_t bytes) {
  room -= std::min(room, bytes);
  return room;
}

}  // namespace

bool RequestSplitter::next(v1::DeformStreamRequest& message) {
  message.Clear();
  if (ended_) return false;
  message.set_request_id(request_id_);
  v1::DeformRequest& part = *message.mutable_request();
  if (!begun_) {
    set_head(part);
    begun_ = true;
  }
  std::size_t room = message_payload;
  while (design_ < request_.designs_size() && room > 0) add_design(part, room);
  ended_ = design_ == request_.designs_size();
  message.set_more(!ended_);
  return true;
}

/// All but the designs.
void RequestSplitter::set_head(v1::DeformRequest& part) const {
  part.set_system_id(request_.system_id());
  if (request_.has_output()) *part.mutable_output() = request_.output();
  part.set_path(request_.path());
  part.set_check(request_.check());
  if (request_.has_splitting()) *part.mutable_splitting() = request_.splitting();
  part.set_solver_tolerance(request_.solver_tolerance());
  part.set_warm_start(request_.warm_start());
  part.set_failures(request_.failures());
  part.set_intersections(request_.intersections());
}

/// Adds the next design, or the rest of it, or as much of it as there is room for.
void RequestSplitter::add_design(v1::DeformRequest& part, std::size_t& room) {
  const v1::Design& source = request_.designs(design_);
  const std::size_t variables = static_cast<std::size_t>(source.variables_size()) * sizeof(double);
  const bool first_of_message = part.designs_size() == 0;
  if (!inside_ && variables + overhead > room && !first_of_message) {
    room = 0;
    return;
  }
  v1::Design& design = *part.add_designs();
  design.set_continues(inside_);
  if (!inside_) {
    *design.mutable_variables() = source.variables();
    spend(room, variables);
  }
  spend(room, overhead);
  inside_ = true;
  while (motion_ < source.motions_size()) {
    if (!add_motion(source.motions(motion_), design, room)) {
      room = 0;
      return;
    }
    ++motion_;
  }
  ++design_;
  inside_ = false;
  motion_ = 0;
}

/// False when there was no room for all of it.
bool RequestSplitter::add_motion(const v1::Motion& motion, v1::Design& design, std::size_t& room) {
  if (motion.handle().size() > message_payload / 2) {
    throw Error(ErrorCode::invalid_argument, "motion: a handle name of " + std::to_string(motion.handle().size()) + " bytes");
  }
  const std::size_t head = motion.handle().size() + static_cast<std::size_t>(motion.affine_size()) * sizeof(double) + overhead;
  const std::size_t need = head + (motion.displacements_size() > 0 ? smallest_piece : 0);
  if (need > room && !(design.motions_size() == 0 && room + overhead >= message_payload)) return false;
  v1::Motion& piece = *design.add_motions();
  piece.set_handle(motion.handle());
  if (displacements_ == 0 && displaced_ == 0) *piece.mutable_affine() = motion.affine();
  spend(room, head);
  return add_pieces(motion, piece, room);
}

bool RequestSplitter::add_pieces(const v1::Motion& motion, v1::Motion& piece, std::size_t& room) {
  while (displacements_ < motion.displacements_size()) {
    const v1::Displacements& source = motion.displacements(displacements_);
    const std::size_t left = source.xyz().size() - displaced_;
    const std::size_t fits = room > overhead ? (room - overhead) / point_bytes * point_bytes : 0;
    if (fits == 0 && left > 0) return false;
    const std::size_t bytes = std::min(left, fits);
    v1::Displacements& target = *piece.add_displacements();
    target.set_first(source.first() + displaced_ / point_bytes);
    target.set_xyz(source.xyz().substr(displaced_, bytes));
    spend(room, bytes + overhead);
    displaced_ += bytes;
    if (displaced_ < source.xyz().size()) return false;
    ++displacements_;
    displaced_ = 0;
  }
  displacements_ = 0;
  return true;
}

}  // namespace deform::client
