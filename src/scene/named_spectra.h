#pragma once
#include <optional>
#include <string>
#include <string_view>

#include "cloudrenderer/math.h"

namespace cloudrenderer {

// The spectra that pbrt-v4 knows by name: "metal-Au-eta", "glass-BK7", "stdillum-D65" ... Illuminants
// have a luminance of 1, glasses are the index at the sodium line in all channels.
std::optional<Rgb> named_spectrum(std::string_view name);
// For messages.
std::string named_spectra();

}  // namespace cloudrenderer
