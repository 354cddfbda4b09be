#pragma once
// A manager with hosts that do as they are told.
#include <gtest/gtest.h>

#include <algorithm>

#include "tasks/manager_core.h"

namespace cloudrenderer::manager_test {

inline JobSpec job(std::uint32_t parts = 5, std::uint32_t side = 64, std::uint32_t spp = 16) {
  JobSpec j;
  j.frame = {side, side, 0, 0, side, side};
  j.spp = spp;
  j.start.set_job(1);
  for (std::uint32_t p = 0; p < parts; ++p)
    j.parts.push_back({100, Vec3(static_cast<float>(p)), {}});
  return j;
}

// What a host knows after a map that may say only what has changed.
inline void follow(wire::SceneHostMap& known, const wire::SceneHostMap& news) {
  if (news.since() == 0) return void(known = news);
  EXPECT_EQ(news.since(), known.epoch());
  wire::SceneHostMap next = news;
  next.clear_since();
  next.clear_gone();
  next.clear_hosts();
  next.clear_holdings();
  const auto has = [](const auto& list, std::uint32_t host) {
    return std::any_of(list.begin(), list.end(), [&](const auto& e) { return e.host() == host; });
  };
  const auto gone = [&](std::uint32_t host) {
    return std::find(news.gone().begin(), news.gone().end(), host) != news.gone().end();
  };
  for (const auto& e : known.hosts())
    if (!gone(e.host()) && !has(news.hosts(), e.host())) *next.add_hosts() = e;
  for (const auto& h : known.holdings())
    if (!gone(h.host()) && !has(news.holdings(), h.host())) *next.add_holdings() = h;
  for (const auto& e : news.hosts()) *next.add_hosts() = e;
  for (const auto& h : news.holdings())
    if (h.parts_size() != 0) *next.add_holdings() = h;
  known = std::move(next);
}

inline wire::Hello hello(std::uint64_t memory = 10000) {
  wire::Hello h;
  h.set_protocol(wire::kProtocolVersion);
  h.set_fingerprint(1);
  h.set_memory(memory);
  h.set_threads(1);
  h.set_path_credits(20000);
  return h;
}

// The manager with hosts that do as they are told.
struct Cluster {
  explicit Cluster(ManagerOptions o = {}, JobSpec spec = job()) : core(o, std::move(spec)) {}

  HostId join(std::uint64_t memory = 10000) {
    const auto id = core.join(hello(memory), now);
    EXPECT_TRUE(id) << id.error();
    return *id;
  }
  // Collects what was said, per host.
  void listen() {
    for (auto& [to, m] : core.take_outbox()) {
      if (auto* load = std::get_if<wire::LoadParts>(&m))
        for (const std::uint32_t p : load->parts()) ordered[to].insert(p);
      if (auto* unload = std::get_if<wire::UnloadParts>(&m))
        for (const std::uint32_t p : unload->parts()) dropped[to].push_back(p);
      if (auto* map = std::get_if<wire::SceneHostMap>(&m)) follow(maps[to], *map);
      if (auto* task = std::get_if<wire::SubmitTask>(&m)) tasks[to].push_back(*task);
      if (auto* cancel = std::get_if<wire::CancelTask>(&m)) {
        cancelled[to].insert(cancel->task());
        std::erase_if(tasks[to], [&](const wire::SubmitTask& t) {
          return std::get<RendererRange>(t.payload).task == cancel->task();
        });
      }
      if (std::holds_alternative<wire::JobEnd>(m)) ended.insert(to);
    }
  }
  void report_loaded(HostId h) {
    listen();
    wire::LoadReport r;
    r.set_job(1);
    for (const std::uint32_t p : ordered[h]) r.add_loaded(p);
    core.receive(h, r, now);
    listen();
  }
  void do_task(HostId h, const wire::SubmitTask& t) {
    const auto& range = std::get<RendererRange>(t.payload);
    wire::RendererReply r;
    r.task = range.task;
    r.sums.resize(std::size_t{range.x1 - range.x0} * (range.y1 - range.y0));
    for (PixelSums& p : r.sums)
      for (std::uint32_t s = range.sample_begin; s < range.sample_end; ++s) p.add({s, 2, 3}, s);
    core.receive(h, wire::Reply{t.id, 1, std::move(r)}, now);
  }
  // Until nobody has a task.
  void work(std::size_t at_most = 100000) {
    for (;;) {
      listen();
      bool any = false;
      for (auto& [h, list] : tasks) {
        if (list.empty() || gone.contains(h) || at_most == 0) continue;
        const auto t = list.front();
        list.erase(list.begin());
        do_task(h, t);
        --at_most;
        any = true;
      }
      if (!any) return;
      now += 0.01;
    }
  }
  void finals() {
    wire::Status s;
    s.set_final(true);
    for (const HostId h : ended) core.receive(h, s, now);
  }
  std::uint64_t outstanding_paths(HostId h) {
    std::uint64_t n = 0;
    for (const auto& t : tasks[h]) n += std::get<RendererRange>(t.payload).paths();
    return n;
  }

  double now = 0;
  ManagerCore core;
  std::map<HostId, std::set<std::uint32_t>> ordered, cancelled;
  std::map<HostId, std::vector<std::uint32_t>> dropped;  // before there is a map
  std::map<HostId, wire::SceneHostMap> maps;
  std::map<HostId, std::vector<wire::SubmitTask>> tasks;
  std::set<HostId> ended, gone;
};

using Phase = ManagerCore::Phase;

}  // namespace cloudrenderer::manager_test
