#include "scene/named_spectra.h"

#include "scene/spectrum.h"

namespace cloudrenderer {

namespace {

// Indices of refraction and absorption, seen by the CIE 1931 observer in equal-energy light, before
// they are divided by what the observer sees of a constant. Measured spectra of the Sopra database
// (refractiveindex.info); brass by Querry 1985.
struct Metal {
  std::string_view name;
  Rgb eta, k;
};
constexpr Metal kMetals[] = {
    {"Ag", {0.155265f, 0.116723f, 0.138381f}, {4.828348f, 3.122243f, 2.146958f}},
    {"Al", {1.657460f, 0.880366f, 0.521230f}, {9.223886f, 6.269517f, 4.837018f}},
    {"Au", {0.143125f, 0.374939f, 1.442507f}, {3.983177f, 2.385724f, 1.603214f}},
    {"Cu", {0.200416f, 0.924046f, 1.102216f}, {3.912948f, 2.452838f, 2.142199f}},
    {"CuZn", {0.444f, 0.527f, 1.094f}, {3.695f, 2.765f, 1.829f}},
    {"MgO", {2.089652f, 1.650714f, 1.594882f}, {0.f, 0.f, 0.f}},
    {"TiO2", {3.456626f, 2.801706f, 2.905160f}, {0.f, 0.f, 0.f}},
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
  static const Rgb white = spectrum_to_rgb({{500}, {1}}, Dialect::v2);
  for (const Metal& m : kMetals) {
    if (name.substr(6) == std::string(m.name) + "-eta") return m.eta / white;
    if (name.substr(6) == std::string(m.name) + "-k") return m.k / white;
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
