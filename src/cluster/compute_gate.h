#pragma once
// Who computes next where one process works for many jobs: shares of processor time by weight.
#include <condition_variable>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>

namespace cloudrenderer {

// Stride scheduling (Waldspurger and Weihl 1995) by measured processor time. Every job has a pass,
// the seconds that it has used divided by its weight; a free slot goes to the waiting job with the
// smallest. No slot stays free while somebody waits. Who was idle takes up the pass of the others:
// nothing is saved up, but for a short wait between two batches. A value: no threads, no clock.
class GateCore {
 public:
  using Job = std::uint64_t;
  explicit GateCore(unsigned slots) : slots_(slots) {}

  Job add(double weight);
  void set_weight(Job job, double weight);
  void remove(Job job);  // when none of its threads waits or runs
  void want(Job job);    // one of its threads waits for a slot
  // A slot is given away to a waiting thread of this job; none: nobody waits, or no slot is free.
  std::optional<Job> next();
  void done(Job job, double cpu_s);    // a slot is free again; what was computed meanwhile
  void charge(Job job, double cpu_s);  // used without a slot

 private:
  struct State {
    double weight = 1, pass = 0;
    double turn_s = 0;  // what a turn takes, lately; foreseen for those that run
    unsigned waiting = 0, running = 0;
    double foreseen() const { return pass + running * turn_s / weight; }
  };
  const unsigned slots_;
  unsigned busy_ = 0;
  Job last_ = 0;
  double now_ = 0;  // the pass of those that get slots
  std::map<Job, State> jobs_;
};

// The gate itself, for the threads of all jobs. Any thread.
class ComputeGate {
 public:
  using Job = GateCore::Job;
  explicit ComputeGate(unsigned slots) : core_(slots) {}
  Job add(double weight);
  void set_weight(Job job, double weight);
  void remove(Job job);
  void charge(Job job, double cpu_s);

  // What one thread holds to compute; its processor time is counted from take() to give_back().
  class Slot {
   public:
    Slot() = default;  // of no gate: every call does nothing
    Slot(ComputeGate& gate, Job job) : gate_(&gate), job_(job) {}
    ~Slot() { give_back(); }
    Slot(const Slot&) = delete;
    Slot& operator=(const Slot&) = delete;
    void take();  // waits; who has one offers it to those whose turn it is
    void give_back();

   private:
    ComputeGate* gate_ = nullptr;
    Job job_ = 0;
    bool held_ = false;
    double since_ = 0;
  };

 private:
  struct Waiting {
    unsigned granted = 0;
    std::condition_variable turn;
  };
  void hand_out();  // with the mutex

  std::mutex mutex_;
  GateCore core_;
  std::map<Job, Waiting> waiting_;
};

}  // namespace cloudrenderer
