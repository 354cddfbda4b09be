#pragma once
// Exactly-once, in-order delivery between two hosts over anything that may lose, double, delay or
// reorder frames, or that breaks and is made again (TCP). A value: no socket, no clock. One Link
// per peer, for as long as the peer has its host number; not thread-safe.
#include <cstdint>
#include <deque>
#include <limits>
#include <map>
#include <optional>
#include <vector>

#include "wire/codec.h"

namespace cloudrenderer {

struct LinkOptions {
  // Seconds until an unacknowledged frame is sent again; doubled each time up to 32 times. Infinity
  // (the default) suits TCP, where only reconnected() sends again.
  double retransmit_after = std::numeric_limits<double>::infinity();
  double ack_delay = 0.02;  // a plain acknowledgement is sent at the latest after this time ...
  std::uint32_t ack_frames = 16;                 // ... or this many frames ...
  std::size_t ack_bytes = std::size_t{1} << 20;  // ... or bytes
  std::uint32_t window =
      256;  // frames on the way at most; frames further ahead than this are not kept
};

class Link {
 public:
  // Low halves of the incarnations; frames of another incarnation are refused.
  Link(std::uint32_t own_incarnation, std::uint32_t peer_incarnation, LinkOptions options = {})
      : options_(options), own_(own_incarnation), peer_(peer_incarnation) {}

  struct Frame {
    wire::LinkHeader link;
    wire::Bytes payload;  // null: acknowledgement only
  };

  // Queues a payload.
  void send(wire::Bytes payload);
  // A frame that arrived. Payloads that are now in order are appended to `delivered`.
  void receive(const wire::LinkHeader& link, wire::Bytes payload, double now,
               std::vector<wire::Bytes>& delivered);
  // The next frame to put on the wire at this time, or none. Call until it is empty.
  std::optional<Frame> next(double now);
  // When next() may have something again without a call in between (infinity: not before one).
  double deadline() const;
  // The connection was made again: everything unacknowledged is sent once more.
  void reconnected();
  // All that was sent has been acknowledged.
  bool drained() const { return unsent_.empty() && unacknowledged_.empty(); }
  std::size_t queued() const { return unsent_.size() + unacknowledged_.size(); }

  struct Counters {
    std::uint64_t sent = 0, retransmitted = 0, delivered = 0, duplicates = 0, refused = 0;
  };
  const Counters& counters() const { return counters_; }

 private:
  struct Sent {
    std::uint32_t sequence;
    wire::Bytes payload;
    double due;  // when it is sent again
    double wait;
    bool arrived = false;  // acknowledged above the cumulative number
    bool again = false;    // send now
  };
  wire::LinkHeader header(std::uint32_t sequence);

  LinkOptions options_;
  std::uint32_t own_, peer_;
  std::uint32_t next_sequence_ = 1;
  std::deque<wire::Bytes> unsent_;
  std::deque<Sent> unacknowledged_;             // consecutive sequences
  bool resend_ = false;                         // some of them have `again` set
  std::uint32_t received_ = 0;                  // cumulative
  std::map<std::uint32_t, wire::Bytes> early_;  // above received_ + 1
  double ack_due_ = std::numeric_limits<double>::infinity();
  std::uint32_t unreported_frames_ = 0;
  std::size_t unreported_bytes_ = 0;
  Counters counters_;
};

}  // namespace cloudrenderer
