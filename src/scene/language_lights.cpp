#include "scene/language.h"

namespace cloudrenderer {

namespace {

constexpr auto kDone = LanguageState::done;
constexpr unsigned kV23 = kInV2 | kInV3;

// clang-format off
constexpr LanguageRow kRows[] = {
    {"LightSource", "distant", kV23, kDone, "spectrum L, spectrum scale, point from, point to", ""},
    {"LightSource", "exinfinite", kInV3, kDone, "spectrum L, spectrum scale, string mapname, -integer samples, -integer nsamples", "as infinite"},
    {"LightSource", "goniometric", kV23, kDone, "spectrum I, spectrum scale, string mapname", ""},
    {"LightSource", "infinite", kV23, kDone, "spectrum L, spectrum scale, string mapname, -integer samples@v3, -integer nsamples", "importance sampled"},
    {"LightSource", "point", kV23, kDone, "spectrum I, spectrum scale, point from", ""},
    {"LightSource", "projection", kV23, kDone, "spectrum I, spectrum scale, float fov, string mapname", ""},
    {"LightSource", "spot", kV23, kDone, "spectrum I, spectrum scale, point from, point to, float coneangle, float conedeltaangle", ""},
    {"LightSource", "distant", kInV4, kDone, "spectrum L, float scale, float illuminance, point3 from, point3 to", ""},
    {"LightSource", "goniometric", kInV4, kDone, "spectrum I, float scale, float power, string filename", "a square map of equal areas"},
    {"LightSource", "infinite", kInV4, kDone, "spectrum L, float scale, float illuminance, string filename, point3 portal", "a square map of equal areas"},
    {"LightSource", "point", kInV4, kDone, "spectrum I, float scale, float power, point3 from", ""},
    {"LightSource", "projection", kInV4, kDone, "float scale, float power, float fov, string filename", ""},
    {"LightSource", "spot", kInV4, kDone, "spectrum I, float scale, float power, point3 from, point3 to, float coneangle, float conedeltaangle", ""},
    {"AreaLightSource", "area", kInV2, kDone, "spectrum L, spectrum scale, -integer nsamples", "as diffuse"},
    {"AreaLightSource", "diffuse", kV23, kDone, "spectrum L, spectrum scale, -integer nsamples, -integer samples@v3, bool twosided@v3", "shapes inside of objects are seen, but light nothing, as in pbrt"},
    {"AreaLightSource", "diffuse", kInV4, kDone, "spectrum L, float scale, float power, bool twosided, string filename", "the power of every triangle or bilinear patch, as pbrt counts it; quads of a plymesh are two triangles; on shapes that are no meshes the mean of a picture shines; shapes inside of objects do not"},
};
// clang-format on

}  // namespace

LanguageTable language_lights() { return kRows; }

}  // namespace cloudrenderer
