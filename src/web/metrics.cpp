#include "web/job_view.h"
#include "web/metric_families.h"

namespace cloudrenderer {

std::string metrics_text(const JobView& job) {
  Families f;
  const auto number = [](auto n) { return static_cast<double>(n); };
  const CostPoint cost = cost_point(job);
  std::uint32_t there = 0;
  for (const HostView& h : job.hosts) there += h.left_s ? 0 : 1;
  f.gauge("cloudrenderer_hosts", "Hosts that are there", there);
  f.counter("cloudrenderer_hosts_joined_total", "Hosts that have joined", number(job.hosts.size()));
  f.gauge("cloudrenderer_paths_expected", "Paths of the whole job", number(job.progress.paths_total));
  f.counter("cloudrenderer_paths_total", "Paths in the film", number(job.progress.paths_done));
  f.counter("cloudrenderer_invalid_samples_total", "Samples that were not finite", number(job.core.invalid_samples));
  f.counter("cloudrenderer_render_seconds_total", "Time since the first sample", job.progress.render_s);
  f.counter("cloudrenderer_host_seconds_total", "Hosts times the time that they were there", cost.host_s);
  f.gauge("cloudrenderer_parts", "Parts of the scene", job.parts);
  f.gauge("cloudrenderer_paged_parts", "Parts that no host has memory for", job.core.paged_parts);
  if (const auto& e = job.progress.estimate) {
    f.gauge("cloudrenderer_estimated_relmse", "Estimated error of the picture", e->relmse);
    f.gauge("cloudrenderer_estimated_relmse_low", "Lower end of its interval", e->low);
    f.gauge("cloudrenderer_estimated_relmse_high", "Upper end of its interval", e->high);
  }
  for (const char* phase : {"gathering", "loading", "rendering", "ending", "done", "failed"})
    f.gauge("cloudrenderer_phase", "1 for the phase of the job", job.phase == phase ? 1 : 0, {{"phase", phase}});
  for (const HostView& h : job.hosts) {
    const wire::Counters& c = h.status.counters();
    const auto labels = [&](const char* name = nullptr, const char* value = nullptr) {
      Families::Labels l{{"host", std::to_string(h.id)}, {"name", h.name}};
      if (name) l.push_back({name, value});
      return l;
    };
    f.gauge("cloudrenderer_host_up", "1 while the host is there", h.left_s ? 0 : 1, labels());
    f.gauge("cloudrenderer_host_threads", "Threads of the host", h.threads, labels());
    f.gauge("cloudrenderer_host_memory_budget_bytes", "Memory for parts and textures", number(h.memory_budget), labels());
    f.gauge("cloudrenderer_host_memory_used_bytes", "Of this, used", number(c.memory_used()), labels());
    f.gauge("cloudrenderer_host_parts", "Parts that the host holds", number(h.parts.size()), labels());
    f.gauge("cloudrenderer_host_live_paths", "Paths under way of the host's tasks", number(h.status.live_paths()), labels());
    f.gauge("cloudrenderer_host_queue_seconds", "Queued work by measured speed", h.status.load_s(), labels());
    f.counter("cloudrenderer_host_busy_seconds_total", "Time of all threads in tasks", c.busy_s(), labels());
    f.counter("cloudrenderer_host_cpu_seconds_total", "Processor time of the host", c.cpu_s(), labels());
    f.counter("cloudrenderer_host_sent_bytes_total", "Sent, files left out", number(c.bytes_sent()), labels());
    f.counter("cloudrenderer_host_received_bytes_total", "Received, files left out", number(c.bytes_received()), labels());
    const std::pair<const char*, std::uint64_t> rays[] = {{"camera", c.camera()}, {"bounce", c.bounce()}, {"shadow", c.shadow()},
                                                          {"moved", c.moved()},   {"shadow_asked", c.shadow_asked()}};
    for (const auto& [kind, n] : rays)
      f.counter("cloudrenderer_rays_total", "Rays, by kind", number(n), labels("kind", kind));
  }
  return f.text();
}

}  // namespace cloudrenderer
