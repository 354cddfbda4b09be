#pragma once
#include <cstdint>
#include <string>

namespace cloudrenderer {

// "64MiB", "4GiB", "512MB", "100k" or plain bytes; fractions are allowed ("1.5GiB"). Throws
// UsageError.
std::uint64_t parse_size(const std::string& text);
// "1.5 GiB", for people.
std::string format_size(std::uint64_t bytes);

}  // namespace cloudrenderer
