#pragma once
#include <span>
#include <string>
#include <vector>

#include "film/film.h"

namespace cloudrenderer {

// The file that write_image would write, in memory: for viewers elsewhere.
std::vector<unsigned char> encode_image(const std::string& name, const Image& image, const FilmFrame& frame,
                                        const ImageHeader& header = {}, std::span<const ImageChannel> channels = {});

}  // namespace cloudrenderer
