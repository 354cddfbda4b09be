#include "scene/spectrum.h"

#include <algorithm>
#include <array>
#include <numeric>

#include "base/portable_math.h"
#include "scene/cie1931.h"
#include "scene/lexer.h"

namespace cloudrenderer {

namespace {

// pbrt-v3's value of the integral of the CIE's y, kept to its digits.
constexpr double kCieYIntegral = 106.856895;

void sort_by_wavelength(SampledSpectrum& s) {
  if (std::is_sorted(s.wavelengths.begin(), s.wavelengths.end())) return;
  std::vector<std::size_t> order(s.wavelengths.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return s.wavelengths[a] < s.wavelengths[b];
  });
  SampledSpectrum sorted;
  for (const std::size_t i : order) {
    sorted.wavelengths.push_back(s.wavelengths[i]);
    sorted.values.push_back(s.values[i]);
  }
  s.wavelengths = std::move(sorted.wavelengths);
  s.values = std::move(sorted.values);
}

double value_at(const SampledSpectrum& s, double wavelength) {
  if (s.ends && (wavelength < s.wavelengths.front() || wavelength > s.wavelengths.back())) return 0;
  if (wavelength <= s.wavelengths.front()) return s.values.front();
  if (wavelength >= s.wavelengths.back()) return s.values.back();
  const auto above = std::upper_bound(s.wavelengths.begin(), s.wavelengths.end(), wavelength);
  const auto i = static_cast<std::size_t>(above - s.wavelengths.begin());
  const double t = (wavelength - s.wavelengths[i - 1]) / (s.wavelengths[i] - s.wavelengths[i - 1]);
  return s.values[i - 1] * (1 - t) + s.values[i] * t;
}

// CIE standard illuminant D65 from 360 nm in steps of 10 nm (ISO 11664-2).
constexpr double kD65Step = 10;
constexpr std::array kD65{
    46.6383, 52.0891, 49.9755, 54.6482, 82.7549, 91.4860, 93.4318, 86.6823, 104.865, 117.008,
    117.812, 114.861, 115.923, 108.811, 109.354, 107.802, 104.790, 107.689, 104.405, 104.046,
    100.000, 96.3342, 95.7880, 88.6856, 90.0062, 89.5991, 87.6987, 83.2886, 83.6992, 80.0268,
    80.2146, 82.2778, 78.2842, 69.7213, 71.6091, 74.3490, 61.6040, 69.8856, 75.0870, 63.5927,
    46.4182, 66.8054, 63.3828, 64.3040, 59.4519, 51.9590, 57.4406, 60.3125};

double d65(double wavelength) {
  const double at = (wavelength - kCieFirst) / kD65Step;
  const std::size_t i = std::min(static_cast<std::size_t>(at), kD65.size() - 2);
  const double t = at - static_cast<double>(i);
  return kD65[i] * (1 - t) + kD65[i + 1] * t;
}

// Applies the observer to value(wavelength).
template <class F>
Rgb observe(F value, Dialect dialect) {
  double xyz[3] = {0, 0, 0}, y_sum = 0;
  for (std::size_t i = 0; i < kCie1931.size(); ++i) {
    const double v = value(static_cast<double>(kCieFirst) + static_cast<double>(i));
    for (std::size_t c = 0; c < 3; ++c) xyz[c] += v * kCie1931[i][c];
    y_sum += kCie1931[i][1];
  }
  const double scale =
      dialect == Dialect::v2 ? 1 / y_sum : (kCieSamples - 1) / (kCieYIntegral * kCieSamples);
  return xyz_to_rgb(xyz[0] * scale, xyz[1] * scale, xyz[2] * scale);
}

}  // namespace

Rgb xyz_to_rgb(double x, double y, double z) {
  return {static_cast<float>(3.240479 * x - 1.537150 * y - 0.498535 * z),
          static_cast<float>(-0.969256 * x + 1.875991 * y + 0.041556 * z),
          static_cast<float>(0.055648 * x - 0.204043 * y + 1.057311 * z)};
}

Rgb spectrum_to_rgb(SampledSpectrum spectrum, Dialect dialect) {
  if (spectrum.wavelengths.empty()) return Rgb(0.f);
  sort_by_wavelength(spectrum);
  return observe([&](double wavelength) { return value_at(spectrum, wavelength); }, dialect);
}

bool SampledSpectrum::covers_all() const {
  const auto [least, most] = std::minmax_element(wavelengths.begin(), wavelengths.end());
  return *least <= 360 && *most >= 830;
}

Rgb reflectance_to_rgb(SampledSpectrum spectrum) {
  if (spectrum.wavelengths.empty()) return Rgb(0.f);
  // Grey exactly: media with the same rate in all channels cost less.
  const auto& v = spectrum.values;
  if ((!spectrum.ends || spectrum.covers_all()) && std::all_of(v.begin(), v.end(), [&](double x) { return x == v.front(); })) return Rgb(static_cast<float>(v.front()));
  sort_by_wavelength(spectrum);
  static const float white = luminance(observe(d65, Dialect::v2));
  return observe([&](double w) { return value_at(spectrum, w) * d65(w); }, Dialect::v2) / white;
}

Rgb illuminant_to_rgb(SampledSpectrum spectrum) {
  const Rgb c = spectrum_to_rgb(std::move(spectrum), Dialect::v2);
  const float y = luminance(c);
  return y > 0.f ? c / y : Rgb(0.f);
}

Rgb blackbody_to_rgb(double kelvin, Dialect dialect) {
  if (!(kelvin > 0)) return Rgb(0.f);
  kelvin = std::min(kelvin, 1e9);  // beyond that exp(x) - 1 loses its digits
  // hc/k in nm K: pbrt-v2's rounded value, and from the 2010 CODATA constants that v3 names.
  const double c2 =
      dialect == Dialect::v2 ? 1.4388e7 : 6.62606957e-34 * 299792458 / 1.3806488e-23 * 1e9;
  const double reference = dialect == Dialect::v2 ? 555.0 : 2.8977721e-3 / kelvin * 1e9;
  const auto planck = [&](double wavelength) {
    const double w = wavelength / 555.0;
    return 1 / (w * w * w * w * w * (portable::exp(c2 / (wavelength * kelvin)) - 1));
  };
  const double norm = planck(reference);
  if (!(norm > 0)) return Rgb(0.f);  // colder than anything that glows
  return observe([&](double wavelength) { return planck(wavelength) / norm; }, dialect);
}

SampledSpectrum read_spd(const std::string& path, const FileLocation& where) {
  auto text = SourceText::open(path);
  if (!text) throw SceneError(where, text.error());
  Lexer lexer(*text);
  SampledSpectrum out;
  for (Token t = lexer.next(); t.kind != Token::Kind::end; t = lexer.next()) {
    out.wavelengths.push_back(lexer.to_double(t));
    const Token value = lexer.next();
    if (value.kind == Token::Kind::end)
      throw SceneError(lexer.location(value), "the last wavelength of the spectrum has no value");
    out.values.push_back(lexer.to_double(value));
    if (!std::isfinite(out.wavelengths.back()) || !std::isfinite(out.values.back()))
      throw SceneError(lexer.location(t), "the number is too large");
  }
  if (out.values.empty())
    throw SceneError(where, "the spectrum file '" + path + "' has no samples");
  return out;
}

}  // namespace cloudrenderer
