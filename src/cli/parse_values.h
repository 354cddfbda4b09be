#pragma once
// Values of options that need more than a conversion. All throw UsageError with a message that names the option.
#include <spdlog/fmt/fmt.h>

#include <array>
#include <charconv>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "base/error.h"
#include "scene/description.h"

namespace cloudrenderer {

template <class T>
std::optional<T> number(std::string_view text) {
  T value{};
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size()) return std::nullopt;
  return value;
}

// A value of at least `least`. CLI11 would take "-1" for a large unsigned number.
template <class T>
T at_least(const std::string& option, const std::string& text, T least) {
  const std::optional<T> v = number<T>(text);
  if (!v || !(*v >= least))
    throw UsageError(fmt::format("{} must be a number of at least {}, got '{}'", option, least, text));
  return *v;
}

std::vector<std::string> fields(const std::string& text, char separator);
double duration_option(const std::string& option, const std::string& text);  // "30", "10m", "12h", "7d": seconds
std::uint64_t size_option(const std::string& option, const std::string& text);
std::pair<std::uint32_t, std::uint32_t> resolution_option(const std::string& text);
std::array<float, 4> crop_option(const std::string& text);
Dialect dialect_option(const std::string& text);

}  // namespace cloudrenderer
