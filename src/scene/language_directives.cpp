#include "scene/language.h"

namespace cloudrenderer {

namespace {

constexpr auto kDone = LanguageState::done;

// clang-format off
constexpr LanguageRow kRows[] = {
    {"Accelerator", "", kInAll, LanguageState::ignored, "", "Embree is the accelerator"},
    {"ActiveTransform", "", kInAll, kDone, "", "shapes, instances and cameras move; lights and textures stand at their start"},
    {"AreaLightSource", "", kInAll, kDone, "", ""},
    {"Attribute", "", kInV4, kDone, "", "targets shape, light, material, medium, texture"},
    {"AttributeBegin", "", kInAll, kDone, "", ""},
    {"AttributeEnd", "", kInAll, kDone, "", ""},
    {"Camera", "", kInAll, kDone, "", ""},
    {"ColorSpace", "", kInV4, kDone, "", "srgb, rec2020, dci-p3, aces2065-1: converted to linear sRGB"},
    {"ConcatTransform", "", kInAll, kDone, "", ""},
    {"CoordSysTransform", "", kInAll, kDone, "", ""},
    {"CoordinateSystem", "", kInAll, kDone, "", ""},
    {"Film", "", kInAll, kDone, "", ""},
    {"Identity", "", kInAll, kDone, "", ""},
    {"Import", "", kInV4, kDone, "", "read at its place; changes of the state stay inside"},
    {"Include", "", kInAll, kDone, "", "gzipped files too"},
    {"Integrator", "", kInV3 | kInV4, kDone, "", ""},
    {"LightSource", "", kInAll, kDone, "", ""},
    {"LookAt", "", kInAll, kDone, "", ""},
    {"MakeNamedMaterial", "", kInAll, kDone, "", ""},
    {"MakeNamedMedium", "", kInV3 | kInV4, kDone, "", ""},
    {"Material", "", kInAll, kDone, "", ""},
    {"MediumInterface", "", kInV3 | kInV4, kDone, "", ""},
    {"NamedMaterial", "", kInAll, kDone, "", ""},
    {"ObjectBegin", "", kInAll, kDone, "", ""},
    {"ObjectEnd", "", kInAll, kDone, "", ""},
    {"ObjectInstance", "", kInAll, kDone, "", ""},
    {"Option", "", kInV4, LanguageState::ignored, "", "disablepixeljitter, msereferenceimage and the like are left out with a warning"},
    {"PixelFilter", "", kInAll, kDone, "", ""},
    {"Renderer", "", kInV2, LanguageState::approximated, "", "metropolis: the light transport of path; others: the surface integrator"},
    {"ReverseOrientation", "", kInAll, kDone, "", ""},
    {"Rotate", "", kInAll, kDone, "", ""},
    {"Sampler", "", kInAll, LanguageState::approximated, "", "the samples of a scrambled Sobol sequence, as many as asked for"},
    {"Scale", "", kInAll, kDone, "", ""},
    {"Shape", "", kInAll, kDone, "", ""},
    {"SurfaceIntegrator", "", kInV2, kDone, "", ""},
    {"Texture", "", kInAll, kDone, "", ""},
    {"Transform", "", kInAll, kDone, "", ""},
    {"TransformBegin", "", kInAll, kDone, "", ""},
    {"TransformEnd", "", kInAll, kDone, "", ""},
    {"TransformTimes", "", kInAll, kDone, "", ""},
    {"Translate", "", kInAll, kDone, "", ""},
    {"Volume", "", kInV2, kDone, "", ""},
    {"VolumeIntegrator", "", kInV2, kDone, "", ""},
    {"WorldBegin", "", kInAll, kDone, "", ""},
    {"WorldEnd", "", kInV2 | kInV3, kDone, "", ""},
};
// clang-format on

}  // namespace

LanguageTable language_directives() { return kRows; }

}  // namespace cloudrenderer
