#include <charconv>
#include <chrono>
#include <string_view>

#include "service/job.h"

namespace cloudrenderer {
namespace {

constexpr double kLongest = 1e9;  // seconds from now

// So many digits at the front of the text, taken off it.
std::optional<int> digits(std::string_view& text, std::size_t n) {
  int value = 0;
  if (text.size() < n || text.find_first_not_of("0123456789") < n) return std::nullopt;
  std::from_chars(text.data(), text.data() + n, value);
  text.remove_prefix(n);
  return value;
}

bool take(std::string_view& text, char c) {
  if (!text.starts_with(c)) return false;
  text.remove_prefix(1);
  return true;
}

// "YYYY-MM-DDTHH:MM[:SS]" and "Z" or an offset as Unix time.
std::optional<double> iso_time(std::string_view text) {
  const auto year = digits(text, 4);
  if (!year || !take(text, '-')) return std::nullopt;
  const auto month = digits(text, 2);
  if (!month || !take(text, '-')) return std::nullopt;
  const auto day = digits(text, 2);
  if (!day || !(take(text, 'T') || take(text, ' '))) return std::nullopt;
  const auto hour = digits(text, 2);
  if (!hour || *hour > 23 || !take(text, ':')) return std::nullopt;
  const auto minute = digits(text, 2);
  if (!minute || *minute > 59) return std::nullopt;
  int second = 0, offset = 0;
  if (take(text, ':')) {
    const auto s = digits(text, 2);
    if (!s || *s > 60) return std::nullopt;
    second = *s;
  }
  if (!take(text, 'Z')) {
    const int sign = take(text, '+') ? 1 : take(text, '-') ? -1 : 0;
    const auto h = digits(text, 2);
    take(text, ':');
    const auto m = digits(text, 2);
    if (sign == 0 || !h || *h > 23 || !m || *m > 59) return std::nullopt;
    offset = sign * (*h * 3600 + *m * 60);
  }
  const std::chrono::year_month_day date{std::chrono::year(*year), std::chrono::month(static_cast<unsigned>(*month)), std::chrono::day(static_cast<unsigned>(*day))};
  if (!text.empty() || !date.ok()) return std::nullopt;
  return static_cast<double>(std::chrono::sys_days(date).time_since_epoch().count()) * 86400 + *hour * 3600 + *minute * 60 + second - offset;
}

}  // namespace

std::optional<Deadline> parse_deadline(const std::string& text) {
  if (const auto time = iso_time(text)) return Deadline{*time, false, text};
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value, std::chars_format::fixed);
  if (error != std::errc{}) return std::nullopt;
  const std::string_view unit(end, static_cast<std::size_t>(text.data() + text.size() - end));
  for (const auto& [name, seconds] : {std::pair{"", 1}, {"s", 1}, {"m", 60}, {"h", 3600}, {"d", 86400}})
    if (unit == name && value > 0 && value * seconds <= kLongest) return Deadline{value * seconds, true, text};
  return std::nullopt;
}

}  // namespace cloudrenderer
