// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>

#include "server/engine/deform_call.h"

namespace deform::server {

/// What the client holds: letting go of it cancels.
std::shared_ptr<DeformJob> make_deform_job(std::shared_ptr<DeformCall> call);

}  // namespace deform::server
