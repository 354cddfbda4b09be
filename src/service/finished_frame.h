#pragma once
#include <string>

#include "service/job_json.h"

namespace cloudrenderer {

// A frame that does not run any more, as its window would show it (src/web/README.md): the job, made of the frame's
// report ("" or null: there is none), and the picture.
Json view_of_report(const Json& report, const std::string& file, bool done);
// The same as a stream: the view, then tiles. Throws std::runtime_error when the picture cannot be read.
std::string stream_of_picture(const std::string& picture, Json view);

}  // namespace cloudrenderer
