#pragma once
// Hard cases with a known answer, as tests and as rows of a table.
//
//   TEST(Spheres, FarAway) {
//     const std::uint64_t n = rays(20'000, 10'000'000);   // in the ordinary run, in the full one
//     ...
//     record("sphere 1e7 radii from the origin", "distance to the surface / p_error", 1.0, worst, n);
//   }
//
// record() fails the test where the measured value is above the bound (or NaN), and appends a row to the file that the
// environment variable CLOUDRENDERER_STABILITY_TABLE names. tools/stability_table.py sets it, runs the program and makes
// the table. CLOUDRENDERER_STABILITY=full chooses the full counts (the ctest `stability.full`, label slow).
// A failure of the format itself, which no renderer of that format can mend, is a `limit`: its row says so, and its bound
// is what was found when the row was written, so that it cannot grow unseen.
#include <gtest/gtest.h>

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <string>
#include <string_view>

namespace cloudrenderer::stability {

inline bool full() {
  const char* const mode = std::getenv("CLOUDRENDERER_STABILITY");
  return mode && std::string_view(mode) == "full";
}
inline std::uint64_t rays(std::uint64_t ordinary, std::uint64_t in_full) { return full() ? in_full : ordinary; }

enum class Kind { bound, limit };

// `name`: what was tried, the row's first column; `quantity`: what is bounded, with its unit; `count`: rays, samples, ...
// Neither text may hold a tab or "|".
inline void record(const std::string& name, const std::string& quantity, double bound, double measured, std::uint64_t count,
                   Kind kind = Kind::bound) {
  EXPECT_LE(measured, bound) << name << ": " << quantity << " in " << count << " tries";
  EXPECT_GT(count, 0u) << name << ": nothing was tried";
  const char* const path = std::getenv("CLOUDRENDERER_STABILITY_TABLE");
  if (!path) return;
  const auto number = [](double x) {
    char text[32];
    std::snprintf(text, sizeof text, "%.4g", x);
    return std::string(text);
  };
  const std::string row = name + '\t' + quantity + '\t' + number(bound) + '\t' + number(measured) + '\t' +
                          std::to_string(count) + '\t' + (kind == Kind::limit ? "limit" : "bound") + '\n';
  std::ofstream file(path, std::ios::app);
  file << row << std::flush;
  EXPECT_TRUE(file.good()) << "cannot write " << path;
}
inline void record_limit(const std::string& name, const std::string& quantity, double bound, double measured, std::uint64_t count) {
  record(name, quantity, bound, measured, count, Kind::limit);
}

}  // namespace cloudrenderer::stability
