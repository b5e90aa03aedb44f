// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "deform/v1/service.pb.h"

namespace deform::client {

/// A request as the messages of DeformStream, each below 1 MiB however large the designs are: designs one after the other,
/// motions of a design one after the other (`continues`), displacements of a motion in pieces. Keeps the request alive by
/// reference.
class RequestSplitter {
 public:
  /// The request must outlive this.
  RequestSplitter(const v1::DeformRequest& request, std::uint64_t request_id) : request_(request), request_id_(request_id) {}

  /// False after the last one.
  bool next(v1::DeformStreamRequest& message);

 private:
  void set_head(v1::DeformRequest& part) const;
  void add_design(v1::DeformRequest& part, std::size_t& room);
  bool add_motion(const v1::Motion& motion, v1::Design& design, std::size_t& room);
  bool add_pieces(const v1::Motion& motion, v1::Motion& piece, std::size_t& room);

  const v1::DeformRequest& request_;
  const std::uint64_t request_id_;
  bool begun_ = false;
  bool ended_ = false;
  int design_ = 0;             ///< next
  bool inside_ = false;        ///< part of that design was sent
  int motion_ = 0;             ///< next of that design
  int displacements_ = 0;      ///< next of that motion
  std::size_t displaced_ = 0;  ///< bytes of these already sent
};

}  // namespace deform::client
