#include "service/meter.h"

#include <algorithm>

namespace cloudrenderer {

std::map<FrameRef, Usage> share_out(std::map<FrameRef, Usage> used, double price_an_hour) {
  double passed = 0, cpu_s = 0, there_s = 0;
  for (const auto& [frame, u] : used) {
    passed = std::max(passed, u.host_s);
    cpu_s += u.cpu_s;
    there_s += u.host_s;
  }
  for (auto& [frame, u] : used) {
    const double part = cpu_s > 0 ? u.cpu_s / cpu_s : there_s > 0 ? u.host_s / there_s : 0;
    u.host_s = passed * part;
    u.cost = u.host_s / 3600 * price_an_hour;
  }
  return used;
}

}  // namespace cloudrenderer
