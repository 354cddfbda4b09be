#include "service/job.h"

namespace cloudrenderer {

const char* name(JobState state) {
  static constexpr std::array kNames{"checking", "queued", "running", "paused", "done", "failed", "cancelled"};
  return kNames[static_cast<std::size_t>(state)];
}

const char* name(FrameState state) {
  static constexpr std::array kNames{"waiting", "splitting", "ready", "running", "done", "failed", "cancelled"};
  return kNames[static_cast<std::size_t>(state)];
}

void Usage::add(const Usage& o) {
  cpu_s += o.cpu_s;
  memory_byte_s += o.memory_byte_s;
  bytes += o.bytes;
  rays += o.rays;
  host_s += o.host_s;
  cost += o.cost;
  service_cpu_s += o.service_cpu_s;
}

Usage Job::usage() const {
  Usage sum;
  for (const JobFrame& f : frames) sum.add(f.usage);
  return sum;
}

}  // namespace cloudrenderer
