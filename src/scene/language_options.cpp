// What stands before WorldBegin.
#include "scene/language.h"

namespace cloudrenderer {

namespace {

constexpr auto kDone = LanguageState::done;
constexpr auto kNear = LanguageState::approximated;
constexpr auto kIgnored = LanguageState::ignored;
constexpr auto kMissing = LanguageState::missing;
constexpr unsigned kV23 = kInV2 | kInV3, kV34 = kInV3 | kInV4;

constexpr std::string_view kPathNote = "rendered with path, which estimates the same light";

// clang-format off
#define SHUTTER "-float shutteropen, -float shutterclose"
constexpr LanguageRow kRows[] = {
    {"Camera", "environment", kV23, kDone, SHUTTER ", -float frameaspectratio, -float screenwindow, -float lensradius, -float focaldistance, -float hither@v2, -float yon@v2", ""},
    {"Camera", "orthographic", kInAll, kDone, SHUTTER ", float frameaspectratio, float screenwindow, float lensradius, float focaldistance, -float hither@v2, -float yon@v2", ""},
    {"Camera", "perspective", kInAll, kDone, SHUTTER ", float frameaspectratio, float screenwindow, float lensradius, float focaldistance, float fov, float halffov@v23, -float hither@v2, -float yon@v2", ""},
    {"Camera", "realistic", kV34, kMissing, SHUTTER ", !string lensfile, !float aperturediameter, !float focusdistance, !bool simpleweighting@v3, !string aperture@v4", "perspective is used"},
    {"Film", "image", kV23, kDone, "integer xresolution, integer yresolution, float cropwindow, string filename, -bool display@v2, float scale@v3, float maxsampleluminance@v3, -float diagonal@v3", ".exr and .png"},
    {"Sampler", "02sequence", kInV3, kNear, "integer pixelsamples, -integer dimensions", ""},
    {"Sampler", "adaptive", kInV2, kNear, "-integer minsamples, integer maxsamples, -string method", "the largest number of samples everywhere"},
    {"Sampler", "bestcandidate", kInV2, kNear, "integer pixelsamples", ""},
    {"Sampler", "halton", kInAll, kNear, "integer pixelsamples, -bool samplepixelcenter@v3, -integer seed@v4, -string randomization@v4", ""},
    {"Sampler", "lowdiscrepancy", kV23, kNear, "integer pixelsamples, -integer dimensions@v3", ""},
    {"Sampler", "maxmindist", kInV3, kNear, "integer pixelsamples, -integer dimensions", ""},
    {"Sampler", "random", kV23, kDone, "integer pixelsamples", ""},
    {"Sampler", "sobol", kV34, kDone, "integer pixelsamples, -integer seed@v4, -string randomization@v4", ""},
    {"Sampler", "stratified", kInAll, kNear, "integer xsamples, integer ysamples, -bool jitter, -integer dimensions@v3, -integer seed@v4", ""},
    {"Sampler", "zerotwosequence", kInV3, kNear, "integer pixelsamples, -integer dimensions", ""},
    {"PixelFilter", "box", kV23, kDone, "float xwidth, float ywidth", ""},
    {"PixelFilter", "gaussian", kV23, kDone, "float xwidth, float ywidth, float alpha", ""},
    {"PixelFilter", "mitchell", kV23, kDone, "float xwidth, float ywidth, float B, float C", ""},
    {"PixelFilter", "sinc", kV23, kDone, "float xwidth, float ywidth, float tau", ""},
    {"PixelFilter", "triangle", kV23, kDone, "float xwidth, float ywidth", ""},
    {"SurfaceIntegrator", "ambientocclusion", kInV2, kDone, "integer nsamples, float maxdist", ""},
    {"SurfaceIntegrator", "diffuseprt", kInV2, kNear, "-integer lmax, -integer nsamples", kPathNote},
    {"SurfaceIntegrator", "dipolesubsurface", kInV2, LanguageState::done, "integer maxdepth, -float maxerror, -float minsampledistance, -string pointsfile", "as path, whose walks are what the dipole approximates"},
    {"SurfaceIntegrator", "directlighting", kInV2, kDone, "integer maxdepth, -string strategy", ""},
    {"SurfaceIntegrator", "exphotonmap", kInV2, kNear, "integer maxdepth, -integer causticphotons, -integer indirectphotons, -integer nused, -integer maxspeculardepth, -integer maxphotondepth, -bool finalgather, -integer finalgathersamples, -float maxdist, -float gatherangle", kPathNote},
    {"SurfaceIntegrator", "glossyprt", kInV2, kNear, "-integer lmax, -integer nsamples, -spectrum Kd, -spectrum Ks, -float roughness", kPathNote},
    {"SurfaceIntegrator", "igi", kInV2, kNear, "integer maxdepth, -integer nlights, -integer nsets, -float rrthreshold, -float glimit, -integer gathersamples", kPathNote},
    {"SurfaceIntegrator", "irradiancecache", kInV2, kNear, "integer maxdepth, -integer maxspeculardepth, -integer maxindirectdepth, -float minweight, -float minpixelspacing, -float maxpixelspacing, -float maxangledifference, -integer nsamples", kPathNote},
    {"SurfaceIntegrator", "path", kInV2, kDone, "integer maxdepth", ""},
    {"SurfaceIntegrator", "photonmap", kInV2, kNear, "integer maxdepth, -integer causticphotons, -integer indirectphotons, -integer nused, -integer maxspeculardepth, -integer maxphotondepth, -bool finalgather, -integer finalgathersamples, -float maxdist, -float gatherangle", kPathNote},
    {"SurfaceIntegrator", "useprobes", kInV2, kNear, "-string filename", kPathNote},
    {"SurfaceIntegrator", "whitted", kInV2, kDone, "integer maxdepth", ""},
    {"Integrator", "ambientocclusion", kInV3, kDone, "integer nsamples, bool cossample, float maxdist, -float pixelbounds", ""},
    {"Integrator", "ao", kInV3, kDone, "integer nsamples, bool cossample, float maxdist, -float pixelbounds", ""},
    {"Integrator", "bdpt", kInV3, kNear, "integer maxdepth, -bool visualizestrategies, -bool visualizeweights, -string lightsamplestrategy, -integer pixelbounds", kPathNote},
    {"Integrator", "directlighting", kInV3, kDone, "integer maxdepth, -string strategy, -integer pixelbounds", ""},
    {"Integrator", "mlt", kInV3, kNear, "integer maxdepth, -integer bootstrapsamples, -integer chains, -integer mutationsperpixel, -float largestepprobability, -float sigma", kPathNote},
    {"Integrator", "path", kInV3, kDone, "integer maxdepth, -float rrthreshold, -string lightsamplestrategy, -integer pixelbounds", ""},
    {"Integrator", "sppm", kInV3, kNear, "integer maxdepth, -integer iterations, -integer numiterations, -integer photonsperiteration, -integer imagewritefrequency, -float radius", kPathNote},
    {"Integrator", "volpath", kInV3, kNear, "integer maxdepth, -float rrthreshold, -string lightsamplestrategy, -integer pixelbounds", "rendered with path: no media"},
    {"Integrator", "whitted", kInV3, kDone, "integer maxdepth, -integer pixelbounds", ""},
    {"Renderer", "metropolis", kInV2, kNear, "integer maxdepth, -integer samplesperpixel, -float largestepprobability, -integer directsamples, -bool dodirectseparately, -integer maxconsecutiverejects, -integer bootstrapsamples, -bool bidirectional", kPathNote},
    {"Renderer", "sampler", kInV2, kIgnored, "-bool visualizeobjectids", ""},
    {"VolumeIntegrator", "emission", kInV2, kIgnored, "-float stepsize", "there are no volumes"},
    {"VolumeIntegrator", "single", kInV2, kIgnored, "-float stepsize", "there are no volumes"},
    {"Accelerator", "bvh", kInAll, kIgnored, "-integer maxnodeprims, -string splitmethod", ""},
    {"Accelerator", "grid", kInV2, kIgnored, "-bool refineimmediately", ""},
    {"Accelerator", "kdtree", kInAll, kIgnored, "-integer intersectcost, -integer traversalcost, -float emptybonus, -integer maxprims, -integer maxdepth", ""},
    {"Accelerator", "none", kInV2, kIgnored, "", ""},
};
#undef SHUTTER
// clang-format on

}  // namespace

LanguageTable language_options() { return kRows; }

}  // namespace cloudrenderer
