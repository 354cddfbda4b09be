#pragma once
// Inside src/film only.
#include <span>
#include <vector>

#include "film/film.h"

namespace cloudrenderer {

// An OpenEXR file in memory: 32 bit floats R, G, B and the channels, packed with zip; data and display window from the
// frame. Throws std::exception (Iex) with the reason.
std::vector<unsigned char> encode_exr(const Image& image, const FilmFrame& frame, const ImageHeader& header,
                                      std::span<const ImageChannel> channels);

}  // namespace cloudrenderer
