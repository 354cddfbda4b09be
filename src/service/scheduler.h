#pragma once
// Which frame is split, started or stopped when. A value: no socket, clock, thread or process.
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "base/error.h"
#include "service/fair_shares.h"
#include "service/job.h"

namespace cloudrenderer {

// What a user may do, and what is the user's part of the hosts.
struct UserLimits {
  double share = 1;
  int priority_limit = 0;          // the highest that jobs may have
  std::optional<double> budget;    // money, over all jobs
  std::uint32_t jobs = 1000;       // that have not ended
};

// What is kept of a user beside the jobs that are known.
struct UserAccount {
  Usage past;              // of jobs that were removed
  double used_lately = 0;  // processor seconds, halved with every half-life, as they were
  double at = 0;           // then
};

// How a child process that worked on a frame has ended.
struct FrameEnd {
  enum class How : std::uint8_t {
    done,
    interrupted,  // as asked, with a checkpoint
    failed,       // may go well next time
    hopeless,     // will not: the scene is wrong
  };
  How how = How::failed;
  std::string reason;
};

class Scheduler {
 public:
  struct Options {
    std::uint32_t slots = 4;   // frames that run at once; each gets this part of every host's memory (or several)
    std::uint32_t splits = 1;  // at once
    double retry_after_s = 2;  // doubles with every attempt
    double patience_s = 30;    // a user without a running frame waits so long for a slot that others have beyond theirs
    double half_life_s = 3600; // of what users have used, in the choice of who is next
  };
  static constexpr int kLowestPriority = -10, kHighestPriority = 10;

  explicit Scheduler(const Options& options) : options_(options) {}

  void set_users(std::map<std::string, UserLimits> users) { users_ = std::move(users); }
  // Memory of the hosts that are there, bytes.
  void set_hosts(std::vector<std::uint64_t> memory) { hosts_ = std::move(memory); }
  // Memory of the largest host that can be asked for: what fits there waits for it.
  void set_largest_to_come(std::uint64_t memory) { largest_to_come_ = memory; }
  // A job from an earlier life of the service: what ran goes on from its checkpoint.
  void restore(Job job);
  void restore(std::map<std::string, UserAccount> accounts, std::uint64_t next_id);
  const std::map<std::string, UserAccount>& accounts() const { return accounts_; }
  std::uint64_t next_id() const { return next_id_; }  // no number is given to two jobs, whatever is removed

  bool has_ended(std::uint64_t job) const;  // and no process is at work for it
  void remove(std::uint64_t job);           // that has ended; what was used stays its user's

  Result<std::uint64_t> submit(JobRequest request, double now);
  bool cancel(std::uint64_t job, double now);  // false: it has ended already
  // What is wrong with this priority for this user, if anything.
  std::optional<std::string> refuse_priority(int priority, const std::string& user) const;
  // Of a job that has not ended, as far as `user` may have it; else what is wrong with that.
  std::optional<std::string> set_priority(std::uint64_t job, int priority, const std::string& user);
  // Goes on with a job that was stopped by a budget; false: that is not so.
  bool resume(std::uint64_t job, std::optional<double> budget);
  void split_ended(FrameRef frame, const FrameEnd& end, const FrameNeeds& needs, double now);
  void frame_ended(FrameRef frame, const FrameEnd& end, double now);
  // What a running frame has used since the last call; counts for the user's turn and budgets.
  void used(FrameRef frame, const Usage& usage);
  void tick(double now);

  struct Action {
    enum class What : std::uint8_t { split, start, stop, kill };  // stop: keep a checkpoint
    What what;
    FrameRef frame;
    friend bool operator==(const Action&, const Action&) = default;
  };
  std::vector<Action> take_actions() { return std::exchange(actions_, {}); }
  std::set<std::uint64_t> take_changed() { return std::exchange(changed_, {}); }  // jobs to be kept

  // Of the frames that run, or of those of them that hosts may work for already: the part of the processors, and of a
  // host's memory (of 1). A user's part goes to those that are asked for, not to the ones that are only about to begin.
  struct Portion {
    double weight = 1, memory = 1;
    std::uint64_t least_memory = 0;
  };
  std::map<FrameRef, Portion> portions(const std::set<FrameRef>* at_work = nullptr) const;

  const std::map<std::uint64_t, Job>& jobs() const { return jobs_; }
  const Job* find(std::uint64_t id) const;
  std::map<std::string, Usage> usage() const;  // by user, all jobs that are known

 private:
  enum class Stop : std::uint8_t { no, cancel, timeout, make_room, budget };
  struct Run {
    std::uint32_t slots = 1;
    Stop stop = Stop::no;
    bool told = false;  // the action is out
  };
  JobFrame& frame_at(FrameRef ref) { return jobs_.at(ref.job).frames.at(ref.frame); }
  const UserLimits& limits(const std::string& user) const;
  std::uint64_t largest_host() const;
  std::uint32_t slots_for(const JobFrame& frame) const;
  std::uint32_t slots_taken(const std::string* user = nullptr) const;
  std::uint32_t running_of(std::uint64_t job) const;
  double turn(const std::string& user, double now) const;
  std::optional<FrameRef> next_frame(const Job& job, FrameState state, double now) const;
  std::vector<std::uint64_t> queue(double now) const;
  void stop(FrameRef ref, Stop why);
  void start_splits(double now);
  void start_frames(double now);
  void make_room(double now);
  void look_at_budgets(double now);
  void age_accounts(double now);
  std::map<std::string, double> parts() const;
  void end_job(Job& job, double now);
  void fail_job(Job& job, const std::string& reason, double now);
  void update(Job& job, double now);

  const Options options_;
  std::map<std::string, UserLimits> users_;
  std::vector<std::uint64_t> hosts_;
  std::uint64_t largest_to_come_ = 0;
  std::map<std::uint64_t, Job> jobs_;
  std::map<FrameRef, Run> running_;
  std::set<FrameRef> splitting_;
  std::map<std::string, UserAccount> accounts_;
  std::map<std::uint64_t, std::string> removed_;     // whose they were
  std::map<std::string, double> waits_since_;        // for a frame to run
  FairShares fair_;
  std::vector<Action> actions_;
  std::set<std::uint64_t> changed_;
  std::uint64_t next_id_ = 1;
};

}  // namespace cloudrenderer
