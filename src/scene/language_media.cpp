#include "scene/language.h"

namespace cloudrenderer {

namespace {

constexpr auto kDone = LanguageState::done;
constexpr auto kNear = LanguageState::approximated;

// clang-format off
constexpr LanguageRow kRows[] = {
    {"MakeNamedMedium", "cloud", kInV4, kNear, "spectrum sigma_a, spectrum sigma_s, float g, float density, float wispiness, float frequency, point3 p0, point3 p1", "the noise is sampled on a grid, three times a period of its finest octave, at most 384 times along an axis"},
    {"MakeNamedMedium", "heterogeneous", kInV3, kDone, "string preset, spectrum sigma_a, spectrum sigma_s, float scale, float g, point p0, point p1, integer nx, integer ny, integer nz, float density", ""},
    {"MakeNamedMedium", "homogeneous", kInV3 | kInV4, kDone, "string preset, spectrum sigma_a, spectrum sigma_s, spectrum Le@v4, float Lescale@v4, float scale, float g", ""},
    {"MakeNamedMedium", "nanovdb", kInV4, kDone, "string filename, string gridname, string temperaturename, spectrum sigma_a, spectrum sigma_s, float scale, float g, float Lescale, float LeScale, float temperatureoffset, float temperaturecutoff, float temperaturescale", "version 32 of the format, plain or zipped"},
    {"MakeNamedMedium", "rgbgrid", kInV4, kDone, "rgb sigma_a, rgb sigma_s, rgb Le, float scale, float Lescale, float g, point3 p0, point3 p1, integer nx, integer ny, integer nz", ""},
    {"MakeNamedMedium", "uniformgrid", kInV4, kDone, "string preset, spectrum sigma_a, spectrum sigma_s, spectrum Le, float Lescale, float scale, float g, point3 p0, point3 p1, integer nx, integer ny, integer nz, float density, float temperature, float temperatureoffset, float temperaturecutoff, float temperaturescale", ""},
    {"Volume", "exponential", kInV2, kDone, "spectrum sigma_a, spectrum sigma_s, float g, spectrum Le, point p0, point p1, float a, float b, vector updir", ""},
    {"Volume", "homogeneous", kInV2, kDone, "spectrum sigma_a, spectrum sigma_s, float g, spectrum Le, point p0, point p1", ""},
    {"Volume", "volumegrid", kInV2, kDone, "spectrum sigma_a, spectrum sigma_s, float g, spectrum Le, point p0, point p1, integer nx, integer ny, integer nz, float density", ""},
};
// clang-format on

}  // namespace

LanguageTable language_media() { return kRows; }

}  // namespace cloudrenderer
