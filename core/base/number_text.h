// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace deform {

/// The shortest decimal text that reads back as the same double: "0.1", "1e-07", "-inf". Independent of the locale. Meant for
/// messages: std::to_string would print 0.1000001 beside a limit of 0.1 as "0.100000".
std::string number_digits(double value);

/// With three significant digits: "0.0123", "1.2e+15". Depends on the locale of C.
std::string three_digits(double value);

/// Formats a number of bytes in mebibytes: "12.3 MiB"; less than one in kibibytes: "12.3 KiB".
std::string mebibytes(std::size_t bytes);

}  // namespace deform
