#pragma once
// What a compute thread takes from a WorkerCore, and what it brings back. execute() is the only
// place where batches are computed; it is pure, runs outside of every lock, and is all that the
// simulation and the real drivers share.
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <unordered_map>
#include <utility>
#include <variant>
#include <vector>

#include "integrator/engine.h"
#include "tasks/routing.h"
#include "tasks/task.h"
#include "trace/bvh_form.h"
#include "wire/messages.h"

namespace cloudrenderer {

// Segments kept until another host has answered for them, with what this host knows of them.
struct KeptSegments {
  wire::SegmentChunk segments;
  std::vector<Hit> hits;
  std::vector<AnsweredSurface> surfaces{};  // of hits that other hosts have answered
};
// Paths that wait for one answer each; arrays of equal length but for `parts`.
struct ParkedAsks {
  wire::RayChunk rays;
  wire::TimeChunk times;  // of the rays; null where nothing moves
  std::vector<ParkedPath> paths;
  std::vector<Fixed3> contributions;  // added when the ray is free
  std::vector<std::uint32_t>
      part_end;  // ray i still has to pass parts[part_end[i - 1], part_end[i])
  std::vector<PartId> parts;
  std::size_t size() const { return paths.size(); }
};

// The samples of a renderer task that have arrived: a bit each, and exact sums. A sample counts
// once. In jobs with features it is complete when its path has told all (or that there is nothing), in any order.
class RendererLedger {
 public:
  RendererLedger(const RendererRange& range, std::uint32_t film_width, bool features = false, bool negative_lobes = false);
  enum class Outcome { counted, duplicate, foreign };
  Outcome record(const PathEnd& end, bool negative_lobe = false);  // true only if the ledger has negative lobes
  Outcome record(const PathFeatures& features);
  const RendererRange& range() const { return range_; }
  std::uint64_t remaining() const { return remaining_; }
  // Runs [first, first + count) of path numbers (in the order of PathEngine::camera) that have not
  // arrived.
  struct Run {
    std::uint64_t first, count;
  };
  std::vector<Run> missing() const;
  wire::RendererReply reply() &&;  // consumes the sums

 private:
  struct Place {
    std::size_t pixel, sample;
  };
  std::optional<Place> place(std::uint32_t task, std::uint32_t pixel, std::uint32_t sample) const;
  void complete(const Place& at);
  void arrived(const Place& at, std::uint8_t what);

  RendererRange range_;
  std::uint32_t film_width_;
  std::size_t sums_per_pixel_;
  std::uint64_t remaining_;
  std::vector<std::uint64_t> bits_;
  std::vector<PixelSums> sums_;
  std::vector<std::uint8_t> arrived_;  // by sample, in jobs with features: kTellsHit, kTellsSurface, kEnded
  std::vector<PixelFeatures> features_;
  std::unordered_map<std::uint32_t, Splat> splats_;  // by pixel
  std::uint64_t invalid_ = 0, clamped_ = 0;
};
using Ledgers = std::unordered_map<std::uint32_t, RendererLedger>;  // by renderer task number

struct CameraWork {  // renderer: make camera segments
  RendererRange range;
  std::uint16_t owner = 0;
  std::uint64_t first = 0, count = 0;
};
struct TraceWork {  // tracer: local segments, blocks of other hosts, and what other hosts gave
                    // back, as one batch
  std::vector<std::vector<PathSegment>> local;
  struct Arrived {
    wire::TaskUuid id;
    HostId from;
    wire::SegmentBlock block;
  };
  std::vector<Arrived> arrived;
  struct Returned {
    std::vector<KeptSegments> kept;
    wire::TracerReply reply;  // count 0: not asked at all, every segment looks for another way
    // Instead, of a host that only intersects, with all that it held by the map at which it was asked.
    wire::NearestReply nearest{};
    HostId by{};
    RoutingPtr at{};
  };
  std::vector<Returned> returned;
};
struct ShadeWork {  // aggregator
  std::vector<SegmentBatch> batches;
};
struct OccludeWork {  // intersection, for other hosts
  struct Asked {
    wire::TaskUuid id;
    HostId from;
    wire::OcclusionBlock block;
  };
  std::vector<Asked> asked;
};
struct ResolveWork {  // intersection: answers to our asks
  struct Answered {
    std::vector<ParkedAsks> asks;
    HostId by;      // none: not asked, every ray looks for a holder again
    RoutingPtr at;  // by which the host was chosen
    wire::OcclusionReply reply;
  };
  std::vector<Answered> answered;
};
struct CollectWork {  // renderer: record path ends. One at a time: it holds the ledgers.
  Ledgers ledgers;
  std::vector<EndBatch> ends;
  std::vector<RendererRange> opened;  // renderer tasks that are new since
  bool list_missing = false;          // a host was lost: say what is to be made again
};
struct StartJobWork {  // loader
  wire::JobStart job;
};
struct LoadWork {  // loader
  std::vector<PartId> parts;
  std::vector<PartId> evict;  // may be unloaded to make room, the last one first; what is not stays in the list
};
struct PageWork {  // loader: a part that no host holds, for a while
  PartId part;
  std::vector<PartId> evict;
};
struct UnloadWork {  // unloader
  std::vector<PartId> parts;
  bool before_paths = false;  // path work waits for it
};
struct EndJobWork {  // unloader: drop everything
  std::string reason;
};

struct Work {
  std::variant<CameraWork, TraceWork, ShadeWork, OccludeWork, ResolveWork, CollectWork,
               StartJobWork, LoadWork, PageWork, UnloadWork, EndJobWork>
      what;
  std::vector<wire::TaskUuid> tasks;  // that are running in it
  RoutingPtr routing;                 // never null for work that needs it
  std::uint64_t job = 0;
  std::uint32_t film_width = 0;
  bool features = false;
  double taken = 0;              // clock at take()
  std::size_t segments() const;  // size for load and speed
};

// Segments and asks that leave for one host (or, with none, find no holder at present).
struct LeavingSegments {
  HostId to;
  KeptSegments kept;
};
struct LeavingAsks {
  HostId to;
  ParkedAsks asks;
};

// What waits for a part that this host will load for a while (Routing::paged).
struct PagedSegments {
  PartId part;
  KeptSegments kept;
};
struct PagedAsks {
  PartId part;
  ParkedAsks asks;
};

struct WorkResult {
  std::vector<PathSegment> next;  // to be traced here
  SegmentBatch to_shade;
  std::vector<LeavingSegments> leaving;
  std::vector<LeavingAsks> asks;
  std::vector<PagedSegments> paged;
  std::vector<PagedAsks> paged_asks;
  std::vector<std::pair<HostId, EndBatch>> ends;  // by owner
  std::vector<std::pair<HostId, wire::Reply>> replies;
  RayCounts counts;
  // TraceWork: a part, and how many rays in a row have their nearest hit there, or go on to it.
  std::vector<std::pair<std::uint32_t, std::uint32_t>> visits;
  // CollectWork
  Ledgers ledgers;
  std::vector<wire::RendererReply> completed;
  std::vector<std::pair<std::uint32_t, std::uint64_t>> remaining;  // task, samples still to come
  std::vector<std::pair<std::uint32_t, std::vector<RendererLedger::Run>>> missing;
  std::uint64_t duplicates = 0, unknown = 0;
  // loaders
  std::vector<PartId> loaded, unloaded, declined;
  std::uint64_t bytes_used = 0;
  std::string error;
};

// What the loader categories need: the driver's own part store, scene and engine. Calls are made
// one at a time.
class PartLoader {
 public:
  virtual ~PartLoader() = default;
  // Fetches the manifest and builds what every host has (main scene, part map, engine). "" or an
  // error.
  virtual std::string start_job(const wire::JobStart& job) = 0;
  // False when loading the part could take more memory than the host may use, as things are: others are evicted, or
  // it is declined.
  virtual bool has_room(PartId, BvhForm) const { return true; }
  // Makes a part traceable (also for batches that run at this moment). "" or an error.
  virtual std::string load(PartId part, BvhForm form) = 0;
  virtual void unload(PartId part) = 0;
  virtual void end_job() = 0;
  virtual std::uint64_t bytes_used() const = 0;
};

// Path work; consumes `work.what`. The engine may be shared by many threads.
WorkResult execute(const PathEngine& engine, Work& work);
// Loader and unloader work.
WorkResult execute(PartLoader& loader, Work& work);
bool is_loader_work(const Work& work);

}  // namespace cloudrenderer
