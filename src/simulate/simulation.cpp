#include "simulate/simulation.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>

#include "simulate/dice.h"
#include "simulate/event_queue.h"
#include "simulate/manager_driver.h"
#include "simulate/message_size.h"
#include "simulate/simulated_host.h"

namespace cloudrenderer::sim {
namespace {

constexpr double kWorkOverhead = 2e-5;        // seconds of a thread for a batch
constexpr std::uint32_t kRealTile = 32, kRealRound = 16;
std::uint64_t incarnation_of(HostId h) { return 1000 + h.value; }

class Simulation {
 public:
  Simulation(const SceneModel& model, const ClusterPlan& plan)
      : model_(model),
        plan_(plan),
        grain_(choose_grain(model, plan)),
        weight_(grain_.paths()),
        width_((model.width + grain_.side - 1) / grain_.side),
        height_((model.height + grain_.side - 1) / grain_.side),
        dice_(plan.seed),
        manager_(manager_options(), job(), std::uint64_t{kRealTile} * kRealTile, std::uint64_t{grain_.side} * grain_.side,
                 [this](HostId to, const Link::Frame& f) { to_worker(to, f); }) {
    nodes_.push_back(nullptr);
  }

  Prediction run() {
    for (std::uint32_t i = 0; i < plan_.hosts; ++i)
      at(plan_.boot_s * i / std::max(1u, plan_.hosts), [this] { join(); });
    schedule_tick();
    while (!events_.empty() && !core().finished() && now() < kEndOfTime) {
      events_.step();
      watch();
    }
    return predict();
  }

 private:
  ManagerCore& core() { return manager_.core(); }
  double now() const { return events_.now(); }
  void at(double t, std::function<void()> what) { events_.at(t, std::move(what)); }

  ManagerOptions manager_options() const {
    ManagerOptions o;
    o.incarnation = 1;
    o.min_hosts = plan_.hosts;
    o.replication = plan_.replication;
    o.tile = std::max(1u, kRealTile / grain_.side);
    o.smallest_tile = std::max(1u, o.smallest_tile / grain_.side);
    o.round_samples = std::max(1u, kRealRound / grain_.samples);
    o.smallest_task = std::max<std::uint64_t>(1, o.smallest_task / weight_);
    return o;
  }
  WorkerOptions worker_options(const HostKind& kind) const {
    WorkerOptions o;
    o.threads = kind.threads;
    o.maps = maps_;
    const auto less = [&](auto& n) {
      n = std::max<std::remove_reference_t<decltype(n)>>(1, n / weight_);
    };
    less(o.path_credits);
    less(o.camera_batch);
    less(o.trace_batch);
    less(o.small_batch);
    less(o.low_mark);
    less(o.block_segments);
    less(o.paging_credits);
    return o;
  }
  std::uint32_t spp() const { return std::max(1u, (model_.spp + grain_.samples / 2) / grain_.samples); }
  JobSpec job() const {
    JobSpec j;
    j.frame = {width_, height_, 0, 0, width_, height_};
    j.spp = spp();
    j.samples_per_ray = model_.samples_per_ray;
    j.seed = plan_.seed;
    for (const ModelPart& p : model_.parts) j.parts.push_back(p.placement);
    j.prototype_bytes = model_.prototype_bytes;
    j.start.set_job(1);
    j.start.set_part_count(static_cast<std::uint32_t>(j.parts.size()));
    j.start.set_width(width_);
    j.start.set_height(height_);
    j.start.set_x1(width_);
    j.start.set_y1(height_);
    j.start.set_spp(j.spp);
    j.start.set_columns(model_.columns);
    return j;
  }

  // ---- hosts ----
  void join() {
    if (core().finished() || core().phase() == ManagerCore::Phase::ending) return;
    const HostKind& kind = kinds_.next();
    const HostId expected(static_cast<std::uint32_t>(nodes_.size()));
    const WorkerOptions options = worker_options(kind);
    auto node = std::make_unique<SimulatedHost>();
    node->id = expected;
    node->kind = &kind;
    node->core = std::make_unique<WorkerCore>(expected, incarnation_of(expected), options);
    node->store = std::make_unique<Store>(model_, kind.memory, width_, height_, spp());
    node->link = std::make_unique<Link>(static_cast<std::uint32_t>(incarnation_of(expected)), 1u);
    node->joined = now();
    node->debt = plan_.start_s;
    SimulatedHost& n = *node;
    nodes_.push_back(std::move(node));
    wire::Hello hello;
    hello.set_protocol(wire::kProtocolVersion);
    hello.set_incarnation(incarnation_of(expected));
    hello.set_name(kind.name + std::to_string(expected.value));
    hello.set_listen("10." + std::to_string(expected.value >> 16) + "." + std::to_string(expected.value >> 8 & 255) + "." +
                     std::to_string(expected.value & 255) + ":7000");
    hello.set_threads(kind.threads);
    hello.set_memory(kind.memory);
    hello.set_fingerprint(1);
    if (model_.samples_per_ray > 1) hello.add_features("shared rays");
    hello.set_path_credits(options.path_credits);
    hello.set_paging_credits(options.paging_credits);
    const auto id = manager_.join(hello, now());
    if (!id || *id != expected) {
      error_ = id ? "host numbers do not follow each other" : id.error();
      n.alive = false;
      return;
    }
    ++joined_;
    threaten(n);
    pump(n);
    after_manager();
  }
  // What will befall this host.
  void threaten(SimulatedHost& n) {
    const Trouble& t = plan_.trouble;
    const std::uint32_t id = n.id.value;
    if (t.failures > 0) at(now() + dice_.exponential(t.failures / 3600), [this, id] { die(id, false); });
    if (t.reclaims > 0)
      at(now() + dice_.exponential(t.reclaims / 3600), [this, id] {
        SimulatedHost& host = *nodes_[id];
        if (!host.alive || !busy_time()) return;
        ++reclaimed_;
        host.core->leave("the spot instance is reclaimed");
        pump(host);
        replace();
        at(now() + plan_.trouble.notice_s, [this, id] { die(id, true); });
      });
  }
  bool busy_time() { return !core().finished() && core().phase() != ManagerCore::Phase::ending; }
  void die(std::uint32_t id, bool told) {
    SimulatedHost& n = *nodes_[id];
    if (!n.alive || !busy_time()) return;
    end(n);
    ++lost_;
    if (!told) replace();
  }
  void end(SimulatedHost& n) {
    n.alive = false;
    n.left = now();
  }
  void replace() {
    if (plan_.trouble.replace_s > 0) at(now() + plan_.trouble.replace_s, [this] { join(); });
  }

  // ---- everything that follows from a change in a worker ----
  void pump(SimulatedHost& n) {
    if (!n.alive) return;
    for (int round = 0; round < 2; ++round) start_work(n);
    for (auto& [to, m] : n.core->take_outbox()) {
      if (to.value == 0)
        n.link->send(wire::encode(m));
      else
        to_peer(n, to, std::move(m));
    }
    flush_link(n);
    set_wake(n);
  }
  void set_wake(SimulatedHost& n) {
    const double wake = std::max(n.core->deadline(), now() + 1e-6);
    if (wake >= n.wake) return;
    n.wake = wake;
    at(wake, [this, &n, wake] {
      if (n.wake != wake) return;
      n.wake = kEndOfTime;
      if (!n.alive) return;
      DriverCounters c;
      c.drained = n.in_flight == 0;
      n.core->set_driver_counters(c);
      n.core->tick(now());
      pump(n);
    });
  }
  void start_work(SimulatedHost& n) {
    while (n.busy < n.kind->threads) {
      auto work = n.core->take(now());
      if (!work) break;
      ++n.busy;
      // What runs does not see what happens meanwhile, so it is computed at its beginning.
      auto held = std::make_shared<Work>(std::move(*work));
      auto result = std::make_shared<WorkResult>(execute(n.store->engine, *held));
      double cpu = n.store->engine.seconds(n.store->engine.take_tally()) * weight_ + kWorkOverhead;
      if (std::holds_alternative<CollectWork>(held->what)) cpu += collected(*held) * weight_ * model_.costs.path;
      note_leaving(n, *result);
      cpu += std::exchange(n.debt, 0);
      const double taken = cpu / n.kind->speed;
      at(now() + taken, [this, &n, held, result, cpu, taken] {
        --n.busy;
        n.cpu_s += cpu;
        n.busy_s += taken;
        if (!n.alive) return;
        n.core->finish(*held, *result, now());
        pump(n);
      });
    }
    if (auto work = n.core->take_load(now())) load(n, std::move(*work));
  }
  static double collected(const Work& work) {
    std::size_t n = 0;
    for (const auto& ends : std::get<CollectWork>(work.what).ends) n += ends.size();
    return static_cast<double>(n);
  }
  static void note_leaving(SimulatedHost& n, const WorkResult& r) {
    std::size_t leaving = 0;
    for (const auto& l : r.leaving) leaving += l.kept.segments->size();
    for (const auto& a : r.asks) leaving += a.asks.size();
    if (leaving != 0) n.per_batch += 0.1 * (static_cast<double>(leaving) - n.per_batch);
  }

  void load(SimulatedHost& n, Work work) {
    std::uint64_t bytes = 0, triangles = 0;
    if (std::holds_alternative<StartJobWork>(work.what)) {
      bytes = model_.manifest_bytes + model_.parts[0].file_bytes;
      triangles = model_.parts[0].triangles;
    }
    const auto add = [&](PartId p) {
      bytes += model_.parts[p.value].file_bytes;
      triangles += model_.parts[p.value].triangles;
    };
    if (const auto* load = std::get_if<LoadWork>(&work.what)) for (const PartId p : load->parts) add(p);
    if (const auto* page = std::get_if<PageWork>(&work.what)) add(page->part);
    const double fetched = bytes == 0 ? now() : fetch(n, bytes);
    const double cpu = static_cast<double>(triangles) * model_.costs.triangle;
    // All threads of a host build a part. Where they also trace, each of the two takes the other's time.
    const bool shared = core().phase() == ManagerCore::Phase::rendering;
    (shared ? n.debt : n.cpu_s) += cpu;
    loaded_bytes_ += static_cast<double>(bytes);
    at(fetched + (shared ? 2 : 1) * cpu / (n.kind->speed * n.kind->threads) + 1e-4, [this, &n, held = std::make_shared<Work>(std::move(work))] {
      if (!n.alive) return;
      WorkResult r = execute(*n.store, *held);
      n.core->finish(*held, r, now());
      pump(n);
    });
  }
  // When the bytes are there. The store gives to one after the other, a host takes no faster than its line.
  double fetch(SimulatedHost& n, std::uint64_t bytes) {
    const Network& net = plan_.network;
    const auto size = static_cast<double>(bytes);
    n.line_in = std::max(n.line_in, now()) + size / net.bandwidth;
    double there = n.line_in + net.latency;
    const double shared = net.parts_from_manager ? net.manager_bandwidth : net.store_bandwidth;
    if (shared > 0) {
      double& line = net.parts_from_manager ? manager_out_ : store_out_;
      line = std::max(line, now()) + size / shared;
      there = std::max(there, line + net.latency);
    }
    return there;
  }

  // ---- network ----
  void to_peer(SimulatedHost& n, HostId to, wire::Message m) {
    if (n.peers.insert(to.value).second && !nodes_[to.value]->peers.contains(n.id.value)) connections_ += 2;
    const MessageSize size = size_of(m, weight_, n.per_batch, n.peers.size());
    sent_bytes_ += size.bytes;
    const double cpu = 0.5 * (size.messages * model_.costs.message + size.bytes * model_.costs.message_byte + size.moves * model_.costs.move);
    n.debt += cpu;
    n.line_out = std::max(n.line_out, now()) + size.bytes / plan_.network.bandwidth;
    ++n.in_flight;
    auto held = std::make_shared<wire::Message>(std::move(m));
    at(n.line_out + plan_.network.latency, [this, &n, to, held, size, cpu] {
      --n.in_flight;
      SimulatedHost& there = *nodes_[to.value];
      if (!there.alive) return;
      there.line_in = std::max(there.line_in, now()) + size.bytes / plan_.network.bandwidth;
      there.debt += cpu;
      if (there.line_in - now() < 1e-5) return arrive(n.id, there, *held);
      at(there.line_in, [this, from = n.id, &there, held] { arrive(from, there, *held); });
    });
  }
  void arrive(HostId from, SimulatedHost& n, wire::Message& m) {
    if (!n.alive) return;
    n.core->receive(from, std::move(m), now());
    pump(n);
  }
  void flush_link(SimulatedHost& n) {
    while (const auto frame = n.link->next(now())) {
      const auto bytes = static_cast<double>(manager_.frame_bytes(*frame, frame->payload ? reply_sums(*frame->payload) : 0));
      sent_bytes_ += bytes;
      n.line_out = std::max(n.line_out, now()) + bytes / plan_.network.bandwidth;
      manager_in_ = std::max(manager_in_, n.line_out) + bytes / plan_.network.manager_bandwidth;
      at(manager_in_ + plan_.network.latency, [this, &n, f = *frame] {
        if (core().finished() || !manager_.knows(n.id)) return;
        manager_.receive(n.id, f, now());
        after_manager();
        const double due = manager_.link_deadline(n.id);
        if (due < kEndOfTime)
          at(due, [this, id = n.id] { manager_.acknowledge(id, now()); });
      });
    }
  }
  void to_worker(HostId to, const Link::Frame& frame) {
    SimulatedHost& n = *nodes_[to.value];
    const auto bytes = static_cast<double>(manager_.frame_bytes(frame, 0));
    manager_out_ = std::max(manager_out_, now()) + bytes / plan_.network.manager_bandwidth;
    sent_bytes_ += bytes;
    at(manager_out_ + plan_.network.latency, [this, &n, frame] {
      if (!n.alive) return;
      std::vector<wire::Bytes> in_order;
      n.link->receive(frame.link, frame.payload, now(), in_order);
      for (const wire::Bytes& payload : in_order) {
        if (last_payload_ != payload) {  // many hosts hear the same
          last_message_ = *wire::decode(*payload);
          last_payload_ = payload;
        }
        n.core->receive(HostId(0), last_message_, now());
        if (auto* map = std::get_if<wire::SceneHostMap>(&last_message_)) {  // what follows from it is shared (SharedMaps)
          map->clear_hosts();
          map->clear_holdings();
          map->clear_gone();
        }
      }
      if (!in_order.empty()) pump(n);
    });
  }
  void after_manager() {
    for (const HostId h : manager_.take_gone())
      if (nodes_[h.value]->alive) end(*nodes_[h.value]);
  }
  void schedule_tick() {
    at(std::max(core().deadline(), now() + 1e-3), [this] {
      manager_.tick(now());
      after_manager();
      if (!core().finished()) schedule_tick();
    });
  }

  // ---- what comes of it ----
  struct Mark {
    double at = 0, busy_s = 0, cpu_s = 0, capacity_s = 0, most_busy = 0, bytes = 0;
  };
  Mark mark() const {
    Mark m;
    m.at = now();
    m.bytes = sent_bytes_;
    for (const auto& n : nodes_) {
      if (!n) continue;
      m.busy_s += n->busy_s;
      m.cpu_s += n->cpu_s;
      const double threads = n->kind->threads;
      m.most_busy = std::max(m.most_busy, n->busy_s / threads);
      m.capacity_s += threads * ((n->alive ? now() : n->left) - n->joined);
    }
    return m;
  }
  // Render time is looked at in three stages: until it begins, until nine tenths are done, the end.
  void watch() {
    if (!began_ && core().phase() == ManagerCore::Phase::rendering) began_ = mark();
    if (!began_ || late_ || events_.done() % std::max<std::uint64_t>(64, nodes_.size()) != 0) return;
    const ManagerCore::Progress p = core().progress();
    if (p.paths_done * 10 >= p.paths_total * 9) late_ = mark();
  }
  Prediction predict() {
    Prediction p;
    const ManagerCore::Progress progress = core().progress();
    const double w = weight_;
    p.hosts = plan_.hosts;
    p.segment = weight_;
    p.error = error_;
    if (p.error.empty() && core().phase() == ManagerCore::Phase::failed) p.error = core().error();
    if (p.error.empty() && progress.paths_done != progress.paths_total)
      p.error = core().waiting_for().empty() ? "the render does not end" : core().waiting_for();
    p.events = events_.done();
    // What rounding to whole simulated pixels and samples has added or left out.
    const double real = static_cast<double>(model_.width) * model_.height * model_.spp;
    const double done = static_cast<double>(progress.paths_done) * w;
    const double fit = done > 0 ? real / done : 1;
    p.paths = done * fit;
    p.load_s = progress.render_began;
    p.render_s = std::max(0.0, progress.render_ended - progress.render_began) * fit;
    p.wall_s = p.load_s + p.render_s;
    if (!began_ || done == 0) return p;
    const Mark end = mark(), began = *began_, late = late_.value_or(end);
    p.cpu_s = (end.cpu_s - began.cpu_s) * fit;
    p.bytes = (end.bytes - began.bytes) * fit;
    p.loaded_bytes = loaded_bytes_;
    double moved = 0, asked = 0, wasted = 0, copied = 0;
    for (const auto& [id, host] : core().hosts()) {
      const wire::Counters& c = host.last.counters();
      moved += static_cast<double>(c.moved());
      asked += static_cast<double>(c.shadow_asked());
      wasted += static_cast<double>(c.wasted_paths());
      copied += static_cast<double>(c.copied_paths());
      p.cost += ((host.left ? *host.left : now()) - host.joined) / 3600 * nodes_[id.value]->kind->price;
    }
    p.cost += plan_.manager_price * now() / 3600;
    const auto simulated = static_cast<double>(progress.paths_done);
    p.moves_per_path = moved / simulated;
    p.asks_per_path = asked / simulated;
    p.wasted = wasted / simulated;
    p.copied = copied / simulated;
    p.paged_parts = progress.paged_parts;
    p.teams = progress.teams;
    p.connections = connections_ / joined_;
    const double capacity = end.capacity_s - began.capacity_s;
    p.busy = capacity > 0 ? (end.busy_s - began.busy_s) / capacity : 0;
    const double ideal = nodes_[1]->store->engine.ideal_seconds_per_path() * p.paths / mean_speed();
    p.efficiency = capacity > 0 ? ideal / (capacity * fit) : 0;
    p.tail = core().tail(0.1);
    p.lost = lost_;
    p.reclaimed = reclaimed_;
    p.joined = joined_;
    p.manager = manager_.load(progress.render_began, progress.render_ended);
    p.manager.out_share = p.render_s > 0 ? p.manager.sent / (plan_.network.manager_bandwidth * p.wall_s) : 0;
    blame(p, began, late, end, ideal / fit);
    return p;
  }
  double mean_speed() const {
    double speed = 0, threads = 0;
    for (const auto& n : nodes_) {
      if (!n || !n->kind) continue;
      speed += n->kind->speed * n->kind->threads;
      threads += n->kind->threads;
    }
    return threads > 0 ? speed / threads : 1;
  }
  // What of the processors' time, loading included, went where no path was brought on; the largest is the bottleneck.
  void blame(Prediction& p, const Mark& began, const Mark& late, const Mark& end, double ideal) const {
    const double before = late.capacity_s - began.capacity_s, after = end.capacity_s - late.capacity_s;
    const double idle_before = std::max(0.0, before - (late.busy_s - began.busy_s));
    const double idle_after = std::max(0.0, after - (end.busy_s - late.busy_s));
    const double span = late.at - began.at;
    // Where some host was busy all the time the others waited for it, else all waited for messages.
    const double fullest = span > 0 ? std::min(1.0, (late.most_busy - began.most_busy) / span) : 0;
    const double imbalance = std::min(idle_before, std::max(0.0, fullest * before - (late.busy_s - began.busy_s)));
    const double all = end.capacity_s;
    const std::pair<const char*, double> shares[] = {
        {"loading", began.capacity_s},
        {"tail", idle_after},
        {"imbalance", imbalance},
        {"latency", idle_before - imbalance},
        {"moving paths", std::max(0.0, end.busy_s - began.busy_s - ideal * (1 + p.wasted + p.copied))},
        {"second copies at the end", ideal * p.copied},
        {"paths made again", ideal * p.wasted},
    };
    for (const auto& [name, seconds] : shares) {
      if (all <= 0 || seconds / all <= p.bottleneck_share) continue;
      p.bottleneck = name;
      p.bottleneck_share = seconds / all;
    }
    if (p.manager.cpu_share >= 0.8) {
      p.bottleneck = "manager's processor";
      p.bottleneck_share = p.manager.cpu_share;
    } else if (p.manager.out_share >= 0.8) {
      p.bottleneck = "manager's line";
      p.bottleneck_share = p.manager.out_share;
    }
  }

  const SceneModel& model_;
  const ClusterPlan& plan_;
  const Grain grain_;
  const std::uint32_t weight_, width_, height_;
  Dice dice_;
  EventQueue events_;
  ManagerDriver manager_;
  std::vector<std::unique_ptr<SimulatedHost>> nodes_;  // by host number; none is 0
  KindMixer kinds_{plan_.kinds};
  std::shared_ptr<SharedMaps> maps_ = std::make_shared<SharedMaps>();
  wire::Bytes last_payload_;
  wire::Message last_message_;
  double manager_out_ = 0, manager_in_ = 0, store_out_ = 0;  // when these lines are free again
  double sent_bytes_ = 0, loaded_bytes_ = 0, connections_ = 0;
  std::uint32_t lost_ = 0, reclaimed_ = 0, joined_ = 0;
  std::optional<Mark> began_, late_;
  std::string error_;
};

}  // namespace

Prediction simulate(const SceneModel& model, const ClusterPlan& plan) { return Simulation(model, plan).run(); }

}  // namespace cloudrenderer::sim
