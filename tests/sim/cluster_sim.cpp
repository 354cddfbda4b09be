#include "cluster_sim.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "cluster_node.h"
#include "reference.h"
#include "simulate/event_queue.h"

namespace cloudrenderer::sim {
namespace {

constexpr double kEndOfTime = 600;  // virtual seconds: a run that is not done by then never will be
constexpr std::size_t kOrders = 200;  // frames that say neither block nor end: maps, loads, heartbeats

class Simulation {
 public:
  // `journal`: of an earlier cluster.
  explicit Simulation(const Scenario& s, std::span<const std::byte> journal = {})
      : s_(s), dice_(s.seed ^ 0xabcdef), manager_(manager_options(journal), job()) {
    if (const auto made = header_of(journal)) {
      CheckpointReader reader(journal, *made);
      while (const auto tile = reader.next())
        if (!manager_.restore(*tile)) fail("a record of the journal is refused");
      const auto good = journal.first(reader.position());
      journal_.assign(good.begin(), good.end());
      out_.restored = manager_.progress().paths_restored;
    }
    nodes_.push_back(std::make_unique<Node>(kManager));
    nodes_[0]->wake = kEndOfTime * 2;
  }

  // What the manager has written by this time, and all is lost.
  Bytes run_until(double time, std::string& error) {
    at(time, [this] { stopped_ = true; });
    error = run().error;
    return std::move(journal_);
  }

  Outcome run() {
    for (std::uint32_t i = 0; i < s_.hosts; ++i) at(dice_.real() * 0.05, [this] { join(); });
    for (std::uint32_t i = 0; i < s_.intersectors; ++i) at(dice_.real() * 0.05, [this] { join(false); });
    for (const Scenario::Event& e : s_.events) at(e.at, [this, e] { happen(e); });
    pump(*nodes_[0]);
    while (!events_.empty() && !manager_.finished() && now_ < kEndOfTime && out_.error.empty() &&
           !stopped_)
      step();
    if (out_.error.empty() && !stopped_) check();
    out_.seconds = now_;
    return out_;
  }

 private:
  static std::optional<CheckpointJob> header_of(std::span<const std::byte> journal) {
    const auto header = read_header(journal);
    return header ? *header : std::nullopt;
  }
  ManagerOptions manager_options(std::span<const std::byte> journal) const {
    ManagerOptions o = s_.manager;
    o.keep_merged = true;
    if (const auto made = header_of(journal)) o.fixed_tile = made->tile;
    o.incarnation = incarnation_of(kManager);
    o.min_hosts = s_.hosts + s_.intersectors;
    o.replication = s_.replication;
    return o;
  }
  JobSpec job() const {
    JobSpec j;
    j.frame = {s_.scene.width, s_.height, 0, 0, s_.scene.width, s_.height};
    j.spp = s_.spp;
    j.seed = s_.seed;
    for (std::uint32_t p = 0; p < s_.scene.parts; ++p)
      j.parts.push_back({part_bytes(s_, p), Vec3(static_cast<float>(p)), {}});
    j.start.set_job(s_.seed + 1);
    j.start.set_part_count(s_.scene.parts);
    j.start.set_width(s_.scene.width);
    j.start.set_height(s_.height);
    j.start.set_x1(s_.scene.width);
    j.start.set_y1(s_.height);
    j.start.set_spp(s_.spp);
    j.start.set_columns(wire::kAllColumns);
    j.start.set_features(s_.scene.features);
    if (s_.scene.negative_lobes) j.lobes = {1.5, 0.5};
    return j;
  }

  void write_journal() {
    const std::vector<TileSums> merged = manager_.take_merged();
    if (merged.empty()) return;
    if (journal_.empty()) {
      CheckpointJob j;
      j.frame = job().frame;
      j.tile = manager_.tile_size();
      j.features = s_.scene.features;
      j.negative_lobes = s_.scene.negative_lobes;
      journal_ = encode_header(j);
    }
    for (const TileSums& t : merged) encode_record(t, header_checksum(journal_), journal_);
  }

  void at(double t, std::function<void()> what) { events_.at(t, std::move(what)); }
  void step() {
    events_.step();
    now_ = events_.now();
  }
  void fail(const std::string& why) {
    if (out_.error.empty())
      out_.error = "seed " + std::to_string(s_.seed) + " at " + std::to_string(now_) + " s: " + why;
  }

  // ---- hosts ----
  void join(bool traces = true) {
    wire::Hello hello;
    if (!traces)
      for (const auto c : {wire::LOADER, wire::UNLOADER, wire::INTERSECTION}) hello.add_categories(c);
    hello.set_protocol(wire::kProtocolVersion);
    hello.set_fingerprint(1);
    hello.set_threads(s_.threads);
    hello.set_memory(s_.memory);
    hello.set_path_credits(s_.worker.path_credits);
    hello.set_paging_credits(s_.worker.paging_credits);
    hello.set_incarnation(incarnation_of(HostId(static_cast<std::uint32_t>(nodes_.size()))));
    const auto id = manager_.join(hello, now_);
    if (!id) {
      if (!manager_.finished() && manager_.phase() != ManagerCore::Phase::ending)
        fail("refused: " + id.error());
      return;
    }
    auto node = std::make_unique<Node>(*id);
    WorkerOptions options = s_.worker;
    options.threads = s_.threads;
    node->core = std::make_unique<WorkerCore>(*id, incarnation_of(*id), options);
    node->loader = std::make_unique<Loader>(s_);
    node->traces = traces;
    if (!traces) node->loader->engine.resident.clear();  // the main scene is others'
    node->slowness = std::pow(s_.unevenness, dice_.real());
    node->wake = kEndOfTime * 2;
    nodes_.push_back(std::move(node));
    pump(*nodes_.back());
    pump(*nodes_[0]);
  }
  // Who was given up by bad luck alone (the same frame was lost again and again) is a new host then.
  void come_back(Node& n) {
    if (!n.alive || n.going || manager_.finished()) return;
    n.alive = false;
    at(now_ + 0.1, [this, traces = n.traces] { join(traces); });
  }
  // Who may be struck: hosts that live, as long as one that traces will be left.
  std::vector<Node*> up_hosts() const {
    std::vector<Node*> up;
    std::size_t tracers = 0;
    for (auto& n : nodes_) {
      if (!n->core || !n->alive || n->going) continue;
      up.push_back(n.get());
      tracers += n->traces;
    }
    if (tracers < 2) std::erase_if(up, [](const Node* n) { return n->traces; });
    else if (up.size() < 2) up.clear();
    return up;
  }
  void happen(const Scenario::Event& event) {
    using Kind = Scenario::Event::Kind;
    const Kind kind = event.kind;
    if (kind == Kind::join) return join();
    if (kind == Kind::cut) return cut(event.seconds);
    if (kind == Kind::cancel) {
      manager_.cancel("asked to", now_);
      cancelled_ = true;
      return pump(*nodes_[0]);
    }
    const std::vector<Node*> up = up_hosts();
    if (up.empty()) return;
    Node& n = *up[dice_.below(up.size())];
    n.going = true;
    if (kind == Kind::leave) {
      n.core->leave("asked to");
      return pump(n);
    }
    if (kind != Kind::declare_lost) n.alive = false;
    if (kind == Kind::kill_silently) return;  // the manager finds out by its silence
    at(now_ + 0.05 * dice_.real(), [this, &n] {
      manager_.host_lost(n.id, now_);
      pump(*nodes_[0]);
    });
  }

  // A link that stays cut costs one of the two hosts its place: neither is struck by anything else.
  void cut(double seconds) {
    std::vector<Node*> up = up_hosts();
    if (up.size() < 2) return;
    std::swap(up[0], up[dice_.below(up.size())]);
    std::swap(up[1], up[1 + dice_.below(up.size() - 1)]);
    if (seconds == 0) up[0]->going = up[1]->going = true;
    const std::pair link = std::minmax(up[0]->id, up[1]->id);
    cut_.insert(link);
    ++out_.cut;
    attempt(link, seconds == 0 ? kEndOfTime * 2 : now_ + seconds);
  }
  // Both sides try to reach each other, as drivers do.
  void attempt(std::pair<HostId, HostId> link, double until) {
    const bool whole = now_ >= until;
    if (whole) cut_.erase(link);
    for (const auto& [from, to] : {link, std::pair(link.second, link.first)}) {
      Node& n = *nodes_[from.value];
      if (!n.alive || n.gone.contains(to)) continue;
      if (whole)
        n.core->peer_reachable(to);
      else
        n.core->peer_unreachable(to);
      pump(n);
    }
    if (!whole) at(std::min(until, now_ + 0.2), [this, link, until] { attempt(link, until); });
  }

  // ---- everything that follows from a change in a node ----
  void pump(Node& n) {
    if (!n.alive) return;
    if (n.core) {
      for (int round = 0; round < 2; ++round) start_work(n);
      follow_hosts(n);
      for (auto& [to, m] : n.core->take_outbox()) send(n, to, m);
      const std::size_t segments = n.core->queued_segments() + n.core->kept_segments();
      out_.most_segments = std::max(out_.most_segments, segments);
    } else {
      write_journal();
      for (auto& [to, m] : manager_.take_outbox()) {
        if (std::holds_alternative<wire::CancelTask>(m)) ++out_.cancelled;
        if (!std::holds_alternative<wire::Welcome>(m)) send(n, to, m);
      }
      for (const HostId h : manager_.take_gone()) {
        n.links.erase(h);
        n.gone.insert(h);
        come_back(*nodes_[h.value]);
      }
    }
    double wake = n.core ? n.core->deadline() : manager_.deadline();
    for (auto& [to, link] : n.links) {
      while (auto frame = link.next(now_)) transmit(n.id, to, *frame);
      wake = std::min(wake, link.deadline());
      // Nobody listens any more to a host that was given up; its driver would be told so.
      if (to != kManager || !nodes_[0]->gone.contains(n.id))
        out_.most_frames = std::max(out_.most_frames, link.queued());
    }
    if (wake < n.wake) {
      n.wake = wake;
      at(std::max(wake, now_ + 1e-6), [this, &n, wake] {
        if (n.wake != wake) return;
        n.wake = kEndOfTime * 2;
        if (!n.alive) return;
        if (n.core)
          tick(n);
        else
          manager_.tick(now_);
        pump(n);
      });
    }
  }
  void start_work(Node& n) {
    while (n.busy < s_.threads) {
      auto work = n.core->take(now_);
      if (!work) break;
      ++n.busy;
      const double t =
          s_.seconds_per_segment * n.slowness * static_cast<double>(work->segments() + 1) *
          (0.5 + dice_.real());
      auto held = std::make_shared<Work>(std::move(*work));
      at(now_ + t, [this, &n, held] {
        if (!n.alive) return;
        WorkResult r = execute(n.loader->engine, *held);
        n.core->finish(*held, r, now_);
        --n.busy;
        pump(n);
      });
    }
    if (auto work = n.core->take_load(now_)) {
      auto held = std::make_shared<Work>(std::move(*work));
      at(now_ + 0.01 * dice_.real(), [this, &n, held] {
        if (!n.alive) return;
        WorkResult r = execute(*n.loader, *held);
        n.core->finish(*held, r, now_);
        pump(n);
      });
    }
  }
  void tick(Node& n) {
    DriverCounters c;
    c.drained = std::all_of(n.links.begin(), n.links.end(), [](const auto& l) {
      return l.first == kManager || l.second.drained();
    });
    n.core->set_driver_counters(c);
    n.core->tick(now_);
  }
  // Links to hosts that were on the list and are no more are closed.
  void follow_hosts(Node& n) {
    if (n.core->hosts_version() == n.hosts_version) return;
    n.hosts_version = n.core->hosts_version();
    std::set<HostId> now;
    for (const wire::HostEntry& e : n.core->hosts()) now.insert(HostId(e.host()));
    for (const HostId h : n.peers) {
      if (now.contains(h)) continue;
      n.links.erase(h);
      n.gone.insert(h);
    }
    n.peers = std::move(now);
  }

  // ---- network ----
  Link& link(Node& n, HostId to) {
    LinkOptions o;
    o.retransmit_after = 0.05 + 4 * (s_.delay + s_.jitter);
    o.window = 64;
    const auto low = [](std::uint64_t v) { return static_cast<std::uint32_t>(v); };
    return n.links.try_emplace(to, low(incarnation_of(n.id)), low(incarnation_of(to)), o)
        .first->second;
  }
  void send(Node& n, HostId to, const wire::Message& m) {
    if (to == n.id) return fail("a host sends to itself: " + std::string(wire::message_name(m)));
    if (!n.gone.contains(to)) link(n, to).send(wire::encode(m));
  }
  void transmit(HostId from, HostId to, const Link::Frame& frame) {
    ++out_.frames;
    for (int copies = dice_.chance(s_.doubling) ? 2 : 1; copies > 0; --copies) {
      if (dice_.chance(s_.loss) || cut_.contains(std::minmax(from, to))) continue;
      at(now_ + s_.delay + s_.jitter * dice_.real(),
         [this, from, to, frame] { arrive(from, to, frame); });
    }
  }
  void arrive(HostId from, HostId to, const Link::Frame& frame) {
    Node& n = *nodes_[to.value];
    if (!n.alive || n.gone.contains(from)) return;
    std::vector<wire::Bytes> in_order;
    link(n, from).receive(frame.link, frame.payload, now_, in_order);
    for (const wire::Bytes& payload : in_order) {
      auto m = wire::decode(*payload);
      if (!m) return fail("a message cannot be read: " + m.error());
      if (n.core)
        n.core->receive(from, std::move(*m), now_);
      else
        manager_.receive(from, std::move(*m), now_);
    }
    pump(n);
  }

  // ---- what must be true in the end ----
  void check() {
    if (!manager_.finished())
      return fail("does not end: " + std::to_string(manager_.progress().paths_done) + " of " +
                  std::to_string(manager_.progress().paths_total) + " paths, phase " +
                  std::to_string(static_cast<int>(manager_.phase())) + state());
    if (manager_.phase() == ManagerCore::Phase::failed) return fail(manager_.error());
    check_film();
    const auto p = manager_.progress();
    if (!cancelled_ && p.paths_done != p.paths_total)
      return fail("paths were lost or counted twice");
    write_journal();
    check_journal();
    // A path waits at one host, and while it moves at two.
    const std::uint64_t hosts = nodes_.size() - 1, bound = 2 * hosts * std::max(s_.worker.path_credits, s_.worker.paging_credits);
    if (out_.most_segments > bound)
      return fail("a host held " + std::to_string(out_.most_segments) + " segments");
    // Frames for a host that does not answer: what its paths can say to it in the time until it is
    // given up, orders, and a report of every part.
    if (out_.most_frames > 2 * bound + kOrders + 2 * s_.scene.parts)
      return fail("a host kept " + std::to_string(out_.most_frames) + " frames for another");
    for (const auto& n : nodes_)
      if (n->core && n->alive && manager_.hosts().at(n->id).last.final()) check_empty(*n);
    for (const auto& n : nodes_)
      if (n->loader) out_.unloaded += n->loader->unloaded;
    for (const auto& [id, report] : manager_.hosts()) {
      out_.paged_in += report.last.counters().paged_in();
      out_.moved += report.last.counters().moved();
      out_.asked += report.last.counters().shadow_asked();
      out_.nearest_asked += report.last.counters().nearest_asked();
      out_.wasted += report.last.counters().wasted_paths();
      out_.dropped += report.last.counters().dropped_messages();
    }
    out_.generations = p.generation;
    out_.teams = p.teams;
    out_.teams_ended = p.teams_ended;
    if (p.generation <= 1 && out_.wasted != 0) return fail("paths were made in vain though nothing was lost");
  }
  // Of every pixel exactly the samples that the manager says it has, each once.
  void check_film() {
    const auto [paths, told] = reference(s_);
    const MadeUpEngine engine(s_.scene);
    const std::size_t pixels = std::size_t{s_.scene.width} * s_.height, per_pixel = manager_.film().sums_per_pixel();
    std::vector<PixelSums> expected(pixels * per_pixel);
    std::vector<PixelFeatures> features(s_.scene.features ? pixels : 0);
    std::uint64_t samples = 0;
    for (std::size_t t = 0; t < manager_.tiles(); ++t) {
      const auto tile = manager_.tile_sums(t);
      if (!tile) continue;
      for (std::uint32_t y = tile->y0; y < tile->y1; ++y)
        for (std::uint32_t x = tile->x0; x < tile->x1; ++x)
          for (const SampleRange& range : tile->samples)
            for (std::uint32_t i = range.begin; i < range.end; ++i, ++samples) {
              const std::size_t pixel = std::size_t{y} * s_.scene.width + x;
              const PathEnd& e = paths[pixel * s_.spp + i];
              const bool negative = engine.in_negative_lobe(static_cast<std::uint32_t>(pixel), i, false);
              if (!(e.flags & kEndInvalid)) expected[pixel * per_pixel + (negative ? 1 : 0)].add(e.radiance, i);
              if (!told.empty()) features[pixel].merge(told[pixel * s_.spp + i]);
            }
    }
    if (samples != manager_.progress().paths_done) return fail("paths are counted wrongly");
    const auto got = manager_.film().sums();
    for (std::size_t i = 0; i < expected.size(); ++i)
      if (expected[i].count != got[i].count || expected[i].sum != got[i].sum)
        return fail("pixel " + std::to_string(i / per_pixel) + " differs");
    if (features != manager_.features()) fail("what paths saw differs");
  }
  // It has all that the film has.
  void check_journal() {
    const auto made = header_of(journal_);
    if (!made) return manager_.progress().paths_done == 0 ? void() : fail("there is no journal");
    ManagerCore again(manager_options(journal_), job());
    CheckpointReader reader(journal_, *made);
    while (const auto tile = reader.next()) (void)again.restore(*tile);
    if (again.progress().paths_done != manager_.progress().paths_done)
      fail("the journal does not have everything");
  }
  // A host that has reported the end of its job holds nothing of it any more.
  void check_empty(const Node& n) {
    if (n.core->queued_segments() + n.core->kept_segments() != 0) fail("segments are left over");
    for (const TaskState state :
         {TaskState::fresh, TaskState::waiting, TaskState::submitting, TaskState::replying})
      if (n.core->tasks_in(state) != 0) fail(std::string("tasks are left over: ") + name(state));
  }
  std::string state() const {
    std::string text;
    for (const auto& n : nodes_) {
      if (!n->core) continue;
      const wire::Status st = n->core->status();
      text += "\n  host " + std::to_string(n->id.value) + (n->alive ? "" : " (dead)") +
              ": queued " + std::to_string(st.queued_segments()) + ", kept " +
              std::to_string(n->core->kept_segments()) + ", live " +
              std::to_string(st.live_paths()) + ", epoch " + std::to_string(st.epoch()) + "/" +
              std::to_string(st.generation()) + ", tasks";
      for (std::size_t i = 0; i < kTaskStates; ++i)
        text += " " + std::to_string(n->core->tasks_in(static_cast<TaskState>(i)));
    }
    return text;
  }

  const Scenario s_;
  Dice dice_;
  ManagerCore manager_;
  std::vector<std::unique_ptr<Node>> nodes_;  // by host number
  EventQueue events_;
  double now_ = 0;
  bool stopped_ = false, cancelled_ = false;
  std::set<std::pair<HostId, HostId>> cut_;
  Bytes journal_;
  Outcome out_;
};

}  // namespace

Outcome run(const Scenario& s) {
  if (s.restart_at == 0) return Simulation(s).run();
  Outcome first;
  Bytes journal = Simulation(s).run_until(s.restart_at, first.error);
  if (!first.error.empty()) return first;
  Dice dice(s.seed ^ 0x7e57);
  // What a crash leaves of the last writes is anybody's guess.
  if (!journal.empty() && dice.chance(0.5)) journal.resize(dice.below(journal.size()));
  Scenario other = s;  // the same job on another cluster
  other.threads = dice.between(1, 3);
  if (s.events.empty()) other.hosts = s.hosts + dice.between(0, 2);
  return Simulation(other, journal).run();
}

}  // namespace cloudrenderer::sim
