#pragma once
#include <sys/types.h>

#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>

#include "net/tls.h"
#include "service/elastic.h"
#include "service/frame_hosts.h"
#include "service/frame_progress.h"
#include "service/keep_rules.h"
#include "service/port_range.h"
#include "service/prices.h"
#include "service/scene_files.h"
#include "service/scheduler.h"
#include "service/store.h"
#include "service/trash.h"
#include "service/users.h"
#include "web/metric_families.h"

namespace cloudrenderer {

struct ServiceConfig {
  std::string folder;   // all that the service keeps
  Address managers;     // where frames' managers listen; each takes a free port
  std::optional<PortRange> manager_ports;  // or one of these
  std::string managers_host;  // how workers reach it
  std::string token;    // of the cluster: for the managers
  TlsOptions tls;
  bool allow_inexact = false;
  Scheduler::Options scheduler;
  ElasticLimits elastic;
  std::uint64_t child_memory = std::uint64_t{4} << 30;  // of a process that splits, or manages a frame
  std::uint64_t child_disk = std::uint64_t{1} << 40;    // of a file that it writes
  double split_timeout_s = 3600;
  std::uint64_t user_bytes = std::uint64_t{100} << 30;  // that one user may have uploaded
  KeepRules rules;
};

// Where a picture of a frame is: at the window of its manager while it runs, or in its folder.
struct FrameView {
  std::string window;  // its URL, or
  std::string folder;  // with picture.exr, of a frame that is done or was stopped
};

// What somebody who looks on has been told: versions of jobs.
struct WatchedJobs {
  std::map<std::uint64_t, std::uint64_t> versions;
};

// Jobs of users, rendered by children of this process on the hosts of a pool. step() belongs to one thread, on which
// children are started (they end with it); everything else may be called by any, and throws ApiError.
class Service {
 public:
  // Makes the hosts for the service of this name, which no other has.
  using MakeHosts = std::function<std::unique_ptr<FrameHosts>(const std::string& service)>;
  // Goes on with what the folder holds. Throws UsageError: another service is at it.
  Service(ServiceConfig config, Users users, std::optional<PriceTable> prices, const MakeHosts& hosts);
  ~Service();  // children are asked for a checkpoint
  Service(const Service&) = delete;
  Service& operator=(const Service&) = delete;

  void step(double now);

  Users& users() { return users_; }
  BlobStore& blobs() { return blobs_; }

  Json blob(const Caller& caller, const std::string& sha256);
  void check_upload(const Caller& caller, std::uint64_t total);  // throws when the user has no room for it
  void blob_came(const Caller& caller, const std::string& sha256, std::uint64_t bytes);
  Json add_scene(const Caller& caller, const Json& body);
  Json scene(const Caller& caller, const std::string& id);
  Json scenes(const Caller& caller);

  Json submit(const Caller& caller, const Json& body);
  Json jobs(const Caller& caller);
  Json job(const Caller& caller, std::uint64_t id);
  Json cancel(const Caller& caller, std::uint64_t id);
  Json change(const Caller& caller, std::uint64_t id, const Json& body);  // its priority
  Json remove(const Caller& caller, std::uint64_t id);  // that has ended, with its files
  Json resume(const Caller& caller, std::uint64_t id, const Json& body);
  Json events(const Caller& caller, std::uint64_t id);

  // A file of a frame that is there, or nothing is. `name` is one of ours, never the caller's.
  std::string frame_file(const Caller& caller, std::uint64_t id, std::uint64_t frame, const std::string& name);
  std::string frame_log(const Caller& caller, std::uint64_t id, std::uint64_t frame);  // its last megabyte
  // The window of a frame that runs: its URL.
  std::string frame_window(const Caller& caller, std::uint64_t id, std::uint64_t frame);

  // Rows of jobs that have changed since, of about so many bytes, and the numbers of those that are gone.
  Json changed_jobs(const Caller& caller, WatchedJobs& seen, std::size_t bytes) const;
  FrameView frame_view(const Caller& caller, std::uint64_t id, std::uint64_t frame) const;

  Json hosts();
  Json hosts_wanted(const Caller& caller);  // with reasons of the caller's own jobs
  Json usage(const Caller& caller);
  std::string metrics(const Caller& caller);
  const std::string& token() const { return config_.token; }

 private:
  struct Child {
    pid_t pid = 0;
    bool splits = false;
    double started = 0;
    std::size_t log_offset = 0;  // where this attempt's log begins
    double counted_cpu_s = 0;
    std::uint16_t port = 0;  // that its manager was given; 0: it takes a free one
    std::optional<Address> manager;
    std::string window;
    bool asked = false;  // to end
    std::optional<double> killed_at;
  };
  const Job& job_of(const Caller& caller, std::uint64_t id) const;
  std::string frame_folder(FrameRef ref) const;
  std::string split_folder(const Job& job, const JobFrame& frame) const;
  Json watch_row(const Job& job) const;
  std::string shown(const std::string& text) const;  // without the names of our folders
  void act(const Scheduler::Action& action, double now);
  void start_split(FrameRef ref, double now);
  void start_frame(FrameRef ref, double now);
  void read_addresses(Child& child, FrameRef ref);
  void collect(double now);
  void split_ended(FrameRef ref, const Child& child, int status, double now);
  void frame_ended(FrameRef ref, const Child& child, int status, double now);
  void meter();
  void meter_children(double now);
  void meter_child(FrameRef ref, Child& child, double cpu_s);
  std::uint16_t choose_port() const;
  void tidy(double now);
  void tidy_scenes(double now);
  void tidy_splits(const std::set<std::string>& needed, double now);
  void remove_job(std::uint64_t id);
  void give_orders();
  void plan_hosts(double now);
  void look_at_frames();  // how far they are
  void add_wanted(Families& families) const;
  void keep(double now);
  void note(std::uint64_t job, const std::string& text, double now);

  const ServiceConfig config_;
  const int lock_;  // of the folder
  mutable std::mutex mutex_;
  Users users_;
  const std::optional<PriceTable> prices_;
  BlobStore blobs_;
  Store store_;
  Scheduler scheduler_;
  std::unique_ptr<FrameHosts> hosts_;
  std::map<std::uint64_t, ServiceHost> host_view_;  // for any thread
  std::map<FrameRef, Child> children_;
  Store::Meters metered_, newly_metered_;  // what has been counted; of it, what is not kept yet
  std::map<std::uint64_t, std::string> states_;                  // of jobs, when last noted
  std::set<std::uint64_t> dirty_;  // jobs that have changed since they were kept
  double users_read_ = 0, kept_ = 0, children_metered_ = 0;
  double tidied_ = 0, meters_tidied_ = 0;
  bool disk_is_full_ = false;
  SteadyHosts steady_hosts_;
  std::map<std::string, HostKind> seen_kinds_;
  HostsWanted hosts_wanted_;
  std::vector<ElasticHost> planned_hosts_;  // that hosts_wanted_ speaks of
  double planned_ = 0;
  std::map<std::uint64_t, std::uint64_t> versions_;  // of jobs that have changed in this life
  std::uint64_t version_ = 1;
  ProgressOf progress_;
  ProgressWatch watch_;
  Trash trash_;
};

}  // namespace cloudrenderer
