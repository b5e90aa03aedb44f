// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "core/io/formats/openfoam/openfoam_folder.h"

namespace deform::io {

/// A file of the class decomposedBlockData, which OpenFOAM's file handler "collated" writes: the bytes of one file of each part,
/// one after the other, each with their number. The first has a header, which holds for all.
class CollatedFile {
 public:
  CollatedFile() = default;
  /// Throws Error(invalid_argument) naming file and line: another class, blocks that are cut off, another number of blocks than
  /// `count`.
  CollatedFile(FoamFiles::Part file, std::size_t count);

  /// The file of one part, with the header that holds for it, and a name that says which it is: "points (part 2)".
  FoamFiles::Part part(std::size_t block, std::size_t number) const;
  /// The file with other bytes in the place of those that part() gives of each block.
  std::string with_parts(const std::vector<std::string>& parts) const;

 private:
  /// Where the number of its bytes stands, and these.
  struct Block {
    std::size_t count_begin = 0, count_end = 0, begin = 0, end = 0;
    bool headed = false;  ///< it has a header of its own
  };

  std::string_view bytes_of(const Block& block) const {
    return std::string_view(file_.bytes).substr(block.begin, block.end - block.begin);
  }

  FoamFiles::Part file_;
  std::vector<Block> blocks_;
  std::string header_;  ///< put before those without
};

/// Whether the bytes are those of such a file.
bool is_collated(std::string_view bytes);

}  // namespace deform::io
