// SPDX-License-Identifier: GPL-3.0-or-later
// make_vectors FOLDER           writes the test vectors of the wire contract
// make_vectors --check FOLDER   says which of the files there are not what the code writes; exit code 1 when any is not
#include <filesystem>
#include <fstream>
#include <iostream>
#include <iterator>

#include "tests/wire/vectors.h"

namespace deform::wire {

std::string base64(std::string_view bytes) {
  constexpr std::string_view digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    std::uint32_t three = 0;
    for (std::size_t k = 0; k < 3; ++k)
      three = three << 8 | (i + k < bytes.size() ? static_cast<unsigned char>(bytes[i + k]) : 0u);
    for (std::size_t k = 0; k < 4; ++k) text += i + k > bytes.size() ? '=' : digits[three >> (18 - 6 * k) & 63u];
  }
  return text;
}

namespace {

std::string contents(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

int run(const std::filesystem::path& folder, bool check) {
  Vectors vectors;
  add_block_vectors(vectors);
  add_reply_vectors(vectors);
  add_upload_vectors(vectors);
  add_setup_vectors(vectors);
  int differences = 0;
  for (const auto& [name, json] : vectors) {
    const std::string text = json.dump(1) + '\n';
    if (!check) {
      std::ofstream(folder / name, std::ios::binary) << text;
    } else if (contents(folder / name) != text) {
      std::cerr << (folder / name).string() << ": is not what the code writes\n";
      ++differences;
    }
  }
  if (differences == 0) return 0;
  std::cerr
      << "The bytes on the wire have changed. Clients and stores of earlier versions depend on them: see tests/wire/README.md.\n";
  return 1;
}

}  // namespace

}  // namespace deform::wire

int main(int argc, char** argv) {
  const bool check = argc == 3 && std::string_view(argv[1]) == "--check";
  if (argc != 2 && !check) {
    std::cerr << "usage: make_vectors [--check] FOLDER\n";
    return 2;
  }
  return deform::wire::run(argv[argc - 1], check);
}
