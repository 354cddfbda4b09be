#pragma once
// How many hosts of which kind would help now, why, and which may go. Values: no socket, clock or thread.
#include <cstdint>
#include <deque>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace cloudrenderer {

// A kind of machine that can be had.
struct HostKind {
  std::string name;
  double price = 0;            // an hour
  std::uint32_t threads = 1;
  std::uint64_t memory = 0;    // bytes for parts; 0: not known, and taken to be enough
  double speed = 1;            // of a thread, against those that the jobs' work was measured on
  std::uint32_t least = 0, most = std::numeric_limits<std::uint32_t>::max();
  double capacity() const { return threads * speed > 1e-9 ? threads * speed : 1e-9; }
};

// A host that is there and does not leave.
struct ElasticHost {
  std::uint64_t id = 0;
  std::string kind;
  std::uint32_t threads = 1;
  std::uint64_t memory = 0;
  // What its leaving costs: parts that no other host holds, frames that it works for, bytes that are loaded.
  std::uint64_t lone_parts = 0, frames = 0, loaded = 0;
};

// What is left of a job.
struct ElasticJob {
  std::uint64_t id = 0;
  double work = 0;        // processor seconds of a thread of speed 1
  bool measured = false;  // the work is; else estimated
  double weight = 1;      // its part of the processors, against the others'
  double most_threads = std::numeric_limits<double>::infinity();  // that find something to do at once
  std::optional<double> deadline;  // Unix time
  std::optional<double> money;     // left of its budget
  std::uint64_t least_memory = 0;  // without which a host is of no use to it
  std::uint64_t main_bytes = 0, bytes = 0;  // on every host; of all parts together with that
  double memory_part = 1;                   // of a host's memory that it gets
  bool fits(std::uint64_t memory) const { return memory == 0 || least_memory <= memory; }
};

struct ElasticLimits {
  std::uint32_t least = 0, most = 100;
  double start_s = 60;   // from asking for a host until it helps
  double worth_s = 240;  // a new host is asked for only if there is so much to do for each
  double idle_s = 300;   // a host is let go only when so long fewer have been wanted
  std::uint32_t jobs_at_once = 4;
};

struct HostsWanted {
  struct Kind {
    std::string name;
    std::uint32_t wanted = 0, there = 0;
    double price = 0;
  };
  struct Reason {
    std::optional<std::uint64_t> job;
    std::string text;
  };
  struct Forecast {
    std::uint64_t job = 0;
    double work = 0;
    bool measured = false;
    std::optional<double> deadline;
    // Unix time of the end with the hosts that are there, and with those that are wanted; none: never.
    std::optional<double> ends, ends_then;
  };
  std::vector<Kind> kinds;  // by name
  std::vector<Reason> reasons;
  std::vector<Forecast> jobs;
  std::vector<std::uint64_t> surplus;  // hosts that may be ended, first those whose leaving costs least
  std::uint32_t wanted() const;
  std::uint32_t there() const;
};

// Hosts of one kind in a forecast, which begin to help after so many seconds.
struct HostGroup {
  double capacity = 0;  // of all
  std::uint64_t memory = 0;
  double from_s = 0;
};
// When jobs end, seconds from now, infinite: never. The first `at_once` that are not done share the processors by their
// weights; nobody gets more than has use for it.
std::vector<double> forecast(const std::vector<ElasticJob>& jobs, const std::vector<HostGroup>& groups, std::uint32_t at_once);

// What would help at this moment, without regard to what was wanted before. `jobs` in the order in which they are served.
// `surplus`: all hosts that are there and not wanted.
//  * A job needs one host that can hold its main scene and its largest part, and together the room for all parts.
//  * Without a deadline: every host that is there helps as long as its threads find work; new ones while each has worth_s
//    to do, so that its start does not cost more than it brings.
//  * With one: as few as make it in nine tenths of the time that is left.
//  * A budget buys processor time; work that it does not pay for asks for no hosts.
HostsWanted hosts_wanted(const std::vector<ElasticJob>& jobs, const std::vector<HostKind>& kinds, const std::vector<ElasticHost>& hosts,
                         const ElasticLimits& limits, double now);

// Lets hosts go only when fewer have been wanted for idle_s, so that numbers do not swing.
class SteadyHosts {
 public:
  explicit SteadyHosts(const ElasticLimits& limits) : limits_(limits) {}
  // The same with what is kept, and surplus hosts of kinds only of which there are more than wanted.
  HostsWanted settle(HostsWanted wanted, const std::vector<ElasticHost>& hosts, double now);

 private:
  struct Said {
    double at = 0;
    std::uint32_t wanted = 0;
  };
  const ElasticLimits limits_;
  std::optional<double> began_;
  std::map<std::string, std::deque<Said>> said_;  // by kind; the wanted fall, the first is the most of the last idle_s
};

}  // namespace cloudrenderer
