#pragma once
#include <algorithm>
#include <cstdint>
#include <functional>
#include <utility>
#include <vector>

namespace cloudrenderer::sim {

// What happens in virtual time: events at the same time in the order in which they were made.
class EventQueue {
 public:
  void at(double time, std::function<void()> what) {
    events_.push_back({time, next_order_++, std::move(what)});
    std::push_heap(events_.begin(), events_.end());
  }
  bool empty() const { return events_.empty(); }
  double now() const { return now_; }
  std::uint64_t done() const { return done_; }
  void step() {
    std::pop_heap(events_.begin(), events_.end());
    Event e = std::move(events_.back());
    events_.pop_back();
    now_ = std::max(now_, e.at);
    ++done_;
    e.what();
  }

 private:
  struct Event {
    double at;
    std::uint64_t order;
    std::function<void()> what;
    bool operator<(const Event& o) const { return at != o.at ? at > o.at : order > o.order; }
  };
  std::vector<Event> events_;  // a heap
  std::uint64_t next_order_ = 0, done_ = 0;
  double now_ = 0;
};

}  // namespace cloudrenderer::sim
