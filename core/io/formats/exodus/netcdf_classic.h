// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

namespace deform::io {

/// Whether the bytes are a classic netCDF file (CDF-1, CDF-2 or CDF-5) rather than HDF5.
bool is_classic_netcdf(std::string_view bytes);

/// Throws Error(invalid_argument) if a classic netCDF file is truncated: libnetcdf reads zeros beyond the end and extends the
/// file when writing there. Variables along the unlimited dimension may be short, because results come last. Other files pass.
/// Format: NetCDF Users Guide, appendix "File Format Specifications".
void check_classic_netcdf(std::string_view bytes, const std::string& name);

}  // namespace deform::io
