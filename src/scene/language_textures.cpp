#include "scene/language.h"

namespace cloudrenderer {

namespace {

constexpr auto kDone = LanguageState::done;
constexpr auto kMissing = LanguageState::missing;
constexpr unsigned kV23 = kInV2 | kInV3;

// clang-format off
#define MAPPING_2D "string mapping, float uscale, float vscale, float udelta, float vdelta, vector v1, vector v2"
constexpr LanguageRow kRows[] = {
    {"Texture", "bilerp", kInAll, kDone, "spectrum v00, spectrum v01, spectrum v10, spectrum v11, " MAPPING_2D, ""},
    {"Texture", "checkerboard", kInAll, kDone, "spectrum tex1, spectrum tex2, integer dimension, string aamode@v23, " MAPPING_2D, ""},
    {"Texture", "constant", kInAll, kDone, "spectrum value", ""},
    {"Texture", "dots", kInAll, kDone, "spectrum inside, spectrum outside, " MAPPING_2D, ""},
    {"Texture", "fbm", kInAll, kDone, "integer octaves, float roughness", ""},
    {"Texture", "directionmix", kInV4, kDone, "spectrum tex1, spectrum tex2, vector dir", ""},
    {"Texture", "imagemap", kInV4, kDone, "string filename, string wrap, float maxanisotropy, string filter, float scale, bool invert, string encoding, " MAPPING_2D, ""},
    {"Texture", "imagemap", kV23, kDone, "string filename, string wrap, float maxanisotropy, bool trilinear, float scale, float gamma@v2, bool gamma@v3, " MAPPING_2D, "formats that OpenImageIO reads"},
    {"Texture", "marble", kInAll, kDone, "integer octaves, float roughness, float scale, float variation", ""},
    {"Texture", "mix", kInAll, kDone, "spectrum tex1, spectrum tex2, float amount", ""},
    {"Texture", "ptex", kInV3 | kInV4, kMissing, "string filename, float gamma@v3, string encoding@v4, float scale@v4", "grey"},
    {"Texture", "scale", kInV4, kDone, "spectrum tex, float scale", ""},
    {"Texture", "scale", kV23, kDone, "spectrum tex1, spectrum tex2", ""},
    {"Texture", "uv", kV23, kDone, MAPPING_2D, ""},
    {"Texture", "windy", kInAll, kDone, "", ""},
    {"Texture", "wrinkled", kInAll, kDone, "integer octaves, float roughness", ""},
};
#undef MAPPING_2D
// clang-format on

}  // namespace

LanguageTable language_textures() { return kRows; }

}  // namespace cloudrenderer
