#include "cli/size.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <cmath>

#include "base/error.h"

namespace cloudrenderer {
namespace {

struct Unit {
  const char* name;
  double bytes;
};
constexpr std::array<Unit, 14> kUnits{{{"", 1},
                                       {"b", 1},
                                       {"k", 1e3},
                                       {"kb", 1e3},
                                       {"kib", 0x1p10},
                                       {"m", 1e6},
                                       {"mb", 1e6},
                                       {"mib", 0x1p20},
                                       {"g", 1e9},
                                       {"gb", 1e9},
                                       {"gib", 0x1p30},
                                       {"t", 1e12},
                                       {"tb", 1e12},
                                       {"tib", 0x1p40}}};

}  // namespace

std::uint64_t parse_size(const std::string& text) {
  double number = 0;
  const char* last = text.data() + text.size();
  const auto [end, error] = std::from_chars(text.data(), last, number, std::chars_format::fixed);
  std::string name(end, last);
  name.erase(0, std::min(name.find_first_not_of(' '), name.size()));
  std::transform(name.begin(), name.end(), name.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  const auto unit =
      std::find_if(kUnits.begin(), kUnits.end(), [&](const Unit& u) { return name == u.name; });
  const double bytes = unit == kUnits.end() ? -1 : number * unit->bytes;
  if (error != std::errc{} || unit == kUnits.end() || !(bytes >= 1) || bytes > 0x1p62)
    throw UsageError("'" + text +
                     "' is no size (expected for example 64MiB, 4GiB, 512MB or bytes)");
  return static_cast<std::uint64_t>(std::llround(bytes));
}

std::string format_size(std::uint64_t bytes) {
  constexpr std::array<const char*, 5> names{"bytes", "KiB", "MiB", "GiB", "TiB"};
  double value = static_cast<double>(bytes);
  std::size_t i = 0;
  for (; value >= 1024 && i + 1 < names.size(); ++i) value /= 1024;
  return i == 0 ? fmt::format("{} bytes", bytes) : fmt::format("{:.1f} {}", value, names[i]);
}

}  // namespace cloudrenderer
