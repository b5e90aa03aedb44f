// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <vector>

#include "core/constraints/detection/detect.h"
#include "deform/v1/detection.pb.h"

namespace deform::convert {

/// Converts the options. Throws Error(invalid_argument) with the path of the field.
DetectOptions detect_options(const v1::DetectRequest& request);

/// The replies in the order of detection.proto, without `seconds`.
std::vector<v1::DetectReply> detect_replies(const Detection& detection);

}  // namespace deform::convert
