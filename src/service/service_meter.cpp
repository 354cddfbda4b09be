// What jobs use: of hosts, and of the processes that the service has for them.
#include <time.h>

#include "cluster/usage.h"
#include "service/meter.h"
#include "service/service.h"

namespace cloudrenderer {
namespace {

constexpr double kChildrenEvery = 1;

}  // namespace

// What hosts say that frames have used, as far as it is new.
void Service::meter() {
  for (const auto& [id, host] : host_view_) {
    std::map<FrameRef, Usage> news;
    for (const auto& [ref, used] : host.used) {
      Usage& counted = metered_[{id, ref}];
      const Usage more{used.cpu_s - counted.cpu_s, used.memory_byte_s - counted.memory_byte_s, used.bytes - counted.bytes, 0,
                       used.host_s - counted.host_s, 0};
      if (more.cpu_s <= 0 && more.host_s <= 0 && more.bytes <= 0 && more.memory_byte_s <= 0) continue;
      counted = used;
      newly_metered_[{id, ref}] = used;
      news[ref] = more;
    }
    for (const auto& [ref, more] : share_out(std::move(news), prices_ ? prices_->an_hour(host.kind) : 0))
      if (scheduler_.find(ref.job)) scheduler_.used(ref, more);
  }
}

// While they run, too: what a service has not counted when it is killed is lost with them.
void Service::meter_children(double now) {
  if (now < children_metered_ + kChildrenEvery) return;
  children_metered_ = now;
  for (auto& [ref, child] : children_) {
    clockid_t clock{};
    if (clock_getcpuclockid(child.pid, &clock) == 0) meter_child(ref, child, clock_seconds(clock));
  }
}

void Service::meter_child(FrameRef ref, Child& child, double cpu_s) {
  if (cpu_s <= child.counted_cpu_s) return;
  Usage more;
  more.service_cpu_s = cpu_s - std::exchange(child.counted_cpu_s, cpu_s);
  scheduler_.used(ref, more);
}

}  // namespace cloudrenderer
