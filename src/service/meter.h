#pragma once
#include <map>

#include "service/job.h"

namespace cloudrenderer {

// What frames have used of one host since it was last asked: each frame's own processor time, memory and bytes, and
// as host_s the time that the host has worked for the frame. Gives the same with the host's time, which passes once
// however many work on it, shared out by processor time, and what that costs. Where nobody has used the processor the
// time is shared out by who was there.
std::map<FrameRef, Usage> share_out(std::map<FrameRef, Usage> used, double price_an_hour);

}  // namespace cloudrenderer
