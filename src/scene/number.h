#pragma once
#include <algorithm>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string_view>

namespace cloudrenderer {

namespace detail {
// Powers of ten that a double holds exactly.
inline constexpr double kExactPowers[] = {1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,
                                          1e8,  1e9,  1e10, 1e11, 1e12, 1e13, 1e14, 1e15,
                                          1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22};
inline bool is_digit(char c) { return static_cast<unsigned char>(c - '0') < 10; }

// The slow way, for numbers with many digits or extreme exponents. [begin, end) is a well-formed
// number without '+'.
inline float float_from_chars(const char* begin, const char* end) {
  float v = 0;
  if (std::from_chars(begin, end, v).ec != std::errc::result_out_of_range) return v;
  // from_chars does not say which side was left; double tells, with room to spare.
  double d = 0;
  const bool huge = std::from_chars(begin, end, d).ec == std::errc::result_out_of_range
                        ? [&] {  // beyond double: the sign of the exponent decides
                            for (const char* p = begin; p != end; ++p)
                              if (*p == 'e' || *p == 'E') return p[1] != '-';
                            for (const char* p = begin; p != end && *p != '.'; ++p)
                              if (*p >= '1' && *p <= '9') return true;
                            return false;
                          }()
                        : std::fabs(d) > 1;
  const float magnitude = huge ? std::numeric_limits<float>::infinity() : 0.f;
  return *begin == '-' ? -magnitude : magnitude;
}
}  // namespace detail

// Reads a decimal number ("1", "+.5", "-2.", "1e+006") at p and moves p behind it. Gives exactly
// the float nearest to the decimal, as std::from_chars does; infinity when it is too large, 0 when
// it is too small. Returns false, with p where the number breaks off, when there is none.
//
// Method: a mantissa below 2^53 and a power of ten up to 22 are exact doubles, so that one
// operation gives the nearest double (Clinger 1990, "How to Read Floating Point Numbers
// Accurately"). Rounding it again to float is right unless the double lies exactly between two
// floats.
inline bool parse_float(const char*& p, const char* end, float& out) {
  using detail::is_digit;
  const bool plus = p != end && *p == '+';
  p += plus;
  const char* const begin = p;
  const bool negative = !plus && p != end && *p == '-';
  p += negative;
  std::uint64_t mantissa = 0;
  int digits = 0, exponent = 0;  // digits: since the first that is not 0
  const char* const first = p;
  for (; p != end && is_digit(*p); ++p) {
    mantissa = mantissa * 10 + static_cast<std::uint64_t>(*p - '0');
    digits += mantissa != 0;
  }
  std::int64_t count = p - first;
  if (p != end && *p == '.') {
    const char* const fraction = ++p;
    for (; p != end && is_digit(*p); ++p) {
      mantissa = mantissa * 10 + static_cast<std::uint64_t>(*p - '0');
      digits += mantissa != 0;
    }
    count += p - fraction;
    const std::int64_t places = p - fraction;
    exponent = places > 400 ? -400 : -static_cast<int>(places);
  }
  if (count == 0) return false;
  if (p != end && (*p == 'e' || *p == 'E')) {
    ++p;
    const bool minus = p != end && *p == '-';
    if (p != end && (*p == '-' || *p == '+')) ++p;
    if (p == end || !is_digit(*p)) return false;
    int e = 0;
    for (; p != end && is_digit(*p); ++p) e = e < 100000 ? e * 10 + (*p - '0') : e;
    exponent += minus ? -e : e;
  }
  if (digits <= 19 && mantissa <= (std::uint64_t{1} << 53) && exponent >= -22 && exponent <= 22) {
    double d = static_cast<double>(mantissa);
    d = exponent < 0 ? d / detail::kExactPowers[-exponent] : d * detail::kExactPowers[exponent];
    const bool between = (std::bit_cast<std::uint64_t>(d) & 0x1fffffff) == 0x10000000;
    if (!between && ((d >= 1.2e-38 && d <= 3.4e38) || mantissa == 0)) {
      out = static_cast<float>(negative ? -d : d);
      return true;
    }
  }
  out = detail::float_from_chars(begin, p);
  return true;
}

// Reads what printf writes where there is no number, or none that is finite: "nan", "-nan(ind)", "inf", "-1.#IND00". False, with
// p where it was: it is none of these.
inline bool parse_non_finite(const char*& p, const char* end, float& out) {
  const char* at = p;
  const bool negative = at != end && *at == '-';
  at += at != end && (*at == '-' || *at == '+');
  const auto take = [&](std::string_view word) {
    const auto lower = [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; };
    if (static_cast<std::size_t>(end - at) < word.size() || !std::ranges::equal(std::string_view(at, word.size()), word, {}, lower)) return false;
    at += word.size();
    return true;
  };
  out = std::numeric_limits<float>::quiet_NaN();
  if (take("nan")) {
    if (!take("(ind)")) take("(snan)");
  } else if (take("inf")) {
    take("inity");
    out = std::numeric_limits<float>::infinity();
  } else if (take("1.#inf")) {
    out = std::numeric_limits<float>::infinity();
  } else if (!take("1.#ind") && !take("1.#qnan") && !take("1.#snan")) {
    return false;
  }
  while (at != end && detail::is_digit(*at)) ++at;  // "1.#IND00"
  if (negative) out = -out;
  p = at;
  return true;
}

}  // namespace cloudrenderer
