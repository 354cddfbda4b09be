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
constexpr std::string_view kTransferNote = "rendered with directlighting and the scene's materials";
constexpr std::string_view kCausticsNote = "rendered with path, and with paths from the lights for caustics (--light-paths)";

// clang-format off
#define V4_FILM "integer xresolution, integer yresolution, float cropwindow, integer pixelbounds, string filename, ~string sensor, float iso, float exposuretime, float whitebalance, float maxcomponentvalue, float diagonal, -bool savefp16"
#define SHUTTER "float shutteropen, float shutterclose"
constexpr LanguageRow kRows[] = {
    {"Camera", "environment", kV23, kDone, SHUTTER ", -float frameaspectratio, -float screenwindow, -float lensradius, -float focaldistance, -float hither@v2, -float yon@v2", ""},
    {"Camera", "orthographic", kInAll, kDone, SHUTTER ", float frameaspectratio, float screenwindow, float lensradius, float focaldistance, -float hither@v2, -float yon@v2", ""},
    {"Camera", "perspective", kInAll, kDone, SHUTTER ", float frameaspectratio, float screenwindow, float lensradius, float focaldistance, float fov, float halffov@v23, -float hither@v2, -float yon@v2", ""},
    {"Camera", "realistic", kV34, kDone, SHUTTER ", string lensfile, float aperturediameter, float focusdistance, bool simpleweighting@v3, string aperture@v4", "the weights are pbrt-v3's"},
    {"Camera", "spherical", kInV4, kDone, SHUTTER ", string mapping, -float frameaspectratio, -float screenwindow, -float lensradius, -float focaldistance", ""},
    {"Film", "gbuffer", kInV4, kNear, V4_FILM ", -string coordinatesystem", "only the colours"},
    {"Film", "rgb", kInV4, kDone, V4_FILM, ".exr, .pfm, .png and .tga; sensors are plain exposure and white balance"},
    {"Film", "spectral", kInV4, kNear, V4_FILM ", -integer nbuckets, -float lambdamin, -float lambdamax", "an RGB picture"},
    {"Film", "image", kV23, kDone, "integer xresolution, integer yresolution, float cropwindow, string filename, -bool display@v2, float scale@v3, float maxsampleluminance@v3, float diagonal@v3", ".exr, .pfm, .png and .tga"},
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
    {"Sampler", "independent", kInV4, kDone, "integer pixelsamples, -integer seed", ""},
    {"Sampler", "paddedsobol", kInV4, kDone, "integer pixelsamples, -integer seed, -string randomization", ""},
    {"Sampler", "pmj02bn", kInV4, kNear, "integer pixelsamples, -integer seed", ""},
    {"Sampler", "zsobol", kInV4, kNear, "integer pixelsamples, -integer seed, -string randomization", ""},
    {"PixelFilter", "box", kInV4, kDone, "float xradius, float yradius", ""},
    {"PixelFilter", "gaussian", kInV4, kDone, "float xradius, float yradius, float sigma", ""},
    {"PixelFilter", "mitchell", kInV4, kDone, "float xradius, float yradius, float B, float C", ""},
    {"PixelFilter", "sinc", kInV4, kDone, "float xradius, float yradius, float tau", ""},
    {"PixelFilter", "triangle", kInV4, kDone, "float xradius, float yradius", ""},
    {"PixelFilter", "box", kV23, kDone, "float xwidth, float ywidth", ""},
    {"PixelFilter", "gaussian", kV23, kDone, "float xwidth, float ywidth, float alpha", ""},
    {"PixelFilter", "mitchell", kV23, kDone, "float xwidth, float ywidth, float B, float C", ""},
    {"PixelFilter", "sinc", kV23, kDone, "float xwidth, float ywidth, float tau", ""},
    {"PixelFilter", "triangle", kV23, kDone, "float xwidth, float ywidth", ""},
    {"SurfaceIntegrator", "ambientocclusion", kInV2, kDone, "integer nsamples, float maxdist", ""},
    {"SurfaceIntegrator", "diffuseprt", kInV2, kNear, "-integer lmax, -integer nsamples", kTransferNote},
    {"SurfaceIntegrator", "dipolesubsurface", kInV2, LanguageState::done, "integer maxdepth, -float maxerror, -float minsampledistance, -string pointsfile", "by walks, which the dipole approximates; light that comes directly only, as in pbrt-v2"},
    {"SurfaceIntegrator", "directlighting", kInV2, kDone, "integer maxdepth, -string strategy", ""},
    {"SurfaceIntegrator", "exphotonmap", kInV2, kNear, "integer maxdepth, -integer causticphotons, -integer indirectphotons, -integer nused, -integer maxspeculardepth, -integer maxphotondepth, -bool finalgather, -integer finalgathersamples, -float maxdist, -float gatherangle", kCausticsNote},
    {"SurfaceIntegrator", "glossyprt", kInV2, kNear, "-integer lmax, -integer nsamples, -spectrum Kd, -spectrum Ks, -float roughness", kTransferNote},
    {"SurfaceIntegrator", "igi", kInV2, kNear, "integer maxdepth, -integer nlights, -integer nsets, -float rrthreshold, -float glimit, -integer gathersamples", kPathNote},
    {"SurfaceIntegrator", "irradiancecache", kInV2, kNear, "-integer maxspeculardepth, -integer maxindirectdepth, -float minweight, -float minpixelspacing, -float maxpixelspacing, -float maxangledifference, -integer nsamples", kPathNote},
    {"SurfaceIntegrator", "path", kInV2, kDone, "integer maxdepth", ""},
    {"SurfaceIntegrator", "photonmap", kInV2, kNear, "integer maxdepth, -integer causticphotons, -integer indirectphotons, -integer nused, -integer maxspeculardepth, -integer maxphotondepth, -bool finalgather, -integer finalgathersamples, -float maxdist, -float gatherangle", kCausticsNote},
    {"SurfaceIntegrator", "useprobes", kInV2, kNear, "-string filename", kPathNote},
    {"SurfaceIntegrator", "whitted", kInV2, kDone, "integer maxdepth", ""},
    {"Integrator", "ambientocclusion", kInV3, kDone, "integer nsamples, bool cossample, ~integer pixelbounds", ""},
    {"Integrator", "bdpt", kInV3, kNear, "integer maxdepth, -bool visualizestrategies, -bool visualizeweights, -string lightsamplestrategy, ~integer pixelbounds", kCausticsNote},
    {"Integrator", "directlighting", kInV3, kDone, "integer maxdepth, -string strategy, ~integer pixelbounds", ""},
    {"Integrator", "mlt", kInV3, kNear, "integer maxdepth, -integer bootstrapsamples, -integer chains, ~integer mutationsperpixel, -float largestepprobability, -float sigma", kCausticsNote},
    {"Integrator", "path", kInV3, kDone, "integer maxdepth, -float rrthreshold, -string lightsamplestrategy, ~integer pixelbounds", ""},
    {"Integrator", "sppm", kInV3, kNear, "integer maxdepth, ~integer iterations, ~integer numiterations, -integer photonsperiteration, -integer imagewritefrequency, -float radius", kCausticsNote},
    {"Integrator", "volpath", kInV3, kDone, "integer maxdepth, -float rrthreshold, -string lightsamplestrategy, ~integer pixelbounds", ""},
    {"Integrator", "whitted", kInV3, kDone, "integer maxdepth, ~integer pixelbounds", ""},
    {"Integrator", "ambientocclusion", kInV4, kDone, "bool cossample, float maxdistance", ""},
    {"Integrator", "ao", kInV4, kDone, "bool cossample, float maxdistance", ""},
    {"Integrator", "bdpt", kInV4, kNear, "integer maxdepth, -bool visualizestrategies, -bool visualizeweights, -string lightsampler, -bool regularize", kCausticsNote},
    {"Integrator", "function", kInV4, kNear, "-string function, -bool skipbad, -string imagefilename", kPathNote},
    {"Integrator", "lightpath", kInV4, kNear, "integer maxdepth", kPathNote},
    {"Integrator", "mlt", kInV4, kNear, "integer maxdepth, -integer bootstrapsamples, -integer chains, ~integer mutationsperpixel, -float largestepprobability, -float sigma, -bool regularize", kCausticsNote},
    {"Integrator", "path", kInV4, kDone, "integer maxdepth, -string lightsampler, bool regularize", ""},
    {"Integrator", "randomwalk", kInV4, kNear, "integer maxdepth", kPathNote},
    {"Integrator", "simplepath", kInV4, kNear, "integer maxdepth, ~bool samplelights, -bool samplebsdf", kPathNote},
    {"Integrator", "simplevolpath", kInV4, kDone, "integer maxdepth", "as volpath"},
    {"Integrator", "sppm", kInV4, kNear, "integer maxdepth, -integer photonsperiteration, -float radius, -integer seed, -bool regularize", kCausticsNote},
    {"Integrator", "volpath", kInV4, kDone, "integer maxdepth, -string lightsampler, bool regularize", ""},
    {"Renderer", "createprobes", kInV2, kIgnored, "-string filename, -integer lmax, -bool directlighting, -bool indirectlighting, -integer indirectsamples, -float bounds, -float samplespacing, -float time", "its world has no picture: left out where another follows"},
    {"Renderer", "metropolis", kInV2, kNear, "integer maxdepth, ~integer samplesperpixel, -float largestepprobability, -integer directsamples, -bool dodirectseparately, -integer maxconsecutiverejects, -integer bootstrapsamples, -bool bidirectional", kCausticsNote},
    {"Renderer", "sampler", kInV2, kIgnored, "-bool visualizeobjectids", ""},
    {"Renderer", "surfacepoints", kInV2, kIgnored, "-string filename, -float minsampledistance", "its world has no picture: left out where another follows"},
    {"VolumeIntegrator", "emission", kInV2, kDone, "-float stepsize", "tracked without steps"},
    {"VolumeIntegrator", "single", kInV2, kDone, "-float stepsize", "tracked without steps"},
    {"Accelerator", "bvh", kInAll, kIgnored, "-integer maxnodeprims, -string splitmethod", ""},
    {"Accelerator", "grid", kInV2, kIgnored, "-bool refineimmediately", ""},
    {"Accelerator", "kdtree", kInAll, kIgnored, "-integer intersectcost, -integer traversalcost, -float emptybonus, -integer maxprims, -integer maxdepth", ""},
    {"Accelerator", "none", kInV2, kIgnored, "", ""},
};
#undef SHUTTER
#undef V4_FILM
// clang-format on

}  // namespace

LanguageTable language_options() { return kRows; }

}  // namespace cloudrenderer
