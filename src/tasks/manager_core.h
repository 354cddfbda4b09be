#pragma once
// The heart of the manager: who is there, who holds what, which renderer task is whose, and the
// film. A value, driven like WorkerCore: receive(), tick(), take_outbox(); no socket, no clock, no
// thread.
//
// Life of a job: gathering (until min_hosts have joined) -> loading (until every part has a holder)
// -> rendering -> ending (final counters) -> done. Hosts may join, leave and be lost in every
// phase.
#include <cstdint>
#include <limits>
#include <list>
#include <map>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "base/error.h"
#include "film/film.h"
#include "integrator/shared_rays.h"
#include "tasks/checkpoint.h"
#include "tasks/placement.h"
#include "tasks/progress_record.h"
#include "tasks/sample_set.h"
#include "tasks/share_trial.h"
#include "wire/messages.h"

namespace cloudrenderer {

struct ManagerOptions {
  std::uint64_t incarnation = 1;
  std::uint32_t min_hosts = 1;
  std::uint32_t replication = 1;
  double heartbeat_s = 0.5;
  double lost_after_s = 3;           // without any message of a host
  double end_wait_s = 3;             // for final counters
  double map_every_s = 1;            // the others learn what a host has loaded before it has all
  // What may be said in a second, of loads and of what more has been loaded, to all hosts together: where they are
  // thousands it is said less often.
  double news_bytes_per_s = 32e6;
  double statuses_per_s = 4000;      // of all hosts: where they are thousands, each says less often how it is
  std::uint32_t team_hosts = 256;    // of more than twice as many, teams of about so many, if the scene fits each twice
  double newcomers_wait_s = 10;      // at most, for so many that they can be a team where all teams are full
  std::uint32_t tile = 32;           // pixels; smaller for small pictures
  std::uint32_t round_samples = 16;  // samples per pixel of a round; rounds follow each other
  bool hold_rounds = false;          // a round starts only after next_round()
  double task_seconds = 5;           // of work at most
  std::uint32_t smallest_tile = 8;   // pixels: many hosts make tiles smaller, but not than this
  std::uint64_t smallest_task = 512;  // paths; less is not worth a message
  std::uint32_t first_generation = 1;
  bool allow_inexact = false;
  // How long to wait for more hosts when the scene does not fit those that are there; then the job
  // fails.
  double wait_for_room_s = 0;
  bool keep_merged = false;  // for take_merged()
  // To go on from a checkpoint: its tile size, fixed then, and its hosts' fingerprint.
  std::uint32_t fixed_tile = 0;
  std::optional<std::uint64_t> fingerprint;
};

// What the core must know of the scene; the rest is the driver's.
struct JobSpec {
  wire::JobStart start;  // sent to every host as it is
  FilmFrame frame;
  int k = 0;
  FilterLobes lobes;
  std::uint32_t spp = 1;
  std::uint32_t samples_per_ray = 1;  // as in JobSettings: tasks keep the groups of samples whole
  bool share_if_worth = false;
  std::uint64_t seed = 0;
  std::vector<PlacementPart> parts;  // [0] the main scene's geometry
  std::vector<std::uint64_t> prototype_bytes;
  std::vector<std::vector<std::string>> part_features;  // needed by the part; empty: none
};

class ManagerCore {
 public:
  enum class Phase { gathering, loading, rendering, ending, done, failed };
  using Outbox = std::vector<std::pair<HostId, wire::Message>>;
  struct Sending {  // one message to many, which is encoded once
    std::vector<HostId> to;
    wire::Message message;
  };

  ManagerCore(const ManagerOptions& options, JobSpec job);
  ManagerCore(const ManagerCore&) = delete;  // teams and hosts point to each other
  ManagerCore& operator=(const ManagerCore&) = delete;

  // A host asks to join (its secret has been checked). Gives it a number, and queues Welcome and
  // its orders; or says why it is refused: the driver then sends Refused.
  Result<HostId> join(const wire::Hello& hello, double now);
  void receive(HostId from, wire::Message message, double now);
  // The driver knows that a host is gone for good (its connection ended and did not come back in
  // time).
  void host_lost(HostId host, double now);
  void tick(double now);
  double deadline() const { return next_tick_; }
  std::vector<Sending> take_sendings() { return std::exchange(outbox_, {}); }
  Outbox take_outbox();  // the same, a message each
  // Hosts that the core has given up or let go since the last call: their links are to be closed.
  std::vector<HostId> take_gone() { return std::exchange(gone_, {}); }

  Phase phase() const { return phase_; }
  bool finished() const { return phase_ == Phase::done || phase_ == Phase::failed; }
  const std::string& error() const { return error_; }  // phase failed: for ClusterError

  // "": nothing; else for people: why the job does not go on without more hosts.
  const std::string& waiting_for() const { return no_room_; }

  // No more tasks are handed out; the job ends when those on the way are in (--max-time,
  // interrupt).
  void stop(double now);
  // Ends at once (interrupt): the film keeps what is there.
  void cancel(const std::string& reason, double now);
  // With hold_rounds: a round is complete, and the driver decides by the film: next_round() or
  // stop().
  bool round_complete() const;
  // Until every tile has got as many samples as its goal says; without goals round_samples more in each.
  // `expected`: paths of the whole job, as far as is known; 0: not at all.
  void next_round(double now, std::vector<std::uint32_t> goals = {}, std::uint64_t expected = 0);
  // With hold_rounds, by tile: samples that it has got at the end of the round.
  std::span<const std::uint32_t> goals() const { return goals_; }
  // Of an earlier run's last round; before restore() and the first host, with fixed_tile. False: they cannot be.
  bool restore_goals(std::vector<std::uint32_t> goals);
  std::uint32_t decisions() const { return decisions_; }  // how often the goals have changed
  std::uint32_t complete_samples() const;  // samples per pixel of all complete rounds
  std::uint32_t samples_per_ray() const { return shares_ ? job_.samples_per_ray : 1; }
  std::optional<double> shared_variance() const { return shared_variance_; }  // ShareTrial::ratio(), once it has been made

  // What an earlier run of this job has done; before the first host joins, with fixed_tile. False,
  // and nothing has changed: it is no tile of this film, or some of it is already there, or it has
  // more than spp samples. A job of which nothing is left is done.
  bool restore(const TileSums& tile);
  // The sums that were merged into the film since the last call (with keep_merged).
  std::vector<TileSums> take_merged() { return std::exchange(merged_, {}); }
  // All that a tile of the film has got, but for the counts of invalid and clamped samples, which
  // progress() has for the whole film; none: nothing yet.
  std::size_t tiles() const { return covered_.size(); }
  std::optional<TileSums> tile_sums(std::size_t tile) const;
  RendererRange tile_range(std::size_t tile) const;            // its pixels, without samples
  std::uint64_t tile_samples(std::size_t tile) const;          // of each of its pixels, in the film
  std::uint32_t tile_size() const { return covered_.empty() ? 0 : tile_; }
  std::optional<std::uint64_t> fingerprint() const { return fingerprint_; }

  Film& film() { return film_; }
  const Film& film() const { return film_; }
  // Row by row as the film; empty in jobs without features.
  std::vector<PixelFeatures>& features() { return features_; }

  struct HostReport {
    wire::Hello hello;
    double joined = 0;
    std::optional<double> left;
    bool lost = false;
    wire::Status last;  // counters, as of the last status
    double paths_done = 0;
  };
  const std::map<HostId, HostReport>& hosts() const { return reports_; }
  // The parts that a host has reported; none of one that has gone.
  std::vector<PartId> held_by(HostId host) const;
  struct Progress {
    std::uint64_t paths_done = 0, paths_total = 0;
    std::uint64_t paths_restored = 0;  // of those done: by an earlier run
    std::uint32_t hosts = 0, hosts_loading = 0;
    std::uint32_t tracers = 0;  // of these; the others only intersect, and can do nothing alone
    std::uint32_t paged_parts = 0;  // that no host holds, for want of memory
    std::uint64_t invalid_samples = 0, clamped_samples = 0;
    std::uint32_t epoch = 0, generation = 0;
    std::uint32_t teams = 0, teams_ended = 0;
    std::uint64_t dropped_messages = 0;
    double render_began = 0, render_ended = 0;
  };
  Progress progress() const;
  // Share of the render time that the last `share` of this run's paths took.
  double tail(double share) const {
    return record_.tail(progress_.render_began, progress_.paths_restored, share);
  }
  bool bit_exact() const { return bit_exact_; }

 private:
  struct Team;
  static bool can(const wire::Hello& hello, wire::Category category);
  static bool has_feature(const wire::Hello& hello, const std::string& feature);  // none named: all
  struct Host {
    wire::HostEntry entry;
    wire::Hello hello;
    Team* team = nullptr;
    double heard = 0;
    bool started = false;          // has reported the job's main scene ready
    bool mapped = false;           // the hosts know it: it may hold parts and own renderer tasks
    std::size_t mapped_parts = 0;  // that the last map gave it
    bool changed = false;          // since the last map
    std::uint32_t told = 0;        // the last map that it was sent
    double told_load = 0;          // that the others were told
    bool leaving = false, final = false;
    std::uint32_t released = 0;  // leaving: epoch from which on it is no holder
    std::set<PartId> holds;      // reported
    std::set<PartId> wanted;     // ordered or held
    std::set<PartId> declined;   // the host has found no room for them
    // Drops that the host has not reported yet: until then it tells of earlier orders, though the
    // part may be wanted again.
    std::map<PartId, std::uint32_t> unloading;
    std::uint64_t unforeseen =
        0;  // bytes of the main scene that no part's prediction has: textures
    bool complete() const { return started && holds.size() == wanted.size(); }
    bool can_hear_changes = false;  // else it is told everything at every change
    bool traces() const { return can(hello, wire::TRACER); }  // else segments are asked of it, not moved
    double threads() const;  // as many as a host can sensibly have
    std::uint64_t outstanding_paths = 0;
    std::uint32_t outstanding_tasks = 0;
    wire::Status status;
    double paths_per_s = 0;  // measured since rate_since
    double rate_since = 0;
    double fed = 0;  // when it last replied, or was given something after having nothing
    std::uint64_t rate_paths = 0;
  };
  // Holders of each part among started hosts: that have not been released, and of these that do not leave. So that hosts
  // and parts need not be gone through at every message.
  struct Holders {
    std::vector<std::uint32_t> of;  // by part
    std::size_t unheld = 0;         // parts
    std::uint32_t tracers = 0;
  };
  // Hosts that hold the whole scene together. A path stays in its team, so that a host knows the others of its team only:
  // maps, loads, connections, and what a lost host costs do not grow with the cluster. Few hosts are one team.
  struct Team {
    explicit Team(std::size_t parts);
    std::map<HostId, Host*> hosts;
    std::uint32_t epoch = 0, generation = 1;  // of the last map; of the hosts' path work
    bool mapped_all = false;                  // every part had a holder in the last map
    std::vector<std::uint32_t> gone_since_map;
    Holders there, staying;
    std::set<PartId> paged;  // parts that have no holder, for want of memory: hosts load them for a while
    std::uint32_t pause = 0;  // epoch from which on no camera rays are made, until no path is under way
    double next_growth = 0;   // of the map, by hosts that still load
    double next_list = 0, told_heartbeat = 0;
    bool placement_due = false;
    bool able = false;       // every part has a holder, as of the last look
    bool gathering = false;  // newcomers that are too few yet
    bool broken = false;     // what is left of it cannot hold the scene: its hosts go to the other teams
    double waits_until = 0;  // gathering
  };
  struct Outstanding {
    RendererRange range;
    HostId host;
    Host* at;  // in hosts_
    std::uint32_t twin = 0;  // the other copy of the same range, under another number
  };

  // manager_plan.cpp: what hosts shall hold
  // What hosts shall hold from now on; with `drop`, surplus copies may go to make room.
  struct Plan {
    std::map<HostId, std::vector<PartId>> hold, drop;
    std::set<PartId> paged;  // nobody's
  };
  enum class Keep { all, one_copy };  // of what hosts hold already
  PlacementInput placement(const Team& t, bool with_leaving, Keep keep) const;
  Result<Plan> plan(const Team& t, bool with_leaving, Keep keep) const;
  Result<Plan> plan_paged(const Team& t, bool with_leaving) const;
  Plan plan_of(const PlacementInput& in, std::vector<std::vector<PartId>> hold) const;
  // Or none: nothing to do, no room (see no_room_), or no more use for the team (see Team::broken).
  std::optional<Plan> find_plan(Team& t, double now);
  void place(Team& t, double now);
  bool adopt(Team& t, const Plan& p);
  void drop(const Plan& p);
  void order(const Team& t, const Plan& p);
  std::vector<double> visits() const;
  std::vector<double> pressure(const Team& t) const;
  bool everything_held(const Team& t, bool by_leaving) const;
  bool everything_wanted(const Team& t, bool by_leaving) const;
  bool enough_complete(const Team& t) const;
  std::optional<Plan> smaller_plan(const Team& t) const;
  void make_room(Team& t, double now);
  void end_pause(Team& t, double now);
  bool everything_covered(const Team& t) const;

  // manager_teams.cpp: which hosts work together, and what they are told of each other
  void enter(HostId id, Host& h, Team& t);
  void form_teams();
  bool have_room(std::span<Host* const> hosts, std::size_t teams) const;
  Team& team_for_newcomer(double now);
  void look_at_newcomers(double now);
  void end_broken_teams(double now);
  Team* smallest_team();
  void new_map(Team& t, bool generation, const Plan* with_drops = nullptr);
  void send_host_list(Team& t, double now);
  double heartbeat() const;

  // manager_core.cpp: who is there, and who holds what
  std::uint64_t main_bytes() const;
  std::string instruction_sets() const;  // of the hosts that set the measure
  double lost_after() const;
  // What the team's holders count of this host, and no more.
  void count_holds(const Host& h, int sign);
  void count_hold(const Host& h, PartId p);  // one more
  void handle(HostId from, Host& h, wire::LoadReport& m, double now);
  void handle(HostId from, Host& h, wire::Reply& m, double now);
  void handle(HostId from, Host& h, wire::Status& m, double now);
  void handle(HostId from, Host& h, wire::Leave& m, double now);
  template <class M>
  void handle(HostId, Host&, M&, double) {
    ++progress_.dropped_messages;
  }
  void remove(HostId id, bool lost, double now);
  void take_counters(HostId from, wire::Status& m);
  bool depart(HostId id, double now);
  void all_gone();
  void try_release(HostId id, double now);
  void check_unreachable(double now);
  void check_loaded(Team& t, double now);

  // manager_handout.cpp: renderer tasks and the end
  void begin_rendering(double now);
  void hand_out(double now, HostId only = {});
  enum class Turn { enough, given, nothing_left };
  Turn give_one(HostId id, Host& h, double now);
  std::optional<RendererRange> next_range(std::uint64_t paths);
  static bool renders(const Host& h);  // as of the last look at its team
  double speed(const Host& h, double per_thread) const;
  std::uint64_t task_paths(const Host& h, double share) const;
  void give_again(double now);
  std::uint32_t give(HostId id, Host& h, RendererRange range, double now);
  void take_back(std::map<std::uint32_t, Outstanding>::iterator o);
  void merge(const Outstanding& o, wire::RendererReply& r);
  void merge(const RendererRange& range, std::span<const PixelSums> sums, std::span<const PixelFeatures> features,
             std::span<const Splat> splats);
  bool fits(const wire::RendererReply& r, const RendererRange& range) const;
  bool fits(std::span<const Splat> splats) const;
  void add_splats(std::size_t tile, std::vector<Splat>& to) const;  // of its pixels
  void set_tile(std::uint32_t tile);
  void begin_held_rounds();
  void lengthen_rounds();
  void count_rounds();
  bool held_to_the_end() const;
  SampleRange wanted(std::size_t tile) const;  // of the round that is handed out
  // Samples that share camera rays are rendered together, or not at all: a picture with some of a group is wrong.
  void begin_trial();
  void end_trial();
  std::uint32_t whole_groups(std::uint32_t samples) const;  // at least so many, with the last one's group
  SharedRays shared_rays() const { return {job_.samples_per_ray, job_.spp}; }
  std::uint64_t missing_paths() const;
  void cover(std::size_t tile, SampleRange samples);
  void advance_cursor();
  std::uint32_t rounds() const {
    return (job_.spp + options_.round_samples - 1) / options_.round_samples;
  }
  bool nothing_left() const;
  void check_end(double now);
  void begin_end(const std::string& reason, double now);
  void check_final(double now);
  void fail(const std::string& why, double now);
  void send(HostId to, wire::Message m) { outbox_.push_back({{to}, std::move(m)}); }
  void send(std::vector<HostId> to, wire::Message m) {
    if (!to.empty()) outbox_.push_back({std::move(to), std::move(m)});
  }

  ManagerOptions options_;
  JobSpec job_;
  Film film_;
  std::vector<PixelFeatures> features_;
  Phase phase_ = Phase::gathering;
  std::string error_;
  std::vector<Sending> outbox_;
  std::vector<HostId> gone_;
  std::map<HostId, double> departing_;  // released, and until when their final counters are waited for
  std::map<HostId, Host> hosts_;
  std::map<HostId, HostReport> reports_;
  std::uint32_t next_host_ = 1;
  std::list<Team> teams_;  // at least one
  std::uint32_t epoch_ = 0, generation_ = 0;  // the highest of any team
  std::uint32_t lists_ = 0;
  double told_heartbeat_ = 0;
  std::size_t finals_ = 0;       // hosts that have said their last
  double next_turn_ = 0;         // when tasks are handed out to all hosts again
  double next_again_ = 0;        // when second copies are
  double per_thread_ = 1, total_speed_ = 0;
  std::optional<std::uint64_t> fingerprint_;
  bool bit_exact_ = true;

  // Renderer tasks: (round, tile) in order, a cursor inside the tile's samples, and ranges that
  // came back.
  std::uint32_t tile_ = 32, tiles_x_ = 0, tiles_y_ = 0;
  std::uint32_t round_ = 0, allowed_rounds_ = 0, cursor_tile_ = 0;
  std::vector<SampleSet> covered_;  // by tile: samples in the film
  std::vector<std::uint32_t> goals_;
  std::uint32_t decisions_ = 0;
  std::vector<TileSums> merged_;
  std::vector<RendererRange> returned_;
  std::optional<ShareTrial> trial_;  // goes before all else
  std::optional<double> shared_variance_;
  bool shares_ = false;              // samples share camera rays, where their groups are whole
  std::map<std::uint32_t, Outstanding> outstanding_;
  std::uint32_t next_task_ = 1;
  bool stopped_ = false;
  std::uint64_t unassigned_paths_ = 0;
  std::vector<std::uint64_t> round_left_;  // paths of every round that have not arrived
  std::uint64_t next_number_ = 1;          // of task ids
  std::map<HostId, double> unreachable_since_;
  std::vector<double> visits_;  // by part: rays, of all hosts
  std::optional<double> no_room_since_;
  std::string no_room_;

  Progress progress_;
  std::optional<double> last_tick_;
  double last_now_ = 0;
  double next_look_ = std::numeric_limits<double>::infinity();  // at how many hosts have loaded everything
  ProgressRecord record_;  // of the paths in the film
  double next_tick_ = 0, end_deadline_ = std::numeric_limits<double>::infinity();
};

}  // namespace cloudrenderer
