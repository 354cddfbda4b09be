#include "scene/language.h"

namespace cloudrenderer {

namespace {

constexpr auto kDone = LanguageState::done;
constexpr auto kMissing = LanguageState::missing;
constexpr unsigned kV23 = kInV2 | kInV3;

// clang-format off
#define ROUGH "float roughness, float uroughness, float vroughness, bool remaproughness"
#define DISPLACED "float displacement, string normalmap"
constexpr LanguageRow kRows[] = {
    // pbrt-v2 and v3
    {"Material", "disney", kInV3, kDone, "spectrum color, float metallic, float roughness, float eta, float spectrans, float anisotropic, float speculartint, float sheen, float sheentint, float clearcoat, float clearcoatgloss, spectrum scatterdistance, bool thin, float flatness, float difftrans, float bumpmap", ""},
    {"Material", "fourier", kInV3, kDone, "string bsdffile, float bumpmap", "black without its file, as in pbrt-v3"},
    {"Material", "glass", kV23, kDone, "spectrum Kr, spectrum Kt, float uroughness@v3, float vroughness@v3, bool remaproughness@v3, float index, float eta@v3, float bumpmap", ""},
    {"Material", "hair", kInV3, kDone, "spectrum sigma_a, spectrum color, float eumelanin, float pheomelanin, float eta, float beta_m, float beta_n, float alpha", ""},
    {"Material", "kdsubsurface", kV23, kDone, "spectrum Kd, float meanfreepath@v2, spectrum mfp@v3, float index@v2, float eta@v3, spectrum Kr, spectrum Kt@v3, float uroughness@v3, float vroughness@v3, bool remaproughness@v3, float scale@v3, float g@v3, float bumpmap", "a random walk through the medium inside"},
    {"Material", "matte", kV23, kDone, "spectrum Kd, float sigma, float bumpmap", ""},
    {"Material", "measured", kInV2, kDone, "string filename, float bumpmap", "MERL tables and .brdf files"},
    {"Material", "metal", kV23, kDone, "spectrum eta, spectrum k, float roughness, float uroughness@v3, float vroughness@v3, bool remaproughness@v3, float bumpmap", ""},
    {"Material", "mirror", kV23, kDone, "spectrum Kr, float bumpmap", ""},
    {"Material", "mix", kV23, kDone, "spectrum amount, string namedmaterial1, string namedmaterial2", ""},
    {"Material", "none", kV23, kDone, "", "the surface is passed through; so is \"\""},
    {"Material", "plastic", kV23, kDone, "spectrum Kd, spectrum Ks, float roughness, bool remaproughness@v3, float bumpmap", ""},
    {"Material", "shinymetal", kInV2, kDone, "spectrum Ks, spectrum Kr, float roughness, float bumpmap", ""},
    {"Material", "substrate", kV23, kDone, "spectrum Kd, spectrum Ks, float uroughness, float vroughness, bool remaproughness@v3, float bumpmap", ""},
    {"Material", "subsurface", kV23, kDone, "string name, spectrum sigma_a, spectrum sigma_prime_s@v2, spectrum sigma_s@v3, float scale, float index@v2, float eta@v3, float g@v3, spectrum Kr, spectrum Kt@v3, float uroughness@v3, float vroughness@v3, bool remaproughness@v3, float bumpmap", "a random walk through the medium inside"},
    {"Material", "translucent", kV23, kDone, "spectrum Kd, spectrum Ks, spectrum reflect, spectrum transmit, float roughness, bool remaproughness@v3, float bumpmap", ""},
    {"Material", "uber", kV23, kDone, "spectrum Kd, spectrum Ks, spectrum Kr, spectrum Kt, spectrum opacity, float roughness, float uroughness@v3, float vroughness@v3, bool remaproughness@v3, float index, float eta@v3, float bumpmap", ""},
    // pbrt-v4
    {"Material", "coatedconductor", kInV4, kDone, "float interface.roughness, float interface.uroughness, float interface.vroughness, spectrum interface.eta, float thickness, spectrum conductor.eta, spectrum conductor.k, spectrum reflectance, float conductor.roughness, float conductor.uroughness, float conductor.vroughness, bool remaproughness, integer maxdepth, integer nsamples, float g, spectrum albedo, " DISPLACED, "at most 64 walks; spectra become RGB and one index for the coat"},
    {"Material", "coateddiffuse", kInV4, kDone, "spectrum reflectance, " ROUGH ", spectrum eta, float thickness, integer maxdepth, integer nsamples, float g, spectrum albedo, " DISPLACED, "at most 64 walks"},
    {"Material", "conductor", kInV4, kDone, "spectrum eta, spectrum k, spectrum reflectance, " ROUGH ", " DISPLACED, "spectra become RGB before the Fresnel terms"},
    {"Material", "dielectric", kInV4, kDone, "spectrum eta, " ROUGH ", " DISPLACED, "no dispersion: spectra become one index"},
    {"Material", "diffuse", kInV4, kDone, "spectrum reflectance, " DISPLACED, ""},
    {"Material", "diffusetransmission", kInV4, kDone, "spectrum reflectance, spectrum transmittance, float scale, " DISPLACED, ""},
    {"Material", "hair", kInV4, kDone, "spectrum sigma_a, spectrum reflectance, spectrum color, float eumelanin, float pheomelanin, float eta, float beta_m, float beta_n, float alpha", ""},
    {"Material", "interface", kInV4, kDone, "", "the surface is passed through; so is \"\""},
    {"Material", "measured", kInV4, kDone, "string filename, " DISPLACED, "files of the RGL database, with spectra or rgb; spectra become RGB in the light of D65"},
    {"Material", "mix", kInV4, kDone, "string materials, float amount", "weighted, not chosen by chance"},
    {"Material", "subsurface", kInV4, kDone, "string name, spectrum sigma_a, spectrum sigma_s, spectrum reflectance, spectrum mfp, float scale, float eta, float g, " ROUGH ", " DISPLACED, "a random walk through the medium inside"},
    {"Material", "thindielectric", kInV4, kDone, "spectrum eta, " DISPLACED, ""},
};
#undef ROUGH
#undef DISPLACED
// clang-format on

}  // namespace

LanguageTable language_materials() { return kRows; }

}  // namespace cloudrenderer
