#include "scene/language.h"

namespace cloudrenderer {

namespace {

constexpr auto kDone = LanguageState::done;

// clang-format off
constexpr LanguageRow kRows[] = {
    {"Shape", "bilinearmesh", kInV4, kDone, "integer indices, point3 P, normal N, point2 uv, -integer faceIndices, !string emissionfilename, texture alpha", "triangles, as fine as the patch is twisted"},
    {"Shape", "cone", kInV2 | kInV3, kDone, "float radius, float height, float phimax", ""},
    {"Shape", "curve", kInV3 | kInV4, kDone, "point3 P, string basis, integer degree, string type, normal N, float width, float width0, float width1, integer splitdepth, texture alpha@v4", ""},
    {"Shape", "cylinder", kInAll, kDone, "float radius, float zmin, float zmax, float phimax, texture alpha@v4", ""},
    {"Shape", "disk", kInAll, kDone, "float height, float radius, float innerradius, float phimax, texture alpha@v4", ""},
    {"Shape", "heightfield", kInV2 | kInV3, kDone, "integer nu, integer nv, float Pz", ""},
    {"Shape", "hyperboloid", kInV2 | kInV3, kDone, "point p1, point p2, float phimax", ""},
    {"Shape", "loopsubdiv", kInAll, kDone, "integer nlevels@v2, integer levels@v34, integer indices, point P, string scheme", "all schemes are Loop's"},
    {"Shape", "nurbs", kInV2 | kInV3, kDone, "integer nu, integer nv, integer uorder, integer vorder, float uknots, float vknots, float u0, float u1, float v0, float v1, point P, float Pw", ""},
    {"Shape", "paraboloid", kInV2 | kInV3, kDone, "float radius, float zmin, float zmax, float phimax", ""},
    {"Shape", "plymesh", kInV3 | kInV4, kDone, "string filename, texture alpha, texture shadowalpha@v3, !texture displacement@v4, !float edgelength@v4", "gzipped files too"},
    {"Shape", "sphere", kInAll, kDone, "float radius, float zmin, float zmax, float phimax, texture alpha@v4", ""},
    {"Shape", "trianglemesh", kInAll, kDone, "integer indices, point P, normal N, !vector S, float uv, float st@v23, texture alpha, texture shadowalpha@v3, bool discarddegenerateUVs@v23, -integer faceIndices@v34", ""},
};
// clang-format on

}  // namespace

LanguageTable language_shapes() { return kRows; }

}  // namespace cloudrenderer
