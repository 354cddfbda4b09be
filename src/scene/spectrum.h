#pragma once
#include <span>
#include <string>
#include <vector>

#include "base/error.h"
#include "cloudrenderer/math.h"
#include "scene/description.h"

namespace cloudrenderer {

// A sampled spectrum: wavelengths in nanometres and values.
struct SampledSpectrum {
  std::vector<double> wavelengths, values;
  bool ends = false;  // nothing beyond the first and last: what files and scenes of pbrt-v4 give
  bool covers_all() const;  // that an observer sees
};

// CIE XYZ to linear RGB with Rec. 709 primaries and a D65 white, the matrix that pbrt uses.
Rgb xyz_to_rgb(double x, double y, double z);

// A spectrum as RGB the way pbrt in its default RGB mode makes it: weighted with the CIE 1931
// observer at every nanometre from 360 to 830, constant beyond the first and last sample. The
// dialects differ by 471/470 in scale.
Rgb spectrum_to_rgb(SampledSpectrum spectrum, Dialect dialect);

// As pbrt-v4 sees them with its default film: a reflectance or an index in the light of D65, and a
// light of luminance 1 whatever the values' scale.
Rgb reflectance_to_rgb(SampledSpectrum spectrum);
Rgb illuminant_to_rgb(SampledSpectrum spectrum);

// Planck's law for a temperature in kelvin: in v2 1 at 555 nm, in v3 1 at its maximum. Black for
// kelvin <= 0.
Rgb blackbody_to_rgb(double kelvin, Dialect dialect);

// Reads a .spd file: pairs of wavelength and value, '#' comments. Throws SceneError with the place
// in the file; `where` is the place of the parameter that names it, for a file that cannot be
// opened.
SampledSpectrum read_spd(const std::string& path, const FileLocation& where);

}  // namespace cloudrenderer
