#pragma once
// Hosts that work for many jobs at once, as their service sees them: who is there, what each is to
// work for, what each has used. A value: no socket, no clock.
#include <compare>
#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "base/error.h"
#include "net/address.h"
#include "wire/messages.h"

namespace cloudrenderer {

// One frame that hosts are to work for. (job, manager) names it: another manager is another frame,
// which the hosts join anew; the usage is summed by job.
struct PoolOrder {
  std::string job;           // 1 to 128 characters, no control characters
  Address manager;           // as hosts reach it
  double weight = 1;         // a host's processors are shared by it
  std::uint64_t memory = 0;  // bytes a host; 0: all that the host has. A host's real use never
                             // exceeds its own budget, whatever is promised here
  friend bool operator==(const PoolOrder&, const PoolOrder&) = default;
};

// What a job has used at one host, or in sum.
struct PoolUsage {
  double cpu_s = 0, memory_byte_s = 0, host_s = 0;
  std::uint64_t bytes_sent = 0, bytes_received = 0, batches = 0;
  std::uint64_t loaded_bytes = 0, shared_bytes = 0;  // of parts: loaded for it, or there already
  std::uint64_t memory_used = 0;                     // now
  bool working = false;                              // now
  void add(const PoolUsage& other);
  friend bool operator==(const PoolUsage&, const PoolUsage&) = default;
};

struct PoolHost {
  std::uint64_t incarnation = 0;
  std::string name, kind;
  unsigned threads = 0;
  std::uint64_t memory = 0, memory_used = 0, memory_peak = 0;
  double joined_s = 0;
  std::optional<double> left_s;
  bool leaving = false;  // asked to leave: it ends what it does, and takes no orders
  double cpu_s = 0;      // of the whole process since it is in a pool
  std::uint64_t words = 0;  // that it has said of its use: where they are as many as before, nothing has changed
  std::map<std::string, PoolUsage> jobs;
};

class PoolCore {
 public:
  struct Options {
    std::uint64_t incarnation = 1;
    double heartbeat_s = 1;
    double lost_after_s = 3;
    std::uint64_t fingerprint = 0;  // of those that may join
    bool allow_inexact = false;     // others may, too
  };
  explicit PoolCore(const Options& options) : options_(options) {}

  // A host says Hello, for the first time or again. PoolWelcome, and the orders, are in the outbox
  // then. A failure is to be told to it.
  Result<std::uint64_t> join(const wire::Hello& hello, double now);  // its incarnation
  void receive(std::uint64_t from, const wire::Message& message, double now);
  void connection_ended(std::uint64_t host, double now);  // it is lost when it does not come back
  // Every host's orders from now on, those of hosts to come too; forgets all single ones.
  void order(std::vector<PoolOrder> orders);
  // One host's, until it leaves.
  void order(std::uint64_t host, std::vector<PoolOrder> orders);
  void tick(double now);
  double deadline() const;

  using Outbox = std::vector<std::pair<std::uint64_t, wire::Message>>;
  Outbox take_outbox() { return std::exchange(outbox_, {}); }
  // Hosts that have left since: their connections may be closed.
  std::vector<std::uint64_t> take_gone() { return std::exchange(gone_, {}); }

  // Those that have left stay here for a while (the last 1024 of them).
  const std::map<std::uint64_t, PoolHost>& hosts() const { return hosts_; }
  // By job, over all hosts that ever were.
  std::map<std::string, PoolUsage> usage() const;

 private:
  struct Presence {  // of a host that has not left
    double heard = 0;
    bool connected = true;
    std::optional<std::vector<PoolOrder>> orders;  // its own
  };
  void send_orders(std::uint64_t host, const Presence& presence);
  void leave(std::uint64_t host, double now);
  void take_usage(PoolHost& host, const wire::PoolStatus& status);
  void forget_oldest();

  const Options options_;
  std::vector<PoolOrder> orders_;
  std::set<std::string> ordered_;  // ever: what hosts may speak of
  double ticked_ = 0;
  std::map<std::uint64_t, PoolHost> hosts_;
  std::map<std::uint64_t, Presence> present_;
  std::vector<std::uint64_t> left_;           // oldest first
  std::map<std::string, PoolUsage> past_;     // of hosts that are forgotten
  Outbox outbox_;
  std::vector<std::uint64_t> gone_;
};

}  // namespace cloudrenderer
