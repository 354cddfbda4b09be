#pragma once
#include <nlohmann/json.hpp>

#include "cluster/render.h"

namespace cloudrenderer {

// The figures of a render as the JSON object that --report writes. `difference`: to the reference,
// when there is one.
nlohmann::ordered_json make_report(const RenderOutcome& outcome, const std::string& scene,
                                   const std::optional<ImageDifference>& difference);

}  // namespace cloudrenderer
