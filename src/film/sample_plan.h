#pragma once
// Adaptive sampling: where the next round's samples go. A pure function of the film at the end of a round, so that any
// cluster decides alike.
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "film/film.h"

namespace cloudrenderer {

// The film's tiles: squares of pixels from the upper left corner of its window, row by row, cut at the borders.
struct SamplePlan {
  std::vector<std::uint32_t> goals;   // by tile: samples that each pixel shall have at the end of the round
  std::uint64_t expected_paths = 0;   // of the whole render, if what is known now holds; 0: no end is known
};

// `samples`: what each tile has. The relMSE of n_t samples is the sum of v_t / n_t, least for a given number of samples
// where n_t goes by sqrt(v_t) (Neyman's allocation). v_t is taken from the eight tiles around t, never from t itself: if
// a tile's own samples decided how many it gets, lucky tiles would stay with few samples and an estimate that is too
// small, and fireflies would be thinned by the samples that they cause, so that the mean would be too dark. (Over
// several rounds a trace of that is left: neighbours of neighbours.) No tile falls behind an eighth of the average, since
// the estimate cannot know what no sample has found. A round adds from a twentieth to two fifths of the samples that
// there are, and at most doubles a tile.
//   estimate: of the film.
//   max_error: until the upper end of the estimate's interval is below; none: as long as there is time.
//   most: samples of a pixel.
SamplePlan plan_samples(const Film& film, float scale, const Film::ErrorEstimate& estimate, std::uint32_t tile,
                        std::span<const std::uint32_t> samples, std::optional<double> max_error, std::uint32_t most);

}  // namespace cloudrenderer
