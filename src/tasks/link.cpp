#include "tasks/link.h"

#include <algorithm>
#include <utility>

namespace cloudrenderer {
namespace {

constexpr double kNever = std::numeric_limits<double>::infinity();
constexpr double kMaxBackoff = 32;

}  // namespace

void Link::send(wire::Bytes payload) { unsent_.push_back(std::move(payload)); }

wire::LinkHeader Link::header(std::uint32_t sequence) {
  wire::LinkHeader h{own_, sequence, received_, 0};
  for (const auto& [early, payload] : early_) {
    if (early < received_ + 2) continue;
    const std::uint32_t bit = early - received_ - 2;
    if (bit >= 32) break;
    h.window |= 1u << bit;
  }
  // Every frame acknowledges, so nothing is left to report.
  ack_due_ = kNever;
  unreported_frames_ = 0;
  unreported_bytes_ = 0;
  return h;
}

void Link::receive(const wire::LinkHeader& link, wire::Bytes payload, double now,
                   std::vector<wire::Bytes>& delivered) {
  if (link.incarnation != peer_) {
    ++counters_.refused;
    return;
  }
  if (link.ack < next_sequence_) {  // else the peer acknowledges what was never sent: ignored
    while (!unacknowledged_.empty() && unacknowledged_.front().sequence <= link.ack)
      unacknowledged_.pop_front();
    for (Sent& s : unacknowledged_) {
      const std::uint32_t ahead =
          s.sequence - link.ack;  // the acknowledgement may be older than the front
      if (ahead < 2 || ahead - 2 >= 32) continue;
      if (link.window >> (ahead - 2) & 1u) s.arrived = true;
    }
  }
  if (link.sequence == 0 || !payload) return;
  ack_due_ = std::min(ack_due_, now + options_.ack_delay);
  if (link.sequence <= received_ || early_.contains(link.sequence)) {
    ++counters_.duplicates;
    ack_due_ = now;  // the acknowledgement must have been lost
    return;
  }
  if (link.sequence - received_ > options_.window) return;  // comes again
  ++unreported_frames_;
  unreported_bytes_ += payload->size();
  if (unreported_frames_ >= options_.ack_frames || unreported_bytes_ >= options_.ack_bytes)
    ack_due_ = now;
  early_.emplace(link.sequence, std::move(payload));
  while (!early_.empty() && early_.begin()->first == received_ + 1) {
    delivered.push_back(std::move(early_.begin()->second));
    early_.erase(early_.begin());
    ++received_;
    ++counters_.delivered;
  }
}

std::optional<Link::Frame> Link::next(double now) {
  if (resend_ || options_.retransmit_after < kNever) {
    for (Sent& s : unacknowledged_) {
      if (s.arrived || (!s.again && s.due > now)) continue;
      if (!s.again) s.wait = std::min(s.wait * 2, options_.retransmit_after * kMaxBackoff);
      s.again = false;
      s.due = now + s.wait;
      ++counters_.retransmitted;
      return Frame{header(s.sequence), s.payload};
    }
    resend_ = false;
  }
  if (!unsent_.empty() && unacknowledged_.size() < options_.window) {
    Sent s{next_sequence_++, std::move(unsent_.front()), now + options_.retransmit_after,
           options_.retransmit_after};
    unsent_.pop_front();
    unacknowledged_.push_back(s);
    ++counters_.sent;
    return Frame{header(s.sequence), std::move(s.payload)};
  }
  if (ack_due_ <= now) return Frame{header(0), nullptr};
  return std::nullopt;
}

double Link::deadline() const {
  double t = ack_due_;
  for (const Sent& s : unacknowledged_)
    if (!s.arrived) t = std::min(t, s.due);
  return t;
}

void Link::reconnected() {
  for (Sent& s : unacknowledged_) {
    s.again = true;
    s.arrived = false;  // frames above the cumulative number may have been kept only on the way
  }
  resend_ = !unacknowledged_.empty();
}

}  // namespace cloudrenderer
