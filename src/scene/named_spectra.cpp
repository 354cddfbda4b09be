#include "scene/named_spectra.h"

#include "scene/spectrum.h"

namespace cloudrenderer {

namespace {

// Indices of refraction and absorption. Those of silver, aluminium, gold and copper are such that each channel reflects, in air
// and under a coat up to 80 degrees, what Sopra's spectra (refractiveindex.info) do when D65 and the CIE 1931 observer see them:
// within 0.001 (copper and gold 0.005), but for gold's red of 1.02, which no index gives. Of the others the means of the spectra;
// brass by Querry 1985.
struct Metal {
  std::string_view name;
  Rgb eta, k;
};
constexpr Metal kMetals[] = {
    {"Ag", {0.1293f, 0.1263f, 0.1511f}, {4.1105f, 3.3655f, 2.4106f}},
    {"Al", {1.4370f, 0.9359f, 0.5956f}, {7.7623f, 6.6294f, 5.3844f}},
    {"Au", {0.0200f, 0.4014f, 1.5980f}, {15.f, 2.3298f, 1.7265f}},
    {"Cu", {0.1821f, 0.9791f, 1.2135f}, {3.8029f, 2.6248f, 2.3683f}},
    {"CuZn", {0.3685f, 0.5558f, 1.2033f}, {3.0667f, 2.9159f, 2.0117f}},
    {"MgO", {1.7343f, 1.7408f, 1.7542f}, {0.f, 0.f, 0.f}},
    {"TiO2", {2.8689f, 2.9546f, 3.1953f}, {0.f, 0.f, 0.f}},
};

// Indices at 587.6 nm from the makers' data sheets (Schott; F5, F10 and F11 are SF5, SF10, SF11).
struct Glass {
  std::string_view name;
  float eta;
};
constexpr Glass kGlasses[] = {{"BAF10", 1.6700f}, {"BK7", 1.5168f},  {"F10", 1.7283f},
                              {"F11", 1.7847f},   {"F5", 1.6727f},   {"FK51A", 1.4866f},
                              {"LASF9", 1.8503f}, {"SF11", 1.7847f}};

// Chromaticities of CIE standard illuminants for the 2 degree observer (CIE 15:2004, table T.3 and
// appendix), and of the ACES white.
struct Illuminant {
  std::string_view name;
  double x, y;
};
constexpr Illuminant kIlluminants[] = {
    {"illum-acesD60", 0.32168, 0.33767}, {"stdillum-A", 0.44758, 0.40745},
    {"stdillum-D50", 0.34567, 0.35851},  {"stdillum-D65", 0.31272, 0.32903},
    {"stdillum-F1", 0.31310, 0.33727},   {"stdillum-F2", 0.37208, 0.37529},
    {"stdillum-F3", 0.40910, 0.39430},   {"stdillum-F4", 0.44018, 0.40329},
    {"stdillum-F5", 0.31379, 0.34531},   {"stdillum-F6", 0.37790, 0.38835},
    {"stdillum-F7", 0.31292, 0.32933},   {"stdillum-F8", 0.34588, 0.35875},
    {"stdillum-F9", 0.37417, 0.37281},   {"stdillum-F10", 0.34609, 0.35986},
    {"stdillum-F11", 0.38052, 0.37713},  {"stdillum-F12", 0.43695, 0.40441}};

}  // namespace

std::optional<Rgb> named_spectrum(std::string_view name) {
  for (const Illuminant& i : kIlluminants)
    if (name == i.name) return xyz_to_rgb(i.x / i.y, 1, (1 - i.x - i.y) / i.y);
  if (name.starts_with("glass-")) {
    for (const Glass& g : kGlasses)
      if (name.substr(6) == g.name) return Rgb(g.eta);
    return std::nullopt;
  }
  if (!name.starts_with("metal-")) return std::nullopt;
  for (const Metal& m : kMetals) {
    if (name.substr(6) == std::string(m.name) + "-eta") return m.eta;
    if (name.substr(6) == std::string(m.name) + "-k") return m.k;
  }
  return std::nullopt;
}

std::string named_spectra() {
  std::string out;
  const auto add = [&](std::string name) { out += (out.empty() ? "" : ", ") + std::move(name); };
  for (const Metal& m : kMetals) {
    add("metal-" + std::string(m.name) + "-eta");
    add("metal-" + std::string(m.name) + "-k");
  }
  for (const Glass& g : kGlasses) add("glass-" + std::string(g.name));
  for (const Illuminant& i : kIlluminants) add(std::string(i.name));
  return out;
}

}  // namespace cloudrenderer
