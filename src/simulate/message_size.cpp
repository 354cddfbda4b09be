#include "simulate/message_size.h"

#include <algorithm>
#include <cmath>

#include "wire/codec.h"

namespace cloudrenderer::sim {
namespace {

constexpr std::size_t kRadianceBytes = 5;     // of a channel, as a rule
constexpr std::uint64_t kEndBytes = 31, kRayBytes = 28, kMissBytes = 8;
constexpr std::uint64_t kControlBytes = wire::kFrameHeaderBytes + wire::kPayloadHeaderBytes + 30;

}  // namespace

MessageSize size_of(const wire::Message& m, double weight, double per_batch, std::size_t peers) {
  const double w = weight, full = 640, hosts = static_cast<double>(std::max<std::size_t>(1, peers));
  const auto reached = [&](double segments) { return hosts * -std::expm1(-segments / hosts); };
  const double more = reached(std::max(1e-3, per_batch) * w) / reached(std::max(1e-3, per_batch));
  const auto blocks = [&](double items, double most) { return std::max(more, items * w / most); };
  MessageSize s;
  if (const auto* submit = std::get_if<wire::SubmitTask>(&m)) {
    if (const auto* b = std::get_if<wire::SegmentBlock>(&submit->payload)) {
      const auto items = static_cast<double>(b->size());
      s.messages = blocks(items, full);
      s.bytes = items * w * static_cast<double>(wire::segment_bytes(b->columns, kRadianceBytes));
      s.moves = items * w;
    } else if (const auto* o = std::get_if<wire::OcclusionBlock>(&submit->payload)) {
      const auto items = static_cast<double>(o->size());
      s.messages = blocks(items, 4 * full);
      s.bytes = items * w * kRayBytes;
      s.moves = items * w;
    }
  } else if (const auto* reply = std::get_if<wire::Reply>(&m)) {
    if (const auto* t = std::get_if<wire::TracerReply>(&reply->payload)) {
      s.messages = blocks(t->count, full);
      s.bytes = w * (t->count / 8.0 + static_cast<double>(t->tested.size() * kMissBytes));
    } else if (const auto* o = std::get_if<wire::OcclusionReply>(&reply->payload)) {
      s.messages = blocks(o->count, 4 * full);
      s.bytes = w * o->count / 8.0;
    }
  } else if (const auto* ends = std::get_if<wire::PathEnds>(&m)) {
    const auto items = static_cast<double>(ends->batch.size());
    s.messages = blocks(items, 2 * full);
    s.bytes = items * w * kEndBytes;
  }
  s.bytes += s.messages * kControlBytes;
  return s;
}

std::uint64_t reply_sums(const std::vector<std::byte>& payload) {
  const auto m = wire::decode(payload);
  const auto* r = m ? std::get_if<wire::Reply>(&*m) : nullptr;
  const auto* renderer = r ? std::get_if<wire::RendererReply>(&r->payload) : nullptr;
  return renderer ? renderer->sums.size() : 0;
}

}  // namespace cloudrenderer::sim
