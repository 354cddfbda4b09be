#pragma once
// What the jobs of one process use. Any thread.
#include <time.h>

#include <atomic>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <string>

namespace cloudrenderer {

class Meter {
 public:
  struct Account {
    std::atomic<std::uint64_t> bytes_sent{0}, bytes_received{0}, batches{0};
    std::atomic<std::uint64_t> loaded_bytes{0}, shared_bytes{0};
    // With the meter's mutex: of threads that have ended, and of libraries.
    double finished_cpu_s = 0, libraries_cpu_s = 0;
  };

  // The calling thread works for the account while this lives; for null, for the process itself.
  class Thread {
   public:
    Thread(Meter& meter, Account* account);
    ~Thread();
    Thread(const Thread&) = delete;
    Thread& operator=(const Thread&) = delete;

   private:
    Meter& meter_;
  };

  // Embree and OpenImageIO compute on threads of their own while a scene is loaded. What the process
  // uses beyond all known threads is shared by those that load at the time.
  class Loading {
   public:
    Loading(Meter& meter, Account& account);
    ~Loading();
    Loading(const Loading&) = delete;
    Loading& operator=(const Loading&) = delete;

   private:
    Meter& meter_;
    Account& account_;
  };

  double cpu_s(const Account& account) const;
  // What the process has used for nobody's account: its own bookkeeping, and libraries while nobody loads.
  double unaccounted_cpu_s();
  // Of libraries for the account so far, and of the calling thread.
  double loading_cpu_s(const Account& account) const;

 private:
  struct Known {
    Account* account = nullptr;
    clockid_t clock{};
    double since = 0;
  };
  void share_libraries_time();  // with the mutex
  double known_cpu_s() const;   // likewise

  mutable std::mutex mutex_;
  std::map<const Thread*, Known> threads_;
  std::multiset<Account*> loading_;
  double accounted_cpu_s_ = 0;  // of threads of accounts that have ended, and of libraries for accounts
  double finished_cpu_s_ = 0;  // of all threads that have ended, and what was shared out
  double others_cpu_s_ = 0;    // of unknown threads, when it was last looked at
};

}  // namespace cloudrenderer
