#include "cli/parse_values.h"

#include "cli/size.h"

namespace cloudrenderer {

std::vector<std::string> fields(const std::string& text, char separator) {
  std::vector<std::string> out;
  for (std::size_t at = 0; at <= text.size();) {
    const std::size_t end = std::min(text.find(separator, at), text.size());
    out.push_back(text.substr(at, end - at));
    at = end + 1;
  }
  return out;
}

double duration_option(const std::string& option, const std::string& text) {
  constexpr std::pair<char, double> kUnits[] = {{'s', 1}, {'m', 60}, {'h', 3600}, {'d', 86400}};
  double unit = 1;
  std::string digits = text;
  for (const auto& [letter, seconds] : kUnits)
    if (text.ends_with(letter)) {
      unit = seconds;
      digits.pop_back();
    }
  const auto value = number<double>(digits);
  if (!value || !(*value > 0 && *value <= 1e9)) throw UsageError(option + " is a time like 90s, 45m, 12h or 30d, got '" + text + "'");
  return *value * unit;
}

std::uint64_t size_option(const std::string& option, const std::string& text) {
  try {
    return parse_size(text);
  } catch (const UsageError& e) {
    throw UsageError(option + ": " + e.what());
  }
}

std::pair<std::uint32_t, std::uint32_t> resolution_option(const std::string& text) {
  constexpr std::uint32_t kLargest = 65536;
  const auto wh = fields(text, 'x');
  const auto w = wh.size() == 2 ? number<std::uint32_t>(wh[0]) : std::nullopt;
  const auto h = wh.size() == 2 ? number<std::uint32_t>(wh[1]) : std::nullopt;
  if (!w || !h || *w == 0 || *h == 0 || *w > kLargest || *h > kLargest)
    throw UsageError("--resolution is WIDTHxHEIGHT, for example 640x480, got '" + text + "'");
  return {*w, *h};
}

std::array<float, 4> crop_option(const std::string& text) {
  const auto texts = fields(text, ',');
  std::array<float, 4> crop{};
  bool good = texts.size() == 4;
  for (std::size_t i = 0; good && i < 4; ++i) {
    const auto v = number<float>(texts[i]);
    good = v && *v >= 0 && *v <= 1;
    if (good) crop[i] = *v;
  }
  if (!good || crop[0] >= crop[1] || crop[2] >= crop[3])
    throw UsageError("--crop is X0,X1,Y0,Y1 in [0,1] with X0 < X1 and Y0 < Y1, got '" + text + "'");
  return crop;
}

Dialect dialect_option(const std::string& text) {
  if (text != "v2" && text != "v3" && text != "v4") throw UsageError("--dialect is v2, v3 or v4, got '" + text + "'");
  return text == "v2" ? Dialect::v2 : text == "v3" ? Dialect::v3 : Dialect::v4;
}

}  // namespace cloudrenderer
