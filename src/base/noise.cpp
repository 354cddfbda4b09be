#include "base/noise.h"

#include <array>
#include <cstdint>

namespace cloudrenderer {
namespace {

// The permutation of Perlin's reference implementation of 2002.
constexpr std::array<std::uint8_t, 256> kPermutation{
    151, 160, 137, 91,  90,  15,  131, 13,  201, 95,  96,  53,  194, 233, 7,   225,  //
    140, 36,  103, 30,  69,  142, 8,   99,  37,  240, 21,  10,  23,  190, 6,   148,  //
    247, 120, 234, 75,  0,   26,  197, 62,  94,  252, 219, 203, 117, 35,  11,  32,   //
    57,  177, 33,  88,  237, 149, 56,  87,  174, 20,  125, 136, 171, 168, 68,  175,  //
    74,  165, 71,  134, 139, 48,  27,  166, 77,  146, 158, 231, 83,  111, 229, 122,  //
    60,  211, 133, 230, 220, 105, 92,  41,  55,  46,  245, 40,  244, 102, 143, 54,   //
    65,  25,  63,  161, 1,   216, 80,  73,  209, 76,  132, 187, 208, 89,  18,  169,  //
    200, 196, 135, 130, 116, 188, 159, 86,  164, 100, 109, 198, 173, 186, 3,   64,   //
    52,  217, 226, 250, 124, 123, 5,   202, 38,  147, 118, 126, 255, 82,  85,  212,  //
    207, 206, 59,  227, 47,  16,  58,  17,  182, 189, 28,  42,  223, 183, 170, 213,  //
    119, 248, 152, 2,   44,  154, 163, 70,  221, 153, 101, 155, 167, 43,  172, 9,    //
    129, 22,  39,  253, 19,  98,  108, 110, 79,  113, 224, 232, 178, 185, 112, 104,  //
    218, 246, 97,  228, 251, 34,  242, 193, 238, 210, 144, 12,  191, 179, 162, 241,  //
    81,  51,  145, 235, 249, 14,  239, 107, 49,  192, 214, 31,  181, 199, 106, 157,  //
    184, 84,  204, 176, 115, 121, 50,  45,  127, 4,   150, 254, 138, 236, 205, 93,   //
    222, 114, 67,  29,  24,  72,  243, 141, 128, 195, 78,  66,  215, 61,  156, 180};

std::uint8_t hash(unsigned x, unsigned y, unsigned z) {
  const auto at = [](unsigned i) { return kPermutation[i & 255u]; };
  return at(at(at(x) + y) + z);
}

// The part of a lattice point's gradient along d. Twelve of the gradients point to the edges of a
// cube; which four are doubled is pbrt's choice (Perlin's differ in two).
float along_gradient(std::uint8_t hashed, const Vec3& d) {
  const unsigned h = hashed & 15u;
  const bool last = h == 12u || h == 13u;
  const float u = h < 8u || last ? d.x : d.y, v = h < 4u || last ? d.y : d.z;
  return (h & 1u ? -u : u) + (h & 2u ? -v : v);
}

float fade(float t) { return t * t * t * (t * (t * 6.f - 15.f) + 10.f); }
float lerp(float t, float a, float b) { return (1.f - t) * a + t * b; }

}  // namespace

float noise(const Vec3& p) {
  if (!is_finite(p)) return 0.f;
  const Vec3 low = glm::floor(p), d = p - low;
  const Vec3 cell = low - 256.f * glm::floor(low * (1.f / 256));  // exact, also for huge numbers
  const auto x = static_cast<unsigned>(cell.x), y = static_cast<unsigned>(cell.y),
             z = static_cast<unsigned>(cell.z);
  const auto corner = [&](unsigned i, unsigned j, unsigned k) {
    const Vec3 from(static_cast<float>(i), static_cast<float>(j), static_cast<float>(k));
    return along_gradient(hash((x + i) & 255u, (y + j) & 255u, (z + k) & 255u), d - from);
  };
  const float u = fade(d.x), v = fade(d.y), w = fade(d.z);
  const auto along_x = [&](unsigned j, unsigned k) {
    return lerp(u, corner(0, j, k), corner(1, j, k));
  };
  return lerp(w, lerp(v, along_x(0, 0), along_x(1, 0)), lerp(v, along_x(0, 1), along_x(1, 1)));
}

}  // namespace cloudrenderer
