#pragma once
#include <cstddef>
#include <deque>
#include <memory>

#include "net/session.h"

namespace cloudrenderer {

// The accepted connections whose other end is not known yet. When there are too many the oldest
// makes room: who belongs here is known within a moment, so whoever has waited longest is the least
// likely to. (Turning the newcomer away instead, a stranger with enough silent connections would
// keep everybody out.) On the I/O thread.
class Strangers {
 public:
  explicit Strangers(std::size_t most) : most_(most) {}

  void add(const std::shared_ptr<Session>& session) {
    waiting_.push_back(session);
    if (waiting_.size() <= most_) return;
    const std::shared_ptr<Session> oldest = waiting_.front().lock();
    waiting_.pop_front();
    if (oldest) oldest->close("too many connections that have not introduced themselves");
  }
  // It has introduced itself, or ended.
  void remove(const std::shared_ptr<Session>& session) {
    std::erase_if(waiting_, [&](const auto& w) { return w.lock() == session; });
  }
  std::size_t size() const { return waiting_.size(); }

 private:
  const std::size_t most_;
  std::deque<std::weak_ptr<Session>> waiting_;
};

}  // namespace cloudrenderer
