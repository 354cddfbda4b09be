// Pictures of lights and furnaces whose radiance is known: white rooms a thousand bounces deep, tiny and huge lights, a sun
// in an environment map, colours that are negative.
#include "../shading_lights_support.h"
#include "picture.h"
#include "quadrature.h"
#include "record.h"

namespace cloudrenderer::stability {
namespace {

std::string number(double x) {
  char text[40];
  std::snprintf(text, sizeof text, "%.17g", x);
  return text;
}

// A closed box, seen from inside, that shines with 1 everywhere. With an alpha texture no light is sampled in pbrt-v4, so that every
// bounce finds exactly 1: the radiance after n bounces is n + 1, and one path that is lost or doubled is seen.
std::string box(const std::string& material, bool sampled) {
  return std::string(sampled ? "" : "Texture \"all\" \"float\" \"constant\" \"float value\" [1]\n") + material +
         "\nAreaLightSource \"diffuse\" \"rgb L\" [1 1 1]\nShape \"trianglemesh\" " + (sampled ? "" : "\"texture alpha\" \"all\" ") +
         "\"point P\" [-1 -1 -1  1 -1 -1  1 1 -1  -1 1 -1  -1 -1 1  1 -1 1  1 1 1  -1 1 1] "
         "\"integer indices\" [0 1 2 0 2 3  4 6 5 4 7 6  0 5 1 0 4 5  3 2 6 3 6 7  0 3 7 0 7 4  1 6 2 1 5 6]\n";
}

TEST(Furnaces, AThousandBouncesDeep) {
  const std::uint64_t spp = rays(4, 1024);
  // As the parser writes pbrt-v4's films.
  const std::string start = header("0 0 0  1 .2 .1  0 0 1", 4, spp, 1000, 40,
                                   "Film \"image\" \"integer xresolution\" [4] \"integer yresolution\" [4] \"string filename\" \"a.exr\" "
                                   "\"bool keepsnegative\" \"true\"\n");
  for (const auto& [name, material] : {std::pair<std::string, std::string>{"matte, albedo 1", "Material \"matte\" \"rgb Kd\" [1 1 1]"},
                                       {"mirror, albedo 1", "Material \"mirror\" \"rgb Kr\" [1 1 1]"},
                                       {"rough matte, albedo 1", "Material \"matte\" \"rgb Kd\" [1 1 1] \"float sigma\" [1e-5]"},
                                       {"black", "Material \"matte\" \"rgb Kd\" [0 0 0]"}}) {
    const Picture p = render(start + box(material, false) + "WorldEnd\n", Dialect::v3, 1500);
    const double exact = name == "black" ? 1 : 1001;
    record("shining box, " + name + ", depth 1000", "relative error of the energy", 1e-4, std::fabs(p.mean() / exact - 1), p.samples);
  }
  // The same with light samples, weighted against the others: noise of its own.
  const Picture p = render(header("0 0 0  1 .2 .1  0 0 1", 4, rays(4, 512), 1000) + box("Material \"matte\" \"rgb Kd\" [1 1 1]", true) + "WorldEnd\n");
  record("shining box, matte, albedo 1, depth 1000, lights sampled", "relative error of the energy", full() ? 1e-3 : 2e-2, std::fabs(p.mean() / 1001 - 1), p.samples);
}

// Glass in a white furnace cannot be seen.
TEST(Furnaces, GlassIsInvisible) {
  for (const double index : {1.0, 1.000001, 1.5, 3.0}) {
    const Picture p = render(header("0 -3 0.2  0 0 0  0 0 1", 8, rays(16, 1024), 1000) + "LightSource \"infinite\" \"color L\" [1 1 1]\n" +
                             "Material \"glass\" \"float index\" [" + number(index) + "]\nShape \"sphere\"\nShape \"sphere\" \"float radius\" [.5]\n" + "WorldEnd\n",
                             Dialect::v2);
    double worst = 0;
    for (const Rgb& c : p.film.image(1.f).pixels) worst = std::max(worst, std::fabs(static_cast<double>(c.y) - 1));
    record("spheres of glass in a white furnace, index " + number(index), "error of the worst pixel", 1e-3, worst, p.samples);
  }
}

TEST(Furnaces, RoughGlassOfIndexOneIsInvisible) {
  const Picture p = render(header("0 -3 0.2  0 0 0  0 0 1", 8, rays(16, 1024), 100) + "LightSource \"infinite\" \"rgb L\" [1 1 1]\n" +
                           "Material \"glass\" \"float eta\" [1] \"float uroughness\" [.3] \"float vroughness\" [.3]\nShape \"sphere\"\nWorldEnd\n");
  double worst = 0;
  for (const Rgb& c : p.film.image(1.f).pixels) worst = std::max(worst, std::fabs(static_cast<double>(c.y) - 1));
  record("sphere of rough glass in a white furnace, index 1", "error of the worst pixel", 1e-3, worst, p.samples);
}

// A long way of open white tube: light that comes in goes out.
TEST(Furnaces, OpenTubeIsInvisible) {
  const Picture p = render(header("0 0 0  1 .2 .3  0 0 1", 8, rays(256, 65536), 1000) + "LightSource \"infinite\" \"rgb L\" [1 1 1]\n" +
                           "Material \"matte\" \"rgb Kd\" [1 1 1]\nShape \"cylinder\" \"float radius\" [1] \"float zmin\" [-3] \"float zmax\" [3]\nWorldEnd\n");
  record("open white tube in a white furnace, depth 1000", "relative error of the energy", full() ? 1e-3 : 3e-2, std::fabs(p.mean() - 1), p.samples);
}

// Normals that are turned against the surface, as far as they come: in a furnace nothing changes.
TEST(Furnaces, NormalsThatOpposeTheSurface) {
  for (const auto& [name, n] : {std::pair<std::string, std::string>{"along", "0 0 1"}, {"opposed", "0 0 -1"}, {"60 degrees off", ".8660254 0 .5"},
                                {"89 degrees off", ".9998477 0 .0174524"}, {"120 degrees off", ".8660254 0 -.5"}}) {
    std::string normals;
    for (int i = 0; i < 4; ++i) normals += n + "  ";
    const Picture p = render(header("0 -2 2  0 0 0  0 0 1", 2, rays(4096, 1 << 18), 1, 5) + "LightSource \"infinite\" \"rgb L\" [1 1 1]\n" +
                             "Material \"matte\" \"rgb Kd\" [1 1 1]\nShape \"trianglemesh\" \"point P\" [-9 -9 0  9 -9 0  9 9 0  -9 9 0] \"normal N\" [" + normals +
                             "] \"integer indices\" [0 1 2 0 2 3]\nWorldEnd\n");
    record("white plane in a white furnace, normals " + name, "relative error of the energy", full() ? 1e-3 : 3e-2, std::fabs(p.mean() - 1), p.samples);
  }
}

// The radiance of a white diffuse floor at the origin. The light may not be seen itself.
double floor_radiance(const std::string& light, std::uint64_t spp, std::uint64_t& samples) {
  const Picture p = render(header(".1 0 .1  0 0 0  0 0 1", 1, spp, 1, 1e-4) +
                           "AttributeBegin\n" + light + "AttributeEnd\nMaterial \"matte\" \"rgb Kd\" [1 1 1]\n" +
                           "Shape \"trianglemesh\" \"point P\" [-5 -5 0  5 -5 0  5 5 0  -5 5 0] \"integer indices\" [0 1 2 0 2 3]\nWorldEnd\n");
  samples = p.samples;
  return p.mean();
}

TEST(Lights, SpheresFromTinyToHuge) {
  struct Ball {
    double radius, distance;
    double bound;
  };
  // 1e-9 steradian at 1.784e-5 radii a distance. The last ones are much larger than their distance from the floor.
  for (const Ball& b : {Ball{1e-12, 1, 1e-3}, {1e-9, 1, 1e-3}, {1.784124e-5, 1, 1e-3}, {1.784124e-2, 1e3, 1e-3}, {0.01, 1, 1e-3}, {0.5, 1, 1e-3}, {100, 101, 1e-3}, {1e4, 10001, 2e-3}}) {
    std::uint64_t samples;
    // As strong as one of radius 1e-2 at a distance of 1 would be.
    const double l = b.radius < 0.1 ? 1e-4 * (b.distance / b.radius) * (b.distance / b.radius) : 1;
    const double seen = floor_radiance("AreaLightSource \"diffuse\" \"rgb L\" [" + number(l) + " " + number(l) + " " + number(l) + "]\nTranslate 0 0 " + number(b.distance) +
                                       "\nMaterial \"matte\" \"rgb Kd\" [0 0 0]\nShape \"sphere\" \"float radius\" [" + number(b.radius) + "]\n",
                                       rays(4096, 1 << 18), samples);
    const double exact = l * (b.radius / b.distance) * (b.radius / b.distance);
    record("sphere light of radius " + number(b.radius) + " at " + number(b.distance), "relative error of the light on a floor", full() ? b.bound : 4 * b.bound, std::fabs(seen / exact - 1), samples);
  }
}

TEST(Lights, SquaresFromTinyToHuge) {
  for (const double half : {1e-9, 1.58e-5, 0.01, 1.0, 100.0, 1e6}) {
    std::uint64_t samples;
    const double l = half < 0.1 ? 1e-4 / (half * half) : 1;
    const std::string h = number(half), m = number(-half);
    const double seen = floor_radiance("AreaLightSource \"diffuse\" \"rgb L\" [" + number(l) + " " + number(l) + " " + number(l) + "]\nMaterial \"matte\" \"rgb Kd\" [0 0 0]\n" +
                                       "Shape \"trianglemesh\" \"point P\" [" + m + " " + m + " 1  " + m + " " + h + " 1  " + h + " " + h + " 1  " + h + " " + m + " 1] \"integer indices\" [0 1 2 0 2 3]\n",
                                       rays(4096, 1 << 18), samples);
    // Four times the form factor of a rectangle over one of its corners (any text book of heat transfer).
    const double x = half, a = std::sqrt(1 + x * x), exact = l * 4 * (2 * x / a * std::atan(x / a)) / (2 * kPiDouble);
    record("square light of half side " + h + " at 1", "relative error of the light on a floor", full() ? 1e-3 : 1e-2, std::fabs(seen / exact - 1), samples);
  }
}

// A sun of 1e5 to 1, bilinear as it is looked up, at an angle and overhead, where the map is narrow.
TEST(Lights, SunInAnEnvironmentMap) {
  constexpr int kWidth = 256, kHeight = 128;
  for (const int row : {30, 0}) {
    const test::MapFile map(kWidth, kHeight, [&](int x, int y) { return Rgb(x == 77 && y == row ? 1e5f : 1.f); });
    double exact = 0, cosines = 0;
    constexpr int kFine = 16;  // of each half texel
    const auto texel = [&](int x, int y) { return ((x % kWidth) + kWidth) % kWidth == 77 && ((y % kHeight) + kHeight) % kHeight == row ? 1e5 : 1.0; };
    for (int y = 0; y < kHeight * kFine; ++y) {
      const double v = (y + 0.5) / kFine, theta = kPiDouble * v / kHeight;
      if (theta > kPiDouble / 2) break;
      const double w = std::sin(theta) * std::cos(theta);
      double row_sum = 0;
      const int y0 = static_cast<int>(std::floor(v - 0.5));
      const double dy = v - 0.5 - y0;
      for (int x = 0; x < kWidth; ++x) {  // a row of bilinear values has the mean of its texels
        row_sum += (1 - dy) * texel(x, y0) + dy * texel(x, y0 + 1);
      }
      exact += w * row_sum;
      cosines += w * kWidth;
    }
    exact /= cosines;  // of an even sky of 1
    std::uint64_t samples;
    const double seen = floor_radiance("LightSource \"infinite\" \"string mapname\" [\"" + map.path() + "\"]\n", rays(1 << 14, 1 << 20), samples);
    record(std::string("sun of 1e5 to 1 in an environment map, ") + (row ? "at an angle" : "overhead"), "relative error of the light on a floor", full() ? 1e-3 : 1e-2,
           std::fabs(seen / exact - 1), samples);
  }
}

// A narrow band of wavelengths lies outside of what RGB can show: channels would be negative.
TEST(Lights, NegativeColoursAreNone) {
  const std::string teal = "\"spectrum L\" [480 0 490 1 505 1 515 0]", green = "\"spectrum I\" [515 0 520 1 530 1 535 0]";
  for (const auto& [name, light] : {std::pair<std::string, std::string>{"a point", "LightSource \"point\" " + green + " \"point from\" [0 0 2]\n"},
                                    {"a sphere", "AreaLightSource \"diffuse\" " + teal + "\nTranslate 0 0 2\nShape \"sphere\" \"float radius\" [.5]\n"},
                                    {"the sky", "LightSource \"infinite\" " + teal + "\n"},
                                    {"a sphere of negative rgb", "AreaLightSource \"diffuse\" \"rgb L\" [-3 1 -3]\nTranslate 0 0 2\nShape \"sphere\" \"float radius\" [.5]\n"}}) {
    const Picture p = render_cut(header("1 0 1  0 0 0  0 0 1", 8, 64, 3, 60) + "AttributeBegin\n" + light +
                                 "AttributeEnd\nMaterial \"matte\" \"spectrum Kd\" [480 0 490 1 505 1 515 0]\n"
                                 "Shape \"trianglemesh\" \"point P\" [-5 -5 0  5 -5 0  5 5 0  -5 5 0] \"integer indices\" [0 1 2 0 2 3]\nWorldEnd\n",
                                 Dialect::v3, 1 << 26);
    record("light outside of RGB: " + name, "negative radiance", 0, -static_cast<double>(p.lowest), p.samples);
    EXPECT_GT(p.mean(), 0) << name << " gives no light";
  }
}

// Pixels that see a light only by a chain of mirrors: exact, however long the chain is, and no noise.
TEST(SpecularChains, OfMirrorsAreExact) {
  struct Chain {
    const char* reflectance;
    double factor;
    std::vector<double> slopes;
  };
  // Roulette thins chains of less than all light from the fourth vertex on: those are exact in the mean only.
  for (const Chain& chain : {Chain{"1", 1, {0.02, 0.1, 0.3, 0.5}}, Chain{".9", static_cast<double>(0.9f), {0.01, 0.02, 0.03}}}) {
    // Two long parallel mirrors, the camera between them at one end, a light that closes the other.
    const std::string mirrors = std::string("Material \"mirror\" \"rgb Kr\" [") + chain.reflectance + " " + chain.reflectance + " " + chain.reflectance + "]\n" +
                                "Shape \"trianglemesh\" \"point P\" [-1 -1 0  100 -1 0  100 1 0  -1 1 0] \"integer indices\" [0 1 2 0 2 3]\n"
                                "Shape \"trianglemesh\" \"point P\" [-1 -1 1  100 -1 1  100 1 1  -1 1 1] \"integer indices\" [0 1 2 0 2 3]\n"
                                "AreaLightSource \"diffuse\" \"rgb L\" [2 2 2] \"bool twosided\" \"true\"\nMaterial \"matte\" \"rgb Kd\" [0 0 0]\n"
                                "Shape \"trianglemesh\" \"point P\" [100 -9 -9  100 9 -9  100 9 9  100 -9 9] \"integer indices\" [0 1 2 0 2 3]\n";
    double worst = 0, noise = 0;
    std::uint64_t samples = 0;
    for (const double slope : chain.slopes) {
      const Picture p = render(header("0 0 .5  1 0 " + number(0.5 + slope) + "  0 1 0", 1, rays(16, 4096), 100, 1e-3) + mirrors + "WorldEnd\n", Dialect::v3, 400);
      const int bounces = static_cast<int>(std::floor(100 * slope + 0.5));
      worst = std::max(worst, std::fabs(p.mean() / (2 * std::pow(chain.factor, bounces)) - 1));
      noise = std::max(noise, p.film.estimated_relmse(1.f));
      samples += p.samples;
    }
    const std::string name = std::string("pixels that see a light by 1 to 50 mirrors of ") + chain.reflectance;
    record(name, "relative error of the radiance", 1e-6, worst, samples);
    record(name, "estimated relMSE", 0, noise, samples);
  }
}

}  // namespace
}  // namespace cloudrenderer::stability
