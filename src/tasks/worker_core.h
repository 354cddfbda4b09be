#pragma once
// The heart of a worker: tasks, queues, and who is told what. A value: no socket, no clock, no
// thread. Drivers hold one mutex around it and touch it once per batch or message:
//
//   connection:  core.receive(from, decoded message, now)            (delivered in order and once:
//   tasks/link.h) compute:     while (auto w = core.take(now)) { r = execute(engine, *w);
//   core.finish(*w, r, now); } loader:      the same with core.take_load(now) and execute(loader,
//   *w) timer:       core.tick(now), at the latest at core.deadline() after each:  for (auto& [to,
//   message] : core.take_outbox()) link(to).send(encode(message))
//
// receive/tick/finish may make new work ready: has_work() tells whether idle threads are to be
// woken. The driver answers Blob*, Hello, PeerHello and the rest of the handshake itself. Work may
// still be running when the loader gets end_job() or another start_job(): whoever executes it
// shares the ownership of its engine.
//
//                       a          b            c, j
//   blocks, ranges -> fresh -> ready -> running -> replying -> end
//                       | d       ^        | g
//                       v         | h      v
//                  submitting -> waiting (for replies of other hosts)
//                            f
#include <array>
#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <set>
#include <unordered_map>
#include <utility>
#include <vector>

#include "tasks/task.h"
#include "tasks/work.h"
#include "wire/messages.h"

namespace cloudrenderer {

struct WorkerOptions {
  std::uint32_t threads = 1;
  std::uint64_t path_credits = 131072;  // live paths of own renderer tasks at most
  std::size_t camera_batch = 16384;     // camera segments made at once
  std::size_t trace_batch =
      16384;  // small tracer and aggregator batches are joined up to this size
  std::size_t small_batch =
      2048;                       // local work below this waits while there are camera rays to make
  std::size_t low_mark = 131072;  // segments waiting here above which no camera rays are made
  float peer_load_limit_s = 2.f;  // nor while another host announces more queued work than this
  std::size_t block_segments =
      640;  // segments (about 64 KB) after which a block leaves; asks: 4 times as many
  double block_age_s =
      0.001;  // ... or after this time, or at once when the receiver owes no answer
  double status_every_s = 0.5;
  double retry_s = 0.05;  // batches without a holder, refused ones
  float alpha = 0.25f;    // load against hosts in the cover, 1/s
  // Instead of path_credits while parts are paged: the more paths wait, the more rays share the loading of a part.
  std::uint64_t paging_credits = 1u << 20;
  std::shared_ptr<SharedMaps> maps;  // null: this core makes its own
};

// What only the driver knows, for the report.
struct DriverCounters {
  std::uint64_t bytes_sent = 0, bytes_received = 0, memory_used = 0, memory_peak = 0, peak_rss = 0;
  double cpu_s = 0;
  // Other workers have acknowledged all that was sent to them. A host that leaves goes only then,
  // for nobody takes frames of a host that is off the list.
  bool drained = false;
};

class WorkerCore {
 public:
  using Outbox = std::vector<std::pair<HostId, wire::Message>>;

  // `self` and `incarnation` as agreed on in Hello/Welcome. Host 0 is the manager.
  WorkerCore(HostId self, std::uint64_t incarnation, const WorkerOptions& options);

  void receive(HostId from, wire::Message message, double now);
  void tick(double now);
  double deadline() const;                    // of the next tick that may do something
  std::optional<Work> take(double now);       // path work, deepest first
  std::optional<Work> take_load(double now);  // loader and unloader work; one at a time
  void finish(Work& work, WorkResult& result, double now);
  bool has_work() const;
  bool has_load_work() const;
  Outbox take_outbox() { return std::exchange(outbox_, {}); }

  // An attempt to reach a peer has failed (or succeeded again): told to the manager with every
  // status for some seconds, or for as long as attempts go on failing. It decides.
  void peer_unreachable(HostId peer);
  void peer_reachable(HostId peer);
  void set_driver_counters(const DriverCounters& c);
  // Asks the manager for leave; the host works on until left().
  void leave(const std::string& reason);
  bool left() const { return left_; }
  // Where peers are, of the last map; changes with hosts_version().
  const std::vector<wire::HostEntry>& hosts() const { return routing_->map()->entries(); }
  std::uint64_t hosts_version() const { return hosts_version_; }

  // ---- for the report, tests and the simulation ----
  wire::Status status() const;
  std::uint64_t dropped_messages() const { return dropped_; }
  std::size_t tasks_in(TaskState s) const { return in_state_[static_cast<std::size_t>(s)]; }
  std::size_t queued_segments() const { return queued_; }  // waiting for a thread here
  std::size_t kept_segments() const { return kept_; }  // waiting for another host, asks included
  std::uint64_t live_paths() const;
  bool idle() const;

 private:
  using Uuid = wire::TaskUuid;

  // Blocks that gather for one host: state submitting until they leave.
  struct Gather {
    std::vector<KeptSegments> segments;
    std::size_t segment_count = 0;
    double segments_since = 0;
    std::uint32_t segment_blocks_out = 0;  // unanswered
    std::vector<ParkedAsks> asks;
    std::size_t ask_count = 0;
    double asks_since = 0;
    std::uint32_t ask_blocks_out = 0;
    EndBatch ends;
    double ends_since = 0;
    Uuid segment_task, ask_task;  // in state submitting while something gathers
  };
  struct Waiting {  // submitted, reply to come
    std::variant<std::vector<KeptSegments>, std::vector<ParkedAsks>> kept;
    RoutingPtr at;
    std::size_t count = 0;
    bool nearest = false;  // segments that the other host was only asked about
  };
  struct Renderer {  // a renderer task of this host
    Uuid id;
    RendererRange range;
    std::deque<RendererLedger::Run> to_make;
    std::uint64_t unissued = 0, remaining = 0;
    bool cancelled = false;  // stays until its last path has ended, for it takes up credits
    std::uint64_t live() const { return remaining > unissued ? remaining - unissued : 0; }
  };
  template <class T>
  struct Ready {
    Uuid id;
    T item;
    std::size_t count = 0;
  };

  // worker_core.cpp: messages
  void handle(HostId from, wire::JobStart& m);
  void handle(HostId from, wire::JobEnd& m);
  void handle(HostId from, wire::CancelJob& m);
  void handle(HostId from, wire::CancelTask& m);
  void handle(HostId from, wire::HostList& m);
  void handle(HostId from, wire::SceneHostMap& m);
  void handle(HostId from, wire::LoadParts& m);
  void handle(HostId from, wire::UnloadParts& m);
  void handle(HostId from, wire::SubmitTask& m);
  void handle(HostId from, wire::Reply& m);
  void handle(HostId from, wire::PathEnds& m);
  template <class M>
  void handle(HostId, M&) {
    ++dropped_;
  }  // not for a worker in the middle of a job

  void forget_cancelled();
  void submit_renderer(Uuid id, const RendererRange& range);
  void submit_block(HostId from, wire::SubmitTask& m);
  void forget_in_flight();  // all path work but renderer tasks and path ends
  void forget_job();
  void regroup();
  bool known(HostId h) const { return routing_->slot(h) != Routing::kNoSlot; }
  bool gone(HostId h) const { return !known(h) && h.value < seen_.size() && seen_[h.value]; }
  void unload(const std::vector<std::uint32_t>& parts, bool before_paths);
  void end_job(const std::string& reason);

  // worker_queues.cpp: tasks, blocks for other hosts
  Task& create(Uuid id, TaskCategory category, HostId submitter);
  Task& create(TaskCategory category) {
    return create({incarnation_, next_number_++}, category, self_);
  }
  void move(Task& task, TaskMove m);  // erases the task at its end
  void move(Uuid id, TaskMove m) { move(tasks_.at(id), m); }
  void end_inline(Uuid id);  // a waiting task that has nothing left to do
  void ready_local(std::vector<PathSegment> segments);
  void ready_shade(SegmentBatch batch);
  void ready_returned(Uuid id, TraceWork::Returned returned, std::size_t count);
  void ready_resolve(Uuid id, ResolveWork::Answered answered, std::size_t count);
  void gather(HostId to, KeptSegments kept);
  void gather(HostId to, ParkedAsks asks);
  void gather_ends(HostId to, EndBatch ends);
  void flush(HostId to, Gather& g);
  void flush_all();
  void send_segments(HostId to, Gather& g);
  void send_asks(HostId to, Gather& g);
  void strand(Uuid id, std::variant<TraceWork::Returned, ResolveWork::Answered> item,
              std::size_t count);
  void retry_stranded(bool all);

  // worker_pages.cpp: parts that no host holds
  using PagedItem = std::variant<TraceWork::Returned, ResolveWork::Answered>;
  void page(PartId part, PagedItem item, std::size_t count);
  void wake(PartId part);
  void wake_all();
  bool may_page() const;
  Work take_page();
  std::vector<PartId> take_pages();
  void keep_pages(const std::vector<PartId>& pages);
  void finish_page(const PageWork& work, WorkResult& r, double taken);
  std::uint64_t credits() const {
    return routing_->paging() ? options_.paging_credits : options_.path_credits;
  }

  // worker_take.cpp: work and results
  bool may_make_camera() const;
  bool may_collect() const { return !collecting_ && (!own_ends_.empty() || list_missing_); }
  bool may_unload() const;
  Work base_work(double now);
  void run(Work& work, Uuid id);
  Work take_camera(double now);
  Work take_trace(double now);
  Work take_shade(double now);
  Work take_occlude(double now);
  Work take_resolve(double now);
  Work take_collect(double now);
  void finish_collect(const CollectWork& work, WorkResult& r);
  void finish_load(const Work& work, WorkResult& r);
  void count_tasks(const Work& work);
  void say_visits(wire::Status& s);
  void send(HostId to, wire::Message m) {
    drained_ = drained_ && std::holds_alternative<wire::Status>(m);
    outbox_.emplace_back(to, std::move(m));
  }

  HostId self_;
  std::uint64_t incarnation_;
  WorkerOptions options_;
  Outbox outbox_;
  bool leaving_ = false, left_ = false;
  bool drained_ = false;  // nothing but status has been sent since the driver said so

  // job
  std::optional<wire::JobStart> job_;
  bool job_ready_ = false;
  wire::ColumnSet columns_ = wire::kAllColumns;
  RoutingPtr routing_ = std::make_shared<const Routing>();
  std::uint32_t refuse_below_ =
      0;  // epoch: blocks routed by an older map may ask for unloaded parts
  std::uint64_t hosts_version_ = 0;
  std::map<HostId, double> unreachable_;  // and when an attempt failed last
  std::vector<bool> seen_;  // by number, hosts of all maps of this job: what is not in it is yet to come

  // tasks
  std::uint64_t next_number_ = 1;
  std::unordered_map<Uuid, Task> tasks_;
  std::array<std::size_t, kTaskStates> in_state_{};
  std::unordered_map<Uuid, Waiting> waiting_;
  std::deque<Ready<std::vector<PathSegment>>> ready_local_;
  std::deque<Ready<TraceWork::Arrived>> ready_arrived_;
  std::deque<Ready<TraceWork::Returned>> ready_returned_;
  std::deque<Ready<SegmentBatch>> ready_shade_;
  std::deque<Ready<OccludeWork::Asked>> ready_occlude_;
  std::deque<Ready<ResolveWork::Answered>> ready_resolve_;
  std::deque<Ready<Work>> ready_load_;
  std::map<HostId, Gather> gather_;
  std::set<HostId> filling_;  // for whom something gathers
  struct Stranded {
    double since;
    Uuid id;
    std::variant<TraceWork::Returned, ResolveWork::Answered> item;
    std::size_t count;
  };
  std::vector<Stranded> stranded_;  // fresh: no holder at present
  std::vector<std::pair<HostId, wire::SubmitTask>>
      early_;  // of a generation that this host does not know yet

  // parts that come and go
  struct Paged {
    struct Item {
      Uuid id;
      PagedItem item;
      std::size_t count;
    };
    std::vector<Item> items;
    std::size_t count = 0;  // segments and rays
  };
  std::map<PartId, Paged> paged_;  // what waits, by part
  std::set<PartId> pages_;         // resident for a while
  double next_page_ = 0;           // no attempt before: there was no room
  std::uint32_t pages_declined_ = 0;  // in a row

  // renderer tasks of this host
  std::map<std::uint32_t, Renderer> renderers_;
  Ledgers ledgers_;
  bool collecting_ = false;    // a thread has the ledgers
  bool list_missing_ = false;  // to be asked of the next collection
  bool remaking_ = false;      // until it has answered no camera rays are made
  std::vector<EndBatch> own_ends_;
  std::vector<RendererRange> opened_;

  std::size_t queued_ = 0, kept_ = 0, running_ = 0;
  std::size_t local_queued_ = 0, shade_queued_ = 0;  // parts of queued_
  bool loading_ = false;
  std::size_t drops_ = 0;      // unloads before which no path work is taken
  double segments_per_s_ = 0;  // measured, one thread
  double next_status_ = 0;
  std::vector<std::uint64_t> visits_;  // by part: those that the manager does not know of
  std::uint64_t visits_said_ = 0;      // the sum of the others
  double busy_s_ = 0;
  std::uint64_t dropped_ = 0;  // messages that fit nothing here
  wire::Counters counters_;
  DriverCounters driver_;
  double now_ = 0;
};

}  // namespace cloudrenderer
