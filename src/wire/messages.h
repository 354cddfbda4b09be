#pragma once
// All that hosts say to each other. Control messages are the generated protobuf values themselves
// (messages.proto lists their fields once); the three that carry columns are the structs below.
//
// To add a message: its fields in messages.proto (or a struct here with its codec in
// bulk_codec.cpp), one word at the END of the variant (the index, from 0, is the type number on the
// wire), one handler in the core that gets it.
#include <compare>
#include <cstdint>
#include <functional>
#include <memory>
#include <variant>
#include <vector>

#include "film/film.h"
#include "integrator/answered_hit.h"
#include "integrator/path_segment.h"
#include "wire/messages.pb.h"

namespace cloudrenderer::wire {

inline constexpr std::uint32_t kProtocolVersion = 2;

// Names a task everywhere: the incarnation of the host that made it, and its running number there.
// Never used twice.
struct TaskUuid {
  std::uint64_t origin = 0, number = 0;
  friend auto operator<=>(const TaskUuid&, const TaskUuid&) = default;
};

// The optional columns of a job's segment blocks; the others always travel.
enum Column : std::uint32_t {
  kColumnBestHit = 1,  // some segment visits more than one holder: more than two parts
  kColumnTested = 2,   // likewise; with the window
  kColumnPreviousNormal = 4,
  kColumnCone = 8,  // textures with a footprint; null surfaces in media; light paths
  kColumnMedium = 16,  // scenes whose rays are in one medium or another
};
using ColumnSet = std::uint32_t;
inline constexpr ColumnSet kAllColumns = 31;
// Bytes of a segment in a block; radiance_bytes: of a channel, as wide as the block's largest.
std::size_t segment_bytes(ColumnSet columns, std::size_t radiance_bytes);

// Shared, because a sender keeps its segments until they are answered. A block is the concatenation
// of its chunks; a decoded block has one chunk.
using SegmentChunk = std::shared_ptr<const std::vector<PathSegment>>;
using RayChunk = std::shared_ptr<const std::vector<OcclusionRay>>;
using TimeChunk = std::shared_ptr<const std::vector<float>>;

struct SegmentBlock {
  ColumnSet columns = kAllColumns;
  std::vector<SegmentChunk> chunks;
  std::size_t size() const {
    std::size_t n = 0;
    for (const auto& c : chunks) n += c->size();
    return n;
  }
};
struct OcclusionBlock {
  std::vector<RayChunk> chunks;
  std::vector<TimeChunk> times;  // of the rays, chunk by chunk; empty in jobs where nothing moves
  bool nearest = false;  // the nearest hits are asked for, not only whether there are any
  std::size_t size() const {
    std::size_t n = 0;
    for (const auto& c : chunks) n += c->size();
    return n;
  }
};

// "Do this for me." A renderer task comes from the manager; blocks come from workers.
struct SubmitTask {
  TaskUuid id;
  std::uint32_t epoch = 0;  // of the sender's scene-host map
  std::uint32_t generation = 0;
  std::variant<RendererRange, SegmentBlock, OcclusionBlock> payload;
};

struct TracerReply {
  std::vector<std::uint64_t> accepted;  // bit i: segment i of the block now belongs to the replier
  std::vector<std::uint64_t> tested;    // the new mask of every segment not accepted, in order
  std::vector<std::uint16_t> windows;   // and its new window; empty: all 0
  std::uint32_t count = 0;              // segments of the block
};
struct OcclusionReply {
  std::vector<std::uint64_t> blocked;  // bit i: ray i
  std::uint32_t count = 0;
};
struct NearestReply {
  std::vector<std::uint64_t> found;  // bit i: ray i hits something
  std::vector<AnsweredHit> hits;     // of these, in order
  std::uint32_t count = 0;
};
struct RendererReply {
  std::uint32_t task = 0;
  std::vector<PixelSums> sums;             // row by row over the task's tile; with negative lobes two of each pixel
  std::uint64_t invalid = 0, clamped = 0;  // samples
  std::vector<PixelFeatures> features{};   // row by row, in jobs with features
  bool negative_lobes = false;             // of the pixel filter
  std::vector<Splat> splats{};             // in jobs with light paths: by pixel, each once
};
struct Refusal {};  // "not a holder at your epoch": nothing was done

struct Reply {
  TaskUuid id;
  std::uint32_t epoch = 0;  // of the replier
  std::variant<Refusal, TracerReply, OcclusionReply, RendererReply, NearestReply> payload;
};

// Ends of paths, to the owner of their renderer tasks. Not answered.
struct PathEnds {
  std::uint32_t generation = 0;
  EndBatch batch;
};

using Message =
    std::variant<Challenge, Proof, Hello, Welcome, Refused, PeerHello, HostList, SceneHostMap,
                 JobStart, JobEnd, CancelJob, LoadParts, UnloadParts, LoadReport, BlobRequest,
                 BlobChunk, SubmitTask, Reply, PathEnds, Status, Leave, Error, CancelTask,
                 PoolWelcome, PoolOrders, PoolStatus>;

// For log lines: "SubmitTask".
const char* message_name(const Message& m);

}  // namespace cloudrenderer::wire

template <>
struct std::hash<cloudrenderer::wire::TaskUuid> {
  std::size_t operator()(const cloudrenderer::wire::TaskUuid& id) const noexcept {
    return static_cast<std::size_t>((id.origin ^ (id.number * 0x9e3779b97f4a7c15u)));
  }
};
