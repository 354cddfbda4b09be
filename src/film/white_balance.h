#pragma once
#include "cloudrenderer/math.h"

namespace cloudrenderer {

// Linear sRGB as a camera shows it that takes daylight of `kelvin` for white (pbrt-v4's "whitebalance"): the chromatic
// adaptation of Bradford (Lam 1985), from the chromaticity of CIE illuminant D (CIE 15; below 4000 K of a black body) to the
// white of the picture's colours (x, y).
glm::mat3 white_balance(float kelvin, const Vec2& white);

}  // namespace cloudrenderer
