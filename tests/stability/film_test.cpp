// What sums and filters make of many, of large and small, and of negative contributions.
#include "film/camera.h"
#include "../film_support.h"
#include "picture.h"
#include "quadrature.h"
#include "record.h"

namespace cloudrenderer::stability {
namespace {

Film one_pixel() { return Film({1, 1, 0, 0, 1, 1}, 30); }

// Contributions c(sample) to one pixel, against the mean of what was given.
template <class Contribution>
double sum_error(std::uint64_t n, Contribution c) {
  Film film = one_pixel();
  long double sum = 0;
  bool clamped = false;
  for (std::uint64_t s = 0; s < n; ++s) {
    const float x = c(s);
    sum += static_cast<long double>(x);
    film.at(0, 0).add(quantise(Rgb(x), fixed_units(film.k()), clamped), static_cast<std::uint32_t>(s));
  }
  EXPECT_FALSE(clamped);
  const PixelSums& p = film.at(0, 0);
  EXPECT_EQ(std::uint64_t{p.count[0]} + p.count[1], n);
  const auto exact = static_cast<double>(sum / static_cast<long double>(n));
  return std::fabs(static_cast<double>(film.image(1.f).pixels[0].x) / exact - 1);
}

TEST(FilmSums, OfManySamples) {
  const std::uint64_t n = rays(1 << 20, 1 << 24);
  // The picture is rounded to float once.
  record("film: 2^24 samples of 0.1 in a pixel", "relative error of the mean", 6.1e-8, sum_error(n, [](std::uint64_t) { return 0.1f; }), n);
  record("film: 1e6 once in 1000 samples of 1e-6", "relative error of the mean", 6.1e-8,
         sum_error(n, [](std::uint64_t s) { return s % 1000 == 7 ? 1e6f : 1e-6f; }), n);
  // A pixel of nothing but small contributions: half a unit of 2^-30 each at most.
  record("film: samples of 1e-6 only", "relative error of the mean", 0x1p-31 / 1e-6, sum_error(n, [](std::uint64_t) { return 1e-6f; }), n);
  record("film: samples of +1e6 and -1e6 and one of 1e-6 in 1024", "relative error of the mean", 0x1p-31 / 1e-6 + 6.1e-8,
         sum_error(n, [](std::uint64_t s) { return s % 1024 == 0 ? 1e-6f : s % 1024 == 1023 ? 0.f : s % 2 ? 1e6f : -1e6f; }), n);
}

// Through the renderer: a pixel of a white sky, of as many samples as a scene may ask for.
TEST(FilmSums, OfManyPaths) {
  const std::uint64_t n = rays(1 << 16, 1 << 24);
  const Picture p = render(header("0 0 0  0 0 1  0 1 0", 1, n, 1) + "LightSource \"infinite\" \"rgb L\" [.1 .1 .1]\nWorldEnd\n");
  EXPECT_EQ(p.samples, n);
  record("pixel of an even sky, 2^24 paths", "relative error of the mean", 6.1e-8, std::fabs(p.mean() / static_cast<double>(0.1f) - 1), p.samples);
}

struct Axis {
  const char* type;
  Dialect dialect;
  double width;
  double (*f)(double);
};
double sinc(double x) { return x == 0 ? 1 : std::sin(kPiDouble * x) / (kPiDouble * x); }
double mitchell(double x) {  // B = C = 1/3
  x = std::fabs(x);
  return x < 1 ? (7 * x * x * x - 12 * x * x + 16. / 3) / 6 : (-7. / 3 * x * x * x + 12 * x * x - 20 * x + 32. / 3) / 6;
}
constexpr Axis kAxes[] = {
    {"box", Dialect::v3, 0.5, [](double) { return 1.0; }},
    {"triangle", Dialect::v3, 2, [](double x) { return 2 - std::fabs(x); }},
    {"gaussian", Dialect::v3, 2, [](double x) { return std::exp(-2 * x * x) - std::exp(-8.0); }},
    {"mitchell", Dialect::v3, 2, mitchell},
    {"sinc", Dialect::v2, 4, [](double x) { return sinc(0.75 * x) * sinc(x / 4); }},
    {"sinc", Dialect::v3, 4, [](double x) { return sinc(x) * sinc(x / 3); }},
};

// Filters are products, so that one axis at a time is enough: f's moments, and the samples'.
TEST(FilmFilters, SampledAreTheirFormulas) {
  constexpr int kSteps = 1 << 16;
  for (const Axis& axis : kAxes) {
    Warnings warnings;
    const auto filter = Filter::build(test::entity(axis.type, {}), warnings, axis.dialect);
    std::array<double, 3> of_filter{}, of_samples{}, of_other_axis{};
    for (int i = 0; i < kSteps; ++i) {
      const double at = (i + 0.5) / kSteps, x = axis.width * (2 * at - 1), value = axis.f(x) * 2 * axis.width / kSteps;
      const auto add = [](std::array<double, 3>& to, double w, double p) {
        to[0] += w;
        to[1] += w * p;
        to[2] += w * p * p;
      };
      add(of_filter, value, x);
      // +-1 over the mean of the signs: of both axes together, and the root of one.
      const FilterLobes lobes = filter->lobes();
      const double weight = (lobes.above + lobes.below) / kSteps;
      Vec2 u(static_cast<float>(at), 0.5f);
      add(of_samples, filter->negative(u) ? -weight : weight, static_cast<double>(filter->sample(u).x));
      u = {0.5f, static_cast<float>(at)};
      add(of_other_axis, filter->negative(u) ? -weight : weight, static_cast<double>(filter->sample(u).y));
    }
    const double other = std::sqrt(filter->lobes().above + filter->lobes().below);
    double worst = 0, moments = 0;
    for (const auto& sampled : {of_samples, of_other_axis}) {
      worst = std::max(worst, std::fabs(sampled[0] / other - 1));
      for (const std::size_t m : {1u, 2u})
        moments = std::max(moments, std::fabs(sampled[m] / other - of_filter[m] / of_filter[0]) / axis.width);
    }
    const std::string name = std::string("filter ") + axis.type + (axis.dialect == Dialect::v2 ? " (v2)" : "");
    record(name, "1 - the integral of its samples' weights", 1e-4, worst, kSteps);
    record(name, "error of its first two moments / width", 1e-4, moments, kSteps);
  }
}

// A closed white box that shines everywhere, seen through a filter with negative lobes: every sample has the same
// radiance, at whatever depth it is gathered, so the pixel has it too if no path is treated differently for its sign.
std::string shining_box() {
  const std::string text = "Texture \"all\" \"float\" \"constant\" \"float value\" [1]\nMaterial \"matte\" \"rgb Kd\" [.9 .9 .9]\n"
                     "AreaLightSource \"diffuse\" \"rgb L\" [1 1 1]\n";
  const std::string box = "Shape \"trianglemesh\" \"texture alpha\" \"all\" \"point P\" [-1 -1 -1  1 -1 -1  1 1 -1  -1 1 -1  -1 -1 1  1 -1 1  1 1 1  -1 1 1] "
                          "\"integer indices\" [0 1 2 0 2 3  4 6 5 4 7 6  0 5 1 0 4 5  3 2 6 3 6 7  0 3 7 0 7 4  1 6 2 1 5 6]\n";
  return text + box;
}

TEST(FilmFilters, NegativeWeightsLiveAsLongAsOthers) {
  const std::uint64_t spp = rays(4096, 65536);
  for (const std::string type : {"mitchell", "sinc"}) {
    const Picture p = render_cut(header("0 0 0  1 .2 .1  0 0 1", 2, spp, 30, 40, "PixelFilter \"" + type + "\"\n") + shining_box() + "WorldEnd\n",
                                 Dialect::v3, 1 << 26);
    double exact = 0, power = 1;
    for (int i = 0; i <= 30; ++i, power *= static_cast<double>(0.9f)) exact += power;
    record("filter " + type + " in front of a shining box, albedo 0.9, depth 30", "relative error of the mean", full() ? 2e-3 : 2e-2,
           std::fabs(p.mean() / exact - 1), p.samples);
  }
}

}  // namespace
}  // namespace cloudrenderer::stability
